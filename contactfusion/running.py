"""Runs a pipeline on a recording or in a scene, as one YAML file describes both."""

import json
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, FrameError, PluginError, name_hint
from contactfusion.files import make_folder, write_whole
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import READING_TYPES, Reading
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Recording
from contactfusion.run_results import commands_csv, contacts_csv, summary, tell
from contactfusion.simulation.scene import heard
from contactfusion.step_summary import Summary
from contactfusion.transforms import transforms_ahead
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
    fields = run_fields(path, overrides, seed)
    with naming(path):
        config = RunConfig(**fields)
        scene = opened_scene(config) if config.scene else None
        source = scene or _recording(config, path.parent)
        pipeline = Pipeline(config)
    make_folder(out)
    counts: Counter[tuple[str, type[Reading]]] = Counter()

    def hear(reading: Reading) -> None:
        counts[reading.sensor, type(reading)] += 1

    start = time.perf_counter()
    try:
        if isinstance(source, Recording):
            steps = list(pipeline.run(heard(transforms_ahead(source.readings()), hear)))
        else:
            steps = list(source.run(pipeline, hear))
    finally:
        pipeline.close()
    took = time.perf_counter() - start
    write_whole(out / "contacts.csv", contacts_csv(steps))
    total = summary(steps)
    tell(total, took)
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
    if faults := list(unheard(pipeline, counts, Summary.of(steps))):
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ConfigurationError(f"{path}: {faults[0]}{more}")


def run_fields(path: Path, overrides: Sequence[str], seed: int | None = None) -> dict[str, Any]:
    """Read the fields of `RunConfig` from a YAML file.

    Args:
        path: the file; relative names in it start at its folder.
        overrides: fields to change, as "a.b=c".
        seed: in place of the file's; None: that of the file.

    Raises:
        ConfigurationError: the file is missing or no YAML, or a change is none.
    """
    fields = {"folder": path.parent, **with_overrides(read_yaml(path), overrides)}
    return fields if seed is None else {**fields, "seed": seed}


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in what is said of a wrong configuration.

    Raises:
        ConfigurationError: in place of the error that does not name it.
    """
    try:
        yield
    except (ConfigurationError, FrameError, PluginError) as error:
        raise ConfigurationError(f"{path}: {error}") from None


def opened_scene(config: RunConfig) -> "Scene":
    """Open the scene of a configuration.

    Raises:
        ConfigurationError: the description of the scene or of the robot is wrong.
        DependencyError: pybullet, or what the robot needs, is not installed.
    """
    # only here: a recording needs no physics
    from contactfusion.simulation.opening import open_scene

    assert config.robot is not None
    return open_scene(config.scene, config.robot, config.seed, config.folder)


def unheard(
    pipeline: Pipeline, counts: Mapping[tuple[str, type[Reading]], int], gave: Summary
) -> Iterator[str]:
    """Say what the pipeline waited for in vain.

    Args:
        pipeline: after its run.
        counts: how many readings came, by sensor and type.
        gave: what its steps amounted to.

    Yields:
        A sentence for each thing that kept the job from being done.
    """
    sensors = {sensor for sensor, _ in counts}
    on = pipeline.config.cycle.on
    if on is not None and not gave.steps:
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
    for name, source in gave.report.sources.items() if gave.report else ():
        if source.invalid and not source.accepted:
            yield f"every cloud of '{name}' was refused: {gave.refusal(name)}"


def _recording(config: RunConfig, folder: Path) -> Recording:
    try:
        return open_recording(config.recording, folder)
    except ConfigurationError as error:
        raise error.under("recording") from None
