"""One grasp of the experiment: its outcome, as one row."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation

from contactfusion.errors import ConfigurationError
from contactfusion.pipeline import Pipeline
from contactfusion.robots.model import shared_robot
from contactfusion_lab.experiments.grasp.plan import Column, Grasp, Plan
from contactfusion_lab.scenes.grasp.scene import GraspCycle, GraspScene, grasped, result_of


@dataclass(frozen=True)
class Row:
    """The outcome of one grasp.

    Attributes:
        trial: its name.
        column: by what it was felt.
        object: by name.
        seed: of the grasp.
        offset: lateral offset of the object from the hand's path, to the left [m].
        yaw: how far it was turned [degrees].
        success: the object was lifted, and held to the end.
        ending: of the controller, or "timeout".
        reason: why, in its words.
        height: how much higher the object was in the end [m].
        moved: how far it had been moved before the gripper closed for the last time [m].
        fallen: whether it has fallen over, and lies there.
        corrections: how often the hand went back.
        time: it took [s].
        force: the greatest that pushed the robot on its path to the object: the sum over all that
            touched it [N].
    """

    trial: str
    column: str
    object: str
    seed: int
    offset: float
    yaw: float
    success: bool
    ending: str
    reason: str
    height: float
    moved: float
    fallen: bool
    corrections: int
    time: float
    force: float
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid")


def begun(plan: Plan, column: Column, grasp: Grasp) -> tuple[GraspScene, Iterator[GraspCycle]]:
    """The scene of a grasp at its start, and the cycles in which a column makes it.

    Raises:
        ContactFusionError: the scene cannot be set up, or the controller failed.
    """
    config = plan.pipeline_of(column, grasp.seed)
    assert config.robot is not None
    scene = GraspScene(plan.scene_of(column, grasp), shared_robot(config.robot), grasp.seed)
    return scene, grasped(scene, Pipeline(config))


def run_trial(plan: Plan, column: Column, grasp: Grasp) -> Row:
    """Grasp once.

    Raises:
        ContactFusionError: the scene cannot be set up, or the controller failed.
    """
    _, cycles = begun(plan, column, grasp)
    return row_of(plan, column, grasp, list(cycles))


def row_of(plan: Plan, column: Column, grasp: Grasp, cycles: Sequence[GraspCycle]) -> Row:
    """Measure a grasp of which all cycles are there."""
    scene, first, last = plan.scenes[grasp.object], cycles[0].truth, cycles[-1]
    believed = scene.object.pose.pose()
    turned = Rotation.from_matrix(first.object[:3, :3] @ believed[:3, :3].T).as_euler("zyx")
    result = result_of(cycles, scene.lifted, scene.held)
    return Row(
        trial=grasp.name,
        column=column.name,
        object=grasp.object,
        seed=grasp.seed,
        offset=float((first.object - believed)[:3, 3] @ first.tool[:3, 0]),
        yaw=float(np.degrees(turned[0])),
        success=result.success,
        ending=last.ending,
        reason=last.step.command.reason if last.step.command else "",
        height=result.height,
        moved=result.moved,
        fallen=result.fallen,
        corrections=result.corrections,
        time=result.time,
        force=result.force,
    )


def content_of(row: Row) -> bytes:
    """The JSON file of a row."""
    return (json.dumps(asdict(row), indent=1) + "\n").encode()


def load(path: Path, column: Column, grasp: Grasp) -> Row:
    """Read a row.

    Args:
        path: its file.
        column: by what it was felt.
        grasp: which.

    Raises:
        ConfigurationError: the file holds no grasp of this experiment, or another one.
    """
    remedy = "remove it, so that it is made again"
    try:
        row = TypeAdapter(Row).validate_json(path.read_bytes())
    except ValidationError:
        raise ConfigurationError(f"{path} is no grasp of this experiment: {remedy}") from None
    if (row.trial, row.column, row.seed) != (grasp.name, column.name, grasp.seed):
        raise ConfigurationError(
            f"{path} is {row.column}/{row.trial} of seed {row.seed}, "
            f"not {column.name}/{grasp.name} of seed {grasp.seed}: {remedy}"
        )
    return row
