"""Contacts anywhere on an arm from the torques, or motor currents, of its joints."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.special import chdtri, logsumexp

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.frames import inverse, points_in, vectors_in
from contactfusion.generator import Generator, GeneratorConfig, OfRobot
from contactfusion.generators.effort_watch import NEVER_FREE, OFTEN, FrozenEfforts, LoadWatch
from contactfusion.generators.external_torque import LONGEST, Effort, ExternalTorque, Sign
from contactfusion.generators.sign import SignWatch
from contactfusion.generators.torque_field import explained
from contactfusion.generators.wrist_loads import Left, WristLoads
from contactfusion.grid import Grid
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, Note
from contactfusion.readings import JointState, Reading
from contactfusion.robots.description import EffortConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State
from contactfusion.surface import RigidPart, Surface
from contactfusion.thinning import voxel_downsample
from contactfusion.units import Acceleration, Force, Spacing, Spread
from contactfusion.vendors import beneath

SURE = 0.999
"""Less than one in a thousand of single contacts leaves more unexplained."""
FAINT = 1e-3
"""Points that are less likely than that part of the likeliest are left out."""
DOUBT = 0.1
"""The odds of a contact before anything is measured; a contact that is less probable is none."""
FELT = 2.0
"""Points where a force changes the evidence by less, as a logarithm, are as good as not felt."""
SLOW = f"its readings come more than {LONGEST:g} s apart: nothing is reported of contacts"
"""A note: after such a gap the observer begins again."""
ELSEWHERE = "what touches these links is left to another sensor: "
"""How a note begins that names links, with commas between them."""
BLIND = "in this pose no joint feels a force on any link"
"""A note: the arm is stretched out, or its efforts are too noisy."""
NO_EFFORTS = "every effort is exactly 0: its driver reports none"
FROZEN = "left out, as their efforts stay exactly as they are while what they bear does not: "
"""How a note begins that names joints, with commas between them."""
UNDECIDED = "it cannot tell on which link: "
"""How a note begins that names links, with commas between them."""
HELD, MOST = 0.9, 3
"""Where more parts of the arm are needed to hold that probability, nothing is claimed."""
UNLOCATED = 3
"""Wherever a link that no more joints move is touched, some force explains their torques: where
another link is as likely, nothing is claimed."""
TENTH = 10
"""Of samples that no contact explains one in so many is tried with the other sign."""
HARD, WIDER = 3.0, 4
"""A likeliest force of so many times `strength` is tried with its own as the strength, so often."""
LARGEST = 30.0
"""Logarithms of odds are cut off there."""


class JointTorqueConfig(GeneratorConfig):
    """The options of `joint_torque`."""

    vendor: str | None = None
    """The convention of a known driver, in place of `effort` and `sign`, such as
    `franka_tau_ext_hat_filtered`."""
    effort: Effort
    """What the joints report: the `external` torque, as some drivers compute it, the `measured`
    torque of the motors or behind the gears, or the motors' `current`."""
    joints: Annotated[dict[str, EffortConfig], OfRobot("efforts")] = Field(min_length=1)
    """The joints, by name, or a list of names from the robot's description."""
    sign: Sign = "on_robot"
    """Whether efforts are torques on the robot, of the world where they are `external` and else of
    its motors, or the reverse."""
    links: tuple[str, ...] = ()
    """The links that may be touched; none: all that a joint moves."""
    forces: bool = True
    """Whether it states the force of its contact, which is taken for the sum of all contacts on the
    robot; false where several have a limb each."""
    gain: float = Field(default=10.0, gt=0)
    """Of the momentum observer [1/s]; it lags by one over it."""
    scale: float = Field(default=0.05, ge=0, lt=1)
    """Standard deviation of torques of contacts and of inertia, as a part of them: by how much
    current constants and inertias are wrong."""
    friction: float = Field(default=0.5, gt=0)
    """The largest tangential force of a contact, per normal force."""
    strength: Force = Field(default=50.0, gt=0)
    """Standard deviation of the force of contacts, by axis [N]."""
    p_max: float = Field(default=0.95, gt=0, le=1)
    """The largest probability of a contact."""
    noise: Spread = Field(default=0.005, ge=0)
    """Standard deviation, by axis, of the position of the robot's surface [m]."""
    spacing: Spacing = Field(default=0.01, gt=0)
    """Distance between the points of the surface that are tried [m]."""
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, -9.81)
    """In the frame of the hypothesis space [m/s²]."""

    @model_validator(mode="before")
    @classmethod
    def _by_vendor(cls, fields: Any) -> Any:
        return beneath("joint_torque", fields)


class JointTorqueGenerator(Generator[JointTorqueConfig]):
    """Regular, single contact: the points of the surface where a force explains all torques."""

    Config = JointTorqueConfig
    readings = (JointState,)
    needs_body = True

    def __init__(self, name: str, config: JointTorqueConfig) -> None:
        super().__init__(name, config)
        self._torque: ExternalTorque | None = None
        self.reset()

    def prepare(self, robot: RobotModel) -> None:
        """Look its joints and links up in the robot.

        Raises:
            ConfigurationError: the robot lacks one of them.
            RobotError: it has no inertias, and the effort needs them.
        """
        config = self.config
        unstated = [name for name, joint in config.joints.items() if joint.constant is None]
        if config.effort == "current" and unstated:
            raise ConfigurationError(
                f"no torque per ampere of {', '.join(unstated)}: give each its `constant`, which "
                "`identify` measures",
                "joints",
            )
        for joint in config.joints:
            if joint not in robot.joint_names:
                hint = name_hint(joint, robot.joint_names, "joints of the robot")
                raise ConfigurationError(f"unknown joint '{joint}'; {hint}", "joints")
            if follower := next((n for n, m in robot.urdf.mimics.items() if m.joint == joint), ""):
                raise ConfigurationError(
                    f"joint '{joint}' drives '{follower}', and its effort is of both: leave it out",
                    "joints",
                )
        dynamics = Dynamics(robot)
        if config.effort != "external":
            dynamics.require_inertias()
        self._dynamics = dynamics
        self._torque = ExternalTorque(
            dynamics, config.joints, config.effort, config.gain, config.scale, config.sign
        )
        self._felt = dynamics.supports & self._torque.known
        self._wrists = WristLoads(dynamics, self._felt, config.scale)
        chosen = robot.known_links(config.links)
        rows = zip(robot.link_names, self._felt, strict=True)
        loaded = {name for name, joints in rows if joints.any()}
        self._parts = {
            name: _thinned(part, robot.exposed[name], self.config.spacing)
            for name, part in robot.parts.items()
            if name in chosen and name in loaded
        }
        """The surface of each link that may be touched."""
        if unfelt := [name for name in config.links if name not in loaded]:
            raise ConfigurationError(
                f"none of `joints` moves {', '.join(unfelt)}: what touches there loads none",
                "links",
            )
        if self._torque.known.sum() <= UNLOCATED and not config.links:
            raise ConfigurationError(
                f"{self._torque.known.sum()} joints cannot tell where on {len(loaded)} links a "
                f"contact is: give more than {UNLOCATED}, or the `links` that may be touched",
                "joints",
            )
        self._groups = np.unique(self._felt, axis=0, return_inverse=True)[1].ravel()

    def reset(self) -> None:
        """Begin the observer again."""
        self._sign, self._unexplained, self._reverse = SignWatch(), 0, False
        self._is_heard = False
        self._load, self._frozen = LoadWatch(), FrozenEfforts(1.0 / self.config.gain)
        self._stamp: float | None = None
        if self._torque is not None:
            self._torque.reset()
            self._wrists.reset()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The surface where one contact explains the torques.

        Raises:
            ConfigurationError: there is no robot.
            InvalidReadingError: a joint has no effort.
        """
        assert isinstance(reading, JointState)
        if self._is_of_others(reading):
            return ()
        grid = state.grid.frame
        if fault := self._fault(reading):
            return (self.nothing(reading, frame=grid, notes=(fault,)),)
        robot, found = self._loads(reading, state)
        if found is None:
            gaps = self._stamp is not None and reading.stamp - self._stamp > LONGEST
            self._stamp = reading.stamp
            return (self.nothing(reading, frame=grid, notes=(SLOW,)),) if gaps else ()
        self._stamp = reading.stamp
        return (self._cloud(reading, state, robot, found),)

    def absorb(self, reading: Reading, state: State) -> None:
        """Follow the momentum and what other sensors measure, without looking for the contact."""
        assert isinstance(reading, JointState)
        if not (self._is_of_others(reading) or self._fault(reading)):
            self._loads(reading, state)
            self._stamp = reading.stamp

    def _loads(self, reading: JointState, state: State) -> tuple[PosedRobot, Left | None]:
        """The robot as the reading has it, and the torques of contacts that it alone tells of.

        These are None before they are known.
        """
        robot = state.posed_robot(self.name)
        if self._torque is None:
            self.prepare(robot.model)
        assert self._torque is not None
        robot = robot.with_joints(reading)
        found = self._torque.update(reading, robot.positions, self._gravity(robot))
        if found is None:
            self._wrists.reset()
            self._frozen.reset()
            return robot, None
        share, (torques, deviations) = self._torque.share, found
        if self.config.effort != "external" and share > 0.0:
            self._frozen.follow(reading.stamp, self._torque.reported, torques, deviations)
        deviations = np.where(self._frozen.found, np.inf, deviations)
        left = self._wrists.left(
            robot, reading.stamp, state.resultants, state.resultant_ages, torques, deviations, share
        )
        return robot, left

    def _gravity(self, robot: PosedRobot) -> FloatArray:
        """Shape (3,) [m/s²], in the root link's frame."""
        gravity: FloatArray = vectors_in(inverse(robot.base), np.array([self.config.gravity]))[0]
        return gravity

    def _is_of_others(self, reading: JointState) -> bool:
        """Whether it is of joints of others, such as a gripper's, once there was one of its own."""
        is_own = not self.config.joints.keys().isdisjoint(reading.names)
        self._is_heard = self._is_heard or is_own
        return self._is_heard and not is_own

    def _fault(self, reading: JointState) -> str:
        """The note on efforts that a driver does not report, or that are all exactly zero."""
        if reading.efforts is None:
            return ""
        own = {
            name: effort
            for name, effort in zip(reading.names, reading.efforts.tolist(), strict=True)
            if name in self.config.joints
        }
        if missing := [name for name, effort in own.items() if np.isnan(effort)]:
            return f"its driver reports no effort of {', '.join(missing)}"
        return NO_EFFORTS if own and not any(own.values()) else ""

    def _cloud(
        self,
        reading: JointState,
        state: State,
        robot: PosedRobot,
        found: Left,
    ) -> HypothesisCloud:
        """The hypotheses that torques give; links that are measured otherwise are left out."""
        config = self.config
        torques, deviations, measured, is_shared = found
        assert self._torque is not None
        parts = [
            (part, robot.poses[name]) for name, part in self._parts.items() if name not in measured
        ]
        left = [name for name in self._parts if name in measured and is_shared]
        elsewhere = (f"{ELSEWHERE}{', '.join(left)}",) if left else ()
        nothing = partial(self.nothing, reading, frame=state.grid.frame)
        if not parts:
            return nothing(notes=elsewhere)
        surface = Surface.of_parts(state.grid.frame, parts, robot.model.link_names)
        points, groups = surface.points, self._groups[surface.links]
        precisions = np.where(self._torque.known, 1.0 / deviations**2, 0.0)
        strength = self.config.strength
        gains, evidence, forces = self._explained(robot, surface, torques, precisions, strength)
        for _ in range(WIDER):  # a blow of many times the usual strength is still a contact
            hardest = float(np.linalg.norm(forces[gains.argmax()]))
            if hardest <= HARD * strength:
                break
            strength = hardest
            gains, evidence, forces = self._explained(robot, surface, torques, precisions, strength)
        whole = float(precisions @ torques**2)
        left_over = whole - float(_explained_by(gains, forces, strength).max())
        limit = float(chdtri(max(int((precisions > 0.0).sum()) - 3, 1), 1.0 - SURE))
        notes: tuple[str, ...] = ()
        if (frozen := self._frozen.found & self._torque.known).any():
            names = np.array(robot.model.joint_names)[frozen]
            notes = (f"{FROZEN}{', '.join(names)}",)
        if whole > limit:
            if left_over <= limit:
                self._unexplained = 0
            else:
                if self._unexplained % TENTH == 0:
                    mirrored = self._mirrored(robot, torques)
                    others, _, pushes = self._explained(
                        robot, surface, mirrored, precisions, strength
                    )
                    other = float(_explained_by(others, pushes, strength).max())
                    self._reverse = bool(precisions @ mirrored**2 - other <= limit)
                self._unexplained += 1
            reverse = self._unexplained > 0 and self._reverse
            if self._sign.suspects(reading.stamp, reverse):
                notes = (*notes, Note.REVERSED)
        is_felt = gains - evidence > FELT
        if not is_felt.any():
            return nothing(notes=(*notes, BLIND))
        points, groups, forces = points[is_felt], groups[is_felt], forces[is_felt]
        gains, evidence = gains[is_felt], evidence[is_felt]
        log_odds = np.log(DOUBT) + logsumexp(evidence) - np.log(len(evidence))
        probability = 1.0 / (1.0 + np.exp(-np.clip(log_odds, -LARGEST, LARGEST)))
        self._load.follow(reading.stamp, probability >= DOUBT)
        if probability < DOUBT:
            return nothing(notes=(*notes, *elsewhere))
        single = float(np.clip(2.0 - left_over / limit, 0.0, 1.0))
        if single < 1.0:
            notes = (*notes, Note.MORE_THAN_ONE_CONTACT)
        weights = np.exp(gains - gains.max())
        weights /= weights.sum()
        undecided, is_located = self._undecided(groups, weights, measured)
        notes = (*notes, *undecided)
        if self._load.may_be_own and not config.links:
            return nothing(notes=(*notes, NEVER_FREE))
        if self._load.is_loaded_often:
            notes = (*notes, OFTEN)
        if single == 0.0 or not is_located:
            return nothing(notes=notes)
        kept = weights >= FAINT * weights.max()
        weights = weights[kept] / weights[kept].sum()
        apart = max(config.spacing, surface.spacing)
        spread = np.hypot(config.noise, apart / np.sqrt(12.0))
        return self.cloud(
            reading,
            points[kept],
            min(probability * single, config.p_max) * weights,
            frame=state.grid.frame,
            forces=forces[kept] if config.forces and not is_shared else None,
            spreads=np.full(len(weights), spread),
            single=True,
            notes=notes,
        )

    def _mirrored(self, robot: PosedRobot, torques: FloatArray) -> FloatArray:
        """What would be left of efforts of the other sign, in an arm at rest, shape (n,)."""
        if self.config.effort == "external":
            return -torques
        still = np.zeros(len(torques))
        return -2.0 * self._dynamics.drift(robot.positions, still, self._gravity(robot)) - torques

    def _undecided(
        self, groups: NDArray[np.intp], weights: FloatArray, measured: frozenset[str]
    ) -> tuple[tuple[str, ...], bool]:
        """A note where the contact may lie on several parts, and whether a place can be claimed.

        It cannot where too many parts come into question, or most likely those near the base.

        Args:
            groups: shape (m,), the part of each point: links that load the same joints.
            weights: shape (m,), how probable each point is; they sum to 1.
            measured: links that are left to another sensor.
        """
        shares = np.bincount(groups, weights, self._groups.max() + 1)
        order = np.argsort(-shares, kind="stable")
        needed = int(np.searchsorted(np.cumsum(shares[order]), HELD)) + 1
        if needed == 1:
            return (), True
        near = np.unique(self._groups[self._felt.sum(axis=1) <= UNLOCATED])
        is_near = shares[near].sum() > 0.5
        parts = {*order[:needed].tolist()}
        links = [
            name
            for name, group in zip(self._dynamics.model.link_names, self._groups, strict=True)
            if group in parts and name in self._parts and name not in measured
        ]
        return (f"{UNDECIDED}{', '.join(links)}",), needed <= MOST and not is_near

    def _explained(
        self,
        robot: PosedRobot,
        surface: Surface,
        torques: FloatArray,
        precisions: FloatArray,
        strength: float,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gains and evidence, shape (m,), and forces, (m, 3) [N], at points of the surface."""
        config, to_root = self.config, inverse(robot.base)
        points, normals = points_in(to_root, surface.points), vectors_in(to_root, surface.normals)
        linear, angular = self._dynamics.axes(robot.positions)
        gains, evidence, forces = (
            np.empty(len(points)),
            np.empty(len(points)),
            np.empty_like(points),
        )
        explained(
            points, normals, self._felt[surface.links], linear, angular, torques, precisions,
            float(1.0 / np.hypot(1.0, config.friction)), strength**-2,
            gains, evidence, forces,
        )  # fmt: skip
        return gains, evidence, vectors_in(robot.base, forces)


def _explained_by(gains: FloatArray, forces: FloatArray, strength: float) -> FloatArray:
    """By how much χ² falls by the force at each point, shape (m,), however strong it is."""
    return np.asarray(2.0 * gains + np.square(forces / strength).sum(axis=1))


def _thinned(part: RigidPart, exposed: NDArray[np.bool_], spacing: float) -> RigidPart:
    """The exposed points of a part that lie a distance [m] apart, or face otherwise."""
    points, normals, links = part.points[exposed], part.normals[exposed], part.links[exposed]
    rows = voxel_downsample(points + spacing * normals, Grid("part", spacing))
    return RigidPart(points[rows], normals[rows], links[rows])


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[JointTorqueConfig]]]:
    """The generator."""
    return {"joint_torque": JointTorqueGenerator}
