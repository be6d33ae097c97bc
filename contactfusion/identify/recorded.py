"""What a recording holds for identification: motions of joints, and wrenches of wrists."""

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RecordingError, RobotError, name_hint
from contactfusion.frames import vectors_in
from contactfusion.generators.external_torque import ExternalTorque
from contactfusion.generators.force_torque import ForceTorqueConfig
from contactfusion.generators.joint_torque import JointTorqueConfig
from contactfusion.grid import Grid
from contactfusion.identify.wrists import Sample
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, Wrench
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import WHOLE
from contactfusion.robot_state import Robot, StateBuffer
from contactfusion.run.configuration import Setting
from contactfusion.run.session import matched
from contactfusion.terminal import followed

LEAST = 10.0
"""The shortest motion that anything is identified from [s]."""
FRESH = 0.1
"""Gravity is looked up in the frames of the robot so often [s]: bases tilt slowly."""
PLATEAU = 0.2
"""An effort that stays so long at exactly its greatest or least value is saturated [s]."""
Spans = list[tuple[float, float]]
"""Beginnings and ends [s]."""


@dataclass(eq=False)
class Motion:
    """The joints of one generator as they moved.

    Attributes:
        readings: by rising stamps.
        positions: of all joints of the robot at each, shape (n,) [rad, m].
        gravities: in the root link's frame at each, shape (3,) [m/s²].
    """

    readings: list[JointState] = field(default_factory=list)
    positions: list[FloatArray] = field(default_factory=list)
    gravities: list[FloatArray] = field(default_factory=list)

    @property
    def stamps(self) -> FloatArray:
        """Of the readings, shape (m,) [s]."""
        return np.array([reading.stamp for reading in self.readings])

    def efforts(self, names: tuple[str, ...]) -> FloatArray:
        """The efforts of joints, shape (m, len(names)), in the order of their names.

        Raises:
            RecordingError: there are none, they are all zero, or a joint has none.
        """
        first = self.readings[0]
        if first.efforts is None:
            raise RecordingError(
                f"{first.label} has no efforts; a driver that reports torques or currents fills "
                "`effort`"
            )
        found = np.empty((len(self.readings), len(names)))
        for column, name in enumerate(names):
            if name not in first.names:
                hint = name_hint(name, first.names, "joints of the reading")
                raise RecordingError(f"{first.label} has no effort of '{name}': {hint}")
        for row, reading in enumerate(self.readings):
            assert reading.efforts is not None
            found[row] = reading.efforts[[reading.names.index(name) for name in names]]
        if dead := [name for name, zero in zip(names, ~found.any(axis=0), strict=True) if zero]:
            raise RecordingError(
                f"the efforts of {', '.join(dead)} are zero throughout: the driver does not "
                "report them"
            )
        return found


@dataclass(eq=False)
class Recorded:
    """What a recording holds for the generators of a configuration.

    Attributes:
        motions: of the joints, by `joint_torque` generator.
        wrenches: with joints and gravity, by `force_torque` generator.
    """

    motions: dict[str, Motion]
    wrenches: dict[str, list[Sample]]
