"""Runs a pipeline on a recording or in a scene, as one YAML file describes both."""

import csv
import io
import json
import math
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import Field, model_validator

from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError, FrameError, PluginError, name_hint
from contactfusion.files import make_folder, write_whole
from contactfusion.frames import points_in, vectors_in
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import READING_TYPES, Reading
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Recording
from contactfusion.yaml_files import read_yaml, with_overrides

if TYPE_CHECKING:
    from contactfusion.simulation.touch import TouchScene
    from contactfusion.simulation.touch_world import Touching


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
    """Run what a YAML file describes; write contacts.csv and summary.json.

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
    heard: Counter[tuple[str, type[Reading]]] = Counter()
    start = time.perf_counter()
    try:
        steps = list(pipeline.run(_counted(source.readings(), heard)))
    finally:
        pipeline.close()
    took = time.perf_counter() - start
    write_whole(out / "contacts.csv", contacts_csv(steps))
    total = summary(steps)
    _tell(total, took)
    if scene and steps:
        truth = true_contacts(scene, pipeline, steps[-1].stamp)
        total["truth"] = {
            "frame": config.integrator.frame,
            "places": truth.places.tolist(),
            "forces": truth.forces.tolist(),
            "links": list(truth.links),
        }
        for line in compared(truth, steps[-1].fusion.contacts):
            print(f"truth: {line}")
    write_whole(out / "summary.json", json.dumps(total, indent=2) + "\n")
    print(f"results: {out / 'contacts.csv'}, {out / 'summary.json'}")
    if faults := list(unheard(pipeline, heard, steps)):
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ConfigurationError(f"{path}: {faults[0]}{more}")


def unheard(
    pipeline: Pipeline, heard: Mapping[tuple[str, type[Reading]], int], steps: Sequence[Step]
) -> Iterator[str]:
    """Say what the pipeline waited for in vain.

    Args:
        pipeline: after its run.
        heard: how many readings came, by sensor and type.
        steps: what it gave.

    Yields:
        A sentence for each thing that kept the job from being done.
    """
    sensors = {sensor for sensor, _ in heard}
    on = pipeline.config.cycle.on
    if on is not None and not steps:
        hint = name_hint(on, sensors | set(READING_TYPES), "sensors and types")
        yield f"cycle.on: no reading of '{on}' came; {hint}"
    if not pipeline.config.generators:
        yield "generators: none are configured, so nothing can be found"
    for name, generator in pipeline.generators.items():
        fit = [sensor for sensor, kind in heard if issubclass(kind, generator.readings)]
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


def true_contacts(scene: "TouchScene", pipeline: Pipeline, stamp: float) -> "Touching":
    """Give where the robot is really touched when its scene ends, in the space's frame.

    Args:
        scene: after its last reading.
        pipeline: which took its readings.
        stamp: when the scene ended [s].

    Raises:
        FrameError: nothing joins the robot's root link to the space.
    """
    truth, state = scene.truth.contacts, pipeline.state(stamp)
    pose = state.frames.pose(state.grid.frame, of=scene.robot.root)
    places, forces = points_in(pose, truth.places), vectors_in(pose, truth.forces)
    return replace(truth, places=places, forces=forces)


def compared(truth: "Touching", contacts: Sequence[Contact]) -> Iterator[str]:
    """Say what really happened, and how near contacts came; one sentence for each true contact.

    Args:
        truth: in the frame of the contacts.
        contacts: of the last step.
    """
    found = np.reshape([contact.position for contact in contacts], (-1, 3))
    for place, link in zip(truth.places, truth.links, strict=True):
        x, y, z = place
        away = np.linalg.norm(found - place, axis=1).min(initial=np.inf) * 1000.0
        near = f"nearest contact {away:.0f} mm away" if contacts else "no contact was found"
        yield f"{link} touched at ({x:.3f}, {y:.3f}, {z:.3f}) m; {near}"
    if not truth.links and contacts:
        yield f"nothing was touched; contacts that are none: {len(contacts)}"
    elif not truth.links:
        yield "no contact, and none was there"


def _scene(config: RunConfig) -> "TouchScene":
    # only here: a recording needs no physics
    from contactfusion.simulation.opening import open_scene

    assert config.robot is not None
    return open_scene(config.scene, config.robot, config.seed, config.folder)


def _recording(config: RunConfig, folder: Path) -> Recording:
    try:
        return open_recording(config.recording, folder)
    except ConfigurationError as error:
        raise error.under("recording") from None


def _counted(
    readings: Iterable[Reading], heard: Counter[tuple[str, type[Reading]]]
) -> Iterator[Reading]:
    for reading in readings:
        heard[reading.sensor, type(reading)] += 1
        yield reading


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
