"""Reads a plan from its file, and looks for all that is wrong with it before a grasp is made."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from contactfusion.assembly import built_controller, built_generator
from contactfusion.errors import ConfigurationError, PluginError, RobotError, name_hint
from contactfusion.fault_config import Fault
from contactfusion.model import rooted
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.experiments.grasp.plan import NONE, Column, Plan, chosen_sources
from contactfusion_lab.scenes.grasp.config import GraspConfig
from contactfusion_lab.scenes.grasp.placing import check_names


def read_plan(
    path: Path, things: Sequence[str], faults: Sequence[Fault], noise: str | None, seed: int
) -> Plan:
    """Put an experiment together.

    Args:
        path: a YAML file as for `run`, with a scene of type `grasp`, and in `objects` by name what
            each object changes of the scene.
        things: names of these objects; none: the first.
        faults: how sensors fail, besides those of the file.
        noise: of the sensors, by name; None: the scene's.
        seed: of all chance.

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
        for name in things:
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
        for name in things or [next(iter(known))]:
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
    for name, one in config.surroundings.items():
        _check_shapes(one, f"surroundings.{name}")


def _check_shapes(config: ObjectConfig, path: str) -> None:
    """Make sure that the files of an object are there."""
    try:
        ObjectModel(config)
    except ConfigurationError as error:
        raise error.under(path) from None
    except RobotError as error:
        raise ConfigurationError(str(error), path) from None
