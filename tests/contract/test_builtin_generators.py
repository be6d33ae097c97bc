"""Every generator of the package keeps the contract."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, State
from contactfusion.frames import FrameTree
from contactfusion.generators.finger_pose import FingerPoseConfig
from contactfusion.generators.first_touch import FirstTouchConfig
from contactfusion.generators.force_torque import ForceTorqueConfig
from contactfusion.generators.free_space import FreeSpaceConfig
from contactfusion.generators.joint_torque import JointTorqueConfig
from contactfusion.generators.networks import LearnedConfig
from contactfusion.generators.range import RangeConfig
from contactfusion.generators.rgbd_cpm import RgbdCpmConfig
from contactfusion.generators.simulator import SimulatorConfig
from contactfusion.generators.tactile import TactileConfig
from contactfusion.generators.taxel_map import TaxelMap, TaxelMapConfig
from contactfusion.plugins import Plugins, installed_plugins
from contactfusion.readings import (
    JointCommand,
    ObjectPose,
    PointCloud,
    Switch,
    TactileImage,
    Twist,
    Wrench,
)
from contactfusion.shapes import BodyConfig
from contactfusion.testing import EXAMPLES, check_generator, example_reading
from tests import arms, hands, pictures
from tests.test_rgbd_cpm import sure_of_a_point

HOME = "contactfusion"
"""The distribution whose generators are checked here."""
Given = Mapping[str, Any]


def force_torque(folder: Path) -> Given:
    """A sensor in the middle of a ball, whose surface its wrenches point to."""
    ball = BodyConfig.model_validate(
        {"frame": "base", "spacing": 0.004, "shapes": [{"shape": "sphere", "radius": 0.06}]}
    )
    state = State(now=0.0, grid=Grid("base", 0.005), surface=ball.sampled(folder))
    place, force = np.array([0.0, 0.0, 0.06]), np.array([1.0, -2.0, -8.0])
    readings = [
        Wrench(
            stamp=0.1 * index,
            frame="base",
            force=(1 + index) * force,
            torque=(1 + index) * np.cross(place, force),
        )
        for index in range(EXAMPLES)
    ]
    return {"config": ForceTorqueConfig(sign="on_robot"), "readings": readings, "state": state}


def finger_pose(folder: Path) -> Given:
    """A hand on a slide that yields, as a finger does; at last it is told to go elsewhere."""
    config = {"fingers": {"slide": {"joints": ("slide",), "links": ("hand",)}}}
    readings = [
        *(hands.joints(0.05 * index, 0.1 * index) for index in range(EXAMPLES)),
        JointCommand(stamp=0.3, frame="base", names=("slide",), positions=np.array([0.5])),
        hands.joints(0.3, 0.4),
    ]
    state = hands.state(hands.slide(folder), x=0.1)
    return {"config": FingerPoseConfig.model_validate(config), "readings": readings, "state": state}


def joint_torque(folder: Path) -> Given:
    """An arm whose forearm is pushed harder and harder."""
    _, _, torques = arms.pushed("link_6", 10.0)
    readings = [arms.reading((1 + index) * torques, stamp=0.1 * index) for index in range(EXAMPLES)]
    config = JointTorqueConfig(effort="external", joints=arms.known())
    return {"config": config, "readings": readings, "state": arms.state()}


def first_touch(folder: Path) -> Given:
    """A hand beside a box, which is then told to be elsewhere."""
    box = {"shapes": [{"shape": "box", "size": (0.1, 0.1, 0.1)}], "pose": {"parent": "base"}}
    readings = [hands.joints(0.1, stamp=0.1 * index) for index in range(EXAMPLES)]
    config = FirstTouchConfig.model_validate({"objects": {"object": box}})
    state = hands.state(hands.slide(folder), x=0.11)
    return {"config": config, "readings": [*readings, example_reading(ObjectPose)], "state": state}


def free_space(folder: Path) -> Given:
    """A box between the camera and what it sees."""
    return {"config": FreeSpaceConfig(box=((-0.05, -0.05, 0.2), (0.05, 0.05, 0.4)))}


def motion(folder: Path) -> Given:
    """A hand that slides on a base that drives."""
    readings = [
        *(hands.joints(0.05 * index, 0.1 * index) for index in range(EXAMPLES)),
        hands.joints(0.15, 0.3, velocity=0.5),
        example_reading(Twist),
    ]
    return {"readings": readings, "state": hands.state(hands.slide(folder), x=0.1)}


def range_camera(folder: Path) -> Given:
    """A hand near a cloud."""
    points = np.random.default_rng(0).uniform(-0.03, 0.03, (EXAMPLES, 200, 3)) + [0.2, 0.0, 0.0]
    readings = [
        PointCloud(stamp=0.1 * index, frame="base", points=points[index])
        for index in range(EXAMPLES)
    ]
    state = hands.state(hands.slide(folder), x=0.1)
    config = RangeConfig(evidence="proximity", margin=0.0)
    return {"config": config, "readings": readings, "state": state}


def lidar_cpm(folder: Path) -> Given:
    """A wall before the face, and networks that are sure of a contact."""
    return {"config": LearnedConfig(weights=sure_of_a_point(folder))}


def lidar_rule(folder: Path) -> Given:
    """A wall that comes to the face."""
    y = np.linspace(-0.2, 0.2, 40)
    readings = [
        PointCloud(
            stamp=0.1 * index,
            frame="base",
            points=np.stack([0.31 + 0.05 * (EXAMPLES - 1 - index) + 0.0 * y, y, 0.0 * y], axis=1),
        )
        for index in range(EXAMPLES)
    ]
    return {"readings": readings}


def rgbd_cpm(folder: Path) -> Given:
    """A box that comes to the face, and networks that are sure of a contact."""
    readings = [
        pictures.picture(near=0.35 - 0.02 * index, stamp=0.1 * index) for index in range(EXAMPLES)
    ]
    config = RgbdCpmConfig(weights=sure_of_a_point(folder))
    return {"config": config, "readings": readings, "state": pictures.state()}


def simulator(folder: Path) -> Given:
    """A hand that is believed to touch a box, which is then told to be elsewhere."""
    box = {"shapes": [{"shape": "box", "size": (0.1, 0.1, 0.1)}], "pose": {"parent": "base"}}
    readings = [hands.joints(0.1, stamp=0.1 * index) for index in range(EXAMPLES)]
    config = SimulatorConfig.model_validate({"objects": {"object": box}})
    state = hands.state(hands.slide(folder), x=0.1)
    return {"config": config, "readings": [*readings, example_reading(ObjectPose)], "state": state}


def switch(folder: Path) -> Given:
    """A hand on a slide, whose switch is closed now and then."""
    readings = [
        Switch(stamp=0.1 * index, frame="hand", closed=index % 2 == 1) for index in range(EXAMPLES)
    ]
    return {"readings": readings, "state": hands.state(hands.slide(folder))}


def tactile(folder: Path) -> Given:
    """Four rows of four taxels, as many as an example has values."""
    grid = {"rows": 4, "columns": 4, "pitch": (0.01, 0.01)}
    return {"config": TactileConfig.model_validate({"patch": {"grid": grid}, "free": True})}


def taxel_map(folder: Path) -> Given:
    """Presses along a line, felt by two channels."""
    x = np.linspace(0.1, 0.9, 40)
    places = np.stack([0.1 * x, 0.0 * x, 0.0 * x], axis=1)
    TaxelMap(np.stack([x, 1.0 - x], axis=1), places, 8, 0.002).save(folder / "map.npz")
    values = ([0.2, 0.8], [0.0, 0.0], [1.5, 1.5])
    readings = [
        TactileImage(stamp=0.1 * index, frame="base", values=np.array(value))
        for index, value in enumerate(values)
    ]
    config = TaxelMapConfig(map=folder / "map.npz", min_signal=0.1)
    return {"config": config, "readings": readings}


def nothing(folder: Path) -> Given:
    """Its defaults, and examples of its readings."""
    return {}


GIVEN: dict[str, Callable[[Path], Given]] = {
    "finger_pose": finger_pose,
    "first_touch": first_touch,
    "force_torque": force_torque,
    "free_space": free_space,
    "joint_torque": joint_torque,
    "lidar_cpm": lidar_cpm,
    "lidar_rule": lidar_rule,
    "motion": motion,
    "range": range_camera,
    "rgbd_cpm": rgbd_cpm,
    "simulator": simulator,
    "switch": switch,
    "tactile": tactile,
    "taxel_map": taxel_map,
}
"""What the kit needs for a generator whose options have no defaults; others need `nothing`."""

BUILT_IN = {
    name: cls
    for name, cls in installed_plugins().offers("generators").items()
    if cls.__module__.split(".")[0] == HOME
}


def test_every_plugin_of_the_package_loads() -> None:
    plugins = Plugins()
    plugins.offers("generators")
    ours = {plugin.name for plugin in plugins.listing() if plugin.distribution.split()[0] == HOME}
    assert {name: why for name, why in plugins.failures.items() if name in ours} == {}
    assert set(GIVEN) <= set(BUILT_IN)


@pytest.mark.parametrize("name", BUILT_IN)
def test_it_keeps_the_contract(name: str, tmp_path: Path) -> None:
    check_generator(BUILT_IN[name], **GIVEN.get(name, nothing)(tmp_path))


@pytest.mark.parametrize("name", BUILT_IN)
def test_what_it_is_checked_with_makes_it_say_something(name: str, tmp_path: Path) -> None:
    cls, given = BUILT_IN[name], GIVEN.get(name, nothing)(tmp_path)
    generator = cls(name, given.get("config") or cls.Config())
    readings = given.get("readings") or [
        example_reading(kind, index) for index in range(EXAMPLES) for kind in cls.readings
    ]
    frames = FrameTree({"sensor": ("base", np.eye(4))})
    state = given.get("state") or State(now=0.0, grid=Grid("base", 0.005), frames=frames)
    assert any(len(cloud) for reading in readings for cloud in generator.generate(reading, state))
