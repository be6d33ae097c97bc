"""Runs a pipeline on a recording or in a scene, as one YAML file describes both."""

import json
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, WritingError, naming
from contactfusion.files import make_folder, write_whole
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Recording
from contactfusion.replaying.configuration import read_fields
from contactfusion.replaying.tally import Tally
from contactfusion.results import (
    COLUMNS,
    COMMAND_COLUMNS,
    command_rows,
    contact_rows,
    table_file,
)
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
    events: list[dict[str, Any]] = []
    last: Step | None = None
    stopped: BaseException | None = None
    start = time.perf_counter()

    def note_events(step: Step) -> None:
        for event in step.events:
            told = {"stamp": step.stamp, "kind": str(event.kind), "message": event.message}
            events.append(told)

    with ExitStack() as stack:
        stack.callback(pipeline.close)
        files = {"contacts.csv": (COLUMNS, contact_rows)}
        if config.controller is not None:
            files["commands.csv"] = COMMAND_COLUMNS, command_rows
        tables = [stack.enter_context(table_file(out / n, *made)) for n, made in files.items()]
        observers = [Observer(tally.add, summary.add), Observer(step=note_events), *tables]
        try:
            played = play(pipeline, source, observers)
            for step in followed(played, f"running {path}", source.end):
                last = step
        except (WritingError, OSError):  # it names the file
            raise
        except (Exception, KeyboardInterrupt) as error:
            if last is None:
                raise
            stopped = error
        took = time.perf_counter() - start
    for line in (*summary.lines(), f"ran for {took:.1f} s", *watch.lines()):
        note(line)
    total = {**summary.fields(), "events": events}
    if scene and last and stopped is None:
        verdict = scene.verdict(pipeline, last)
        total["truth"] = verdict.truth
        for sentence in verdict.sentences:
            note(f"truth: {sentence}")
    write_whole(out / "summary.json", json.dumps(total, indent=2) + "\n")
    print(f"results: {', '.join(str(out / name) for name in (*files, 'summary.json'))}")
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
