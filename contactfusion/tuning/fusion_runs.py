"""Runs of one recording with changed settings; each is kept in a file, and made only once."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any
from urllib.parse import quote

from contactfusion.errors import ConfigurationError
from contactfusion.files import write_whole
from contactfusion.pipeline import Pipeline
from contactfusion.readings import Reading
from contactfusion.tuning.fusion_labels import Label
from contactfusion.tuning.fusion_score import Half, Score, scored

MakePipeline = Callable[[Sequence[str]], Pipeline]
"""Makes a pipeline with fields changed as `--set` changes them."""
Readings = Callable[[], Iterable[Reading]]
"""Gives the readings of the recording, from its start."""


@dataclass(frozen=True, slots=True)
class Job:
    """What every run has in common.

    Attributes:
        make_pipeline: makes the pipeline of a run.
        readings: of the recording.
        labels: in order.
        split: the time that parts the halves [s].
        within: a contact so near a labelled place is right [m].
        out: the folder that keeps the runs.
    """

    make_pipeline: MakePipeline
    readings: Readings
    labels: Sequence[Label]
    split: float
    within: float
    out: Path


def run_score(job: Job, overrides: Sequence[str]) -> Score:
    """Give the score with some fields changed: from its file, or by a run that is then kept.

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
    """Give the file that keeps a run."""
    name = quote(" ".join(overrides), safe="=. ").replace(" ", "+") or "configured"
    if len(name) > 150:
        name = f"{name[:120]}-{sha256(name.encode()).hexdigest()[:16]}"
    return out / "runs" / f"{name}.json"


def inputs_of(pipeline: Pipeline, labels: Path, within: float) -> dict[str, Any]:
    """Give what tells apart the inputs of a folder of runs, but for the recording."""
    config = pipeline.config.model_dump(
        mode="json", exclude={"folder": True, "within": True, "robot": {"within": True}}
    )
    dumped = json.dumps(config, sort_keys=True, default=str)
    return {
        "configuration": sha256(dumped.encode()).hexdigest(),
        "labels": sha256(labels.read_bytes()).hexdigest(),
        "within": within,
    }


def fingerprint(recording: Path) -> dict[str, str]:
    """Give the SHA-256 of a recording, or of each file in the folder that it is, by name."""
    files = [recording] if recording.is_file() else sorted(recording.rglob("*"))
    return {str(one.relative_to(recording.parent)): _digest(one) for one in files if one.is_file()}


def _digest(path: Path) -> str:
    digest = sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _read(path: Path) -> Score:
    try:
        held: Mapping[str, Any] = json.loads(path.read_text())
        one, other = held["halves"]
        halves = (Half.from_dict(one), Half.from_dict(other))
        return Score(float(held["first_s"]), float(held["last_s"]), halves)
    except (ValueError, TypeError, KeyError, IndexError):
        raise ConfigurationError(f"{path} is damaged: remove it, and it is made again") from None
