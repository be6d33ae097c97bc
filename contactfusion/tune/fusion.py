"""`tune fusion`: the settings that fit a labelled recording best, and what that is worth."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from os.path import relpath
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import yaml

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.files import make_folder, read_json, require_settings, write_whole
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.model import Model
from contactfusion.pipeline import Pipeline
from contactfusion.readings import Reading
from contactfusion.terminal import Progress
from contactfusion.tune.score import (
    Half,
    Label,
    Score,
    halving,
    read_labels,
    require_within,
    scored,
)
from contactfusion.units import LengthScale
from contactfusion.yaml_files import yaml_value

WITHIN = 0.03
"""Default distance from a labelled position within which a contact is right [m]."""
EVEN = 1e-9
"""Costs with a smaller difference are equal."""
LADDER = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0)
"""Default factors of the configured value at which a field is tried."""
MakePipeline = Callable[[Sequence[str]], Pipeline]
"""Makes a pipeline with fields changed as `--set` changes them."""
Readings = Callable[[], Iterable[Reading]]
"""The readings of the recording, from its start."""


@dataclass(frozen=True, slots=True)
class Varied:
    """A field that is varied.

    Attributes:
        path: e.g. "integrator.threshold".
        configured: its configured value.
        values: all that are tried, the configured value among them.
    """

    path: str
    configured: Any
    values: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Job:
    """Inputs that all runs share.

    Attributes:
        make_pipeline: makes the pipeline of a run.
        readings: of the recording.
        labels: in order, without overlap.
        split: the time that splits the halves [s].
        within: a contact is right within this distance of a labelled position [m].
        out: the folder in which runs are kept.
    """

    make_pipeline: MakePipeline
    readings: Readings
    labels: Sequence[Label]
    split: float
    within: float
    out: Path


@dataclass(frozen=True, slots=True)
class Trial:
    """A run with changed settings.

    Attributes:
        field: the path of the changed field; "" for no change, and for several fields.
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
    """Result of a tuning.

    Attributes:
        configured: the run without change.
        curves: for each field the runs along its values, by the field's path.
        best: for each field the best run on the first half.
        together: the run with all of these changes; None: fewer than two fields changed.
        chosen: the best of all on the first half.
        split: the time that splits the halves [s].
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
        """Every run once: as configured, along each field, together."""
        yield self.configured
        for curve in self.curves.values():
            yield from (trial for trial in curve if trial.overrides)
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

    A field is chosen on the first half of the labels and reported on the second. Runs that `out`
    holds are not repeated, so that an interrupted tuning continues.

    Args:
        make_pipeline: makes the pipeline with fields changed.
        readings: the readings of the recording, from its start.
        labels: a CSV file, see `read_labels`.
        out: the folder in which runs are kept.
        vary: fields and values, see `fields_to_vary`.
        within: a contact is right within this distance of a labelled position [m].
        inputs: what distinguishes the recording from others, such as its `fingerprint`.

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
    progress = Progress("replays", 1 + sum(len(field.values) - 1 for field in fields))
    configured = _trial(job, progress, "", None, ())
    require_within(known, configured.score.first, configured.score.last, labels)
    curves = {field.path: _curve(job, progress, field, configured) for field in fields}
    best = {path: _best(curve, configured) for path, curve in curves.items()}
    together = _together(job, list(best.values()))
    candidates = [configured, *best.values(), *([together] if together else [])]
    # of equals, the first
    chosen = min(candidates, key=lambda trial: round(trial.chosen_on.cost, 9))
    return Tuned(configured, curves, best, together, chosen, job.split)


def _curve(job: Job, progress: Progress, field: Varied, configured: Trial) -> tuple[Trial, ...]:
    """The runs along the values of a field."""
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
    """The run of least cost on the first half; of equals that next to the configured value."""
    at = next((row for row, trial in enumerate(curve) if not trial.overrides), 0)
    order = sorted(range(len(curve)), key=lambda row: abs(row - at))
    best = min(order, key=lambda row: round(curve[row].chosen_on.cost, 9))
    return curve[best] if curve else configured


def _together(job: Job, best: Sequence[Trial]) -> Trial | None:
    """The run with every change that the first half chooses."""
    overrides = tuple(change for trial in best for change in trial.overrides)
    if len(overrides) < 2:
        return None
    return Trial("", None, overrides, run_score(job, overrides))


def override(path: str, value: Any) -> str:
    """A change as `--set` takes it."""
    return f"{path}={yaml.safe_dump(value).splitlines()[0]}"


def fields_to_vary(pipeline: Pipeline, vary: Sequence[str]) -> list[Varied]:
    """The fields to vary, with their values.

    Args:
        pipeline: as configured.
        vary: such as "integrator.threshold=0.1,0.2"; empty: threshold, tolerance,
            timeouts and the length scales of generators, on ladders around what is configured.

    Raises:
        ConfigurationError: a field is unknown or named twice, or may not hold a value.
    """
    holders = _holders(pipeline)
    if not vary:
        paths = _default_paths(pipeline)
        ladders = (_ladder(holders, path) for path in paths)
        return [field for field in ladders if len(field.values) > 1]
    fields = [_requested(holders, text) for text in vary]
    for number, field in enumerate(fields):
        if field.path in [other.path for other in fields[:number]]:
            raise ConfigurationError(f"'{field.path}' is to be varied twice")
    return fields


def _holders(pipeline: Pipeline) -> dict[str, Model]:
    """The configurations that hold fields, by their paths."""
    generators = {f"generators.{name}": g.config for name, g in pipeline.generators.items()}
    integrator = {
        "integrator": pipeline.config.integrator,
        "integrator.rule": pipeline.integrator.rule.config,
        "integrator.condensation": pipeline.integrator.condensation.config,
    }
    return integrator | generators


def _default_paths(pipeline: Pipeline) -> list[str]:
    integrator = pipeline.config.integrator
    paths = ["integrator.threshold"]
    if integrator.condensation == "cluster_centroid":
        paths.append("integrator.tolerance")
    own = [name for name, g in pipeline.generators.items() if g.config.timeout is not None]
    if len(own) < len(pipeline.generators) or integrator.expiry == "voxel":
        paths.append("integrator.timeout")
    if integrator.expiry == "source":
        paths += [f"generators.{name}.timeout" for name in own]
    for name, generator in pipeline.generators.items():
        known = type(generator.config).model_fields.items()
        scales = [
            field for field, info in known if any(isinstance(m, LengthScale) for m in info.metadata)
        ]
        paths += [f"generators.{name}.{field}" for field in scales]
    return paths


def _ladder(holders: dict[str, Model], path: str) -> Varied:
    """The values of the ladder that the field accepts."""
    configured = _configured(holders, path)
    values = []
    for factor in LADDER:
        value = configured if factor == 1.0 else float(f"{configured * factor:.3g}")
        try:
            _require_valid(holders, path, value)
        except ConfigurationError:
            continue
        values.append(value)
    return Varied(path, configured, tuple(values))


def _requested(holders: dict[str, Model], text: str) -> Varied:
    """A field with the values of "field=value,value"."""
    path, equals, listing = text.partition("=")
    path = path.strip()
    if not equals or not listing.strip():
        raise ConfigurationError(f"'{text}' varies nothing; write it as FIELD=value,value")
    configured = _configured(holders, path)
    values = [_value(word, text) for word in listing.split(",")]
    for value in values:
        _require_valid(holders, path, value)
    try:
        every = list(dict.fromkeys([*values, configured]))
    except TypeError:
        raise ConfigurationError(
            f"'{text}': {path} holds several fields; vary one of them"
        ) from None
    if all(isinstance(value, int | float) for value in every):
        every.sort()
    return Varied(path, configured, tuple(every))


def _value(text: str, whole: str) -> Any:
    value = yaml_value(text, whole)
    if value is None:
        raise ConfigurationError(f"'{whole}': '{text.strip()}' is no value")
    if isinstance(value, str) and _is_number(value):
        value = float(value)  # YAML 1.1 takes 1e-3 for text
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigurationError(f"'{whole}': {text.strip()} is not a finite number")
    return value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _configured(holders: dict[str, Model], path: str) -> Any:
    """The value of a field; a tolerance that is left to the integrator is two voxels.

    Raises:
        ConfigurationError: there is no such field.
    """
    holder, _, name = path.rpartition(".")
    if holder not in holders:
        hint = name_hint(holder, holders, "parts with fields")
        raise ConfigurationError(f"unknown field '{path}'; {hint}")
    model = holders[holder]
    if name not in type(model).model_fields:
        hint = name_hint(name, type(model).model_fields, "fields")
        raise ConfigurationError(f"unknown field '{path}'; {hint}")
    value = getattr(model, name)
    if path == "integrator.tolerance" and value is None and isinstance(model, IntegratorConfig):
        return model.linking_distance
    return value


def _require_valid(holders: dict[str, Model], path: str, value: Any) -> None:
    holder, _, name = path.rpartition(".")
    model = holders[holder]
    held = {field: getattr(model, field) for field in model.model_fields_set}
    try:
        type(model)(**{**held, name: value})
    except ConfigurationError as error:
        raise error.under(holder) from None


def run_score(job: Job, overrides: Sequence[str]) -> Score:
    """The score with some fields changed: from its file, or by a run that is then kept.

    Raises:
        ConfigurationError: the file is damaged, a change cannot be made, or no step came.
    """
    path = kept_in(job.out, overrides)
    if path.is_file():
        return _read(path)
    pipeline = job.make_pipeline(overrides)
    try:
        score = scored(pipeline.run(job.readings()), job.labels, job.split, job.within)
    finally:
        pipeline.close()
    if not score.first <= score.last:
        raise ConfigurationError("the recording leads to no step, so nothing can be compared")
    held = {
        "set": list(overrides),
        "first_s": score.first,
        "last_s": score.last,
        "halves": [half.as_dict() for half in score.halves],
    }
    write_whole(path, json.dumps(held) + "\n")
    return score


def kept_in(out: Path, overrides: Sequence[str]) -> Path:
    """The file of a run."""
    name = quote(" ".join(overrides), safe="=. ").replace(" ", "+") or "configured"
    if len(name) > 150:
        name = f"{name[:120]}-{sha256(name.encode()).hexdigest()[:16]}"
    return out / "runs" / f"{name}.json"


def inputs_of(pipeline: Pipeline, labels: Path, within: float) -> dict[str, Any]:
    """What distinguishes the inputs of a folder of runs, but for the recording."""
    config = pipeline.config.model_dump(
        mode="json", exclude={"folder": True, "within": True, "robot": {"within": True}}
    )
    dumped = json.dumps(config, sort_keys=True, default=str)
    return {
        "configuration": sha256(dumped.encode()).hexdigest(),
        "labels": sha256(labels.read_bytes()).hexdigest(),
        "within": within,
    }


def fingerprint(recording: Path, files: Iterable[Path] = ()) -> dict[str, str]:
    """The SHA-256 of a recording, or of each file in the folder that it is, by name.

    Args:
        recording: the file or the folder.
        files: others on which its readings depend, such as those that its description names.
    """
    held = [recording] if recording.is_file() else sorted(recording.rglob("*"))
    every = {file.resolve(): file for file in (*files, *held) if file.is_file()}
    return {relpath(file, recording.parent): _digest(file) for file in every.values()}


def _digest(path: Path) -> str:
    digest = sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _read(path: Path) -> Score:
    try:
        held: Mapping[str, Any] = read_json(path)
        first, second = held["halves"]
        halves = (Half.from_dict(first), Half.from_dict(second))
        return Score(float(held["first_s"]), float(held["last_s"]), halves)
    except (ValueError, TypeError, KeyError, IndexError):
        raise ConfigurationError(f"{path} is damaged: remove it, and it is made again") from None
