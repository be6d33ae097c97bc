"""A touch: the path of a hand, the readings of its sensors, and apart from them the truth."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.frames import Pose, inverse, points_in, pose_of, vectors_in
from contactfusion.hooks import hookimpl
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Reading
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.objects import ObjectModel
from contactfusion.robots.solids import Solid, loaded_open3d
from contactfusion.scene import Scene
from contactfusion.shapes import ShapeConfig
from contactfusion.stream import Arrival, Facts, Verdict
from contactfusion_lab.scenes.approach import Approach, led_by, straight, tries
from contactfusion_lab.scenes.arm import STEP, CompliantArm
from contactfusion_lab.scenes.as_built import as_built
from contactfusion_lab.scenes.clutter import clutter, swept
from contactfusion_lab.scenes.facts import standing, true_contact
from contactfusion_lab.scenes.sensor_errors import Arrivals
from contactfusion_lab.scenes.touch import probes
from contactfusion_lab.scenes.touch.config import TouchConfig
from contactfusion_lab.scenes.touch.sensors import TouchSensors
from contactfusion_lab.scenes.touch.world import Touching, TouchWorld, contacts_of

LEAD = 0.012
"""Distance before the first touch at which the physics begins [m]."""
BEYOND = 0.04
"""Length of the path beyond the first touch; the hand stops there if nothing pushes it [m]."""
WARNING = 0.03
"""Least length of a path before the touch, so that a touch and its twin that stops short of it can
share the path [m]."""
AIMS, SEARCHES = 60, 5
"""Number of paths that are tried, and of initial guesses of joint positions for each."""
CLEAR = 0.01
"""Tolerance of the first touch, for surfaces are sampled points: before it the hand must be
free [m]."""
GUARD = 20
"""Steps of the physics over which the force that stops the hand is averaged."""
STAND = 0.15
"""Least time for which the hand stands still before the touch ends [s]."""
LONGEST = 2.0
"""Greatest time from the first stop to the end, settled or not [s]."""
SLOW = 0.01
"""Joint speed under which the hand has settled [rad/s, m/s]."""
EVERY = {"joints": 0.05, "skins": 0.05, "wrenches": 0.01}
"""Periods of readings [s]."""
SAMPLES = 7
"""At so many places along its path a hand is kept free of clutter."""
UNION = 0.05
"""Time over which contact points count as the truth [s]."""
FAR = 0.5
"""Distance from the object at which the ray casting for the first touch begins [m]."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth at the end of a touch.

    Attributes:
        contacts: positions, forces and links, in the root link's frame; empty after a miss.
        joints: shape (n,), joint positions [rad, m].
        steady: whether the hand has settled.
        onset: stamp of the first contact [s]; NaN without any.
    """

    contacts: Touching
    joints: FloatArray
    steady: bool
    onset: float


class TouchScene(Scene):
    """One touch; its readings can be iterated once.

    Args:
        config: the touch.
        robot: the robot, its root link at the origin.
        seed: of all random draws.

    Raises:
        RobotError: the robot lacks a link that is named.
        ConfigurationError: a joint or the frame of an object is not what it should be.
    """

    Config = TouchConfig

    def __init__(self, config: TouchConfig, robot: RobotModel, seed: int = 0) -> None:
        self.config, self.robot = config, robot
        _check_names(config, robot)
        self._rng = np.random.default_rng(seed)
        self._hand = set(robot.known_links(config.hand or robot.beyond(config.tool)))
        self._leading = led_by(robot, config.tool)
        self._target = ObjectModel(config.objects[config.touched])
        around = {name: ObjectModel(fixed) for name, fixed in config.surroundings.items()}
        self._objects = {config.touched: self._target, **around}
        self._tip = Solid([ShapeConfig(shape="sphere", radius=probes.RADIUS)])
        # parts of the noise have generators of their own: whoever adds one changes no other
        surface_rng, self._clutter_rng, press_rng, late_rng, slide_rng, self._probe_rng = (
            self._rng.spawn(6)
        )
        with as_built(robot, config.noise.surface, surface_rng) as built:
            self._world = TouchWorld(built, self._objects, config.friction)
        self._built = built
        self._clutter: list[ObjectModel] = []
        forces = config.noise.press
        self.press = config.press if forces is None else press_rng.uniform(*forces)
        """Contact force at which the hand stops [N]."""
        self._sideways = slide_rng.uniform(-np.pi, np.pi)
        self._late = Arrivals(config.noise.delays, late_rng)
        self._truth: Truth | None = None
        self._stamp, self._moments = 0.0, list[Touching]()
        self._onset = np.nan

    @classmethod
    def opened(cls, config: TouchConfig, robot: RobotConfig, seed: int) -> Self:
        """A touch at its start."""
        return cls(config, shared_robot(robot), seed)

    @property
    def now(self) -> float:
        """The time of the physics [s]."""
        return self._stamp

    @property
    def truth(self) -> Truth:
        """The ground truth; known when all readings are taken."""
        if self._truth is None:
            raise RuntimeError("the truth of a touch is known when all readings are taken")
        return self._truth

    def facts(self) -> Facts:
        """The true contacts of the last 50 ms, and the true poses of all objects."""
        stamp, root = self._stamp, self.robot.root
        poses = {name: model.config.pose.pose() for name, model in self._objects.items()}
        now = contacts_of(self._moments)
        contacts = tuple(
            true_contact(stamp, root, position, force)
            for position, force in zip(now.places, now.forces, strict=True)
        )
        return Facts(stamp, root, contacts, standing(stamp, root, poses))

    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """The true contacts at the end, and the distance of reported ones from them."""
        return touch_verdict(self.truth.contacts, self.robot.root, pipeline, last)

    def arrivals(self) -> Iterator[Arrival]:
        """The readings with the times at which they come."""
        for reading in self.readings():
            yield Arrival(self._stamp, (reading,))

    def readings(self) -> Iterator[Reading]:
        """All readings: the hand goes forward until it is pushed, then stands until it has settled.

        With the noise `slide` it slides sideways instead, for so long. Readings that are late
        follow when they arrive, or never.

        Raises:
            RobotError: there is no path on which the hand reaches the object first.
        """
        config = self.config
        path = self._path()
        if config.noise.clutter:
            self._clutter = self._cluttered(path)
            self._world.stand(self._clutter)
        end = -config.short if config.short else BEYOND
        travelled = min(end, 0.0) - LEAD
        arm = self._world.arm(path.at(travelled), self._stiffness())
        sensors = TouchSensors(
            self.robot, config.tool, self._leading, path.at(end), config.noise, self._rng
        )
        yield from sensors.believed({config.touched: self._target})
        pushes, self._moments = np.zeros(GUARD), [self._world.touching()]
        step = stood = since = 0
        slide, slid = config.noise.slide, np.zeros_like(self._leading)
        sideways = np.zeros_like(slid)
        while True:
            yield from self._late.until(step * STEP, self._sensed(sensors, arm, step, last=False))
            step += 1
            is_pushed = pushes.mean() >= self.press or (since and config.places > 1)
            yielding = not is_pushed and travelled < end
            travelled = min(travelled + config.speed * STEP, end) if yielding else travelled
            stood = 0 if yielding else stood + 1
            if stood and not since and config.places > 1 and not config.short:
                self._press(arm.positions)
            if slide and stood and not since:
                sideways = self._aside(path.at(travelled))
            since += bool(since or stood)
            slid = slid + STEP * sideways
            arm.step(path.at(travelled) + slid)
            self._look(step)
            pushes[step % GUARD] = np.linalg.norm(self._moments[-1].forces.sum(axis=0))
            settled = bool(np.abs(arm.velocities).max() < SLOW)
            steady = settled and stood * STEP >= STAND
            if since * STEP >= (slide or LONGEST) or (steady and not slide):
                break
        yield from self._late.until(step * STEP, self._sensed(sensors, arm, step, last=True))
        self._truth = Truth(contacts_of(self._moments), arm.positions, steady, self._onset)

    def _look(self, step: int) -> None:
        """Take note of the true contacts after a step of the physics."""
        self._moments = [*self._moments[1 - round(UNION / STEP) :], self._world.touching()]
        if np.isnan(self._onset) and self._moments[-1].links:
            self._onset = step * STEP

    def _sensed(
        self, sensors: TouchSensors, arm: CompliantArm, step: int, *, last: bool
    ) -> Iterator[Reading]:
        """The readings that are due after a step of the physics; after the last one all."""
        stamp = self._stamp = step * STEP
        period = {**EVERY, "sights": 1.0 / self.config.camera_rate}
        due = {name for name, each in period.items() if last or step % round(each / STEP) == 0}
        poses = self.robot.poses_at(arm.positions) if due & {"skins", "sights"} else {}
        if "joints" in due:
            yield sensors.joints(stamp, arm.positions, arm.velocities)
        if "skins" in due:
            yield from sensors.skins(stamp, poses, self._moments[-1])
        if "wrenches" in due and step:
            yield from sensors.wrenches(stamp, arm.positions, self._world.felt())
        if "sights" in due:
            yield from sensors.sights(stamp, poses, self._seen(poses))

    def _seen(self, poses: Mapping[str, Pose]) -> list[tuple[Solid, Pose]]:
        """All collision geometry that is visible to cameras, with its poses."""
        seen = [(solid, poses[name]) for name, solid in self._built.solids.items()]
        seen += [(model.solid, model.config.pose.pose()) for model in self._bodies]
        return seen + [(self._tip, pose) for pose in self._world.balls()]

    @property
    def _bodies(self) -> tuple[ObjectModel, ...]:
        """All bodies that stand in the scene."""
        return (*self._objects.values(), *self._clutter)

    def _press(self, joints: FloatArray) -> None:
        """Press probes on the hand where it stands at joint positions, shape (n,) [rad, m]."""
        touched, forces = self._moments[-1].places, self.config.noise.press
        free = probes.places(self.robot, self._hand, joints, touched, self._bodies, self._probe_rng)
        for place, normal in itertools.islice(free, self.config.places - 1):
            force = self.config.press if forces is None else self._probe_rng.uniform(*forces)
            self._world.press(place, normal, probes.RADIUS, probes.GAP, force)

    def _cluttered(self, path: Approach) -> list[ObjectModel]:
        """Bodies around the target, none of them in the path."""
        pose = self._target.config.pose.pose()
        corners = [points_in(pose, vertices) for vertices, _ in self._target.solid.meshes]
        ends = path.distances[0], BEYOND
        free = swept(self.robot, [path.at(each) for each in np.linspace(*ends, SAMPLES)])
        tool = self.robot.poses_at(path.at(0.0))[self.config.tool]
        x, y = -tool[:2, 2]
        return clutter(
            self.robot.root, np.concatenate(corners), np.arctan2(y, x), free, self._clutter_rng
        )

    def _path(self) -> Approach:
        """A straight path on which the hand, and nothing else, reaches the target first."""
        config, robot = self.config, self.robot
        before = LEAD + max(config.short, WARNING)
        for _ in range(AIMS):
            tool = aimed(config, self._target, self._rng)
            posture = drawn_posture(config, robot, self._rng)
            poses = robot.poses_at(posture)
            far = {name: tool @ inverse(poses[config.tool]) @ pose for name, pose in poses.items()}
            distance = distance_to_touch(robot, self._hand, far, tool[:3, 2], self._target)
            if not np.isfinite(distance):
                continue
            tool[:3, 3] += distance * tool[:3, 2]
            starts = tries(robot, posture, self._leading, self._rng)
            for start in itertools.islice(starts, SEARCHES):
                found = straight(robot, config.tool, tool, start, before, BEYOND)
                if found is not None and self._is_free(found):
                    return found
        low, high = config.azimuth
        raise RobotError(
            f"the arm reaches '{config.touched}' on none of {AIMS} paths from azimuth {low:g} to "
            f"{high:g}: it may stand outside the workspace"
        )

    def _is_free(self, path: Approach) -> bool:
        """Whether a path is free of contacts but that of the hand with the target at its end."""
        target = self.config.touched
        return not any(
            self._world.blocked(
                path.at(distance), self._hand if distance > -CLEAR else set(), target
            )
            for distance in (path.distances[0], -WARNING / 2.0, 0.0, BEYOND / 2.0, BEYOND)
        )

    def _aside(self, joints: FloatArray) -> FloatArray:
        """Joint velocities that move the tool sideways at its speed, without rotation.

        Args:
            joints: shape (n,), where it begins [rad, m].
        """
        tool, angle = self.robot.poses_at(joints)[self.config.tool], self._sideways
        twist = np.zeros(6)
        twist[:3] = self.config.speed * tool[:3, :2] @ (np.cos(angle), np.sin(angle))
        return np.linalg.pinv(self.robot.jacobian(self.config.tool, joints) * self._leading) @ twist

    def _stiffness(self) -> FloatArray:
        hand = self.config.noise.finger_stiffness
        return np.where(self._leading > 0.0, self.config.arm_stiffness, hand)


def _check_names(config: TouchConfig, robot: RobotModel) -> None:
    """Check that the robot has what the scene names, and that poses are in its root link."""
    robot.urdf.require_link(config.tool)
    for name in config.posture:
        if name not in robot.joint_names:
            hint = name_hint(name, robot.joint_names, "joints")
            raise ConfigurationError(f"unknown joint '{name}': {hint}", f"posture.{name}")
        if name in robot.config.still:
            raise ConfigurationError(f"joint '{name}' is still", f"posture.{name}")
    for part in ("objects", "surroundings"):
        for name, placed in getattr(config, part).items():
            if placed.pose.parent != robot.root:
                raise ConfigurationError(
                    f"the scene is placed in the robot's root link '{robot.root}', "
                    f"not in '{placed.pose.parent}'",
                    f"{part}.{name}.pose.parent",
                )


def aimed(config: TouchConfig, target: ObjectModel, rng: np.random.Generator) -> Pose:
    """A random pose of the tool far from the target, from which it goes forward along its z.

    Args:
        config: the directions of approach.
        target: the object to touch.
        rng: draws direction, tilt and aim.

    Returns:
        In the frame of the object's pose.
    """
    azimuth, elevation, roll = np.radians(
        [rng.uniform(*each) for each in (config.azimuth, config.elevation, config.roll)]
    )
    level = np.cos(elevation)
    out = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    side = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    facing = np.stack([-side, np.cross(-out, -side), -out], axis=1)
    turned = facing @ Rotation.from_euler("z", roll).as_matrix()
    lean = np.radians(config.tilt) * np.sqrt(rng.random())
    about = rng.uniform(0.0, 2.0 * np.pi)
    leaning = Rotation.from_rotvec(lean * np.array([np.cos(about), np.sin(about), 0.0]))
    corners = np.concatenate([vertices for vertices, _ in target.solid.meshes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    beside = rng.uniform(-config.wander, config.wander, 3) * (high - low)
    place = points_in(target.config.pose.pose(), ((low + high) / 2.0 + beside)[None])[0]
    # the tilt turns the path, too: the hand moves along its own z
    turned = turned @ leaning.as_matrix()
    away = FAR + float(np.linalg.norm(high - low)) / 2.0
    return pose_of(place - away * turned[:, 2], turned)


def drawn_posture(config: TouchConfig, model: RobotModel, rng: np.random.Generator) -> FloatArray:
    """Random joint positions within the ranges and the limits, shape (n,) [rad, m]."""
    low, high = model.limits.T
    positions = np.array(
        [
            rng.uniform(*config.posture[name])
            if name in config.posture
            else model.config.still.get(name, 0.0)
            for name in model.joint_names
        ]
    )
    return np.asarray(np.clip(positions, low, high))


def distance_to_touch(
    model: RobotModel,
    links: set[str],
    poses: Mapping[str, Pose],
    direction: FloatArray,
    target: ObjectModel,
) -> float:
    """Distance that links go before they touch an object [m]; inf when they pass it by.

    Args:
        model: the robot.
        links: those that may touch.
        poses: of all links at the start, in the frame of the object's pose.
        direction: shape (3,), the unit vector along which they go.
        target: the object.

    Returns:
        As exact as the samples of the surface are dense.
    """
    open3d = loaded_open3d()
    scene = open3d.t.geometry.RaycastingScene()
    for vertices, triangles in target.solid.meshes:
        corners = points_in(target.config.pose.pose(), vertices).astype(np.float32)
        scene.add_triangles(open3d.core.Tensor(corners), open3d.core.Tensor(triangles))
    placed = (
        points_in(poses[name], part.points) for name, part in model.parts.items() if name in links
    )
    points = np.concatenate([np.empty((0, 3)), *placed])  # a link may have no surface
    rays = np.concatenate([points, np.broadcast_to(direction, points.shape)], axis=1)
    hits = scene.cast_rays(open3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
    return float(hits.min(initial=np.inf))


def touch_verdict(touching: Touching, root: str, pipeline: Pipeline, last: Step) -> Verdict:
    """The true contacts, and the distance of the contacts of the last step from them.

    Args:
        touching: true contacts, in the frame of the robot's root link.
        root: that link.
        pipeline: that received the readings.
        last: its last step.

    Raises:
        FrameError: nothing joins the root link to the space.
    """
    state = pipeline.state(last.stamp)
    pose = state.frames.pose(state.grid.frame, of=root)
    places, forces = points_in(pose, touching.places), vectors_in(pose, touching.forces)
    truth = replace(touching, places=places, forces=forces)
    values = {
        "frame": state.grid.frame,
        "places": truth.places.tolist(),
        "forces": truth.forces.tolist(),
        "links": list(truth.links),
    }
    return Verdict(values, tuple(compared(truth, last.fusion.contacts)))


def compared(truth: Touching, contacts: Sequence[Contact]) -> Iterator[str]:
    """A sentence for each true contact, with the distance to the nearest reported one.

    Args:
        truth: in the frame of the contacts.
        contacts: of the last step.
    """
    found = np.reshape([contact.position for contact in contacts], (-1, 3))
    for position, link in zip(truth.places, truth.links, strict=True):
        x, y, z = position
        distance = np.linalg.norm(found - position, axis=1).min(initial=np.inf) * 1000.0
        near = f"nearest contact {distance:.0f} mm away" if contacts else "no contact was found"
        yield f"{link} touched at ({x:.3f}, {y:.3f}, {z:.3f}) m; {near}"
    if not truth.links and contacts:
        yield f"nothing was touched; contacts that are none: {len(contacts)}"
    elif not truth.links:
        yield "no contact, and none was there"


@hookimpl
def contactfusion_scenes() -> dict[str, type[Scene]]:
    """The scene, as a plug-in."""
    return {"touch": TouchScene}
