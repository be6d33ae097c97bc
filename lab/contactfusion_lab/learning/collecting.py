"""A lesson as it is lived: what LiDARs see of a push, and how the object truly touches."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.controllers.pushing import ARRIVED
from contactfusion.frames import points_in
from contactfusion.generators.network_card import KINDS
from contactfusion.generators.perceived import ROBOT
from contactfusion.generators.proximity import ProximityConfig, without
from contactfusion.pipeline import Pipeline
from contactfusion.readings import PointCloud, Reading, Twist
from contactfusion.robots.description import RobotConfig
from contactfusion_lab.experiments.push.suites import Change, controller_options, read_sensing
from contactfusion_lab.learning.lessons import MOUNTINGS, SKIN, Lesson, Motion
from contactfusion_lab.learning.trials import LabelledTrial
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import PushScene, PushTruth

LONGEST = 60.0
"""A lesson ends after so long [s]."""
ONCE_MORE = 2.0
"""At the target the base backs off for so long, and comes back for as long [s]."""
SLOWEST, FASTEST = (0.05, -0.1, -0.3), (0.3, 0.1, 0.3)
"""How it then moves is drawn between these: ahead and aside [m/s], turn [rad/s]."""
PROXIMITY = ProximityConfig(occupied=2)
"""How proximity lengths are made."""
BEHIND = 0.05
"""What touches so far behind the face touches a side of the base [m]."""
TAXELS = 12
"""Of the front of the skin."""


@dataclass(frozen=True, eq=False)
class Moment:
    """One cycle of a lesson: what is seen, and what is true.

    Attributes:
        descriptors: shape (k, S) [m], the proximity lengths from each mounting.
        truth: how the object touches.
    """

    descriptors: FloatArray
    truth: PushTruth


def live(lesson: Lesson, weights: Path | None) -> LabelledTrial:
    """Push, and keep what networks can learn from.

    Args:
        lesson: the push.
        weights: of the networks that drive; None: it is driven by skin.
    """
    moments = list(_moments(lesson, weights))
    truths = [moment.truth for moment in moments]
    touches = [_touch(truth) for truth in truths]
    return LabelledTrial(
        name=lesson.name,
        split=lesson.split,
        round=lesson.round,
        mountings=MOUNTINGS,
        stamp=np.array([truth.stamp for truth in truths]),
        descriptors=np.stack([moment.descriptors for moment in moments], axis=1),
        kind=np.array([KINDS.index(kind) for kind, _ in touches], np.uint8),
        lateral=np.array([lateral for _, lateral in touches]),
    )


def _touch(truth: PushTruth) -> tuple[str, float]:
    """Say how and where an object touches the face; beside or behind it nothing can be seen."""
    ahead, lateral = truth.contact
    if ahead < PROXIMITY.region.x[0] - BEHIND:
        return "none", np.nan
    return truth.kind, lateral


def _moments(lesson: Lesson, weights: Path | None) -> Iterator[Moment]:
    """Let a lesson pass, cycle by cycle."""
    pipeline = _pipeline(lesson, weights)
    robot = pipeline.config.robot
    assert robot is not None
    fields: dict[str, Any] = {"object": lesson.object, "friction": lesson.friction}
    config = PushConfig(
        **fields,
        target=lesson.target,
        offset=lesson.offset,
        yaw=lesson.yaw,
        sees=MOUNTINGS,
    )
    scene = PushScene(config, robot, lesson.seed)
    ahead, aside, turn = np.random.default_rng([lesson.seed, 3]).uniform(SLOWEST, FASTEST).tolist()
    end = LONGEST
    while True:
        readings, truth = scene.readings(), scene.truth()
        for reading in readings:
            pipeline.receive(reading)
        command = pipeline.step(scene.stamp).command
        assert command is not None  # the pipeline has a controller
        assert command.twist is not None
        yield Moment(_descriptors(readings, robot), truth)
        if command.mode == ARRIVED:
            end = min(end, scene.stamp + 2.0 * ONCE_MORE)
        if scene.stamp >= end or np.hypot(*truth.object[:2]) > config.furthest:
            return
        if end < LONGEST:
            scene.drive(-ahead if scene.stamp < end - ONCE_MORE else ahead, aside, turn)
        else:
            scene.drive(*(lesson.detour_at(scene.stamp) or _motion(command.twist)))


def _pipeline(lesson: Lesson, weights: Path | None) -> Pipeline:
    if lesson.driver == SKIN:
        sensing = read_sensing("skin", TAXELS, Change())
    else:
        sensing = read_sensing("lidar", TAXELS, Change(lidar=lesson.driver, weights=weights))
    controller = controller_options(lesson.controller, lesson.target, sensing.face)
    update = {"controller": controller, "seed": lesson.seed}
    return Pipeline(sensing.pipeline.model_copy(update=update))


def _descriptors(readings: Sequence[Reading], robot: RobotConfig) -> FloatArray:
    """Give the proximity lengths as each LiDAR sees them, shape (k, S) [m]."""
    clouds = {one.sensor: one for one in readings if isinstance(one, PointCloud)}
    rows = []
    for name in MOUNTINGS:
        pose = robot.frames[clouds[name].frame].pose()
        seen = without(points_in(pose, clouds[name].points), ROBOT)
        rows.append(PROXIMITY.lengths_of_cloud(seen))
    return np.stack(rows)


def _motion(twist: Twist) -> Motion:
    return float(twist.linear[0]), float(twist.linear[1]), float(twist.angular[2])
