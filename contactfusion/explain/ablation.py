"""The worth of each source: steps fused again without it, as a table, files and a picture."""

import csv
import io
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.contacts import Contact
from contactfusion.errors import ContactFusionError
from contactfusion.explain.counterfactual import paired
from contactfusion.figures import COLOURS, new_figure, plain
from contactfusion.files import make_folder, write_whole
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline import Step
from contactfusion.terminal import printable

FILES = ("ablation.csv", "ablation.json", "ablation.png")
"""Of the folder that takes the results."""
STEP, FURTHEST = 1e-4, 2.0
"""Resolution and greatest value of the counted moves [m]."""

CAUTION = (
    "Each step was fused again without the source. Controllers, and generators that remember, were "
    "not run again. Steps that follow each other are alike: these are counts, not intervals."
)
HEADS = ("without", "lost", "gained", "steps with contact", "median", "p95", "likelihood", "share")


@dataclass
class Quantiles:
    """Counts values by steps of a fixed width; quantiles are exact to half a step.

    Attributes:
        step: the width.
        most: values are counted up to here; larger ones count as this.
        counts: how many values are nearest to each multiple of the step.
    """

    step: float
    most: float
    counts: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.counts = np.zeros(round(self.most / self.step) + 1, np.int64)

    def add(self, value: float) -> None:
        """Count a value of at least 0."""
        self.counts[min(round(value / self.step), len(self.counts) - 1)] += 1

    @property
    def count(self) -> int:
        """How many values were counted."""
        return int(self.counts.sum())

    def at(self, share: float) -> float:
        """The least value that so large a share does not exceed; NaN when none was counted."""
        if not self.count:
            return math.nan
        wanted = max(math.ceil(share * self.count - 1e-9), 1)
        return int(np.searchsorted(np.cumsum(self.counts), wanted)) * self.step


@dataclass(frozen=True, slots=True)
class Worth:
    """The contacts of all steps without some sources, compared to those with them.

    Attributes:
        name: of the generator whose sources were left out, or of one of several sources of it.
        whole: whether it is a generator as a whole.
        steps: number of steps in which it was plugged in.
        contacts: number of contacts of these steps with it.
        steps_with: number of these steps with a contact, with it.
        steps_without: number of these steps with a contact, without it.
        lost: contacts that are not there without it.
        gained: contacts that are there only without it, as when a null source is left out.
        moved_median: of the contacts that remain, how far they move [m], to 0.1 mm; NaN: none is.
        moved_p95: likewise the 95th percentile [m].
        likelihood_change: of the contacts that remain, how much likelier they are, on average.
        share: its mean share of the likelihood of a contact, with it.
    """

    name: str
    whole: bool
    steps: int
    contacts: int
    steps_with: int
    steps_without: int
    lost: int
    gained: int
    moved_median: float
    moved_p95: float
    likelihood_change: float
    share: float


@dataclass
class _Statistics:
    """Counts one group of sources, in memory that does not grow."""

    steps: int = 0
    contacts: int = 0
    steps_with: int = 0
    steps_without: int = 0
    lost: int = 0
    gained: int = 0
    likelihood_change: float = 0.0
    share: float = 0.0
    moved: Quantiles = field(default_factory=lambda: Quantiles(STEP, FURTHEST))

    def add(self, before: Sequence[Contact], after: Sequence[Contact], side: float) -> None:
        """Count a step: its contacts with and without the group; `side` of a voxel [m]."""
        pairs = paired(before, after, side)
        self.steps += 1
        self.contacts += len(before)
        self.steps_with += bool(before)
        self.steps_without += bool(after)
        self.lost += len(before) - len(pairs)
        self.gained += len(after) - len(pairs)
        for row, other, away in pairs:
            self.moved.add(away)
            self.likelihood_change += after[other].likelihood - before[row].likelihood

    def worth(self, name: str, whole: bool) -> Worth:
        """The statistics of the group."""
        remain = self.moved.count
        return Worth(
            name=name,
            whole=whole,
            steps=self.steps,
            contacts=self.contacts,
            steps_with=self.steps_with,
            steps_without=self.steps_without,
            lost=self.lost,
            gained=self.gained,
            moved_median=self.moved.at(0.5),
            moved_p95=self.moved.at(0.95),
            likelihood_change=self.likelihood_change / remain if remain else np.nan,
            share=self.share / self.contacts if self.contacts else np.nan,
        )


def ablated(steps: Iterable[Step]) -> list[Worth]:
    """The worth of each generator, and of each source of one with several: steps fused without it.

    Controllers, and generators that remember, are not run again: what they would have done without
    the source is not known.

    Args:
        steps: in order; each is read once.

    Returns:
        The generators by name, each before its sources.
    """
    statistics: dict[tuple[str, bool], _Statistics] = {}
    for step in steps:
        fusion = step.fusion.alone
        side = fusion.field.entries.grid.voxel_size
        for name, sources in groups(fusion).items():
            group = statistics.setdefault(name, _Statistics())
            group.add(fusion.contacts, _without(fusion, sources).contacts, side)
            group.share += sum(
                contact.shares.get(source, 0.0) for contact in fusion.contacts for source in sources
            )
    order = sorted(statistics, key=lambda name: (name[0].split("/")[0], not name[1], name[0]))
    return [statistics[name].worth(*name) for name in order]


def groups(fusion: Fusion) -> dict[tuple[str, bool], list[str]]:
    """The groups to leave out: sources by a name and whether it is a generator as a whole."""
    generators: dict[str, list[str]] = {}
    for source in fusion.field.entries.sources:
        generators.setdefault(source.name.split("/")[0], []).append(source.name)
    wholes = {(generator, True): sources for generator, sources in generators.items()}
    several = [name for sources in generators.values() if len(sources) > 1 for name in sources]
    return wholes | {(name, False): [name] for name in several}


def _without(fusion: Fusion, sources: Sequence[str]) -> Fusion:
    """Fuse without some sources; those without hypotheses and misses change nothing."""
    entries = fusion.field.entries
    live = dict(
        zip((source.name for source in entries.sources), np.diff(entries.begin), strict=True)
    )
    reporting = {
        source.name for source in entries.sources if source.misses < 1.0 or source.resultant
    }
    for source in sources:
        if live[source] or source in reporting:
            fusion = fusion.without(source)
    return fusion


def table(worths: Sequence[Worth]) -> str:
    """A table as text; the sources of a generator stand indented below it."""
    names = _names(worths)
    rows = [HEADS, *((name, *_cells(worth)) for name, worth in zip(names, worths, strict=True))]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADS))]
    lines = []
    for row in rows:
        first, *rest = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        lines.append("  ".join([row[0].ljust(len(first)), *rest]).rstrip())
    return "\n".join(map(printable, [*lines, "", CAUTION]))


def as_csv(worths: Sequence[Worth]) -> str:
    """One row a generator or source; lengths in m, empty for NaN."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Worth.__dataclass_fields__)
    for worth in worths:
        writer.writerow([_plain(value) for value in asdict(worth).values()])
    return text.getvalue()


def as_json(worths: Sequence[Worth]) -> str:
    """A list of objects; lengths in m, null for NaN."""
    rows = [{name: _plain(value) for name, value in asdict(worth).items()} for worth in worths]
    return json.dumps({"caution": CAUTION, "without": rows}, indent=1) + "\n"


def picture(worths: Sequence[Worth]) -> bytes:
    """Draw what is lost, gained and moved without each; a PNG file.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    figure = new_figure(11.0, 1.8 + 0.45 * len(worths))
    counts, moves = figure.subplots(1, 2, sharey=True)
    rows = -np.arange(len(worths))
    contacts = max((worth.contacts for worth in worths), default=0) or 1
    lost = [100.0 * worth.lost / contacts for worth in worths]
    gained = [100.0 * worth.gained / contacts for worth in worths]
    counts.barh(rows + 0.2, lost, height=0.36, color=COLOURS[1], label="lost without it")
    counts.barh(rows - 0.2, gained, height=0.36, color=COLOURS[0], label="there only without it")
    for row, worth in zip(rows, worths, strict=True):
        median, far = worth.moved_median * 1000.0, worth.moved_p95 * 1000.0
        moves.plot([median, far], [row, row], color="#888888", zorder=1)
        first = row == 0
        moves.plot(median, row, "o", color=COLOURS[2], label="median" if first else None)
        moves.plot(far, row, "|", markersize=12, color="#222222", label="95 %" if first else None)
    counts.set(xlabel=f"part of {contacts} contacts [%]", xlim=(0.0, max(100.0, *gained)))
    counts.set_yticks(rows, map(plain, _names(worths)))
    moves.set(xlabel="contacts that remain move by [mm]")
    moves.set_xlim(left=0.0)
    for axes in (counts, moves):
        axes.grid(axis="x", linewidth=0.3, color="#cccccc")
        axes.set_axisbelow(True)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    counts.set_ylim(-len(worths) + 0.4, 0.6)
    content = io.BytesIO()
    figure.savefig(content, dpi=120, format="png")
    return content.getvalue()


def write_ablation(worths: Sequence[Worth], out: Path) -> list[Path]:
    """Write ablation.csv and ablation.json, and return their paths.

    Raises:
        ContactFusionError: there was no step, or no source.
    """
    if not worths:
        raise ContactFusionError("the recording leads to no step with a source, so nothing is left")
    make_folder(out)
    written = [out / name for name in FILES[:2]]
    for path, content in zip(written, (as_csv(worths), as_json(worths)), strict=True):
        write_whole(path, content)
    return written


def write_picture(worths: Sequence[Worth], out: Path) -> Path:
    """Write ablation.png, and return its path.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    write_whole(out / FILES[2], picture(worths))
    return out / FILES[2]


def _names(worths: Sequence[Worth]) -> list[str]:
    """The names of the rows; sources of a generator with several stand indented."""
    several = {worth.name.split("/")[0] for worth in worths if not worth.whole}
    return [
        f"  {worth.name}" if not worth.whole else worth.name + " (all)" * (worth.name in several)
        for worth in worths
    ]


def _cells(worth: Worth) -> tuple[str, ...]:
    steps = f"{worth.steps_with} -> {worth.steps_without} of {worth.steps}"
    change = "-" if math.isnan(worth.likelihood_change) else f"{worth.likelihood_change:+.2f}"
    share = "-" if math.isnan(worth.share) else f"{worth.share:.0%}"
    lost = f"{worth.lost} of {worth.contacts}"
    moves = (_millimetres(worth.moved_median), _millimetres(worth.moved_p95))
    return lost, str(worth.gained), steps, *moves, change, share


def _millimetres(metres: float) -> str:
    return "-" if math.isnan(metres) else f"{metres * 1000.0:.1f} mm"


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value
