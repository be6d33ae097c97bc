"""The arm of the package in free motion, and what its joints report meanwhile."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from contactfusion.arrays import FloatArray
from contactfusion.robots.description import PayloadConfig, RobotConfig
from contactfusion.robots.model import RobotModel
from tests.arms import ARM, STILL, whole

GRAVITY = np.array([0.0, 0.0, -9.81])
TOOL = PayloadConfig(frame="link_7", mass=0.8, centre_of_mass=(0.02, -0.03, 0.12))
ENCODER = 2e-6
"""Standard deviation of a position [rad], as of encoders of 20 bits."""


@dataclass
class Joints:
    """What joints report beside motion and gravity; each of shape (7,)."""

    offset: FloatArray = field(default_factory=lambda: np.linspace(0.4, -0.3, 7))
    constant: FloatArray = field(default_factory=lambda: np.ones(7))
    coulomb: FloatArray = field(default_factory=lambda: np.linspace(1.2, 0.2, 7))
    viscous: FloatArray = field(default_factory=lambda: np.linspace(1.0, 0.1, 7))
    noise: FloatArray = field(default_factory=lambda: np.linspace(0.6, 0.1, 7))
    """Of one sample [N·m]."""


@dataclass
class Sines:
    """Sums of sines for each joint."""

    span: FloatArray = field(default_factory=lambda: np.full(7, 0.5))
    """Amplitude [rad], shape (7,)."""
    middle: FloatArray = field(
        default_factory=lambda: np.array([0.0, 0.6, 0.0, 1.2, 0.0, 0.8, 0.0])
    )

    def at(self, stamps: FloatArray, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, velocities and accelerations, each of shape (n, 7)."""
        rng, found = np.random.default_rng(seed), np.zeros((3, len(stamps), 7))
        found[0] = self.middle
        for part in (1.0, 0.5):
            rate = 2.0 * np.pi * rng.uniform(0.15, 0.25, 7) / part
            angle = np.outer(stamps, rate) + rng.uniform(0.0, 2.0 * np.pi, 7)
            size = part * self.span * rng.uniform(0.8, 1.2, 7)
            found += (
                size * np.sin(angle),
                size * rate * np.cos(angle),
                -size * rate**2 * np.sin(angle),
            )
        return found[0], found[1], found[2]


def carrying(payload: PayloadConfig | None) -> RobotModel:
    return RobotModel(
        RobotConfig(urdf="contactfusion.robots:arm_hand.urdf", still=STILL, payload=payload)
    )


def table(
    joints: Joints,
    payload: PayloadConfig | None = TOOL,
    seconds: float = 60.0,
    rate: float = 200.0,
    seed: int = 0,
    sines: Sines | None = None,
    push: tuple[float, float, FloatArray] | None = None,
) -> FloatArray:
    """Stamps, positions and efforts, shape (n, 15).

    Args:
        joints: what they report.
        payload: on the arm.
        seconds: length [s].
        rate: of samples [Hz].
        seed: of motion and noise.
        sines: the motion.
        push: when a contact begins and ends [s], and its torques, shape (7,) [N·m].
    """
    stamps = np.arange(0.0, seconds, 1.0 / rate)
    positions, speeds, accelerations = (sines or Sines()).at(stamps, seed)
    pin, model = carrying(payload).kinematics
    data = model.createData()
    torques = np.array(
        [
            pin.rnea(model, data, whole(q), whole(v), whole(a))[:7]
            for q, v, a in zip(positions, speeds, accelerations, strict=True)
        ]
    )
    torques += joints.coulomb * np.tanh(speeds / 0.01) + joints.viscous * speeds
    if push is not None:
        begin, end, load = push
        torques -= ((stamps >= begin) & (stamps < end))[:, None] * load
    rng = np.random.default_rng([seed, 1])
    torques += joints.noise * rng.standard_normal(torques.shape)
    efforts = torques / joints.constant + joints.offset
    measured = positions + ENCODER * rng.standard_normal(positions.shape)
    return np.column_stack([stamps, measured, efforts])


def written(
    folder: Path,
    rows: FloatArray,
    effort: str = "measured",
    names: Sequence[str] = ARM,
    **fields: Any,
) -> tuple[Path, Path]:
    """Write a recording, and a configuration for it.

    Args:
        folder: of both.
        rows: as `table` gives them.
        effort: what the joints report.
        names: of the joints, in the order of the columns.
        **fields: of the configuration.

    Returns:
        The configuration and the recording.
    """
    count = len(names)
    efforts = rows[:, 1 + count :]
    positions = rows[:, 1 : 1 + count]
    differences = np.diff(positions, axis=0, prepend=positions[:1]) / (rows[1, 0] - rows[0, 0])
    padded = np.column_stack([rows[:, 0], positions, differences, efforts])
    np.save(folder / "free.npy", padded)
    columns = [*range(2, 2 + 3 * count)] if efforts.size else [*range(2, 2 + count)]
    arm = {"type": "joint_state", "frame": "base", "names": list(names), "columns": columns}
    log = {"type": "log", "file": "free.npy", "time": {"column": 1}, "readings": {"arm": arm}}
    (folder / "free.yaml").write_text(yaml.safe_dump(log))
    config = {
        "robot": {"urdf": "contactfusion.robots:arm_hand.urdf", "still": dict(STILL)},
        "generators": {
            "arm": {"type": "joint_torque", "sensor": "arm", "effort": effort, "joints": list(ARM)}
        },
        "integrator": {"frame": "base"},
        "cycle": {"on": "arm"},
    }
    (folder / "arm.yaml").write_text(yaml.safe_dump({**config, **fields}))
    return folder / "arm.yaml", folder / "free.yaml"
