"""Contacts by joint torques: the whole field over an arm, against a solver for each point.

`python -m benchmarks.torques` prints the medians [ms] alone.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from benchmarks.interleave import Spread
from benchmarks.over_surface import HASWELL, haswell
from benchmarks.table import Row
from contactfusion.arrays import FloatArray
from contactfusion.generators.torque_field import explained
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import shared_robot

JOINTS, POINTS = 7, 5_000
FRICTION, STRENGTH = 0.5, 50.0
SAMPLED = 200
"""So many points are solved by the peer."""
REPEATS = 20


def rows(rounds: int) -> Iterator[Row]:
    """Measure the field of a push on the hand of the package's arm."""
    ours, peer = _timed(rounds)
    yield Row(f"joint_torque, {JOINTS} joints, {POINTS:,} points", Spread.of(ours), "ms", 10.0)
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.torques", str(rounds)],
        env={**os.environ, **haswell()}, check=True, capture_output=True, text=True,
    )  # fmt: skip
    yield Row(f"  as on {HASWELL}", Spread.of(json.loads(done.stdout)), "ms", 10.0)
    ratios = [theirs / own for theirs, own in zip(peer, ours, strict=True)]
    yield Row("  scipy nnls over a pyramid of friction against it", Spread.of(ratios), "x")


def _timed(rounds: int) -> tuple[list[float], list[float]]:
    """The CPU time of the field, and of the peer on as many points, in each round [ms]."""
    points, normals, loads, linear, angular = _arm()
    force = -20.0 * normals[0]
    torques = np.where(loads[0], (linear + np.cross(angular, points[0])) @ force, 0.0)
    precisions = np.full(len(torques), 1.0 / 0.2**2) * (np.arange(len(torques)) < JOINTS)
    gains, evidence, forces = np.empty(POINTS), np.empty(POINTS), np.empty((POINTS, 3))

    def field() -> None:
        explained(
            points, normals, loads, linear, angular, torques, precisions,
            float(1.0 / np.hypot(1.0, FRICTION)), STRENGTH**-2, gains, evidence, forces,
        )  # fmt: skip

    def peer() -> None:
        roots = np.sqrt(precisions)
        for row in range(SAMPLED):
            arms = np.where(loads[row, :, None], linear + np.cross(angular, points[row]), 0.0)
            edges = _pyramid(normals[row])
            nnls(roots[:, None] * (arms @ edges.T), roots * torques)

    field()  # compiles
    own = [_milliseconds(field, REPEATS) for _ in range(rounds)]
    theirs = [_milliseconds(peer, 1) * POINTS / SAMPLED for _ in range(rounds)]
    return own, theirs


def _arm() -> tuple[FloatArray, FloatArray, NDArray[np.bool_], FloatArray, FloatArray]:
    """Points and normals of the arm, the joints that they load, and the axes of all joints."""
    robot = shared_robot(RobotConfig(urdf="contactfusion.robots:arm_hand.urdf"))
    dynamics, rng = Dynamics(robot), np.random.default_rng(0)
    positions = np.clip(np.full(len(robot.joint_names), 0.4), *robot.limits.T)
    poses, chosen = robot.poses_at(positions), list[tuple[FloatArray, FloatArray, FloatArray]]()
    names = list(robot.parts)
    for _ in range(POINTS):
        name = names[int(rng.integers(len(names)))]
        part, pose = robot.parts[name], poses[name]
        row = int(rng.integers(len(part.points)))
        loads = dynamics.supports[robot.link_names.index(name)]
        chosen.append(
            (pose[:3, :3] @ part.points[row] + pose[:3, 3], pose[:3, :3] @ part.normals[row], loads)
        )
    chosen.sort(key=lambda each: -int(each[2].sum()))
    points, normals, loads = (np.array(column) for column in zip(*chosen, strict=True))
    return points, normals, loads, *dynamics.axes(positions)


def _pyramid(normal: FloatArray) -> FloatArray:
    """Forces along the four edges of a pyramid of friction, shape (4, 3)."""
    first = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    edges = -normal + FRICTION * np.stack([first, -first, second, -second])
    return np.asarray(edges, np.float64)


def _milliseconds(work: Callable[[], None], repeats: int) -> float:
    start = time.process_time()
    for _ in range(repeats):
        work()
    return 1e3 * (time.process_time() - start) / repeats


if __name__ == "__main__":
    print(json.dumps(_timed(int(sys.argv[1]))[0]))
