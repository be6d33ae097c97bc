"""What each source is worth: all steps of a recording fused again without it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.explaining.quantiles import Quantiles
from contactfusion.explaining.remains import paired
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline import Step

STEP, FURTHEST = 1e-4, 2.0
"""Moves are counted to so much, up to so much [m]."""


@dataclass(frozen=True, slots=True)
class Worth:
    """What became of the contacts of all steps without some sources.

    Attributes:
        name: of the generator whose sources were left out, or of one of several sources of it.
        whole: whether it is a generator as a whole.
        steps: how many steps it was plugged in.
        contacts: how many contacts these steps told with it.
        steps_with: in how many of these steps there was a contact with it.
        steps_without: in how many there was one without it.
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
class _Tally:
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
        for one, other, away in pairs:
            self.moved.add(away)
            self.likelihood_change += after[other].likelihood - before[one].likelihood

    def worth(self, name: str, whole: bool) -> Worth:
        """Give what was counted."""
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
    """Fuse every step again without each generator, and without each source of one with several.

    Controllers, and generators that remember, are not run again: what they would have done without
    the source is not known.

    Args:
        steps: in order; each is looked at once.

    Returns:
        The generators by name, each before its sources.
    """
    tallies: dict[tuple[str, bool], _Tally] = {}
    for step in steps:
        fusion = step.fusion
        side = fusion.field.entries.grid.voxel_size
        for name, sources in groups(fusion).items():
            tally = tallies.setdefault(name, _Tally())
            tally.add(fusion.contacts, _without(fusion, sources).contacts, side)
            tally.share += sum(
                one.shares.get(source, 0.0) for one in fusion.contacts for source in sources
            )
    order = sorted(tallies, key=lambda name: (name[0].split("/")[0], not name[1], name[0]))
    return [tallies[name].worth(*name) for name in order]


def groups(fusion: Fusion) -> dict[tuple[str, bool], list[str]]:
    """Give what is left out: sources by a name and whether it is a generator as a whole."""
    generators: dict[str, list[str]] = {}
    for source in fusion.field.entries.sources:
        generators.setdefault(source.name.split("/")[0], []).append(source.name)
    wholes = {(generator, True): sources for generator, sources in generators.items()}
    several = [name for sources in generators.values() if len(sources) > 1 for name in sources]
    return wholes | {(name, False): [name] for name in several}


def _without(fusion: Fusion, sources: Sequence[str]) -> Fusion:
    """Fuse without some sources; those that say nothing change nothing."""
    entries = fusion.field.entries
    live = dict(
        zip((source.name for source in entries.sources), np.diff(entries.begin), strict=True)
    )
    missing = {source.name: source.misses for source in entries.sources}
    for source in sources:
        if live[source] or missing[source] < 1.0:
            fusion = fusion.without(source)
    return fusion
