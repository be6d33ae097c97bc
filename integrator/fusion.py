"""One step of the integrator as its users see it."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import Guard, SourceError, name_hint
from contactfusion.hypotheses import ContactHypothesis, HypothesisKind
from contactfusion.integrator import kernels
from contactfusion.integrator.entries import Entries, Field
from contactfusion.integrator.report import Report
from contactfusion.integrator.store import Int64Array, unpack
from contactfusion.rule import Condensation, Rule
from contactfusion.surface import Surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VERDICTS = np.array(["support_only", "below_threshold", "contact", "nulled"])
"""What was decided about a voxel, by the codes of the kernels."""


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
        """Give one voxel as the papers' record (F §III-A)."""
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
    """What one step made of the live entries; a later step never changes it.

    Attributes:
        field: the fused likelihoods.
        threshold: from which likelihood on a voxel is a contact.
        contacts: the contacts, the most likely first.
        report: how the sources do.
    """

    field: Field
    threshold: float
    contacts: tuple[Contact, ...]
    report: Report
    _again: Callable[[Entries], "Fusion"]

    def __repr__(self) -> str:
        count = len(self.field.entries.keys)
        return f"<Fusion of {len(self.contacts)} contacts from {count} voxels>"

    @cached_property
    def verdict_codes(self) -> NDArray[np.uint8]:
        """The verdict on each voxel, shape (m,), see `VERDICTS`."""
        return kernels.judge(self.field.likelihoods, self.field.entries.bits, self.threshold)

    @cached_property
    def space(self) -> HypothesisSpace:
        """Every voxel with its likelihoods and verdict; built when first asked for."""
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
        """Give the places, shape (n, 3) [m], with evidence of generators other than one."""
        entries = self.field.entries
        found = np.zeros(len(entries.keys), np.bool_)
        for source, (begin, end) in zip(
            entries.sources, itertools.pairwise(entries.begin), strict=True
        ):
            if source.kind == HypothesisKind.REGULAR and source.name.split("/")[0] != without:
                found[entries.places[begin:end]] = True
        return entries.grid.centres(unpack(entries.keys[found]))

    def without(self, source: str) -> "Fusion":
        """Fuse the same entries again without those of one source.

        Raises:
            SourceError: no such source was plugged at this step.
        """
        names = [known.name for known in self.field.entries.sources]
        if source not in names:
            raise SourceError(f"unknown source '{source}': {name_hint(source, names, 'sources')}")
        return self._again(self.field.entries.without(source))

    def plot(self) -> "Figure":
        """Draw voxels by verdict and contacts with their covariances, for a notebook.

        Returns:
            A matplotlib figure of the three projections [mm]; it opens no window.

        Raises:
            DependencyError: matplotlib is not installed.
        """
        from contactfusion.view.plot import plot_fusion

        return plot_fusion(self)  # pyright: ignore[reportArgumentType] this class by its other path


def fuse(
    entries: Entries,
    rule: Rule,
    condensation: Condensation,
    threshold: float,
    surface: Surface | None,
    report: Report,
) -> Fusion:
    """Fuse live entries, judge each voxel, and condense the contacts.

    Raises:
        PluginError: rule or condensation raised.
    """
    with Guard(f"the rule {type(rule).__name__}", type(rule)):
        field = rule.fuse(entries, entries.sources, surface)
        if not isinstance(field, Field):
            raise TypeError(f"it gave {type(field).__name__}, not a Field")
    if condensation.needs_belief:  # it looks at places, not at voxels
        verdicts = np.empty(0, np.uint8)
    else:
        verdicts = kernels.judge(field.likelihoods, entries.bits, threshold)
    with Guard(f"the condensation {type(condensation).__name__}", type(condensation)):
        contacts = tuple(condensation.condense(field, verdicts))

    def again(fewer: Entries) -> Fusion:
        return fuse(fewer, rule, condensation, threshold, surface, report)

    return Fusion(field, threshold, contacts, report, again)
