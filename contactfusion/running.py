"""Runs a pipeline on a recording or in a scene, as one YAML file describes both."""

import csv
import io
import json
import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, FrameError, PluginError, name_hint
from contactfusion.files import make_folder, write_whole
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import READING_TYPES, Reading
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Recording
from contactfusion.simulation.scene import heard
from contactfusion.yaml_files import read_yaml, with_overrides

if TYPE_CHECKING:
    from contactfusion.simulation.scene import Scene


class RunConfig(PipelineConfig):
    """A pipeline, and what it runs on: a recording or a scene."""

    recording: dict[str, Any] = Field(default_factory=dict)
    """The `type` of the recording and its options."""
    scene: dict[str, Any] = Field(default_factory=dict)
    """The `type` of the scene and its options."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if not self.recording and not self.scene:
            raise ConfigurationError("give a recording, or a scene", "recording")
        if self.recording and self.scene:
            raise ConfigurationError("give a recording or a scene, not both", "scene")
        if self.scene and self.robot is None:
            raise ConfigurationError("a scene needs a robot by URDF", "robot")
        return self


def run_file(path: Path, overrides: Sequence[str], out: Path, seed: int | None = None) -> None:
    """Run what a YAML file describes; write contacts.csv, commands.csv and summary.json.

    Args:
        path: the file; relative names in it start at its folder.
        overrides: fields to change, as "a.b=c".
        out: the folder that takes the results.
        seed: in place of the file's; None: that of the file.

    Raises:
        ContactFusionError: the file, a plug-in, the recording or the scene is not what it should
            be.
    """
    fields = with_overrides(read_yaml(path), overrides)
    if seed is not None:
        fields["seed"] = seed
    try:
        config = RunConfig(**{"folder": path.parent, **fields})
        scene = _scene(config) if config.scene else None
        source = scene or _recording(config, path.parent)
        pipeline = Pipeline(config)
    except (ConfigurationError, FrameError, PluginError) as error:
        raise ConfigurationError(f"{path}: {error}") from None
    make_folder(out)
    counts: Counter[tuple[str, type[Reading]]] = Counter()

    def hear(reading: Reading) -> None:
        counts[reading.sensor, type(reading)] += 1

    start = time.perf_counter()
    try:
        if isinstance(source, Recording):
            steps = list(pipeline.run(heard(source.readings(), hear)))
        else:
            steps = list(source.run(pipeline, hear))
    finally:
        pipeline.close()
    took = time.perf_counter() - start
    write_whole(out / "contacts.csv", contacts_csv(steps))
    total = summary(steps)
    _tell(total, took)
    results = [out / "contacts.csv", out / "summary.json"]
    if pipeline.config.controller is not None:
        results.insert(1, out / "commands.csv")
        write_whole(results[1], commands_csv(steps))
    if scene and steps:
        verdict = scene.verdict(pipeline, steps[-1])
        total["truth"] = verdict.truth
        for sentence in verdict.sentences:
            print(f"truth: {sentence}")
    write_whole(out / "summary.json", json.dumps(total, indent=2) + "\n")
    print(f"results: {', '.join(map(str, results))}")
    if faults := list(unheard(pipeline, counts, steps)):
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ConfigurationError(f"{path}: {faults[0]}{more}")


def unheard(
    pipeline: Pipeline, counts: Mapping[tuple[str, type[Reading]], int], steps: Sequence[Step]
) -> Iterator[str]:
    """Say what the pipeline waited for in vain.

    Args:
        pipeline: after its run.
        counts: how many readings came, by sensor and type.
        steps: what it gave.

    Yields:
        A sentence for each thing that kept the job from being done.
    """
    sensors = {sensor for sensor, _ in counts}
    on = pipeline.config.cycle.on
    if on is not None and not steps:
        hint = name_hint(on, sensors | set(READING_TYPES), "sensors and types")
        yield f"cycle.on: no reading of '{on}' came; {hint}"
    if not pipeline.config.generators:
        yield "generators: none are configured, so nothing can be found"
    for name, generator in pipeline.generators.items():
        fit = [sensor for sensor, kind in counts if issubclass(kind, generator.readings)]
        wanted = generator.config.sensor
        if not fit:
            kinds = " or ".join(kind.__name__ for kind in generator.readings)
            yield f"generators.{name}: no {kinds} came"
        elif wanted is not None and wanted not in fit:
            hint = name_hint(wanted, fit, "sensors")
            yield f"generators.{name}.sensor: no reading of '{wanted}' came; {hint}"
    last = steps[-1].fusion.report.sources if steps else {}
    for name, source in last.items():
        if source.invalid and not source.accepted:
            events = (event for step in steps for event in step.events)
            why = next(e.message for e in events if e.source == name and e.kind == "refused")
            yield f"every cloud of '{name}' was refused: {why}"


def _scene(config: RunConfig) -> "Scene":
    # only here: a recording needs no physics
    from contactfusion.simulation.opening import open_scene

    assert config.robot is not None
    return open_scene(config.scene, config.robot, config.seed, config.folder)


def _recording(config: RunConfig, folder: Path) -> Recording:
    try:
        return open_recording(config.recording, folder)
    except ConfigurationError as error:
        raise error.under("recording") from None


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


def commands_csv(steps: Sequence[Step]) -> str:
    """Give one row a command: stamp, twist [m/s, rad/s], gripper, mode, reason."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["stamp", "vx", "vy", "vz", "wx", "wy", "wz", "gripper", "mode", "reason"])
    for step in steps:
        if (command := step.command) is None:
            continue
        twist = command.twist
        numbers = [*twist.linear, *twist.angular] if twist else [""] * 6
        cells = [f"{n:.6g}" if isinstance(n, float) else n for n in (*numbers, command.gripper)]
        writer.writerow([f"{step.stamp:.6f}", *cells, command.mode, command.reason])
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


def _tell(total: Mapping[str, Any], took: float) -> None:
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
