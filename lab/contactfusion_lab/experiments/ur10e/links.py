"""Links that a contact may be on, by `joint_torque` from currents, where the pose is known."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import CycleConfig, PipelineConfig
from contactfusion.readings import JointState
from contactfusion.robots.description import EffortConfig, RobotConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import shared_robot
from contactfusion.robots.posed import PosedRobot
from contactfusion_lab.experiments.ur10e.runs import Run

BASE, TOOL, SENSOR = "base_link", "tool", "arm"
POSE = np.radians([-12.3, -69.5, 105.3, -125.8, -90.0, 107.7])
"""The joints while the tool presses in the profile `direct`; they hardly move."""
UP = np.array([0.0, 0.0, 1.0])
"""Where the sensor under the tool pushes."""
MEASURED = {0: 1, 1: 1, 2: 2, 3: 3, 4: 3, 5: 3}
"""By joint the one whose constant it takes. The force hardly loads the first, fifth and sixth,
whose motors are those of the second, and of the fourth."""
STRIDE = 20
"""So many samples apart contacts are located."""
HELD = 0.9
"""The probability that a set of links holds."""
ARM = RobotConfig(urdf="contactfusion_lab.scenes.arms:ur10e_like.urdf", spacing=0.01)


@dataclass(frozen=True, eq=False)
class Motors:
    """What other runs tell of the motors.

    Attributes:
        constants: shape (6,), torque per current [N·m/A].
        offsets: shape (6,), the residual of free motion [A].
        noises: shape (6,), its standard deviation as a torque [N·m].
    """

    constants: FloatArray
    offsets: FloatArray
    noises: FloatArray

    @classmethod
    def learned(cls, runs: Sequence[Run]) -> Self:
        """By least squares of torques, as the force and the pose tell, over residuals in contact.

        Raises:
            RecordingError: there is no contact to learn from.
        """
        touching = [run.touching for run in runs]
        if not any(rows.any() for rows in touching):
            raise RecordingError("there are no other runs with a contact to learn constants from")
        free = np.concatenate([run.residual[run.free] for run in runs])
        offsets = free.mean(axis=0)
        residuals = np.concatenate(
            [run.residual[rows] for run, rows in zip(runs, touching, strict=True)]
        )
        forces = np.concatenate(
            [run.force_now[rows] for run, rows in zip(runs, touching, strict=True)]
        )
        torques = -np.outer(forces, levers() @ UP)  # motors push against the contact
        left = residuals - offsets
        own = (torques * left).sum(axis=0) / (left**2).sum(axis=0)
        constants = own[list(MEASURED.values())]
        return cls(constants, offsets, constants * free.std(axis=0))


def levers() -> FloatArray:
    """How a force at the tip of the tool loads each joint, shape (6, 3) [m]."""
    robot = shared_robot(ARM)
    linear, angular = Dynamics(robot).axes(POSE)
    tip = robot.poses_at(POSE)[TOOL][:3, 3]
    return np.asarray(linear + np.cross(angular, tip), np.float64)


@dataclass(frozen=True)
class Located:
    """The sets of links of the contacts of a run, shape (n,) each.

    Attributes:
        held: whether the set holds the tool; never where no link is claimed.
        sizes: how many links it has, 0 where none is claimed.
    """

    held: NDArray[np.bool_]
    sizes: NDArray[np.intp]


def located(run: Run, motors: Motors) -> Located:
    """On which links the contacts of a run may be."""
    clouds = list[HypothesisCloud]()
    pipeline = Pipeline(_config(motors), tell=clouds.append)
    robot = shared_robot(ARM)
    surface = PosedRobot(robot, POSE, BASE, np.eye(4)).surface
    tool, held, sizes = surface.link_names.index(TOOL), [], []
    touching = np.flatnonzero(run.touching)[::STRIDE]
    before = np.arange(0, touching[0] if len(touching) else 0, STRIDE)
    for row in (*before, *touching):
        clouds.clear()
        pipeline.take(
            JointState(
                stamp=float(run.stamps[row] - run.stamps[0]), frame=BASE, sensor=SENSOR,
                names=robot.joint_names, positions=POSE, efforts=run.residual[row],
            )
        )  # fmt: skip
        (cloud,) = clouds
        if row < touching[0]:
            continue  # free, as it was before
        if not len(cloud.positions):
            held.append(False)
            sizes.append(0)
            continue
        links = surface.links[surface.nearest(cloud.positions)[1]]
        shares = np.bincount(links, cloud.likelihoods, len(surface.link_names))
        order = np.argsort(-shares, kind="stable")
        size = 1 + int(np.searchsorted(np.cumsum(shares[order]), HELD * shares.sum()))
        held.append(tool in order[:size])
        sizes.append(size)
    return Located(np.array(held, np.bool_), np.array(sizes, np.intp))


def _config(motors: Motors) -> PipelineConfig:
    """The generator with its own settings, and what was learned of the motors."""
    names = shared_robot(ARM).joint_names
    efforts = {
        name: EffortConfig(noise=noise, offset=offset, constant=constant)
        for name, noise, offset, constant in zip(
            names, motors.noises.tolist(), motors.offsets.tolist(),
            motors.constants.tolist(), strict=True,
        )
    }  # fmt: skip
    return PipelineConfig(
        robot=ARM.model_copy(update={"efforts": efforts}),
        generators={
            SENSOR: {
                "type": "joint_torque", "sensor": SENSOR, "effort": "external", "sign": "by_robot",
                "joints": list(efforts),
            }
        },
        integrator=IntegratorConfig(frame=BASE),
        cycle=CycleConfig(on=SENSOR),
    )  # fmt: skip
