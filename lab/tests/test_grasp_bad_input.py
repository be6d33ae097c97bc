"""Whatever goes wrong, a grasp ends in a named state, with the arm safe."""

from typing import Any

import numpy as np
import pytest

from contactfusion.faults import FaultFile
from contactfusion_lab.experiments.grasp.plan import Column
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.scenes.grasp.scene import GraspCycle, GraspScene, result_of
from lab.tests.test_grasp_scene import PAPERS, PLAN, played, scene

ALL = Column("all", Method("de_morgan", "cluster_centroid"))
TABLE = {"parent": "base", "xyz": [0.8, 0.0, 0.23]}
SAFE = 60.0
"""Nothing may be pressed harder at the end [N]."""
SHOVING = 10.0
"""A bottle that slides on the table, where 1.3 N move it, is not pushed harder [N]."""


def faults(**fields: Any) -> dict[str, Any]:
    content: dict[str, Any] = {"faults": [fields]}
    return {"faults": FaultFile(**content).faults}


def once(**fields: Any) -> dict[str, Any]:
    """The controller of all, but that it closes on nothing only once."""
    return {"controller": {**(PLAN.pipeline.controller or {}), "attempts": 1, **fields}}


def ended(grasp: GraspScene, cycles: list[GraspCycle]) -> str:
    """The ending; the hand stands still then, open or with the object in it, and clear of
    the table."""
    last, before = cycles[-1], cycles[-8]
    command = last.step.command
    assert command is not None and command.twist is not None and command.reason
    assert not command.twist.linear.any() and not command.twist.angular.any()
    assert np.linalg.norm((last.truth.tool - before.truth.tool)[:3, 3]) < 0.02
    assert command.gripper == (1.0 if last.ending == "lifted" else 0.0)
    if last.ending != "lifted":
        assert last.truth.force < SAFE
    assert last.truth.tool[2, 3] > 0.28
    return last.ending


def came_back(cycles: list[GraspCycle]) -> bool:
    """Whether the hand is as far back as where it began, and as little aside."""
    first, last = cycles[0].truth.tool, cycles[-1].truth.tool
    lateral, _, forward = first[:3, :3].T @ (last - first)[:3, 3]
    return bool(max(abs(lateral), abs(forward)) < 0.01)


def success(grasp: GraspScene, cycles: list[GraspCycle]) -> bool:
    return result_of(cycles, grasp.config.lifted, grasp.config.held).success


def elsewhere(*xyz: float) -> dict[str, Any]:
    urdf = "contactfusion_lab.experiments.grasp:bottle.urdf"
    return {"urdf": urdf, "pose": {"parent": "base", "xyz": list(xyz)}}


@pytest.mark.slow
def test_a_bottle_that_stands_where_the_arm_ends_is_not_reached() -> None:
    wide = {"table": {"shapes": [{"shape": "box", "size": [0.9, 0.9, 0.04]}], "pose": TABLE}}
    grasp = scene(object=elsewhere(1.14, 0.0, 0.25), surroundings=wide)
    cycles = played(grasp, PAPERS)
    assert ended(grasp, cycles) == "blocked"
    assert cycles[-1].step.command is not None
    assert cycles[-1].step.command.reason == "the hand comes no further"
    assert np.abs(cycles[-1].truth.joints).max() < 3.1


def test_a_bottle_that_is_not_there_is_missed() -> None:
    grasp = scene(offset=0.3)
    assert ended(grasp, played(grasp, PAPERS, **once())) == "missed"


@pytest.mark.slow
def test_what_touches_from_below_makes_the_hand_go_up() -> None:
    """The table rises a little before the bottle, and the hand goes level."""
    pose = {"parent": "base", "xyz": [0.6725, 0.0, 0.2753], "rpy": [0.0, -0.25, 0.0]}
    ramp = {"shapes": [{"shape": "box", "size": [0.16, 0.3, 0.02]}], "pose": pose}
    table = {"shapes": [{"shape": "box", "size": [0.5, 0.9, 0.04]}], "pose": TABLE}
    grasp = scene(surroundings={"table": table, "ramp": ramp})
    cycles = played(grasp, PAPERS)
    reasons = [cycle.step.command.reason for cycle in cycles if cycle.step.command]
    assert any("cm up" in reason for reason in reasons)
    assert ended(grasp, cycles) == "lifted"


@pytest.mark.slow
@pytest.mark.parametrize("column", [PAPERS, ALL], ids=["paper", "all"])
def test_a_saturated_wrench_seems_a_push_from_below_and_the_hand_touches_nothing(
    column: Column,
) -> None:
    """It carries 11 N, and reads 3: the weight that is missing seems to be borne from below."""
    grasp = scene(offset=0.04, wrench_range=(3.0, 0.2))
    cycles = played(grasp, column, **once(corrections=2))
    assert ended(grasp, cycles) == "obstructed"
    assert result_of(cycles, grasp.config.lifted, grasp.config.held).corrections == 2
    assert max(cycle.truth.force for cycle in cycles) == 0.0
    assert came_back(cycles)


@pytest.mark.slow
def test_a_wrench_that_is_dead_leaves_the_grasp_to_the_others() -> None:
    grasp = scene(offset=0.02)
    cycles = played(grasp, ALL, **faults(fault="zeros", sensor="wrist"))
    assert ended(grasp, cycles) == "lifted"
    assert success(grasp, cycles)


@pytest.mark.slow
def test_without_its_wrench_the_hand_shoves_the_bottle_before_it_misses_it_and_comes_back() -> None:
    grasp = scene(offset=0.05)
    cycles = played(grasp, PAPERS, **once(), **faults(fault="silent", sensor="wrist"))
    assert ended(grasp, cycles) == "missed"
    result = result_of(cycles, grasp.config.lifted, grasp.config.held)
    assert result.corrections == 0 and not result.fallen
    assert 0.1 < result.moved < 0.2
    assert 1.0 < max(cycle.truth.force for cycle in cycles) < SHOVING
    assert cycles[-1].truth.force == 0.0 and came_back(cycles)


@pytest.mark.slow
def test_a_tactile_patch_that_reads_zeros_changes_little() -> None:
    grasp = scene(offset=0.045)
    cycles = played(grasp, ALL, **faults(fault="zeros", sensor="tip_1"))
    assert ended(grasp, cycles) == "lifted"
    assert success(grasp, cycles)


def test_a_finger_that_is_stuck_is_named_before_anything_is_touched() -> None:
    grasp = scene(stuck={"finger_1_proximal_joint": 0.4})
    cycles = played(grasp, PAPERS)
    assert ended(grasp, cycles) == "stuck"
    assert cycles[-1].step.command is not None
    assert cycles[-1].step.command.reason == "'finger_1_proximal_joint' does not open"
    assert max(cycle.truth.force for cycle in cycles) == 0.0


@pytest.mark.slow
def test_what_falls_over_when_it_is_touched_is_missed() -> None:
    tall = {
        "shapes": [{"shape": "cylinder", "radius": 0.02, "length": 0.26}],
        "pose": {"parent": "base", "xyz": [0.8, 0.0, 0.381]},
    }
    fields: dict[str, Any] = {"object": tall, "mass": 0.2, "table_friction": 0.59, "height": 0.03}
    grasp = scene(name="carton", offset=0.045, **fields)
    cycles = played(grasp, PAPERS, **once())
    touched = next(row for row, cycle in enumerate(cycles) if cycle.truth.touched)
    assert cycles[touched].truth.object[2, 2] > 0.99
    assert ended(grasp, cycles) == "missed"
    result = result_of(cycles, grasp.config.lifted, grasp.config.held)
    assert result.fallen and not result.success


def test_joints_that_fall_silent_stop_the_hand() -> None:
    grasp = scene(offset=0.0)
    cycles = played(grasp, PAPERS, **faults(fault="silent", sensor="joints", start=2.0))
    last = cycles[-1]
    assert last.step.command is not None and last.step.command.twist is not None
    assert not last.step.command.twist.linear.any()
    assert last.ending == "blind"
    assert last.truth.stamp < 5.0


def test_joints_that_never_come_leave_the_hand_where_it_is() -> None:
    grasp = scene(offset=0.0)
    cycles = played(grasp, PAPERS, **faults(fault="silent", sensor="joints"))
    assert cycles[-1].ending == "blind"
    assert np.linalg.norm((cycles[-1].truth.tool - cycles[0].truth.tool)[:3, 3]) < 0.005
