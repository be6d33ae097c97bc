"""Rules and condensations of strangers explain themselves, and harm no explanation."""

from collections.abc import Iterable, Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from contactfusion import (
    Condensation,
    Contact,
    Contacts,
    Field,
    HypothesisCloud,
    Integrator,
    IntegratorConfig,
    Model,
    Pipeline,
    PipelineConfig,
    Reason,
    Rule,
    Step,
    Surface,
    explain_moment,
    hookimpl,
)
from contactfusion.contacts import NONE
from contactfusion.explain.explanation import Explanation, explanation_of
from contactfusion.explain.moment import Settings, moment_at
from contactfusion.explain.text import as_text
from contactfusion.hooks import GROUP
from contactfusion.integrator import kernels
from contactfusion.integrator.entries import Entries, Source
from contactfusion.integrator.rules import DeMorgan
from contactfusion.plugins import Plugins
from contactfusion.rule import Neighbourhood
from tests.clouds import HERE, NULL, SUPPORT, THERE, cloud
from tests.test_public_names import blocks
from tests.toys import FUSION, point

TWO = (cloud("lidar", 0.0, {HERE: 0.5}), cloud("skin", 0.0, {HERE: 0.75}))


class Mean(Rule):
    """The mean of what the sources gave."""

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The means."""
        given = entries.likelihoods[:, entries.counted]
        count = (~np.isnan(given)).sum(axis=1)
        return Field(entries, np.nansum(given, axis=1, dtype=np.float64) / np.maximum(count, 1))


class Told(Mean):
    """Explains itself."""

    def explain(self, field: Field, row: int) -> str:
        """The mean, in words."""
        given = field.given(row)
        return f"the mean of {' and '.join(given)} is {field.likelihoods[row]:.3f}"


class Mute(Mean):
    """Raises when it is to explain itself."""

    def explain(self, field: Field, row: int) -> str:
        """Nothing."""
        raise KeyError("no words")


class Number(Mean):
    """Explains itself by a number."""

    def explain(self, field: Field, row: int) -> Any:
        """A number."""
        return 42


class First(Condensation):
    """The first voxel over the threshold is the contact, with all that lie beside it."""

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Iterable[Contact]:
        """At most one contact."""
        rows = np.flatnonzero(verdicts == kernels.CONTACT)[:1]
        if not len(rows):
            return ()
        place, entries = self._centres(field)[rows[0]], field.entries
        likelihood = float(field.likelihoods[rows[0]])
        shares = {source.name: 1.0 / len(entries.sources) for source in entries.sources}
        flat = np.stack([place, place])
        spread = np.eye(3) * (self.tolerance / 6.0) ** 2
        point, force = np.zeros((3, 3)), np.full(3, np.nan)
        return [
            Contact(place, likelihood, point, spread, flat, force, 1, shares, 0.0, "base"),
        ]

    def _centres(self, field: Field) -> NDArray[np.float64]:
        return field.entries.grid.centres(field.entries.voxels)


class Blind(First):
    """Looks at no voxels: a contact at the place of the first entry."""

    looks_at_voxels = False

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Iterable[Contact]:
        """One contact."""
        assert not len(verdicts)
        return super().condense(field, np.full(len(field.entries.keys), kernels.CONTACT, np.uint8))


class Strict(First):
    """Knows its voxels, and explains itself."""

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Contacts:
        """The contact with the voxels along x."""
        contacts = tuple(super().condense(field, verdicts))
        along = field.entries.voxels[:, 1:].any(axis=1)
        owners = np.where(along | (not contacts), NONE, 0)
        return Contacts(contacts, lambda: owners)

    def explain(self, field: Field, around: Neighbourhood, contact: Contact | None) -> str:
        """That it is the first."""
        return f"the first of {int(around.inside.sum())} voxels" if contact else ""

    def objections(
        self, field: Field, verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """That it is not the first."""
        return [Reason("not_first", "another voxel comes first", values={"row": around.best})]


class Broken(First):
    """Raises wherever it is asked, and does not know its voxels."""

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Contacts:
        """A contact with owners of another field."""
        return Contacts(tuple(super().condense(field, verdicts)), lambda: np.zeros(99, np.intp))

    def explain(self, field: Field, around: Neighbourhood, contact: Contact | None) -> str:
        """Nothing."""
        raise ValueError("no contact words")

    def objections(
        self, field: Field, verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """Nothing."""
        raise ValueError("no objection")


PAGE = Path(__file__).parents[1] / "docs" / "plugins.md"


@hookimpl
def contactfusion_rules() -> dict[str, type[Rule]]:
    return {"told": Told}


def explained(
    rule: type[Rule] = DeMorgan,
    condensation: type[Condensation] | None = None,
    clouds: Sequence[HypothesisCloud] = TWO,
    at: Sequence[float] | None = None,
    threshold: float = 0.1,
) -> Explanation:
    """One step of some rule and condensation, explained."""
    config = IntegratorConfig(rule="de_morgan", threshold=threshold)
    integrator = Integrator(
        config,
        rule=rule(Model()),
        condensation=condensation(Model(), config.linking_distance) if condensation else None,
    )
    for one in clouds:
        integrator.receive(one)
    step = Step(0.0, integrator.step(0.0), None)
    return explanation_of(moment_at([step], 0.0, 0.01), Settings(config, {}), at)


def test_a_rule_that_says_nothing_lists_what_each_source_gave_and_its_share() -> None:
    (contact,) = explained(Mean).contacts
    assert contact.combination == "lidar and skin: 0.50 (share 40%), 0.75 (share 60%) fuse to 0.62"


def test_a_single_source_whose_likelihood_it_is_needs_no_words() -> None:
    (contact,) = explained(Mean, clouds=TWO[:1]).contacts
    assert contact.combination == ""


def test_a_rule_of_a_stranger_says_why_in_its_own_words() -> None:
    (contact,) = explained(Told).contacts
    assert contact.combination == "the mean of lidar and skin is 0.625"
    (place,) = explained(Told, threshold=0.9).places
    assert place.combination == "the mean of lidar and skin is 0.625"


def test_so_does_one_that_is_found_by_its_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [EntryPoint(name, f"tests.{name}", GROUP) for name in ("test_rule", "toys")]
    found = Plugins(points=[*points, *FUSION], strict=True)
    monkeypatch.setattr("contactfusion.assembly.installed_plugins", lambda: found)
    integrator: Any = {"rule": "told"}
    eyes = {"left": {"type": "echo", "sensor": "left"}, "right": {"type": "echo"}}
    pipeline = Pipeline(PipelineConfig(generators=eyes, integrator=integrator))
    text = explain_moment(pipeline, [point(0.0, 0.1, 0.0, 0.0, sensor="left")], 0.01)
    assert "  the mean of left and right is 0.900" in text.split("\n")


def test_the_rule_of_the_page_explains_itself() -> None:
    (code,) = [code for code in blocks(PAGE.read_text()) if "cf.Rule" in code]
    names: dict[str, Any] = {}
    exec(code, names)
    (rule,) = names["contactfusion_rules"]().values()
    (contact,) = explained(rule).contacts
    assert contact.combination == "the mean of lidar 0.50, skin 0.75 is 0.62"


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        (Mute, "the rule Mute raised KeyError: 'no words' (tests/test_rule.py, line "),
        (Number, "the rule Number raised TypeError: `explain` gave int, not a str (tests/"),
    ],
)
def test_a_rule_whose_explain_fails_is_named_and_the_rest_stands(
    rule: type[Rule], words: str
) -> None:
    failed, sound = as_text(explained(rule)).split("\n"), as_text(explained(Mean)).split("\n")
    assert words in failed[3]
    assert failed[:3] + failed[4:] == sound[:3] + sound[4:]


def test_a_condensation_of_a_stranger_explains_its_contacts_and_where_there_is_none() -> None:
    row = {(x, 0, 0): 0.5 for x in range(4)}
    clouds = [cloud("skin", 0.0, {**row, THERE: 0.5, (0, 9, 0): 0.5})]
    one = explained(condensation=Strict, clouds=clouds)
    (contact,) = one.contacts
    assert contact.combination == "the first of 5 voxels"
    assert [part.voxels for part in contact.said] == [5]
    (reason,) = one.places[0].reasons
    assert (reason.why, reason.sentence) == ("not_first", "another voxel comes first")


def test_null_is_named_beside_the_objection_of_a_condensation() -> None:
    clouds = [
        cloud("skin", 0.0, {HERE: 0.9, (0, 9, 0): 0.9, (0, 10, 0): 0.3}),
        cloud("free", 0.0, {(0, 10, 0): 0.9}, NULL),
    ]
    (place,) = explained(condensation=Strict, clouds=clouds).places
    assert [reason.why for reason in place.reasons] == ["not_first", "nulled"]


def test_a_condensation_that_says_nothing_lets_the_verdict_speak() -> None:
    clouds = [
        cloud("skin", 0.0, {HERE: 0.9, (0, 20, 0): 0.9, (0, 40, 0): 0.05}),
        cloud("motion", 0.0, {(0, 60, 0): 0.9}, SUPPORT),
    ]
    one = explained(condensation=First, clouds=clouds)
    assert [place.reasons[0].sentence for place in one.places] == [
        "1 voxel over the threshold within 10.0 mm, of which cluster_centroid made no contact",
        "likelihood 0.05 is 0.05 under the threshold 0.1",
        "predicted by motion, but no sensor felt it",
    ]


def test_a_condensation_whose_explanations_fail_is_named_and_the_rest_stands() -> None:
    clouds = [cloud("skin", 0.0, {HERE: 0.9, (0, 20, 0): 0.05})]
    one = explained(condensation=Broken, clouds=clouds)
    words = one.contacts[0].combination
    assert "the condensation Broken raised ValueError: no contact words (tests/" in words
    assert "owners of shape (99,), not a row of 1 contacts, or -1, for each of 2 voxels" in words
    reasons = one.places[-1].reasons
    assert reasons[0].sentence == "likelihood 0.05 is 0.05 under the threshold 0.1"
    assert reasons[-1].why == "failed"
    assert "the condensation Broken raised ValueError: no objection (tests/" in as_text(one)


def test_where_nothing_is_a_failing_condensation_comes_second() -> None:
    clouds = [cloud("skin", 0.0, {HERE: 0.9})]
    (place,) = explained(condensation=Broken, clouds=clouds, at=(0.0, 0.04, 0.0)).places
    assert [reason.why for reason in place.reasons] == ["nothing", "failed"]


def test_contacts_without_known_voxels_own_those_within_three_standard_deviations() -> None:
    row = {(x, 0, 0): 0.5 for x in range(4)}
    (contact,) = explained(condensation=First, clouds=[cloud("skin", 0.0, row)]).contacts
    assert [part.voxels for part in contact.said] == [2]  # 3 σ are 5 mm


def test_of_a_condensation_that_looks_at_no_voxels_neither_threshold_nor_tolerance_is_told() -> (
    None
):
    one = explained(condensation=Blind)
    assert as_text(one).startswith("0.000 s: 1 contact in 'base' (de_morgan, cluster_centroid)\n")
