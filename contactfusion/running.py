"""Runs a pipeline on a recording or in a scene, as one YAML file describes both."""

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, naming
from contactfusion.files import make_folder, write_whole
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.play import Observer, play
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Recording
from contactfusion.replaying.configuration import read_fields
from contactfusion.replaying.tally import Tally
from contactfusion.run_results import commands_csv, contacts_csv
from contactfusion.scene import Scene, open_scene
from contactfusion.step_summary import Summary, refuse
from contactfusion.stopwatch import StopWatch
from contactfusion.terminal import followed, note, progress


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

    What was found before a plug-in or the recording broke off, or before an interrupt, is kept.

    Args:
        path: the file; relative names in it start at its folder.
        overrides: fields to change, as "a.b=c".
        out: the folder that takes the results.
        seed: in place of the file's; None: that of the file.

    Raises:
        ContactFusionError: the file, a plug-in, the recording or the scene is not what it should
            be, or something that the configuration needs never came.
        KeyboardInterrupt: the run was interrupted; what was found until then is kept.
    """
    fields = run_fields(path, overrides, seed)
    watch = StopWatch()
    with naming(path), progress(f"opening {path}"):
        config = RunConfig(**fields)
        scene = opened_scene(config) if config.scene else None
        source = scene or _recording(config, path.parent)
        pipeline = Pipeline(config, ask=watch.ask)
    make_folder(out)
    tally, summary = Tally(), Summary(pipeline)
    steps: list[Step] = []
    stopped: BaseException | None = None
    start = time.perf_counter()
    try:
        observers = Observer(tally.add, summary.add), Observer(step=steps.append)
        for _ in followed(play(pipeline, source, observers), f"running {path}", source.end):
            pass
    except (Exception, KeyboardInterrupt) as error:
        if not steps:
            raise
        stopped = error
    finally:
        pipeline.close()
    took = time.perf_counter() - start
    write_whole(out / "contacts.csv", contacts_csv(steps))
    for line in (*summary.lines(), f"ran for {took:.1f} s", *watch.lines()):
        note(line)
    events = [
        {"stamp": step.stamp, "kind": str(event.kind), "message": event.message}
        for step in steps
        for event in step.events
    ]
    total = {**summary.fields(), "events": events}
    results = [out / "contacts.csv", out / "summary.json"]
    if pipeline.config.controller is not None:
        results.insert(1, out / "commands.csv")
        write_whole(results[1], commands_csv(steps))
    if scene and steps and stopped is None:
        verdict = scene.verdict(pipeline, steps[-1])
        total["truth"] = verdict.truth
        for sentence in verdict.sentences:
            note(f"truth: {sentence}")
    write_whole(out / "summary.json", json.dumps(total, indent=2) + "\n")
    print(f"results: {', '.join(map(str, results))}")
    if stopped is not None:
        raise stopped
    refuse(path, summary.complaints(tally.kinds))


def run_fields(path: Path, overrides: Sequence[str], seed: int | None = None) -> dict[str, Any]:
    """Read the fields of `RunConfig` from a YAML file.

    Args:
        path: the file; relative names in it start at its folder.
        overrides: fields to change, as "a.b=c".
        seed: in place of the file's; None: that of the file.

    Raises:
        ConfigurationError: the file is missing, a recording, or no YAML, or a change is none.
    """
    fields = {"folder": path.parent, **read_fields(path, overrides)}
    return fields if seed is None else {**fields, "seed": seed}


def opened_scene(config: RunConfig) -> Scene:
    """Open the scene of a configuration.

    Raises:
        ConfigurationError: the description of the scene or of the robot is wrong.
        PluginError: the scene cannot be used.
        DependencyError: contactfusion-lab, or what the scene or the robot needs, is not installed.
    """
    assert config.robot is not None
    return open_scene(config.scene, config.robot, config.seed, config.folder)


def _recording(config: RunConfig, folder: Path) -> Recording:
    try:
        return open_recording(config.recording, folder)
    except ConfigurationError as error:
        raise error.under("recording") from None
