"""The configuration of a pipeline: named generators, frames, a surface, the integrator."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, name_hint, naming
from contactfusion.faults import FaultConfig
from contactfusion.files import file_in
from contactfusion.frames import FrameConfig, FrameTree
from contactfusion.integrator.config import PARTS, IntegratorConfig
from contactfusion.model import Model, rooted
from contactfusion.preset import preset_named
from contactfusion.robots.description import (
    EffortConfig,
    LinkMassConfig,
    PayloadConfig,
    RobotConfig,
    read_robot,
)
from contactfusion.shapes import BodyConfig
from contactfusion.units import Memory, Period
from contactfusion.yaml_files import read_yaml, with_overrides

NOT_OURS = ("recording", "scene", "live")
"""Fields of a file for `run` that are not of the pipeline."""


class CycleConfig(Model):
    """When the pipeline steps: exactly one of the three."""

    every: Period | None = Field(default=None, ge=1e-4)
    """Step at this period [s]."""
    on: str | None = None
    """Step after each reading of this sensor or type, e.g. `wrench`."""
    ready: bool = False
    """Step when every active source has reported (F §III-B)."""
    wait: Memory = Field(default=0.1, ge=0)
    """How long a reading waits for the transforms that place it, and how old transforms may be at a
    step [s]; on a running robot, and where a recording of one is played."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return {"ready": True} if value == "ready" else value

    @model_validator(mode="after")
    def _one_policy(self) -> Self:
        if (self.every is not None) + (self.on is not None) + self.ready != 1:
            fitting = f"{{on: {self.on}}}" if self.on else "ready"
            whole = f"; --set 'cycle={fitting}' replaces it whole" if self.model_fields_set else ""
            raise ValueError(f"give exactly one of: ready, every, on{whole}")
        return self


class IdentifiedRobot(Model):
    """What was identified of a robot; it replaces what the robot's description holds."""

    efforts: dict[str, EffortConfig] = Field(default_factory=dict)
    """Of the efforts that joints report, by joint."""
    masses: dict[str, LinkMassConfig] = Field(default_factory=dict)
    """Of links, in place of those of the URDF, by link."""
    payload: PayloadConfig | None = None
    """What it carries; None: that of the description."""


class IdentifiedConfig(Model):
    """What `contactfusion identify` writes; it replaces what is configured."""

    robot: IdentifiedRobot = Field(default_factory=IdentifiedRobot)
    """Of the robot."""
    generators: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Options of generators, by name."""

    def over(self, fields: Mapping[str, Any]) -> dict[str, Any]:
        """The fields of a configuration, whose robot is read, with what was identified.

        Raises:
            ConfigurationError: the configuration lacks the robot or a generator.
        """
        robot, generators = fields.get("robot"), _mapping(fields.get("generators"))
        for name in self.generators:
            if name not in generators:
                hint = name_hint(name, generators, "generators")
                raise ConfigurationError(
                    f"there is no such generator; {hint}", f"generators.{name}"
                )
        if self.generators:
            changed = {
                name: {**options, **self.generators.get(name, {})}
                if isinstance(options, Mapping)
                else options
                for name, options in generators.items()
            }
            fields = {**fields, "generators": changed}
        if self.robot == IdentifiedRobot():
            return dict(fields)
        if not isinstance(robot, RobotConfig):
            raise ConfigurationError("the configuration has no robot", "robot")
        update: dict[str, Any] = {
            "efforts": {**robot.efforts, **self.robot.efforts},
            "masses": {**robot.masses, **self.robot.masses},
        }
        if self.robot.payload is not None:
            update["payload"] = self.robot.payload
        return {**fields, "robot": robot.model_copy(update=update)}


class PipelineConfig(Model):
    """Everything between the sensors and the contacts."""

    preset: str | None = None
    """Options in place of defaults: `paper` for what the papers print; what is given here stays."""
    generators: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """By name: the `type` of the generator and its options."""
    integrator: IntegratorConfig = Field(default_factory=IntegratorConfig)
    """The fusion of hypotheses."""
    cycle: CycleConfig = Field(default_factory=lambda: CycleConfig(every=0.01))
    """When to step: `ready`, `{every: seconds}` or `{on: sensor or type}`."""
    frames: dict[str, FrameConfig] = Field(default_factory=dict)
    """Static frames, by name."""
    surface: BodyConfig | None = None
    """The surface of a robot that is one rigid body."""
    robot: RobotConfig | None = None
    """A robot by URDF, or the name of a file that describes it; MODULE:FILE for one in an installed
    Python package."""
    identified: IdentifiedConfig | None = None
    """What `contactfusion identify` measured, or the name of the file that it wrote; it replaces
    what robot and generators are given here."""
    controller: dict[str, Any] | None = None
    """The `type` of the controller and its options."""
    faults: tuple[FaultConfig, ...] = ()
    """Faults of sensors, in the order in which they act."""
    seed: int = Field(default=0, ge=0)
    """Of the random numbers of faults, and of a scene; equal seeds give equal numbers."""
    folder: Path = Path()
    """The folder of relative file names, also in options of plug-ins; `contactfusion run` takes
    that of the configuration."""
    files_within: Path | None = None
    """The folder that all files have to lie in, but for those of packages; None: anywhere. Of a
    configuration in a recording, it is the folder of the recording."""

    @model_validator(mode="before")
    @classmethod
    def _read(cls, fields: Any) -> Any:
        """Apply the preset; read the files of robot and identification, root the names in them."""
        if (preset := fields.get("preset")) is not None:
            fields = preset_named(str(preset)).beneath(fields)
        for name in ("folder", "files_within"):
            if not isinstance(given := fields.get(name, ""), str | Path | None):
                raise ConfigurationError(f"must be a path, not {given!r}", name)
        robot, folder = fields.get("robot"), Path(fields.get("folder") or "")
        within = Path(fields["files_within"]) if fields.get("files_within") is not None else None
        try:
            if isinstance(robot, str | Path):
                fields = {**fields, "robot": read_robot(robot, folder, within)}
            elif isinstance(robot, dict):
                fields = {**fields, "robot": rooted(RobotConfig(**robot), folder, within)}
        except ConfigurationError as error:
            raise error.under("robot") from None
        try:
            fields = with_identified(fields, folder, within)
            if (found := fields.get("identified")) is not None:
                if not isinstance(found, IdentifiedConfig | Mapping):
                    raise ConfigurationError(
                        f"takes a file, or fields such as `robot`, not {found!r}"
                    )
                if not isinstance(found, IdentifiedConfig):
                    found = IdentifiedConfig(**found)
                fields = found.over(fields)
        except ConfigurationError as error:
            raise error.under("identified") from None
        return fields

    @model_validator(mode="after")
    def _inside(self) -> Self:
        if self.surface is not None and self.surface.file is not None:
            try:
                file_in(self.folder, self.surface.file, self.files_within)
            except ConfigurationError as error:
                raise error.under("surface.file") from None
        return self

    @model_validator(mode="after")
    def _one_body(self) -> Self:
        if self.surface is not None and self.robot is not None:
            raise ConfigurationError("give a surface or a robot, not both", "robot")
        return self

    @model_validator(mode="after")
    def _typed(self) -> Self:
        for name, options in self.generators.items():
            if not isinstance(options.get("type"), str):
                raise ConfigurationError(
                    "name the type of the generator", f"generators.{name}.type"
                )
            if "/" in name or not name:
                problem = "a name may not hold a slash" if name else "a generator needs a name"
                raise ConfigurationError(problem, f"generators.{name}")
        if self.controller is not None and not isinstance(self.controller.get("type"), str):
            raise ConfigurationError("name the type of the controller", "controller.type")
        return self

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """The configuration in a YAML file, which may be one for `contactfusion run`.

        Args:
            path: the file; relative names in it start at its folder, and its recording or scene is
                ignored.

        Raises:
            ConfigurationError: the file is missing or no YAML, or a field is wrong; the sentence
                names the file.
        """
        path = Path(path)
        fields = {"folder": path.parent, **pipeline_fields(read_yaml(path))}
        with naming(path):
            return cls(**fields)

    def frame_tree(self) -> FrameTree:
        """The tree of the static frames.

        Raises:
            FrameError: the frames form a circle.
        """
        on_robot = self.robot.frames if self.robot else {}
        frames = {**on_robot, **self.frames}
        space = self.integrator.frame
        where = "`integrator.frame`"
        if "frame" not in self.integrator.model_fields_set:
            where = f"default of {where}"
        return FrameTree(
            {name: (frame.parent, frame.pose()) for name, frame in frames.items()},
            origins={space: f"the integrator's frame '{space}' ({where})"},
        )


def pipeline_fields(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a file for `run` that are of its pipeline."""
    return {name: value for name, value in fields.items() if name not in NOT_OURS}


def with_identified(
    fields: Mapping[str, Any], folder: Path, within: Path | None = None
) -> dict[str, Any]:
    """The fields of a configuration, with what is in the file of `identified` in its place.

    Args:
        fields: of a `PipelineConfig`.
        folder: that of a relative name.
        within: the folder that the file has to lie in; None: no limit.

    Raises:
        ConfigurationError: the file is missing, or no YAML.
    """
    found = fields.get("identified")
    if isinstance(found, str | Path):
        return {**fields, "identified": read_yaml(file_in(folder, found, within))}
    return dict(fields)


def overridden(fields: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """The fields of a configuration with single values changed.

    Args:
        fields: of a `PipelineConfig`; they stay as they are.
        overrides: such as `integrator.voxel_size=0.01`.

    Raises:
        ConfigurationError: one is no change, or is of a generator that does not exist.
    """
    identified = _mapping(fields.get("identified"))  # it would hide a change of what it holds
    placed = [f"identified.{each}" if _holds(identified, each) else each for each in overrides]
    changed = with_overrides(_with_types(fields, overrides), placed)
    known, held = _mapping(fields.get("generators")), _mapping(changed.get("generators"))
    for override in overrides:
        keys = override.partition("=")[0].strip().split(".")
        name = keys[1] if keys[0] == "generators" and len(keys) > 2 else ""
        if name in held and name not in known and "type" not in _mapping(held[name]):
            hint = name_hint(name, known, "generators")
            raise ConfigurationError(f"'{override}': there is no generator '{name}'; {hint}")
    return changed


def _holds(identified: Mapping[str, Any], override: str) -> bool:
    """Whether a change is of what was identified: of a field of the robot, or of an option."""
    keys = override.partition("=")[0].strip().split(".")
    held: Any = identified
    for key in keys:
        if isinstance(held, dict) and key not in held:
            return False
        held = held[key] if isinstance(held, dict) else held
    return len(keys) > (2 if keys[0] == "generators" else 1)


def _with_types(fields: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """The fields with a rule or condensation as a mapping, where a change is of its options."""
    integrator = dict(_mapping(fields.get("integrator")))
    for part in PARTS:
        changed = any(change.lstrip().startswith(f"integrator.{part}.") for change in overrides)
        if changed and isinstance(name := integrator.get(part), str):
            integrator[part] = {"type": name}
    return {**fields, "integrator": integrator} if integrator else dict(fields)


def _mapping(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
