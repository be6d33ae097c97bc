"""Contacts from a six-axis force-torque sensor: where its line of action meets the surface.

One contact at r with force f gives the torque τ = r × f, so r = (f × τ)/|f|² + s f/|f| for some s:
the papers' three groups of equations (F Eq 6-7) are this line solved for x, y or z.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in, vectors_in
from contactfusion.generator import Generator, GeneratorConfig, OfRobot
from contactfusion.generators.compensation import BiasEstimate, Compensation
from contactfusion.generators.sign import SignWatch, WeightWatch
from contactfusion.grid import Grid
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, Note, Resultant
from contactfusion.readings import Reading, Wrench
from contactfusion.robots.description import WristConfig
from contactfusion.state import State
from contactfusion.surface import Surface
from contactfusion.thinning import voxel_downsample
from contactfusion.units import Acceleration, Force, ForceNoise, Memory, Spread, TorqueNoise
from contactfusion.vendors import WRENCHES, beneath

STEADY = 2.0
"""Scatter of samples at rest, in standard deviations of the noise, at most."""
LOADED = 1.0
"""Duration of a load from the first reading on after which it may be a bias [s]."""
ON_LINE = 2.0
"""A contact of others lies on a line of action within so many tolerances of the surface."""
AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


class ForceTorqueConfig(GeneratorConfig):
    """The options of `force_torque`."""

    vendor: str | None = None
    """The convention of a known driver, in place of `sign` and `axes`, such as
    `franka_k_f_ext_hat_k`."""
    sign: Literal["on_robot", "by_robot"] | None = None
    """Whether the sensor measures the force of the world on the robot, or of the robot on the
    world; drivers differ, so it must be configured, here or by `wrist`."""
    wrist: Annotated[WristConfig | None, OfRobot("wrists")] = None
    """The sensor, by its name in the robot's description."""
    axes: str | None = None
    """The frame along whose axes the wrenches are given, about the origin of their own frame; None:
    their own."""
    load: Literal["configured", "robot"] = "configured"
    """Whether the load on the sensor is that of `compensation`, or follows from the robot's URDF
    and joints."""
    force_noise: ForceNoise = Field(default=0.2, gt=0)
    """Standard deviation of one sample of force, by axis [N]."""
    torque_noise: TorqueNoise = Field(default=0.01, gt=0)
    """Standard deviation of one sample of torque, by axis [N·m]."""
    min_force: Force | None = Field(default=None, gt=0)
    """The force under which there is no contact [N]; None: five standard deviations of the
    noise."""
    patch: Spread = Field(default=0.0, ge=0)
    """For contacts that are no points but patches: standard deviation of the moment that torsional
    friction carries, per force [m]."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation, by axis, of the position of the robot's surface [m]."""
    friction: float | None = Field(default=2.0, gt=0)
    """The largest tangential force of a contact, per normal force; None: any force may act on any
    side of the surface (F Eq 6-7)."""
    surface_tolerance: Spread = Field(default=0.01, gt=0)
    """The greatest distance of a contact from a point of the surface [m]; more than the spacing of
    its points."""
    compensation: Compensation = Field(default_factory=Compensation)
    """Load and bias of the sensor."""
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, -9.81)
    """In the frame of the hypothesis space [m/s²]; used where the load has a mass."""
    tare: Memory = Field(default=0.0, ge=0)
    """Duration of the first rest, without contact, whose mean wrench is a further bias [s]; there
    are no clouds before its end. 0: none."""
    unknown_bias: Force = Field(default=0.0, ge=0)
    """Standard deviation of what is left of the bias of a force, by axis [N]; it is learned while
    nothing is touched, with that of torques and with errors of the load. 0: nothing is left."""
    average: Memory = Field(default=0.0, ge=0)
    """Duration over which the newest wrenches are averaged [s], 0: none; the stated noise is that
    of one sample, for drift does not average out."""

    @model_validator(mode="before")
    @classmethod
    def _by_vendor(cls, fields: Any) -> Any:
        return beneath("force_torque", fields)

    @model_validator(mode="after")
    def _compensated_once(self) -> Self:
        known = WRENCHES[self.vendor] if self.vendor else None
        if known and known.compensated and (self.load == "robot" or self.compensation.mass):
            raise ValueError(
                f"the driver takes gravity off what '{self.vendor}' reports: leave the mass in "
                "compensation and `load: robot` out, and tell the driver its payload"
            )
        return self

    @model_validator(mode="after")
    def _one_sign_one_load(self) -> Self:
        if (self.sign is None) == (self.wrist is None):
            raise ValueError(
                "give the sign, or a wrist of the robot's description; a vendor gives the sign"
            )
        if self.load == "robot" and self.compensation.mass:
            raise ValueError("give the mass in compensation, or take the load of the robot")
        return self

    def on_robot(self) -> bool:
        """Whether the sensor measures the force of the world on the robot."""
        return (self.wrist.sign if self.wrist else self.sign) == "on_robot"


class ForceTorqueGenerator(Generator[ForceTorqueConfig]):
    """Regular, single contact: the positions where one contact explains the wrench (F §V-B)."""

    Config = ForceTorqueConfig
    readings = (Wrench,)
    needs_body = True

    def __init__(self, name: str, config: ForceTorqueConfig) -> None:
        super().__init__(name, config)
        self.reset()

    def reset(self) -> None:
        """Drop the tare, the samples of the average, and the state at their start."""
        self._bias: FloatArray | None = None if self.config.tare else np.zeros(6)
        self._rest: list[tuple[float, FloatArray]] = []
        self._recent: deque[tuple[float, FloatArray]] = deque()
        # what the average takes off the newest wrench: other sensors are given it as it is, since
        # what they take off theirs must not be later than these
        self._smoothed: FloatArray = np.zeros(6)
        self._span: tuple[float, float] | None = None
        self._was_free = self._bias is None  # a tare requires it
        self._first_force: FloatArray | None = None
        self._has_changed = False
        self._calmest: tuple[float, str] | None = None
        noise = np.repeat([self.config.force_noise, self.config.torque_noise], 3)
        self._left = BiasEstimate(noise, self.config.unknown_bias)
        self._asked: object = None
        self._touched = False
        self.resultant = None
        self._sign, self._weight, self._is_reversed = SignWatch(), WeightWatch(), False

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The positions on the surface where one contact explains the wrench.

        Raises:
            ConfigurationError: there is no surface to place contacts on.
        """
        assert isinstance(reading, Wrench)
        self.resultant = None
        surface = state.placed_surface(self.name)
        if self._is_dead(reading):
            return (self.nothing(reading, notes=(Note.UNHEALTHY,)),)
        wrench = self._filtered(reading, state)
        if wrench is None or self._span is None:
            return ()
        first = self._span[0]
        force, torque = wrench[:3], wrench[3:]
        pose = state.frames.pose(state.grid.frame, of=reading.frame)
        self.resultant = resultant = self._resultant(wrench + self._smoothed, reading, state)
        if self.config.average:
            resultant = self._resultant(wrench, reading, state)
        said = (Note.REVERSED,) if self._is_reversed else ()
        self._is_reversed = False  # it is reported once
        if np.linalg.norm(force) < self.least_force:
            self._was_free = True
            return (self.nothing(reading, notes=said),)
        probability = self.explained(force, torque)
        notes = (*said, Note.MORE_THAN_ONE_CONTACT) if probability < 1.0 else said
        if not self._was_free and reading.stamp - first >= LOADED:
            notes = (*notes, Note.NEVER_FREE if self._has_changed else Note.UNCHANGED)
        if probability == 0.0:
            return (self._off(reading, state, notes, resultant),)
        nearest = points_in(pose, line_of_action(force, torque)[None])[0]
        force = vectors_in(pose, force[None])[0]
        if links := state.carried_by(reading.frame):
            surface = surface.of_links(links)
        positions = self._on_surface(nearest, force, surface, state.grid)
        pulls = not len(positions) and len(self._on_surface(nearest, -force, surface, state.grid))
        reverse = bool(pulls) or self._is_contradicted(nearest, force, surface, state)
        if self._sign.suspects(reading.stamp, reverse):
            notes = (*notes, Note.REVERSED)
        if not len(positions):
            why = Note.PULLS if pulls else Note.OFF_SURFACE
            return (self._off(reading, state, (*notes, why), resultant),)
        levers = positions - pose[:3, 3]
        return (
            self.cloud(
                reading,
                positions,
                probability / len(positions),
                frame=state.grid.frame,
                forces=np.tile(force, (len(positions), 1)),
                spreads=self.spreads(force, levers),
                single=True,
                notes=notes,
                resultant=resultant,
            ),
        )

    def absorb(self, reading: Reading, state: State) -> None:
        """Take note of a wrench, for the tare, the average, the bias and what is watched."""
        assert isinstance(reading, Wrench)
        self.resultant = None
        if not self._is_dead(reading) and (wrench := self._filtered(reading, state)) is not None:
            self.resultant = self._resultant(wrench + self._smoothed, reading, state)

    def _filtered(self, reading: Wrench, state: State) -> FloatArray | None:
        """The contact's wrench on the robot, shape (6,) [N, N·m]; None before the tare."""
        wrench = self.compensated(reading, state)
        self._watch(reading)
        self._span = self._span[0] if self._span else reading.stamp, reading.stamp
        return wrench

    def _is_contradicted(
        self, start: FloatArray, force: FloatArray, surface: Surface, state: State
    ) -> bool:
        """Whether others find a contact on the line of action where the force pulls, none else."""
        found = state.evidence(without=self.name)
        if not len(found):
            return False
        direction = force / np.linalg.norm(force)
        offsets = found - start
        beside = np.linalg.norm(offsets - np.outer(offsets @ direction, direction), axis=1)
        distances, rows = surface.nearest(found, self.config.surface_tolerance)
        near = (beside <= ON_LINE * self.config.surface_tolerance) & np.isfinite(distances)
        along = surface.normals[rows[near]] @ direction
        return bool(near.any() and (along > 0.0).all())

    def _off(
        self, reading: Wrench, state: State, notes: Sequence[str], resultant: Resultant
    ) -> HypothesisCloud:
        """The cloud where no single contact explains the wrench."""
        return self.cloud(
            reading,
            np.empty((0, 3)),
            0.0,
            frame=state.grid.frame,
            notes=tuple(notes),
            resultant=resultant,
        )

    def _resultant(self, wrench: FloatArray, reading: Wrench, state: State) -> Resultant:
        """The sum over all contacts on the links that the sensor carries, in the grid's frame."""
        deviations = self._force_noise, self._torque_noise
        links = state.carried_by(reading.frame)
        pose = state.frames.pose(state.grid.frame, of=reading.frame)
        return Resultant(wrench[:3], wrench[3:], np.zeros(3), *deviations, links).moved(pose)

    @property
    def waits_for(self) -> str:
        """What prevents the tare; empty once it is taken."""
        if self._bias is not None or self._span is None:
            return ""
        tare, span = self.config.tare, self._span[1] - self._span[0]
        if span < tare:
            return (
                f"its tare takes {tare:g} s, and the readings span {span:.3g} s; "
                "is their unit of time right?"
            )
        if self._calmest is None:
            return f"its tare takes {tare:g} s, and other sources report contacts all the time"
        scatter, axis = self._calmest
        return (
            f"its tare takes {tare:g} s without contact while samples scatter by less than "
            f"{STEADY:g} times the stated noise, and {axis} never scattered by less than "
            f"{scatter:.1f} times: a contact meanwhile, a wrong column, "
            "a robot that moves, or more noise than stated"
        )

    def _watch(self, reading: Wrench) -> None:
        """Register a force that changes: that of a working sensor does, if only by its noise."""
        if self._first_force is None:
            self._first_force = reading.force
        self._has_changed |= bool((reading.force != self._first_force).any())

    def _is_dead(self, reading: Wrench) -> bool:
        """Whether a sensor that carries a load reads exact zeros: no load weighs so little."""
        loaded = self.config.load == "robot" or self.config.compensation.mass > 0.0
        return loaded and not (reading.force.any() or reading.torque.any())

    @property
    def _force_noise(self) -> float:
        """Standard deviation of a force, by axis, with what is unknown of the bias [N]."""
        return self._left.unknown * self.config.force_noise

    @property
    def _torque_noise(self) -> float:
        """Standard deviation of a torque, by axis, with what is unknown of the bias [N·m]."""
        return self._left.unknown * self.config.torque_noise

    @property
    def least_force(self) -> float:
        """The force under which no contact is reported [N]."""
        return self._left.unknown * (self.config.min_force or 5.0 * self.config.force_noise)

    def compensated(self, reading: Wrench, state: State) -> FloatArray | None:
        """The contact's wrench on the robot, shape (6,) [N, N·m]; None before the tare."""
        sign = 1.0 if self.config.on_robot() else -1.0
        parts = np.stack([reading.force, reading.torque])
        if self.config.axes:
            parts = vectors_in(state.frames.pose(reading.frame, of=self.config.axes), parts)
        wrench = sign * parts.ravel()
        compensation, gravity = self.config.compensation, np.zeros(3)
        if compensation.mass or self.config.load == "robot":
            pose = state.frames.pose(reading.frame, of=state.grid.frame)
            gravity = vectors_in(pose, np.array([self.config.gravity]))[0]
            if self.config.load == "robot":
                compensation = self._weighed(compensation, reading, state, pose)
        wrench = wrench - compensation.contactless(gravity)
        weight = compensation.mass * gravity
        self._is_reversed |= self._weight.suspects(reading.stamp, weight, wrench[:3])
        if self._bias is None:
            self._bias = self._tared(reading.stamp, wrench, touched=bool(state.contacts))
            if self._bias is None:
                return None
        newest = wrench - self._bias
        wrench = self._averaged(reading.stamp, newest)
        self._smoothed = newest - wrench
        if not self.config.unknown_bias:
            return wrench
        if state.fusion is not self._asked:  # once a step
            self._asked = state.fusion
            self._touched = len(state.evidence(without=self.name)) > 0
        return self._left.update(reading.stamp, wrench, gravity, compensation.mass, self._touched)

    def _weighed(
        self, compensation: Compensation, reading: Reading, state: State, pose: Pose
    ) -> Compensation:
        """The compensation with the load on the sensor in this pose."""
        mass, centre = state.posed_robot(self.name).load_on(state.link_of(reading.frame))
        x, y, z = points_in(pose, centre[None])[0].tolist()
        return compensation.model_copy(update={"mass": mass, "centre_of_mass": (x, y, z)})

    def explained(self, force: FloatArray, torque: FloatArray) -> float:
        """The probability that one contact explains a wrench.

        A single contact has no torque along its force. With r = |τ·f|/(|f||τ|) and its standard
        deviation σ_r under the noise, P is 1 up to 3 σ_r and falls to 0 at 6 σ_r (method §5). Here
        both are multiplied by |τ|, so that a torque of zero needs no exception.
        """
        magnitude = float(np.linalg.norm(force))
        along = abs(float(torque @ force)) / magnitude
        across = float(np.linalg.norm(np.cross(force, torque))) / magnitude
        sigma = np.sqrt(
            self._torque_noise**2
            + (across * self._force_noise / magnitude) ** 2
            + (self.config.patch * magnitude) ** 2
        )
        return float(np.clip(2.0 - along / (3.0 * sigma), 0.0, 1.0))

    def spreads(self, force: FloatArray, levers: FloatArray) -> FloatArray:
        """Standard deviations of positions by axis across the line, shape (n,) [m].

        The noises t and e of torque and force move the line at r by f × (t - r × e)/|f|². Of the
        two axes across the line, one has the whole lever, the other its part along the force; the
        result is the root of their mean square.

        Args:
            force: shape (3,) [N].
            levers: shape (n, 3) [m], the positions from the sensor's origin, in the same axes.
        """
        magnitude = np.linalg.norm(force)
        lever_squared = (np.square(levers).sum(axis=1) + (levers @ force / magnitude) ** 2) / 2.0
        noise = np.sqrt(self._torque_noise**2 + lever_squared * self._force_noise**2)
        across = np.hypot(noise / magnitude, self.config.patch)
        spreads: FloatArray = np.hypot(across, self.config.noise)
        return spreads

    def _on_surface(
        self, start: FloatArray, force: FloatArray, surface: Surface, grid: Grid
    ) -> FloatArray:
        """Samples of the line of action on the surface, where the force pushes into it.

        Args:
            start: shape (3,) [m], a point of the line.
            force: shape (3,) [N], on the robot, in the frame of the grid.
            surface: in the frame of the grid.
            grid: samples lie a voxel apart, or closer where the tolerance is smaller than that.

        Returns:
            Shape (n, 3) [m], at most one position a voxel.
        """
        direction = force / np.linalg.norm(force)
        reach = self.config.surface_tolerance
        surface = surface.near_line(start, direction, reach)
        step = min(grid.voxel_size, reach)
        offsets = surface.points - start
        along = offsets @ direction
        close = np.flatnonzero(np.einsum("ij,ij->i", offsets, offsets) - along**2 <= reach**2)
        friction = self.config.friction
        least = -np.inf if friction is None else 1.0 / np.hypot(1.0, friction)
        pushed = -(surface.normals[close] @ direction) >= least
        if not pushed.any():
            return np.empty((0, 3))
        first, last = along[close][pushed].min() - reach, along[close][pushed].max() + reach
        samples = start + np.arange(first, last + step, step)[:, None] * direction
        distances = cdist(samples, surface.points[close])
        nearest = distances.argmin(axis=1)
        found = pushed[nearest] & (distances[np.arange(len(samples)), nearest] <= reach)
        kept: FloatArray = samples[found]
        return kept[voxel_downsample(kept, grid)]

    def _tared(self, stamp: float, wrench: FloatArray, touched: bool) -> FloatArray | None:
        """The mean wrench over the rest, once it has lasted long enough; None before.

        The rest starts again when samples scatter more than noise does, and while another source
        reports a contact: a tare during a contact would remove that contact.
        """
        if touched:
            self._rest.clear()
            return None
        self._rest.append((stamp, wrench))
        if stamp - self._rest[0][0] < self.config.tare:
            return None
        samples = np.array([sample for _, sample in self._rest])
        noise = np.repeat([self.config.force_noise, self.config.torque_noise], 3)
        scatter = samples.std(axis=0) / noise
        if (worst := float(scatter.max())) > STEADY:
            if self._calmest is None or worst < self._calmest[0]:
                self._calmest = worst, AXES[int(scatter.argmax())]
            self._rest.clear()
            return None
        bias: FloatArray = samples.mean(axis=0)
        return bias

    def _averaged(self, stamp: float, wrench: FloatArray) -> FloatArray:
        if not self.config.average:
            return wrench
        self._recent.append((stamp, wrench))
        while stamp - self._recent[0][0] > self.config.average:
            self._recent.popleft()
        mean: FloatArray = np.mean([sample for _, sample in self._recent], axis=0)
        return mean


def line_of_action(force: FloatArray, torque: FloatArray) -> FloatArray:
    """The point of the line of action nearest the origin: (f × τ)/|f|², shape (3,) [m].

    The line is parallel to the force. A part of τ along f, which no single force can have, is
    ignored.
    """
    nearest: FloatArray = np.cross(force, torque) / (force @ force)
    return nearest


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[ForceTorqueConfig]]]:
    """The force-torque generator."""
    return {"force_torque": ForceTorqueGenerator}
