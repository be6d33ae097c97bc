"""Runs a pipeline on a recording, as one YAML file describes both."""

import csv
import io
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.files import write_whole
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.recordings.opening import open_recording
from contactfusion.yaml_files import read_yaml, with_overrides


class RunConfig(PipelineConfig):
    """A pipeline, and the recording that it runs on."""

    recording: dict[str, Any] = Field(default_factory=dict)
    """The `type` of the recording and its options."""


def run_file(path: Path, overrides: Sequence[str], out: Path) -> None:
    """Run what a YAML file describes; write contacts.csv and summary.json.

    Args:
        path: the file; relative names in it start at its folder.
        overrides: fields to change, as "a.b=c".
        out: the folder that takes the results.

    Raises:
        ContactFusionError: the file, a plug-in or the recording is not what it should be.
    """
    fields = with_overrides(read_yaml(path), overrides)
    try:
        config = RunConfig(**{"folder": path.parent, **fields})
        if not config.recording:
            raise ConfigurationError("this field is required", "recording")
        recording = open_recording(config.recording, path.parent)
        pipeline = Pipeline(config)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    start = time.perf_counter()
    steps = []
    try:
        for step in pipeline.run(recording.readings()):
            steps.append(step)
    finally:
        pipeline.close()
    took = time.perf_counter() - start
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "contacts.csv", contacts_csv(steps))
    write_whole(out / "summary.json", json.dumps(summary(steps), indent=2) + "\n")
    _tell(steps, took, out)
    _require_some_use(steps)


def contacts_csv(steps: Sequence[Step]) -> str:
    """Give one row a contact: stamp, place [m], likelihood, dispersion [m], force [N], shares."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["stamp", "x", "y", "z", "likelihood", "dispersion", "voxels", "fx", "fy", "fz", "shares"]
    )
    for step in steps:
        for contact in step.fusion.contacts:
            shares = " ".join(f"{name}:{share:.4f}" for name, share in contact.shares.items())
            numbers = [
                *contact.position,
                contact.likelihood,
                contact.dispersion,
                contact.voxels,
                *contact.force,
            ]
            writer.writerow([f"{step.stamp:.6f}", *(f"{n:.6g}" for n in numbers), shares])
    return text.getvalue()


def summary(steps: Sequence[Step]) -> dict[str, Any]:
    """Count steps and contacts, and tell how each source did."""
    last = steps[-1].fusion.report.sources if steps else {}
    return {
        "steps": len(steps),
        "steps_with_contact": sum(bool(step.fusion.contacts) for step in steps),
        "contacts": sum(len(step.fusion.contacts) for step in steps),
        "sources": {
            name: {
                "kind": str(source.kind),
                "rate": None if math.isnan(source.rate) else source.rate,
                "accepted": source.accepted,
                "late": source.late,
                "early": source.early,
                "invalid": source.invalid,
            }
            for name, source in last.items()
        },
        "events": [
            {"stamp": step.stamp, "kind": str(event.kind), "message": event.message}
            for step in steps
            for event in step.events
        ],
    }


def _require_some_use(steps: Sequence[Step]) -> None:
    """Fail when every cloud was refused: then the job was not done.

    Raises:
        ContactFusionError: no cloud could be used; names the first reason.
    """
    sources = steps[-1].fusion.report.sources.values() if steps else ()
    if not any(source.accepted for source in sources):
        refused = [event for step in steps for event in step.events if event.kind == "refused"]
        if refused:
            raise ContactFusionError(f"no cloud could be used: {refused[0].message}")


def _tell(steps: Sequence[Step], took: float, out: Path) -> None:
    total = summary(steps)
    print(
        f"{total['steps']} steps in {took:.1f} s, {total['steps_with_contact']} with contact, "
        f"{total['contacts']} contacts"
    )
    for name, source in total["sources"].items():
        rate = "no rate" if source["rate"] is None else f"{source['rate']:.4g} Hz"
        print(
            f"  {name} ({source['kind']}): {source['accepted']} clouds, {rate}, "
            f"{source['late']} late, {source['early']} early, {source['invalid']} refused"
        )
    refused = [event for event in total["events"] if event["kind"] == "refused"]
    if refused:
        print(f"  first refusal: {refused[0]['message']}")
    print(f"results: {out / 'contacts.csv'}, {out / 'summary.json'}")
