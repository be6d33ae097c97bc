"""Contacts from a six-axis force-torque sensor: where its line of action meets the surface.

One contact at r with force f gives the torque τ = r × f, so r = (f × τ)/|f|² + s f/|f| for some s:
the papers' three groups of equations (F Eq 6-7) are this line solved for x, y or z.
"""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import points_in, vectors_in
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.generators.compensation import Compensation
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, Note
from contactfusion.readings import Reading, Wrench
from contactfusion.state import State
from contactfusion.surface import Surface

STEADY = 5.0
"""A tare counts while the samples scatter less than so many standard deviations of the noise."""


class ForceTorqueConfig(GeneratorConfig):
    """The options of `force_torque`."""

    sign: Literal["on_robot", "by_robot"]
    """Whether the sensor gives the force that the world exerts on the robot, or the reverse;
    drivers differ, so it must be said."""
    force_noise: float = Field(default=0.2, gt=0)
    """Standard deviation of one sample of force, by axis [N]."""
    torque_noise: float = Field(default=0.01, gt=0)
    """Standard deviation of one sample of torque, by axis [N·m]."""
    min_force: float | None = Field(default=None, gt=0)
    """No contact under this force [N]; None: five standard deviations of the noise."""
    patch: float = Field(default=0.0, ge=0)
    """Torsional friction of a contact that is no point: standard deviation of moment per force
    [m]."""
    friction: float = Field(default=2.0, gt=0)
    """The largest tangential force of a contact, per normal force."""
    surface_tolerance: float = Field(default=0.01, gt=0)
    """A contact lies at most this far from the surface [m]."""
    compensation: Compensation = Field(default_factory=Compensation)
    """What the sensor feels without contact."""
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    """In the frame of the hypothesis space [m/s²]; used when the load has a mass."""
    tare: float = Field(default=0.0, ge=0)
    """Take the mean over the first so many seconds at rest as further bias [s]."""
    average: float = Field(default=0.0, ge=0)
    """Average the wrench over the newest so many seconds [s]."""


class ForceTorqueGenerator(Generator[ForceTorqueConfig]):
    """Regular, single contact: the places where one contact explains the wrench (F §V-B)."""

    Config = ForceTorqueConfig
    readings = (Wrench,)

    def __init__(self, name: str, config: ForceTorqueConfig) -> None:
        super().__init__(name, config)
        self.reset()

    def reset(self) -> None:
        """Forget the tare and the samples of the average."""
        self._bias: FloatArray | None = None if self.config.tare else np.zeros(6)
        self._rest: list[tuple[float, FloatArray]] = []
        self._recent: list[tuple[float, FloatArray]] = []

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give the places on the surface where one contact explains the wrench."""
        assert isinstance(reading, Wrench)
        wrench = self.compensated(reading, state)
        if wrench is None:
            return ()
        force, torque = wrench[:3], wrench[3:]
        if np.linalg.norm(force) < self.least_force:
            return (self.nothing(reading),)
        if state.surface is None:
            raise ConfigurationError(
                f"'{self.name}' needs the robot's surface to place contacts on: configure `surface`"
            )
        probability = self.explained(force, torque)
        notes = (Note.MORE_THAN_ONE_CONTACT,) if probability < 1.0 else ()
        if probability == 0.0:
            return (self.nothing(reading, notes=notes),)
        pose = state.frames.pose(state.grid.frame, of=reading.frame)
        start = np.cross(force, torque) / (force @ force)
        line = points_in(pose, start[None])[0]
        direction = vectors_in(pose, (force / np.linalg.norm(force))[None])[0]
        places = self._on_surface(line, direction, state.surface, state.grid.voxel_size)
        if not len(places):
            return (self.nothing(reading, notes=(*notes, Note.OFF_SURFACE)),)
        origin = pose.as_matrix()[:3, 3]
        return (
            self.cloud(
                reading,
                places,
                probability / len(places),
                frame=state.grid.frame,
                forces=np.tile(np.linalg.norm(force) * direction, (len(places), 1)),
                spreads=self.spreads(force, places - origin),
                single=True,
                notes=notes,
            ),
        )

    @property
    def least_force(self) -> float:
        """The force under which nothing is believed [N]."""
        return self.config.min_force or 5.0 * self.config.force_noise

    def compensated(self, reading: Wrench, state: State) -> FloatArray | None:
        """Give the contact's wrench on the robot, shape (6,), or None before the tare is done."""
        sign = 1.0 if self.config.sign == "on_robot" else -1.0
        wrench = sign * np.concatenate([reading.force, reading.torque])
        gravity = np.zeros(3)
        if self.config.compensation.mass:
            pose = state.frames.pose(reading.frame, of=state.grid.frame)
            gravity = vectors_in(pose, np.array([self.config.gravity]))[0]
        wrench = wrench - self.config.compensation.contactless(gravity)
        if self._bias is None and not self._tared(reading.stamp, wrench):
            return None
        assert self._bias is not None
        return self._averaged(reading.stamp, wrench - self._bias)

    def explained(self, force: FloatArray, torque: FloatArray) -> float:
        """Give the probability that one contact explains a wrench.

        A single contact has no torque along its force. With r = |τ·f|/(|f||τ|) and its standard
        deviation σ_r under the noise, P is 1 up to 3 σ_r and falls to 0 at 6 σ_r (SPEC §5).
        """
        magnitude, lever = float(np.linalg.norm(force)), float(np.linalg.norm(torque))
        along = abs(float(torque @ force)) / magnitude
        sigma = np.sqrt(
            self.config.torque_noise**2
            + (lever * self.config.force_noise / magnitude) ** 2
            + (self.config.patch * magnitude) ** 2
        )
        return float(np.clip(2.0 - along / (3.0 * sigma), 0.0, 1.0))

    def spreads(self, force: FloatArray, levers: FloatArray) -> FloatArray:
        """Give the standard deviation of places across the line, shape (n,) [m].

        Args:
            force: shape (3,) [N].
            levers: shape (n, 3) [m], the places from the sensor's origin.
        """
        lengths = np.linalg.norm(levers, axis=1)
        noise = np.hypot(self.config.torque_noise, lengths * self.config.force_noise)
        across: FloatArray = np.hypot(noise / np.linalg.norm(force), self.config.patch)
        return across

    def _on_surface(
        self, line: FloatArray, direction: FloatArray, surface: Surface, side: float
    ) -> FloatArray:
        """Sample the line at the side of a voxel; keep what is on the surface and pushes into it.

        Args:
            line: shape (3,) [m], a point of the line.
            direction: shape (3,), the unit vector of the force on the robot.
            surface: in the same frame.
            side: of a voxel [m].

        Returns:
            Shape (n, 3) [m], at most one place a voxel.
        """
        offsets = surface.points - line
        along = offsets @ direction
        across = np.einsum("ij,ij->i", offsets, offsets) - along**2
        least = 1.0 / np.hypot(1.0, self.config.friction)
        pushed = -(surface.normals @ direction) >= least
        near = pushed & (across <= (self.config.surface_tolerance + side) ** 2)
        if not near.any():
            return np.empty((0, 3))
        first, last = along[near].min(), along[near].max()
        steps = np.arange(first - self.config.surface_tolerance, last + side, side)
        places = line + steps[:, None] * direction
        reach = self.config.surface_tolerance
        distance, nearest = surface.tree.query(places, distance_upper_bound=reach)
        found = np.isfinite(distance)
        found[found] = pushed[np.asarray(nearest)[found]]
        voxels = np.floor(places[found] * (1.0 / side))
        once = np.sort(np.unique(voxels, axis=0, return_index=True)[1])
        kept: FloatArray = places[found][once]
        return kept

    def _tared(self, stamp: float, wrench: FloatArray) -> bool:
        """Collect samples at rest; start again when they scatter more than noise does."""
        self._rest.append((stamp, wrench))
        if stamp - self._rest[0][0] < self.config.tare:
            return False
        samples = np.array([sample for _, sample in self._rest])
        noise = np.repeat([self.config.force_noise, self.config.torque_noise], 3)
        if (samples.std(axis=0) > STEADY * noise).any():
            self._rest.clear()
            return False
        self._bias = samples.mean(axis=0)
        return True

    def _averaged(self, stamp: float, wrench: FloatArray) -> FloatArray:
        if not self.config.average:
            return wrench
        self._recent.append((stamp, wrench))
        while stamp - self._recent[0][0] > self.config.average:
            self._recent.pop(0)
        mean: FloatArray = np.mean([sample for _, sample in self._recent], axis=0)
        return mean


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[ForceTorqueConfig]]]:
    """Offer the force-torque generator."""
    return {"force_torque": ForceTorqueGenerator}
