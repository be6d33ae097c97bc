"""`tune fusion`: which settings fit a labelled recording best, and what that is worth."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.errors import ConfigurationError
from contactfusion.files import make_folder, require_settings
from contactfusion.terminal import Progress
from contactfusion.tuning.fusion_fields import Varied, fields_to_vary, override
from contactfusion.tuning.fusion_labels import halving, read_labels, require_within
from contactfusion.tuning.fusion_runs import (
    Job,
    MakePipeline,
    Readings,
    inputs_of,
    kept_in,
    run_score,
)
from contactfusion.tuning.fusion_score import Half, Score

WITHIN = 0.03
"""A contact so near a labelled place is right, unless told otherwise [m]."""
EVEN = 1e-9
"""Costs that differ by less are equal."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A run with changed settings.

    Attributes:
        field: the path of what was changed; "" for the configuration as it is, and for several.
        value: what it was set to.
        overrides: the changes, as `--set` takes them.
        score: of the run.
    """

    field: str
    value: Any
    overrides: tuple[str, ...]
    score: Score

    @property
    def chosen_on(self) -> Half:
        """The score on the first half."""
        return self.score.halves[0]

    @property
    def reported_on(self) -> Half:
        """The score on the second half."""
        return self.score.halves[1]


@dataclass(frozen=True, slots=True)
class Tuned:
    """What was found.

    Attributes:
        configured: the run without change.
        curves: for each field the runs along its values, by the field's path.
        best: for each field the run that the first half chooses.
        together: all of these changes at once; None: fewer than two fields changed.
        chosen: what the first half chooses of all of them.
        split: the time that parts the halves [s].
    """

    configured: Trial
    curves: Mapping[str, tuple[Trial, ...]]
    best: Mapping[str, Trial]
    together: Trial | None
    chosen: Trial
    split: float

    @property
    def is_better(self) -> bool:
        """Whether what was chosen on the first half also costs less on the second."""
        return self.chosen.reported_on.cost < self.configured.reported_on.cost - EVEN

    def trials(self) -> Iterator[Trial]:
        """Give every run once: as configured, along each field, together."""
        yield self.configured
        for curve in self.curves.values():
            yield from (one for one in curve if one.overrides)
        if self.together:
            yield self.together


def tune_fusion(
    make_pipeline: MakePipeline,
    readings: Readings,
    labels: Path,
    out: Path,
    *,
    vary: Sequence[str] = (),
    within: float = WITHIN,
    inputs: Mapping[str, Any] | None = None,
) -> Tuned:
    """Replay a recording with one field after the other set to several values.

    A field is chosen on the first half of the labels and reported on the second. A run that was
    made before is not made again, so that what was stopped goes on.

    Args:
        make_pipeline: makes the pipeline with fields changed.
        readings: gives the readings of the recording, from its start.
        labels: a CSV file, see `read_labels`.
        out: the folder that keeps the runs.
        vary: what is varied, see `fields_to_vary`.
        within: a contact so near a labelled place is right [m].
        inputs: what tells the recording apart from others, such as `fingerprint` gives.

    Raises:
        ConfigurationError: the labels, a field or a value is not what it should be, or `out` holds
            runs of another recording, configuration or labels.
    """
    if not (within > 0.0 and np.isfinite(within)):
        raise ConfigurationError(f"the distance within which a contact is right is {within} m")
    known = read_labels(labels)
    pipeline = make_pipeline(())
    pipeline.close()
    fields = fields_to_vary(pipeline, vary)
    make_folder(out)
    settings = {**inputs_of(pipeline, labels, within), "recording": dict(inputs or {})}
    require_settings(settings, out)
    job = Job(make_pipeline, readings, known, halving(known), within, out)
    progress = Progress("replays", 1 + sum(len(one.values) - 1 for one in fields))
    configured = _trial(job, progress, "", None, ())
    require_within(known, configured.score.first, configured.score.last, labels)
    curves = {one.path: _curve(job, progress, one, configured) for one in fields}
    best = {path: _best(curve, configured) for path, curve in curves.items()}
    together = _together(job, list(best.values()))
    candidates = [configured, *best.values(), *([together] if together else [])]
    chosen = min(candidates, key=lambda one: round(one.chosen_on.cost, 9))  # the first of equals
    return Tuned(configured, curves, best, together, chosen, job.split)


def _curve(job: Job, progress: Progress, field: Varied, configured: Trial) -> tuple[Trial, ...]:
    """Run along the values of a field."""
    return tuple(
        Trial(field.path, value, (), configured.score)
        if value == field.configured
        else _trial(job, progress, field.path, value, (override(field.path, value),))
        for value in field.values
    )


def _trial(
    job: Job, progress: Progress, field: str, value: Any, overrides: tuple[str, ...]
) -> Trial:
    count = progress.skip if kept_in(job.out, overrides).is_file() else progress.add
    trial = Trial(field, value, overrides, run_score(job, overrides))
    count(1)
    return trial


def _best(curve: Sequence[Trial], configured: Trial) -> Trial:
    """Give the run of least cost on the first half; of equals what is configured, or near it."""
    at = next((row for row, one in enumerate(curve) if not one.overrides), 0)
    order = sorted(range(len(curve)), key=lambda row: abs(row - at))
    best = min(order, key=lambda row: round(curve[row].chosen_on.cost, 9))
    return curve[best] if curve else configured


def _together(job: Job, best: Sequence[Trial]) -> Trial | None:
    """Run with every change that the first half chooses."""
    overrides = tuple(change for one in best for change in one.overrides)
    if len(overrides) < 2:
        return None
    return Trial("", None, overrides, run_score(job, overrides))
