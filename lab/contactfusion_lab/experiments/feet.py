"""`experiment feet`: which feet of a legged robot touch the ground, by the torques of its joints.

A quadruped stands, leans to three of its feet and lifts the fourth, foot by foot; or one leg of it,
whose hip is pinned, is pressed on the ground and lifted. Each leg is a `joint_torque` of its own,
for which the trunk is the root: its joints feel the contact of that leg alone.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from contactfusion import Pipeline, PipelineConfig
from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import make_folder, whole_file, write_whole
from contactfusion.frames import points_in
from contactfusion.readings import JointState, Odometry
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.terminal import note, say
from contactfusion_lab.trials.measures import Measure, grouped, p50, p90, proportion
from contactfusion_lab.trials.tables import as_csv, frame_of

URDF = "pybullet_data:a1/a1.urdf"
LEGS = ("FR", "FL", "RR", "RL")
STANCE = np.array([0.0, 0.75, -1.5])
"""The joints of a leg that stands [rad]."""
STEP, READ, FUSE = 0.001, 5, 20
"""Time step of the physics [s]; readings and steps of the pipeline come every so many."""
STIFFNESS, DAMPING = 200.0, 4.0
"""Of the joints' impedance [N·m/rad, N·m·s/rad]."""
COULOMB, SLOW = 0.3, 0.02
"""Friction of each joint [N·m], and the speed at which it is full [rad/s]."""
TORQUE_NOISE, ENCODER_NOISE, TILT = 0.2, 2e-4, 0.01
"""Standard deviations of a torque [N·m], a position [rad], and the trunk's orientation [rad]."""
MASSES = 0.05
"""Standard deviation of a link's mass, as a part of it: that of the URDF is not quite right."""
LIFT, LEAN, PRESS = 0.05, 0.055, 0.004
"""How high a foot is lifted, how far the trunk leans away from it, and how deep a foot of a pinned
leg is commanded into the ground [m]."""
BEARS = 1.0
"""A foot is in contact when the ground pushes it by that force [N]."""
NEAR = 0.05
"""A contact belongs to the foot that is no further away [m]."""
SAYS = 0.75
"""P(contact) from which a foot is taken to touch; where nothing is known it falls to 0.5."""
EDGE, BOUNCE = 0.06, 0.1
"""A change that is no further from a true one is late or early, not false; a shorter time on the
ground or in the air is none [s]."""
RATES = (10.0, 1.0)
"""Of contacts that are made and broken [1/s]: of walking feet, and the default."""
KNEE = 1.0
"""A foot is taken to touch from that torque of its knee on, as the baseline has it [N·m]; the best
of 0.5 to 5 on seeds 0 to 2."""


@dataclass(frozen=True)
class Phase:
    """A part of the script, over which targets move evenly.

    Attributes:
        seconds: its duration [s].
        lean: shape (3,) [m], of the trunk from the middle of the feet, at its end.
        raised: shape (4,) [m], how high each foot is at its end.
    """

    seconds: float
    lean: FloatArray
    raised: FloatArray


def standing(order: Sequence[int]) -> Iterator[Phase]:
    """Lean, lift, hold and put down one foot after the other."""
    ground, level = np.zeros(4), np.zeros(3)
    yield Phase(0.6, level, ground)
    for leg in order:
        name = LEGS[leg]
        x, y = (-1.0 if name[0] == "F" else 1.0), (-1.0 if name[1] == "L" else 1.0)
        lean = LEAN * np.array([x, y, 0.0])
        raised = LIFT * (np.arange(4) == leg)
        for seconds, goal in ((0.6, ground), (0.2, raised), (0.4, raised), (0.2, ground)):
            yield Phase(seconds, lean, goal)
        yield Phase(0.6, level, ground)


def pinned(leg: int, times: int) -> Iterator[Phase]:
    """Press and lift one foot again and again; all others stay in the air."""
    free, level = np.full(4, LIFT), np.zeros(3)
    down = np.where(np.arange(4) == leg, -PRESS, LIFT)
    yield Phase(0.6, level, free)
    for _ in range(times):
        for seconds, goal in ((0.2, down), (0.5, down), (0.2, free), (0.5, free)):
            yield Phase(seconds, level, goal)


class Quadruped:
    """A quadruped in PyBullet, whose feet are moved by joint impedance; its readings err.

    Args:
        is_pinned: whether its trunk is held where it would stand.
        rng: draws the errors of masses and sensors.
    """

    def __init__(self, is_pinned: bool, rng: np.random.Generator) -> None:
        self.model = RobotModel(robot_config())
        self._rng, self._world = rng, BulletWorld(self.model, fixed=is_pinned, visual=True)
        self._legs = [_rows(self.model, leg) for leg in LEGS]
        self.positions = np.zeros(len(self.model.joint_names))
        for rows in self._legs:
            self.positions[rows] = STANCE
        self.velocities, self._wanted = np.zeros(len(self.positions)), self.positions.copy()
        poses = self.model.poses_at(self.positions)
        self._feet = np.array([poses[f"{leg}_toe"][:3, 3] for leg in LEGS])
        self._stand(poses, is_pinned)
        self.stamp, self._tilt = 0.0, TILT * rng.standard_normal(3)

    def _stand(self, poses: Mapping[str, FloatArray], is_pinned: bool) -> None:
        """Put it on the ground, and set masses, friction and gravity."""
        bullet, client, world = self._world.bullet, self._world.client, self._world
        bullet.setGravity(0.0, 0.0, -9.81, **client)
        bullet.setTimeStep(STEP, **client)
        plane = bullet.createCollisionShape(bullet.GEOM_PLANE, **client)
        self._ground: int = bullet.createMultiBody(0.0, plane, **client)
        bullet.changeDynamics(self._ground, -1, lateralFriction=0.8, **client)
        for row in world.links:
            factor = 1.0 + MASSES * self._rng.standard_normal()
            mass, _, inertia = bullet.getDynamicsInfo(world.robot, row, **client)[:3]
            changes: dict[str, Any] = {
                "jointDamping": 0.0,
                "linearDamping": 0.0,
                "angularDamping": 0.0,
            }
            if not (is_pinned and row < 0):  # with a mass, a trunk that is held would fall
                scaled = [factor * each for each in inertia]
                changes |= {"mass": factor * mass, "localInertiaDiagonal": scaled}
            bullet.changeDynamics(world.robot, row, lateralFriction=0.8, **changes, **client)
        by_link = {link: row for row, link in world.links.items()}
        self._toes = [by_link[f"{leg}_toe"] for leg in LEGS]
        parts = ((poses[link], self.model.parts[link]) for link in (f"{leg}_toe" for leg in LEGS))
        lowest = min(points_in(pose, part.points)[:, 2].min() for pose, part in parts)
        base = np.eye(4)
        base[2, 3] = -lowest
        world.place_robot(base)
        world.bend(self.positions)
        bullet.setJointMotorControlArray(
            world.robot, world.joints, bullet.VELOCITY_CONTROL,
            forces=[0.0] * len(world.joints), **client,
        )  # fmt: skip

    def play(self, phases: Iterator[Phase]) -> Iterator[tuple[Odometry, JointState, FloatArray]]:
        """What its sensors read every `READ` steps, with the true forces on its feet (4,) [N]."""
        lean, raised, count = np.zeros(3), np.zeros(4), 0
        for phase in phases:
            steps = round(phase.seconds / STEP)
            for number in range(steps):
                part = (number + 1) / steps
                at = lean + part * (phase.lean - lean), raised + part * (phase.raised - raised)
                torques = self._step(*at)
                count += 1
                if count % READ == 0:
                    yield *self._readings(torques), self._pushed()
            lean, raised = phase.lean, phase.raised

    def _step(self, lean: FloatArray, raised: FloatArray) -> FloatArray:
        """One step towards the targets of the feet; the torques of the motors, shape (n,) [N·m]."""
        targets = self._feet - lean
        targets[:, 2] += raised
        for leg, rows, target in zip(LEGS, self._legs, targets, strict=True):
            link = f"{leg}_toe"
            away = target - self.model.poses_at(self._wanted)[link][:3, 3]
            across = self.model.jacobian(link, self._wanted)[:3, rows]
            self._wanted[rows] += np.linalg.solve(across, away)
        motors = STIFFNESS * (self._wanted - self.positions) - DAMPING * self.velocities
        rubbed = COULOMB * np.tanh(self.velocities / SLOW)
        bullet, client, world = self._world.bullet, self._world.client, self._world
        bullet.setJointMotorControlArray(
            world.robot, world.joints, bullet.TORQUE_CONTROL, forces=motors - rubbed, **client
        )
        bullet.stepSimulation(**client)
        states = bullet.getJointStates(world.robot, world.joints, **client)
        self.positions = np.array([state[0] for state in states])
        self.velocities = np.array([state[1] for state in states])
        self.stamp += STEP
        return motors

    def _readings(self, torques: FloatArray) -> tuple[Odometry, JointState]:
        noise = self._rng.standard_normal((2, len(torques)))
        joints = JointState(
            stamp=self.stamp, frame="joints", sensor="joints", names=self.model.joint_names,
            positions=self.positions + ENCODER_NOISE * noise[0],
            efforts=torques + TORQUE_NOISE * noise[1],
        )  # fmt: skip
        place, turn = self._world.bullet.getBasePositionAndOrientation(
            self._world.robot, **self._world.client
        )
        seen = Rotation.from_rotvec(self._tilt) * Rotation.from_quat(turn)
        trunk = Odometry(
            stamp=self.stamp, frame="world", sensor="imu", child_frame=self.model.root,
            position=np.array(place), orientation=seen.as_quat(),
        )  # fmt: skip
        return trunk, joints

    def _pushed(self) -> FloatArray:
        """The force of the ground on each foot, shape (4,) [N]."""
        world, found = self._world, np.zeros(len(LEGS))
        for contact in world.bullet.getContactPoints(world.robot, self._ground, **world.client):
            if contact[3] in self._toes:
                found[self._toes.index(contact[3])] += contact[9]
        return found


def robot_config() -> RobotConfig:
    """The quadruped, with what is known of its joints."""
    noise = {"noise": 1.5 * TORQUE_NOISE, "coulomb": COULOMB}
    parts = ("hip", "upper", "lower")
    return RobotConfig.model_validate(
        {
            "urdf": URDF,
            "spacing": 0.006,
            "efforts": {f"{leg}_{part}_joint": noise for leg in LEGS for part in parts},
        }
    )


def pipeline_config(rate: float) -> PipelineConfig:
    """A `joint_torque` a leg, fused by the default rule; contacts are made and broken at a rate."""
    return PipelineConfig.model_validate(
        {
            "robot": robot_config(),
            "generators": {
                leg: {
                    "type": "joint_torque",
                    "sensor": "joints",
                    "effort": "measured",
                    "joints": [f"{leg}_{part}_joint" for part in ("hip", "upper", "lower")],
                    "links": [f"{leg}_toe"],
                    "forces": False,
                    "gain": 100.0,
                }
                for leg in LEGS
            },
            "integrator": {
                "frame": "world",
                "voxel_size": 0.005,
                "condensation": {"type": "members", "rate": rate},
            },
            "cycle": {"every": FUSE * STEP},
        }
    )


def _rows(model: RobotModel, leg: str) -> list[int]:
    return [model.joint_names.index(f"{leg}_{part}_joint") for part in ("hip", "upper", "lower")]


Sample = tuple[Odometry, JointState, FloatArray]
"""What is read at an instant, and the true forces on the feet."""


def recorded(seed: int, is_pinned: bool) -> tuple[list[str], list[Sample]]:
    """The feet that move, and what is read while they do.

    Args:
        seed: of the order of the feet, and of all errors.
        is_pinned: whether one leg alone is pressed and lifted, its hip pinned.
    """
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(LEGS)).tolist()
    robot = Quadruped(is_pinned, rng)
    if is_pinned:
        return [LEGS[order[0]]], [*robot.play(pinned(order[0], 4))]
    return [*LEGS], [*robot.play(standing(order))]


def watched(feet: Sequence[str], samples: Sequence[Sample], rate: float) -> pd.DataFrame:
    """P(contact) of some feet beside the true force.

    Args:
        feet: that are watched.
        samples: what is read.
        rate: of contacts that are made and broken [1/s].

    Returns:
        Columns `stamp` [s], `foot`, `probability`, `knee` [N·m], `force` [N].
    """
    pipeline, rows = Pipeline(pipeline_config(rate)), list[tuple[Any, ...]]()
    for number, (trunk, joints, forces) in enumerate(samples):
        pipeline.receive(trunk)
        pipeline.receive(joints)
        if number % (FUSE // READ) == 0:
            contacts = pipeline.step(joints.stamp).fusion.contacts
            robot = pipeline.state(joints.stamp).posed_robot("feet")
            assert joints.efforts is not None
            for foot in feet:
                knee = abs(float(joints.efforts[joints.names.index(f"{foot}_lower_joint")]))
                force = float(forces[LEGS.index(foot)])
                rows.append((joints.stamp, foot, probability(contacts, robot, foot), knee, force))
    return pd.DataFrame(rows, columns=["stamp", "foot", "probability", "knee", "force"])


def probability(contacts: Sequence[Contact], robot: PosedRobot, foot: str) -> float:
    """The probability of a contact of a foot: that of the most probable contact near it."""
    toe = robot.poses[f"{foot}_toe"][:3, 3]
    near = (c.likelihood for c in contacts if np.linalg.norm(c.position - toe) <= NEAR)
    return max(near, default=0.0)


@dataclass(frozen=True)
class Counted:
    """What a foot's estimate got right over one script.

    Attributes:
        made: times from a contact's beginning until it is found [s]; inf where it is not.
        broken: likewise from its end.
        false: contacts that were found in the air.
        lost: contacts that were lost while the foot stood.
        air: time in the air [s].
        ground: time on the ground [s].
        right: shape (n,), whether each step is right.
    """

    made: list[float]
    broken: list[float]
    false: int
    lost: int
    air: float
    ground: float
    right: NDArray[np.bool_]


def counted(stamps: FloatArray, found: NDArray[np.bool_], truth: NDArray[np.bool_]) -> Counted:
    """Compare found contacts of one foot with the true ones, step by step; all of shape (n,)."""
    pushed, truth = truth, _settled(stamps, truth)
    step = float(np.median(np.diff(stamps)))
    delays: dict[bool, list[float]] = {True: [], False: []}
    for row in (np.flatnonzero(np.diff(truth.astype(int))) + 1).tolist():
        ends = np.flatnonzero(truth[row:] != truth[row])
        until = row + int(ends[0]) if len(ends) else len(truth)
        right = np.flatnonzero(found[row:until] == truth[row])
        delays[bool(truth[row])].append(
            float(stamps[row + right[0]] - stamps[row]) if len(right) else float("inf")
        )
    changes = np.flatnonzero(np.diff(found.astype(int))) + 1
    reach = round(EDGE / step)
    around = {row: pushed[max(row - reach, 0) : row + reach + 1] for row in changes.tolist()}
    false = sum(not near.any() for row, near in around.items() if found[row])
    lost = sum(bool(near.all()) for row, near in around.items() if not found[row])
    air, ground = step * float((~truth).sum()), step * float(truth.sum())
    return Counted(delays[True], delays[False], false, lost, air, ground, found == truth)


def _settled(stamps: FloatArray, truth: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Contacts without bounces: first those in the air are filled, then short ones are left out."""
    settled = truth.copy()
    for state in (False, True):
        changes = np.flatnonzero(np.diff(settled.astype(int))) + 1
        for start, end in itertools.pairwise(changes.tolist()):
            if settled[start] == state and stamps[end] - stamps[start] < BOUNCE:
                settled[start:end] = not state
    return settled


def measure(seeds: Sequence[int]) -> list[Measure]:
    """Delays, false and lost contacts of both scripts, by rate of contacts, beside a knee's torque.

    Args:
        seeds: one script each.
    """
    rng, measures = np.random.default_rng(0), list[Measure]()
    for script in ("pinned leg", "standing"):
        rows: dict[str, list[tuple[int, Counted]]] = {}
        for seed in seeds:
            feet, samples = recorded(seed, script == "pinned leg")
            for rate in RATES:
                frame = watched(feet, samples, rate)
                for _, part in frame.groupby("foot"):
                    stamps = part["stamp"].to_numpy()
                    truth = part["force"].to_numpy() >= BEARS
                    estimates = {f"rate {rate:g}/s": part["probability"].to_numpy() >= SAYS}
                    if rate == RATES[0]:
                        estimates["knee torque"] = part["knee"].to_numpy() >= KNEE
                    for name, found in estimates.items():
                        each = counted(stamps, found, truth)
                        rows.setdefault(f"{script}, {name}", []).append((seed, each))
            note(f"  {script}: {seed}")
        for case, made in rows.items():
            measures += _measures(case, made, rng)
    return measures


def _measures(
    case: str, rows: Sequence[tuple[int, Counted]], rng: np.random.Generator
) -> Iterator[Measure]:
    """The figures of one case, with intervals over scripts."""
    seeds = [seed for seed, _ in rows]
    right = np.concatenate([each.right for _, each in rows])
    owners = np.repeat(seeds, [len(each.right) for _, each in rows])
    value, low, high = proportion(right, owners)
    yield Measure("feet", case, "steps right", value, low, high, "", len(right))
    for what in ("made", "broken"):
        delays = np.array([delay for _, each in rows for delay in getattr(each, what)])
        groups = [seed for seed, each in rows for _ in getattr(each, what)]
        share, low, high = proportion(np.isfinite(delays), groups)
        yield Measure("feet", case, f"{what}: found", share, low, high, "", len(delays))
        for name, statistic in (("p50", p50), ("p90", p90)):
            found = np.where(np.isfinite(delays), delays, 9.0)
            value, low, high = grouped(found, statistic, groups, rng)
            yield Measure("feet", case, f"{what}: delay, {name}", value, low, high, "s", len(found))
    for what, of, when in (("false", "false", "air"), ("lost", "lost", "ground")):
        count = sum(getattr(each, of) for _, each in rows)
        minutes = sum(getattr(each, when) for _, each in rows) / 60.0
        low = float(chi2.ppf(0.025, 2 * count)) / 2.0 / minutes if count else 0.0
        high = float(chi2.ppf(0.975, 2 * count + 2)) / 2.0 / minutes
        name = f"{what} contacts a minute of {when}"
        yield Measure("feet", case, name, count / minutes, low, high, "1/min", count)


def draw(frame: pd.DataFrame, path: Path) -> None:
    """P(contact) of each foot over time, above the times at which the ground truly pushes it.

    Args:
        frame: as `watched` gives it.
        path: the PNG file.
    """
    feet = [part for _, part in frame.groupby("foot", sort=False)]
    figure = new_figure(9.0, 1.4 * len(feet))
    axes = figure.subplots(len(feet), sharex=True, squeeze=False)[:, 0]
    for axis, part in zip(axes, feet, strict=True):
        pushed = part["force"] >= BEARS
        axis.fill_between(part["stamp"], 0.0, 1.0, where=pushed, color="#dddddd", step="post")
        axis.step(part["stamp"], part["probability"], where="post", color=COLOURS[0])
        axis.axhline(SAYS, color=COLOURS[1], linewidth=0.7)
        axis.set_ylabel(f"{part['foot'].iloc[0]}: P")
    axes[-1].set_xlabel("time [s]; grey: the ground pushes")
    with whole_file(path) as file:
        figure.savefig(file, format="png", dpi=110)


def run_feet(trials: int, seed: int, out: Path) -> None:
    """Measure over some scripts; write results.csv, and draw the first of those that stand.

    Args:
        trials: number of scripts, each with a seed of its own.
        seed: the first of them.
        out: the folder that takes the results.
    """
    make_folder(out)
    measures = measure(range(seed, seed + trials))
    for figure in measures:
        note(f"  {figure}")
    write_whole(out / "results.csv", as_csv(frame_of(measures, Measure), missing="nan"))
    draw(watched(*recorded(seed, is_pinned=False), RATES[0]), out / "standing.png")
    say(f"results: {out}")
