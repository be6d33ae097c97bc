"""The condensation `members`: which contacts of a set are reported, and why (method §3)."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import kernels
from contactfusion.integrator.association import paired
from contactfusion.integrator.cells import cell_list, heaviest
from contactfusion.integrator.entries import Entries, Field, Member, Source
from contactfusion.integrator.nearby import Rows, connected, near
from contactfusion.integrator.places import CORE
from contactfusion.model import Model
from contactfusion.reason import Reason, Why, millimetres, place_words
from contactfusion.rule import Condensation, Neighbourhood

FAINT = 0.1
"""What is left is searched while a contact of it could be so probable."""
ROUNDED = 0.005
"""Probabilities that differ by less are printed as one."""
UNLIKELY = 0.05
"""Where a contact lies with less, that end is not described."""
BESIDE = 0.05
"""Contacts that are further apart are not taken for one [m]."""


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
    looks_at_voxels = False
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
        """The probability of the contact, where else it may lie, and why the next is another."""
        if contact is None:
            return ""
        contacts = around.contacts or (contact,)
        found = found_again(contacts, field)
        number = next(n for n, each in enumerate(contacts) if each is contact)
        over_time = f"P(contact) {contact.likelihood:.2f} over time"
        if (member := found.get(number)) is None:
            return f"{over_time}; in this step no source tells of it"
        words = described(member, field.entries.sources)
        if abs(contact.likelihood - member.contact.likelihood) >= ROUNDED:
            words = f"{over_time}; of this step {words}"
        return "; ".join([words, *_elsewhere(member), *_beside(contacts, found, number)])

    def objections(
        self, field: Field, verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """The contact that is not probable enough, those that explain what is here, and null."""
        found = found_again(around.contacts, field)
        member = _unreported(field, around, found)
        reasons = [] if member is None else [self._improbable(field, member)]
        reasons += _explained(field, around, found)
        heard = member.factors if member else {}
        return [*(reasons or _unexplained(field, around)), *_free(field, around, found, heard)]

    def _improbable(self, field: Field, member: Member) -> Reason:
        """That a contact is not probable enough, or not yet."""
        exists = member.contact.likelihood
        under = f"under the existence {self.existence:g} that is asked for"
        if exists >= self.existence - kernels.EDGE:
            under = "but one step alone makes no contact after others without it"
        values = {"exists": exists, "existence": self.existence}
        values |= {f"{name}.factor": factor for name, factor in member.factors.items()}
        sentence = f"{described(member, field.entries.sources)}, {under}"
        return Reason(Why.IMPROBABLE, sentence, values=values)


def found_again(contacts: Sequence[Contact], field: Field) -> dict[int, Member]:
    """The contact of the set of a step that each reported one, by its row, is found as."""
    members = field.members or ()
    pairs = paired(contacts, [member.contact for member in members])
    return {number: members[row] for number, row in sorted(pairs.items())}


def lies_in(member: Member, points: FloatArray, side: float) -> NDArray[np.bool_]:
    """Near which points, shape (n, 3) [m], a contact lies by its position, shape (n,).

    Args:
        member: the contact.
        points: the centres of voxels.
        side: of a voxel [m].
    """
    rows, _ = ends(member)[0]
    core = rows[member.weights[rows] >= CORE * member.weights[rows].max()]
    return near(points, member.places[core], max(member.reach, side))


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


def ends(member: Member) -> list[tuple[Rows, float]]:
    """The ends at which a contact may lie, and how probably: that of its position, then others.

    Places hang together at an end; given are the rows of each.
    """
    left, reaches = member.weights.copy(), np.full(len(member.weights), member.reach)
    cells, found = cell_list(member.places, 2.0 * member.reach), []
    while left.any():
        some = np.finfo(np.float64).tiny
        rows = connected(member.places, cells, left, some, int(left.argmax()), reaches)
        found.append((rows, float(left[rows].sum())))
        left[rows] = 0.0
    away = [_away(member.places[rows], member.contact.position) for rows, _ in found]
    return [found.pop(int(np.argmin(away))), *found]


def described_in(field: Field, row: int) -> str:
    """The probability of the likeliest contact near a voxel, and how it comes about."""
    entries, side = field.entries, field.entries.grid.voxel_size
    centre = entries.grid.centres(entries.voxels[[row]])
    for member in field.members or ():
        if near(centre, member.places, max(member.reach, side)).any():
            return described(member, entries.sources)
    return ""


def described(member: Member, sources: Sequence[Source]) -> str:
    """The probability of a contact of a set, and how it comes about."""
    given = " and ".join(f"{name} {p:.2f}" for name, p in member.given.items())
    words = [f"P(contact) {member.contact.likelihood:.2f} by {given}"]
    if not len(member.explains):
        words = [f"P(contact) {given}, whose force no other contact explains"]
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


def _elsewhere(member: Member) -> Iterator[str]:
    """Where else a contact may lie, in words."""
    (_, here), *others = ends(member)
    likely = [(rows, part) for rows, part in others if part >= UNLIKELY]
    if likely:
        places = [f"{part:.0%} at {place_words(_middle(member, rows))}" for rows, part in likely]
        yield f"it lies here with {here:.0%}, else with {', '.join(places)}"


def _middle(member: Member, rows: Rows) -> FloatArray:
    """The place, shape (3,) [m], that is nearest to the mean of some."""
    places, weights = member.places[rows], member.weights[rows]
    mean = weights @ places / weights.sum()
    middle: FloatArray = places[((places - mean) ** 2).sum(axis=1).argmin()]
    return middle


def _beside(contacts: Sequence[Contact], found: Mapping[int, Member], number: int) -> Iterator[str]:
    """Why a contact and the one that is nearest are two, in words."""
    here = contacts[number].position
    others = sorted((_to(contacts[other], here), other) for other in found if other != number)
    if others and others[0][0] <= BESIDE:
        _, other = others[0]
        both = [name for name in found[number].given if name in found[other].given]
        why = (
            f"{' and '.join(both)} gave a detection of each" if both else "no source tells of both"
        )
        yield f"{_named(contacts, other, here)}, is another: {why}"


def _unreported(field: Field, around: Neighbourhood, found: Mapping[int, Member]) -> Member | None:
    """The contact of the set at a place that is not reported."""
    reported, away = {id(member) for member in found.values()}, dict[float, Member]()
    for member in field.members or ():
        if id(member) not in reported:
            detects = any(name in member.given for name in _sources_here(field, around, member))
            away.setdefault(0.0 if detects else _away(member.places, around.position), member)
    nearest = min(away, default=np.inf)
    return away[nearest] if nearest <= around.reach else None


def _explained(
    field: Field, around: Neighbourhood, found: Mapping[int, Member]
) -> Iterator[Reason]:
    """That contacts elsewhere explain what sources gave at a place."""
    names, words = set[str](), list[str]()
    for number, member in found.items():
        if here := _sources_here(field, around, member):
            names |= here
            words.append(_named(around.contacts, number, around.position))
            for rows, part in ends(member)[1:]:
                if part >= UNLIKELY and _away(member.places[rows], around.position) <= around.reach:
                    words[-1] += f", which lies here with {part:.0%}"
    if words:
        sentence = f"what {' and '.join(sorted(names))} gave here is explained by "
        yield Reason(Why.ELSEWHERE, sentence + ", and by ".join(words), min(names))


def _sources_here(field: Field, around: Neighbourhood, member: Member) -> set[str]:
    """The sources of what a contact explains at a place."""
    entries = field.entries
    rows = member.explains[around.inside[entries.places[member.explains]]]
    own = np.searchsorted(entries.begin, rows, side="right") - 1
    return {entries.sources[row].name for row in np.unique(own)}


def _unexplained(field: Field, around: Neighbourhood) -> Iterator[Reason]:
    """Why no contact explains what is at a place."""
    entries = field.entries
    explained = np.zeros(len(entries.places), np.bool_)
    for member in field.members or ():
        explained[member.explains] = True
    for source, rows in entries.parts(around.inside):
        rows = rows[~explained[rows]]
        if source.kind != HypothesisKind.REGULAR or not len(rows):
            continue
        most = float(entries.columns.likelihoods[rows].max())
        if most < FAINT and not entries.columns.single[rows[0]]:
            sentence = f"what {source.name} gave here is too faint for a contact: {most:.2f}"
            yield Reason(Why.IMPROBABLE, sentence, source.name, {"likelihood": most})
        else:
            sentence = (
                f"no contact explains what {source.name} gave here: it lies off the robot's "
                "surface, or too many others come first"
            )
            yield Reason(Why.NOT_CONDENSED, sentence, source.name)
    if around.best != NONE and not entries.bits[around.best] & kernels.REGULAR:
        names = [*field.given(around.best)]
        sentence = f"predicted by {' and '.join(names)}, but no sensor felt it"
        yield Reason(Why.SUPPORT_ONLY, sentence, names[0])


def _free(
    field: Field, around: Neighbourhood, found: Mapping[int, Member], heard: Mapping[str, float]
) -> Iterator[Reason]:
    """What null at a place does to the nearest contact of which it takes something.

    Args:
        field: what was condensed.
        around: the place.
        found: the contacts that are reported.
        heard: what speaks for or against a contact here, that is described already.
    """
    contacts, place = around.contacts, around.position
    for source, rows in field.entries.parts(around.inside):
        if source.kind != HypothesisKind.NULL or not len(rows) or source.name in heard:
            continue
        likelihood = float(field.entries.columns.likelihoods[rows].max())
        sentence = f"{source.name} (null) gave {likelihood:.2f} here"
        if around.best == NONE:
            sentence += ", where no other source says anything"
        for number in sorted(found, key=lambda number: _to(contacts[number], place)):
            before, after = _changes(found[number]).get(source.name, (0.0, 0.0))
            if before - after >= ROUNDED:
                named = _named(contacts, number, place)
                sentence += f"; it lowers {named}, from {before:.2f} to {after:.2f}"
                break
        yield Reason(Why.NULLED, sentence, source.name, {"likelihood": likelihood})


def _named(contacts: Sequence[Contact], number: int, place: FloatArray) -> str:
    """A contact by its number, and how far away it is."""
    return f"contact {number + 1}, {millimetres(_to(contacts[number], place))} away"


def _to(contact: Contact, place: FloatArray) -> float:
    return float(np.linalg.norm(contact.position - place))


def _away(places: FloatArray, position: FloatArray) -> float:
    """How far the nearest of some places (n, 3) [m] is from a position [m]."""
    return float(np.sqrt(((places - position) ** 2).sum(axis=1).min()))
