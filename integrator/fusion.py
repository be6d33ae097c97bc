"""One step of the integrator as its users see it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact, Contacts
from contactfusion.errors import Guard, SourceError, name_hint
from contactfusion.hypotheses import ContactHypothesis, HypothesisKind
from contactfusion.integrator import kernels
from contactfusion.integrator.entries import Entries, Field, Member
from contactfusion.integrator.members import found_again, lies_in
from contactfusion.integrator.sources import Report
from contactfusion.integrator.store import Int64Array, unpack
from contactfusion.integrator.tracks import ContactEvent
from contactfusion.rule import Condensation, Rule
from contactfusion.surface import Surface

SIGMAS = 3.0
"""A box that is filled evenly reaches so many standard deviations from its middle, its corners."""
VERDICTS = np.array(["support_only", "below_threshold", "contact", "nulled"])
"""The verdicts on a voxel, by the codes of the kernels."""


@dataclass(frozen=True, eq=False)
class HypothesisSpace:
    """Every voxel that holds a live hypothesis, and why it is a contact or not; all read-only.

    Attributes:
        frame: the frame of positions and forces.
        voxels: shape (m, 3), ascending.
        positions: shape (m, 3) [m], the voxels' centres.
        likelihoods: shape (m,), fused.
        verdicts: shape (m,), "contact", "below_threshold", "support_only" or "nulled".
        sources: the k sources by ascending name.
        source_likelihoods: shape (m, k), what each gave, NaN where nothing.
        forces: shape (m, 3) [N] on the robot, NaN where no source felt one.
        stamps: shape (m,) [s], the newest entry.
    """

    frame: str
    voxels: Int64Array
    positions: FloatArray
    likelihoods: FloatArray
    verdicts: NDArray[np.str_]
    sources: tuple[str, ...]
    source_likelihoods: NDArray[np.float32]
    forces: FloatArray
    stamps: FloatArray

    def hypothesis(self, row: int) -> ContactHypothesis:
        """A voxel as the papers' record (F §III-A)."""
        given = zip(self.sources, self.source_likelihoods[row], strict=True)
        force, magnitude = self.forces[row], float(np.linalg.norm(self.forces[row]))
        kind = {"nulled": HypothesisKind.NULL, "support_only": HypothesisKind.SUPPORT}
        felt = np.isfinite(magnitude)
        x, y, z = (float(value) for value in self.positions[row])
        direction = tuple(float(v) for v in force / magnitude) if felt and magnitude > 0 else None
        return ContactHypothesis.model_validate(
            {
                "location": (x, y, z),
                "likelihood": float(self.likelihoods[row]),
                "likelihoods": {name: float(p) for name, p in given if not np.isnan(p)},
                "kind": kind.get(str(self.verdicts[row]), HypothesisKind.REGULAR),
                "stamp": float(self.stamps[row]),
                "frame": self.frame,
                "force_magnitude": magnitude if felt else None,
                "force_direction": direction,
            }
        )


@dataclass(frozen=True, eq=False)
class Fusion:
    """The result of one step from the live entries; a later step never changes it.

    Attributes:
        field: the fused likelihoods.
        threshold: from which likelihood on a voxel is a contact.
        contacts: the contacts, the most likely first.
        report: how the sources do.
        rule: that fused.
        condensation: that made contacts.
        surface: the robot's surface that the rule got, or None.
        changes: what happened to contacts that are followed.
    """

    field: Field
    threshold: float
    contacts: tuple[Contact, ...]
    report: Report
    rule: Rule
    condensation: Condensation
    surface: Surface | None
    _owners: Callable[[], NDArray[np.intp]] | None
    changes: tuple[ContactEvent, ...] = ()

    def __repr__(self) -> str:
        count = len(self.field.entries.keys)
        return f"<Fusion of {len(self.contacts)} contacts from {count} voxels>"

    @cached_property
    def verdict_codes(self) -> NDArray[np.uint8]:
        """The verdict on each voxel, shape (m,), see `VERDICTS`."""
        return kernels.judge(self.field.likelihoods, self.field.entries.bits, self.threshold)

    @cached_property
    def owners(self) -> NDArray[np.intp]:
        """The contact that each voxel belongs to, a row of `contacts` or -1, shape (m,).

        Of contacts that are not made of voxels those where they lie count as theirs, and the
        likeliest contact comes first: their place or area as a set has it, or three standard
        deviations about them.

        Raises:
            PluginError: the condensation raised, or gave what are no rows of its contacts.
        """
        with guarded(self.condensation):
            owners = np.array(self._owners() if self._owners else self._by_place())
            shape, count = self.field.entries.keys.shape, len(self.contacts)
            if owners.shape != shape or not ((owners >= NONE) & (owners < count)).all():
                raise ValueError(
                    f"it gave owners of shape {owners.shape}, not a row of {count} contacts, or "
                    f"{NONE}, for each of {shape[0]} voxels"
                )
        owners.flags.writeable = False
        return owners

    def rows_of(self, contact: Contact) -> NDArray[np.intp]:
        """The voxels of a contact, as rows of the field and of `space`, ascending.

        Raises:
            ValueError: it is no contact of this step.
        """
        for number, own in enumerate(self.contacts):
            if own is contact:
                return np.flatnonzero(self.owners == number)
        raise ValueError(f"this is no contact of this step: {contact}")

    @cached_property
    def space(self) -> HypothesisSpace:
        """Every voxel with its likelihoods and verdict; built on first use."""
        entries = self.field.entries
        voxels = unpack(entries.keys)
        newest = kernels.newest_stamps(entries.places, len(voxels), entries.columns.stamps)
        space = HypothesisSpace(
            frame=entries.grid.frame,
            voxels=voxels,
            positions=entries.grid.centres(voxels),
            likelihoods=self.field.likelihoods.copy(),
            verdicts=VERDICTS[self.verdict_codes],
            sources=tuple(source.name for source in entries.sources),
            source_likelihoods=entries.likelihoods,
            forces=entries.forces,
            stamps=newest / 1e9,
        )
        for value in vars(space).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        return space

    def evidence(self, without: str) -> FloatArray:
        """The places, shape (n, 3) [m], with evidence of generators other than one."""
        entries = self.field.entries
        found = np.zeros(len(entries.keys), np.bool_)
        for source, own in entries.by_source:
            if source.kind == HypothesisKind.REGULAR and source.name.split("/")[0] != without:
                found[entries.places[own]] = True
        return entries.grid.centres(unpack(entries.keys[found]))

    @property
    def alone(self) -> "Fusion":
        """The same step by itself: its contacts are not followed over time."""
        if not self.condensation.needs_members:
            return self
        entries, parts = self.field.entries, (self.rule, self.condensation)
        return fuse(entries, *parts, self.threshold, self.surface, self.report)

    def without(self, source: str) -> "Fusion":
        """The same entries fused again without those of one source, as a step by itself.

        Raises:
            SourceError: no such source was plugged at this step.
        """
        names = [known.name for known in self.field.entries.sources]
        if source not in names:
            raise SourceError(f"unknown source '{source}': {name_hint(source, names, 'sources')}")
        fewer = self.field.entries.without(source)
        return fuse(fewer, self.rule, self.condensation, self.threshold, self.surface, self.report)

    @cached_property
    def found(self) -> dict[int, Member]:
        """What contacts, by their row, are in the set of this step by itself, if they are in it."""
        return found_again(self.contacts, self.field) if self.condensation.needs_members else {}

    def _by_place(self) -> NDArray[np.intp]:
        """The likeliest contact that lies in each voxel, or within whose covariance it lies."""
        entries = self.field.entries
        centres = entries.grid.centres(entries.voxels)
        owners = np.full(len(centres), NONE, np.intp)
        for number, contact in reversed(list(enumerate(self.contacts))):
            if member := self.found.get(number):
                owners[lies_in(member, centres, entries.grid.voxel_size)] = number
                continue
            offsets = centres - contact.position
            squared = (offsets * np.linalg.solve(contact.covariance, offsets.T).T).sum(axis=1)
            owners[squared <= SIGMAS**2] = number
        return owners


def fuse(
    entries: Entries,
    rule: Rule,
    condensation: Condensation,
    threshold: float,
    surface: Surface | None,
    report: Report,
) -> Fusion:
    """Fuse live entries, decide the verdict on each voxel, and condense the contacts.

    Raises:
        PluginError: rule or condensation raised.
    """
    with guarded(rule):
        field = rule.fuse(entries, entries.sources, surface)
        if not isinstance(field, Field):
            raise TypeError(f"it gave {type(field).__name__}, not a Field")
    verdicts = np.empty(0, np.uint8)
    if condensation.looks_at_voxels:
        verdicts = kernels.judge(field.likelihoods, entries.bits, threshold)
    with guarded(condensation):
        found = condensation.condense(field, verdicts)
        contacts = tuple(found)
    owners = found.owners if isinstance(found, Contacts) else None
    return Fusion(field, threshold, contacts, report, rule, condensation, surface, owners)


def guarded(part: Rule | Condensation) -> Guard:
    """A `with` around code of a rule or condensation: what it raises becomes a sentence."""
    what = "rule" if isinstance(part, Rule) else "condensation"
    return Guard(f"the {what} {type(part).__name__}", type(part))
