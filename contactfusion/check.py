"""Builds all that a configuration names, and reports what it holds and lacks."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.assembly import (
    built_controller,
    built_generator,
    described_options,
    generator_class,
)
from contactfusion.errors import ConfigurationError, ContactFusionError, PluginError, name_hint
from contactfusion.estimate import HYPOTHESIS, SAMPLE, counted, size
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import NOT_OURS, PipelineConfig, pipeline_fields
from contactfusion.readings import Reading
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.opening import open_recording
from contactfusion.run.configuration import RunConfig, Setting, setting_of_file
from contactfusion.run.joining import joined
from contactfusion.run.session import Session, stream_of
from contactfusion.run.summary import (
    NO_EVIDENCE,
    NO_GENERATORS,
    lacks_evidence,
    refused_at_once,
)
from contactfusion.stream import Stream

SLACK = 0.1
"""A joint that is `still` may stand so far beyond its limits, as recorded ones do [rad, m]."""


@final
@dataclass(frozen=True)
class Check:
    """What a configuration holds, and what is wrong with it.

    Attributes:
        lines: the report.
        faults: a sentence for each fault; empty where it can run.
    """

    lines: tuple[str, ...]
    faults: tuple[str, ...]


def check_file(
    path: str | Path,
    recording: str | Path | None = None,
    overrides: Sequence[str] = (),
    topics: Mapping[str, str] | None = None,
) -> Check:
    """Check a configuration: build everything, play no more than the beginning of a recording.

    Args:
        path: a YAML file of a pipeline, with or without a recording or a scene.
        recording: what is played in place of the file's own recording or scene.
        overrides: fields to change, as "a.b=c".
        topics: topics of the recording by role.

    Raises:
        ConfigurationError: the file is missing or no YAML, or a change is none.
    """
    path, recording = Path(path), None if recording is None else Path(recording)
    setting = setting_of_file(path, overrides)
    fields = {"folder": setting.folder, **setting.fields}
    if recording is not None:
        fields = pipeline_fields(fields)
    checking = _Checking(fields)
    try:
        checking.build()
        checking.open_stream(setting.choosing(topics or {}, ()), recording)
        lines = list(checking.report()) if not checking.faults else []
    finally:
        checking.close()
    faults = dict.fromkeys(f"{path}: {fault}" for fault in checking.faults)
    return Check(tuple(lines), tuple(faults))


class _Checking:
    """Builds piece by piece, and goes on where one is faulty.

    Args:
        fields: of `RunConfig`, or of `PipelineConfig`.
    """

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self.faults: list[str] = []
        self._fields = dict(fields)
        self._sources: list[str] = []
        self._pipeline: Pipeline | None = None
        self._config = self._configured()

    def build(self) -> None:
        """Build robot, surface, fusion, controller and generators."""
        config = self._config
        with self._gathering("robot"):
            self._check_robot()
        robotless = any(fault.startswith("robot") for fault in self.faults)
        bare: dict[str, Any] = {"generators": {}, "controller": None}
        with self._gathering(""):
            self._pipeline = Pipeline(
                config.model_copy(update=bare | ({"robot": None} if robotless else {}))
            )
        with self._gathering("controller"):
            built_controller(config)
        for name, options in config.generators.items():
            if robotless and _names_robot(options):
                continue  # the robot's fault is reported already
            with self._gathering(f"generators.{name}"):
                if self._pipeline:
                    self._pipeline.plug(name, options)
                else:
                    built_generator(name, options, config.folder, config.robot)

    def open_stream(self, setting: Setting, recording: Path | None) -> None:
        """Open what is played; find topics for the generators, and frames for their sensors."""
        config = self._config
        if recording is None and not isinstance(config, RunConfig):
            return
        is_scene = isinstance(config, RunConfig) and bool(config.scene)
        if is_scene and self.faults:
            return
        if not self._fields.get("generators"):
            self.faults.append(NO_GENERATORS)
        with self._gathering("scene" if is_scene else str(recording or "recording")):
            if recording is not None:
                stream: Stream = open_recording(recording)
            else:
                assert isinstance(config, RunConfig)
                stream = stream_of(config)
            if is_scene:
                self._sources.append(f"scene: {setting.fields['scene'].get('type')}")
                stream.close()
            elif self.faults:
                with closing(stream):
                    self.faults += self._unheard(stream.topics)
            else:
                self._match(setting, stream)

    def _match(self, setting: Setting, stream: Stream) -> None:
        """Find topics for the generators, and frames for their sensors."""
        with closing(Session(setting, stream)) as session:
            recording, inputs = session.stream, session.inputs
            self.faults += inputs.missing
            held = {
                sensor: recording.topics[name]
                for topic, sensor in inputs.sensors.items()
                for name in (topic, sensor)  # a part of a ROS recording has sensors, others
                if name in recording.topics  # topics
            }
            self.faults += self._unheard(held)
            self._sources.append(f"recording: {_listing(held)}")
            self._sources += inputs.taken
            if not self.faults:
                self._join(session.pipeline, recording)
            if not self.faults:
                with self._gathering(""):
                    self.faults += refused_at_once(session.pipeline, session.readings())

    def _join(self, pipeline: Pipeline, recording: Stream) -> None:
        """Find the places of all frames."""
        joining = joined(pipeline, recording)
        self.faults += joining.faults
        self._sources += filter(None, (joining.misplaced,))

    def report(self) -> Iterator[str]:
        """What was built, line by line."""
        config, pipeline = self._config, self._pipeline
        assert pipeline is not None
        fusion = config.integrator
        yield (
            f"frame '{fusion.frame}', voxels of {fusion.voxel_size * 1e3:g} mm; rule "
            f"{fusion.rule}, condensation {fusion.condensation}; a step {_cycle(config)}"
        )
        for name, frame in config.frames.items():
            yield f"frame '{name}' in '{frame.parent}' at {frame.xyz} m"
        for name, generator in pipeline.generators.items():
            kinds = " or ".join(kind.__name__ for kind in generator.readings)
            whose = f" of '{generator.config.sensor}'" if generator.config.sensor else ""
            gives = ", ".join(f"'{source}' ({kind})" for source, kind in generator.sources.items())
            kind = config.generators[name]["type"]
            yield f"generator '{name}' ({kind}): {kinds}{whose} -> {gives}"
        if lacks_evidence(pipeline):
            yield NO_EVIDENCE
        points = 0
        if config.robot is not None:
            model = self._robot()
            points = sum(len(part.points) for part in model.parts.values())
            yield (
                f"robot {config.robot.urdf}: root '{model.root}', {len(model.link_names)} links, "
                f"{len(model.joint_names)} joints, {points} points of surface"
            )
        elif config.surface is not None:
            sampled = config.surface.sampled(config.folder).points
            points = len(sampled)
            yield f"surface: {points} points in '{config.surface.frame}', {_extent(sampled)}"
        if config.controller is not None:
            yield f"controller {config.controller['type']}"
        for fault in config.faults:
            yield f"fault {fault.model_dump()['fault']} of {fault.sensor or 'all sensors'}"
        yield from self._sources
        yield from self._estimate(points)

    def close(self) -> None:
        """End the processes of isolated generators."""
        if self._pipeline:
            self._pipeline.close()

    def _configured(self) -> PipelineConfig:
        """The configuration of all fields that are not faulty."""
        fields = {k: v for k, v in self._fields.items() if v or k not in NOT_OURS}
        while True:
            sources = fields.keys() & set(NOT_OURS)
            try:
                return (RunConfig if sources else PipelineConfig)(**fields)
            except ConfigurationError as error:
                roots = {fault: fault.path.split(".")[0] for fault in error.faults}
                gone = self._fields.keys() - fields.keys()  # what lacks them now is no fault
                self.faults += (str(fault) for fault, name in roots.items() if name not in gone)
                wrong = fields.keys() & roots.values() or sources
                if not wrong:
                    raise
                fields = {name: value for name, value in fields.items() if name not in wrong}

    @contextmanager
    def _gathering(self, path: str) -> Iterator[None]:
        """Keep the faults that building something meets, as seen from the whole file."""
        try:
            yield
        except ConfigurationError as error:
            self.faults += (
                str(fault if fault.path.startswith(path) else fault.under(path))
                for fault in error.faults
            )
        except ContactFusionError as error:
            self.faults.append(f"{path}: {error}" if path else str(error))

    def _robot(self) -> Any:
        from contactfusion.robots.model import shared_robot

        assert self._config.robot is not None
        return shared_robot(self._config.robot)

    def _check_robot(self) -> None:
        """Sample the surface, and look at the joints that stay where the description says."""
        if self._config.robot is None:
            return
        model = self._robot()
        _ = model.parts
        limits = dict(zip(model.joint_names, model.limits, strict=True))
        for name, position in self._config.robot.still.items():
            low, high = limits[name]
            if not low - SLACK <= position <= high + SLACK:
                raise ConfigurationError(
                    f"{position:g} lies beyond the joint's limits, {low:.3f} .. {high:.3f} "
                    "[rad, m]",
                    f"still.{name}",
                )

    def _unheard(self, held: Mapping[str, type[Reading]]) -> Iterator[str]:
        """What the cycle and the faults wait for in vain."""
        known = {*held, *installed_kinds().among(held.values())}
        hint = partial(name_hint, known=known, what="sensors and types")
        on = self._config.cycle.on
        if on is not None and on not in known:
            yield f"cycle.on: the recording holds no '{on}'; {hint(on)}"
        for number, fault in enumerate(self._config.faults):
            if fault.sensor is not None and fault.sensor not in known:
                yield (
                    f"faults.{number}.sensor: the recording holds no '{fault.sensor}'; "
                    f"{hint(fault.sensor)}"
                )

    def _estimate(self, points: int) -> Iterator[str]:
        """How much memory surface and clouds will take, and over how many voxels they reach."""
        config, pipeline = self._config, self._pipeline
        assert pipeline is not None
        body = config.robot or config.surface
        if body is not None:
            voxels = points * (body.spacing / config.integrator.voxel_size) ** 2
            yield (
                f"estimate: {counted(points)} points of surface over {counted(voxels)} voxels, "
                f"{size(points * SAMPLE)}"
            )
        for name, generator in pipeline.generators.items():
            most = generator.most_hypotheses(pipeline.grid)
            if most is not None:
                yield (
                    f"estimate: clouds of '{name}' hold up to {counted(most)} hypotheses, "
                    f"{size(most * HYPOTHESIS)}"
                )


def _names_robot(options: Mapping[str, Any]) -> bool:
    """Whether an option is a name from the robot's description."""
    try:
        described = described_options(generator_class(options["type"]).Config)
    except PluginError:
        return False  # the type is reported by itself
    return any(isinstance(options.get(option), str | list) for option in described)


def _cycle(config: PipelineConfig) -> str:
    cycle = config.cycle
    if cycle.every is not None:
        return f"every {cycle.every:g} s"
    return f"after each reading of '{cycle.on}'" if cycle.on else "when every source has reported"


def _extent(points: FloatArray) -> str:
    """From where to where points reach, axis by axis."""
    ends = np.round([points.min(axis=0), points.max(axis=0)], 3) + 0.0  # no -0.000
    axes = (f"{axis} {low:.3f}..{high:.3f}" for axis, low, high in zip("xyz", *ends, strict=True))
    return ", ".join(axes) + " m"


def _listing(held: Mapping[str, type[Reading]]) -> str:
    return ", ".join(f"'{sensor}' ({kind.__name__})" for sensor, kind in held.items()) or "nothing"
