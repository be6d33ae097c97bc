"""The condensation `members`: which contacts of a set are reported, and why (method §3)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import kernels
from contactfusion.integrator.cells import cell_list, heaviest
from contactfusion.integrator.entries import Entries, Field, Member, Source
from contactfusion.model import Model
from contactfusion.reason import Reason, Why
from contactfusion.rule import Condensation, Neighbourhood

FAINT = 0.1
"""What is left is searched while a contact of it could be so probable."""
ROUNDED = 0.005
"""Probabilities that differ by less are printed as one."""


class MembersConfig(Model):
    """Which contacts of a set are reported."""

    existence: float = FieldOf(default=0.5, gt=0, le=1)
    """A contact is reported when it is at least so probable."""
    rate: float = FieldOf(default=1.0, gt=0)
    """How often contacts are made and broken, about [1/s]: what was there is believed for as long.
    """


class Members(Condensation):
    """The contacts of a set that are probable enough, as the rule found them."""

    Config = MembersConfig
    needs_members = True

    def __init__(self, config: MembersConfig, tolerance: float) -> None:
        super().__init__(config, tolerance)
        self.existence, self.rate = config.existence, config.rate

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Sequence[Contact]:
        """The contacts that exist with at least the probability that is asked for."""
        contacts = [member.contact for member in field.members or ()]
        least = self.existence - kernels.EDGE
        return [contact for contact in contacts if contact.likelihood >= least]

    def explain(self, field: Field, around: Neighbourhood, contact: Contact | None) -> str:
        """The probability of the contact, and by which sources."""
        if (member := _member_at(field, around)) is None:
            return ""
        words = told(member, field.entries.sources)
        if contact is None or abs(contact.likelihood - member.contact.likelihood) < ROUNDED:
            return words
        return f"P(contact) {contact.likelihood:.2f} over time; of this step {words}"

    def objections(
        self, field: Field, verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """The contact that is not probable enough, or that no evidence speaks for."""
        if (member := _member_at(field, around)) is not None:
            exists = member.contact.likelihood
            under = f"under the existence {self.existence:g} that is asked for"
            if exists >= self.existence - kernels.EDGE:
                under = "but one step alone makes no contact after others without it"
            sentence = f"{told(member, field.entries.sources)}, {under}"
            values = {"exists": exists, "existence": self.existence}
            values |= {f"{name}.factor": factor for name, factor in member.factors.items()}
            return [Reason(Why.IMPROBABLE, sentence, values=values)]
        given = {} if around.best == NONE else field.given(around.best)
        sources = field.entries.sources
        evidence = {each.name for each in sources if each.kind == HypothesisKind.REGULAR}
        names = [name for name in given if name in evidence]
        if not names or not field.members:
            return ()
        sentence = f"what {' and '.join(names)} gave here is explained by another contact"
        return [Reason(Why.ELSEWHERE, sentence, names[0])]


def by_voxel(entries: Entries, members: Sequence[Member]) -> FloatArray:
    """The probability of the likeliest contact near each voxel's centre, shape (m,)."""
    likelihoods, counted = np.zeros(len(entries.keys)), entries.counted_voxels
    centres = entries.grid.centres(entries.voxels[counted])
    for member in members:
        reach = max(member.reach, entries.grid.voxel_size)
        cells = cell_list(member.places, 2.0 * reach)
        heights = member.weights / member.weights.max() * member.contact.likelihood
        around = heaviest(centres, member.places, cells, heights, reach)
        likelihoods[counted] = np.maximum(likelihoods[counted], around)
    return likelihoods


def _member_at(field: Field, around: Neighbourhood) -> Member | None:
    """The contact of a set that is nearest to a place, within its reach."""
    away = {
        float(np.linalg.norm(member.contact.position - around.position)): member
        for member in field.members or ()
    }
    nearest = min(away, default=np.inf)
    return away[nearest] if nearest <= around.reach else None


def told(member: Member, sources: Sequence[Source]) -> str:
    """The probability of a contact of a set, and how it comes about."""
    given = " and ".join(f"{name} {p:.2f}" for name, p in member.given.items())
    words = [f"P(contact) {member.contact.likelihood:.2f} by {given}"]
    by_name = {source.name: source for source in sources}
    for name, (before, after) in _changes(member).items():
        if abs(after - before) >= ROUNDED:
            who = _speaker(by_name[name], member, after > before)
            does = "raises" if after > before else "lowers"
            words.append(f"{who} {does} it from {before:.2f} to {after:.2f}")
    return "; ".join(words)


def _changes(member: Member) -> dict[str, tuple[float, float]]:
    """The probability of a contact before and after each source that speaks for or against it."""
    after, changes = member.contact.likelihood, dict[str, tuple[float, float]]()
    for name, factor in [*member.factors.items()][::-1]:
        before = after / (after + factor * (1.0 - after))
        changes[name], after = (before, after), before
    return {name: changes[name] for name in member.factors}


def _speaker(source: Source, member: Member, is_for: bool) -> str:
    """What of a source speaks for or against a contact."""
    if source.kind != HypothesisKind.REGULAR:
        return f"{source.name} ({source.kind})"
    if source.misses < 1.0 and source.resultant is None:
        return f"the silence of {source.name}"
    how = "which needs it" if is_for else "explained without it"
    alone = {*member.given} == {source.name}
    return f"the force of {source.name}, {'which alone tells of it' if alone else how},"
