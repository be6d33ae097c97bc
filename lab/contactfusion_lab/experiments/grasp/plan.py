"""The grasps of the experiment, the sensing of each column, and the file that describes them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from contactfusion.assembly import built_controller, built_generator
from contactfusion.controllers.grasp_parameters import ReactiveGraspConfig
from contactfusion.errors import ConfigurationError, PluginError, RobotError, name_hint
from contactfusion.faults import Fault
from contactfusion.model import rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.readings import DepthImage, PointCloud
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.scenes.grasp.config import GraspConfig
from contactfusion_lab.scenes.grasp.placing import check_names

DEFAULT = Path(__file__).with_name("grasp.yaml")
NONE, ALL = "none", "all"
"""Names of no sources, with which the hand moves forward and closes, and of all sources."""
REACTIVE = "reactive_grasp"
"""Controller that can run open-loop."""
TRIALS = 4
"""Counts up when trials change, so that old ones are not taken for new."""
PLACES: Any = {"object": {"folder"}, "surroundings": {"__all__": {"folder"}}}
"""Fields left out of the settings: the folder of a checkout changes no grasp."""
OTHERWISE: Any = {
    "generators": True, "integrator": True, "controller": True, "faults": True, "seed": True,
    "folder": True, "robot": {"folder"},
}  # fmt: skip
"""Fields left out of the settings: held by column, or without effect on a grasp."""


@dataclass(frozen=True)
class Column:
    """The sensing of a hand: its sources, and the fusion method.

    Attributes:
        sources: names or types of generators with "+" between them, `none` or `all`.
        method: the rule and the condensation.
    """

    sources: str
    method: Method

    @property
    def name(self) -> str:
        """Name of the column and of its folder."""
        return self.sources if self.sources == NONE else f"{self.sources}-{self.method.stem}"


@dataclass(frozen=True)
class Grasp:
    """One grasp of the experiment, the same for all columns.

    Attributes:
        object: the name of the object.
        repeat: counted from 0.
        seed: of all random draws.
    """

    object: str
    repeat: int
    seed: int

    @property
    def name(self) -> str:
        """Name of the grasp and of its file."""
        return f"{self.object}-{self.repeat:03d}"


@dataclass(frozen=True)
class Plan:
    """An experiment.

    Attributes:
        pipeline: all generators, and the controller.
        scenes: the scene of each object, by its name.
        seed: of all random draws.
    """

    pipeline: PipelineConfig
    scenes: Mapping[str, GraspConfig]
    seed: int

    def grasps(self, objects: Sequence[str], repeats: int) -> list[Grasp]:
        """All grasps; more repeats leave the others unchanged."""
        return [
            Grasp(name, repeat, self._seed(name, repeat))
            for repeat in range(repeats)
            for name in objects
        ]

    def pipeline_of(self, column: Column, seed: int = 0) -> PipelineConfig:
        """The pipeline of a column.

        Args:
            column: its sensing.
            seed: of the random draws in faults.

        Raises:
            ConfigurationError: one of its sources is unknown, or there is no open loop of the
                controller.
        """
        known, controller = self.pipeline.generators, dict(self.pipeline.controller or {})
        if column.sources == NONE:
            controller |= self._open_loop()
        chosen = chosen_sources(column.sources, known)
        if controller.get("type") == REACTIVE and not _weighs(controller, chosen, known):
            controller.pop("wrist", None)
        update = {
            "generators": {name: known[name] for name in chosen},
            "integrator": column.method.applied(self.pipeline.integrator),
            "controller": controller,
            "seed": seed,
        }
        return self.pipeline.model_copy(update=update)

    def _open_loop(self) -> dict[str, Any]:
        """Options of the open-loop controller: it closes where the object should stand."""
        fields = dict(self.pipeline.controller or {})
        kind = fields.pop("type", None)
        if kind != REACTIVE:
            raise ConfigurationError(
                f"open loop, '{NONE}', is for {REACTIVE}, not for '{kind}': choose other sources",
                "sources",
            )
        depth = ReactiveGraspConfig(**fields).depth
        nearest = min(scene.distance for scene in self.scenes.values())
        return {"corrections": 0, "reach": nearest - depth}

    def scene_of(self, column: Column, grasp: Grasp) -> GraspConfig:
        """The scene of a grasp; cameras that no generator uses are off."""
        scene, known = self.scenes[grasp.object], self.pipeline.generators
        plugins = installed_plugins()
        readings = {
            reading
            for name in chosen_sources(column.sources, known)
            for reading in plugins.find("generators", known[name]["type"]).readings
        }
        looks = readings & {PointCloud, DepthImage}
        return scene if looks else scene.model_copy(update={"camera_rate": 0.0})

    def settings(self, columns: Sequence[Column]) -> dict[str, Any]:
        """The settings of which trials are a function: with equal ones a folder is resumed."""
        return {
            "trials": TRIALS,
            "seed": self.seed,
            "faults": [fault.model_dump(mode="json") for fault in self.pipeline.faults],
            "columns": {
                column.name: self.pipeline_of(column).model_dump(
                    mode="json", include={"generators", "integrator", "controller"}
                )
                for column in columns
            },
            "objects": {
                name: {**scene.model_dump(mode="json", exclude=PLACES), "file": _digest(scene)}
                for name, scene in self.scenes.items()
            },
            "pipeline": self.pipeline.model_dump(mode="json", exclude=OTHERWISE),
        }

    def _seed(self, name: str, repeat: int) -> int:
        entropy = [self.seed, crc32(name.encode()), repeat]
        return int(np.random.SeedSequence(entropy).generate_state(1)[0])


def _digest(scene: GraspConfig) -> str:
    """The SHA-256 of the URDF of an object; empty when it has none."""
    if scene.object.urdf is None:
        return ""
    path = RobotConfig(urdf=scene.object.urdf, folder=scene.object.folder).path()
    return sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def _weighs(
    controller: Mapping[str, Any], chosen: Sequence[str], known: Mapping[str, Mapping[str, Any]]
) -> bool:
    """Whether a chosen source reads the sensor by which the controller weighs its load."""
    sensor = (controller.get("wrist") or {}).get("sensor")
    return any(known[name].get("sensor") == sensor for name in chosen)


def chosen_sources(sources: str, known: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The generators that sources name, in their order in the file.

    Args:
        sources: names or types with "+" between them, `none` or `all`.
        known: the options of all generators, by name.

    Raises:
        ConfigurationError: there is no such generator, nor any of such a type, or one stands twice.
    """
    if sources in (NONE, ALL):
        return list(known) if sources == ALL else []
    parts = sources.split("+")
    names = {*known, *(options["type"] for options in known.values()), NONE, ALL}
    for part in parts:
        if parts.count(part) > 1:
            raise ConfigurationError(f"'{part}' stands twice in '{sources}'", "sources")
        if part in (NONE, ALL):
            raise ConfigurationError(f"'{part}' stands alone, not in '{sources}'", "sources")
        if part not in names:
            hint = name_hint(part, names, "generators and their types")
            raise ConfigurationError(f"unknown source '{part}': {hint}", "sources")
    return [name for name, options in known.items() if {name, options["type"]} & {*parts}]


def read_plan(
    path: Path, names: Sequence[str], faults: Sequence[Fault], noise: str | None, seed: int
) -> Plan:
    """Put an experiment together.

    Args:
        path: a YAML file as for `run`, with a scene of type `grasp`, and in `objects` by name what
            each object changes of the scene.
        names: names of these objects; none: the first.
        faults: how sensors fail, besides those of the file.
        noise: of the sensors, by name; None: the scene's.
        seed: of all random draws.

    Raises:
        ConfigurationError: the file, an object, the controller or the noise is not what it should
            be, or the robot lacks what a scene names.
    """
    path = path.resolve()
    fields = read_yaml(path)
    scene, objects = fields.pop("scene", None), fields.pop("objects", None)
    try:
        if not isinstance(scene, dict) or not isinstance(objects, dict) or not objects:
            raise ConfigurationError("give a scene of type grasp, and objects by name", "objects")
        known: dict[str, Any] = objects
        _check_objects(known)
        for name in names:
            if name not in known:
                hint = name_hint(name, known, "objects")
                raise ConfigurationError(f"unknown object '{name}': {hint}", "objects")
        pipeline = PipelineConfig(**{"folder": path.parent, **fields})
        if pipeline.robot is None:
            raise ConfigurationError("a scene needs a robot by URDF", "robot")
        if pipeline.controller is None:
            raise ConfigurationError("a grasp needs a controller", "controller")
        _check_controller(pipeline)
        robot = _robot(pipeline)
        given = {"noise": noise} if noise else {}
        scenes = {}
        for name in names or [next(iter(known))]:
            try:
                config = rooted(GraspConfig(**{**scene, **known[name], **given}), path.parent)
                _check_scene(config, robot)
            except ConfigurationError as error:
                raise error.under(f"objects.{name}") from None
            scenes[name] = config
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    pipeline = pipeline.model_copy(update={"faults": (*pipeline.faults, *faults)})
    return Plan(pipeline, scenes, seed)


def check_columns(plan: Plan, columns: Sequence[Column], path: Path) -> None:
    """Make sure that what the columns need can be built, and that no two of them are the same.

    Args:
        plan: the experiment.
        columns: of its table.
        path: the file of the plan.

    Raises:
        ConfigurationError: a column is another's double, or one of its generators is not what it
            should be.
    """
    known, names = plan.pipeline.generators, dict[Any, str]()
    for column in columns:
        chosen = chosen_sources(column.sources, known)
        # with no sources at all the controller is another
        kind = (*chosen, column.sources == NONE, column.method)
        same = names.setdefault(kind, column.sources)
        if same != column.sources:
            raise ConfigurationError(f"'{column.sources}' is the same as '{same}'", "sources")
        try:
            _check_generators(plan.pipeline, chosen)
            _check_controller(plan.pipeline_of(column))
        except ConfigurationError as error:
            raise ConfigurationError(f"{path}: {error}") from None


def _check_objects(objects: Mapping[str, Any]) -> None:
    """Make sure that names of objects can be those of files, and that each is a mapping."""
    for name, changes in objects.items():
        if name.startswith(".") or "/" in name or "\\" in name:
            raise ConfigurationError(
                "its grasps are files of that name: it may hold no slash, nor begin with a dot",
                f"objects.{name}",
            )
        if not isinstance(changes, dict):
            raise ConfigurationError(
                f"give by field what it changes of the scene, not {changes!r}", f"objects.{name}"
            )


def _check_controller(pipeline: PipelineConfig) -> None:
    try:
        built_controller(pipeline)
    except PluginError as error:
        raise ConfigurationError(str(error), "controller.type") from None


def _check_generators(pipeline: PipelineConfig, names: Sequence[str]) -> None:
    for name in names:
        try:
            built_generator(name, pipeline.generators[name], pipeline.folder, pipeline.robot)
        except PluginError as error:
            raise ConfigurationError(str(error), f"generators.{name}.type") from None


def _robot(pipeline: PipelineConfig) -> RobotModel:
    assert pipeline.robot is not None
    try:
        return shared_robot(pipeline.robot)
    except ConfigurationError as error:
        raise error.under("robot") from None
    except RobotError as error:
        raise ConfigurationError(str(error), "robot") from None


def _check_scene(config: GraspConfig, robot: RobotModel) -> None:
    try:
        check_names(config, robot)
    except RobotError as error:
        raise ConfigurationError(str(error), "tool") from None
    _check_shapes(config.object, "object")
    for name, body in config.surroundings.items():
        _check_shapes(body, f"surroundings.{name}")


def _check_shapes(config: ObjectConfig, path: str) -> None:
    """Make sure that the files of an object are there."""
    try:
        ObjectModel(config)
    except ConfigurationError as error:
        raise error.under(path) from None
    except RobotError as error:
        raise ConfigurationError(str(error), path) from None
