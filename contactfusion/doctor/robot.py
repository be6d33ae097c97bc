"""Checks of a ROBOT.yaml: its contents, implausible values, and comparison with a recording."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RecordingError, RobotError, name_hint
from contactfusion.files import require_spared
from contactfusion.frames import inverse, points_in, vectors_in
from contactfusion.identify.wrists import Sample, Weighed, resting, weighed
from contactfusion.model import rooted
from contactfusion.readings import Wrench
from contactfusion.recordings.opening import open_recording
from contactfusion.robot_state import StateBuffer
from contactfusion.robots.description import RobotConfig, located, read_robot
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.robots.solids import Solid
from contactfusion.terminal import say
from contactfusion.yaml_files import read_yaml

NEAR = 0.01
"""The greatest distance of a patch from its link's surface, and depth of a camera's origin [m]."""
FACING = 0.5
"""The cosine of the angle between a patch's z and the normal of the surface is at least this."""
GRAVITY = np.array([[0.0, 0.0, -9.81]])
"""Gravity in the root link's frame, whose z is taken to point up [m/s²]."""


def check_robot(name: str, out: Path | None = None, recording: Path | None = None) -> bool:
    """Print a robot's description, and warnings about implausible values.

    Args:
        name: ROBOT.yaml, a configuration with a `robot`, or a URDF; MODULE:FILE for one in an
            installed Python package.
        out: the PNG of the picture; None: no picture.
        recording: joints and wrenches of the wrists, at rest in several poses.

    Returns:
        Whether there are no warnings.

    Raises:
        ContactFusionError: the description, its URDF or the recording cannot be used.
    """
    path = located(name)
    config = _described(path)
    if out is not None:
        require_spared("--out", out, [path, config.path()])
    try:
        model = RobotModel(config)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    robot = PosedRobot(model, middle(model), model.root, np.eye(4))
    say(f"{path}: {len(model.link_names)} links, {len(model.joint_names)} joints")
    _print_links(model)
    _print_joints(robot)
    _print_sensors(robot)
    faults = [*patch_faults(model), *wrist_faults(model), *camera_faults(robot)]
    faults += [*finger_faults(model), *mass_faults(model)]
    if out is not None:
        from contactfusion.doctor.picture import draw_robot

        say(f"picture: {draw_robot(robot, out)}")
    if recording is not None:
        wrenches = recorded_wrenches(model, recording)
        for wrist in config.wrists:
            lines, wrong = weigh(model, wrist, wrenches)
            say("\n".join(lines), lines=True)
            faults += wrong
    for fault in faults:
        say(f"warning: {fault}")
    say("nothing to warn about" if not faults else f"{len(faults)} to put right")
    return not faults


def _described(path: Path) -> RobotConfig:
    """The description in ROBOT.yaml, or in a configuration, or of a URDF alone."""
    if path.suffix == ".urdf":
        return RobotConfig(urdf=path.name, folder=path.parent)
    robot = read_yaml(path).get("robot")
    if isinstance(robot, str):
        return read_robot(robot, path.parent)
    if not isinstance(robot, dict):
        return read_robot(path)
    try:
        return rooted(RobotConfig(**robot), path.parent)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error.under('robot')}") from None


def middle(model: RobotModel) -> FloatArray:
    """The middle of the joints' limits, shape (n,) [rad, m].

    A joint without limits is at 0, one that mimics another follows it, and one that is `still`
    has its configured position.
    """
    positions: FloatArray = np.where(np.isfinite(model.limits), model.limits, 0.0).mean(axis=1)
    for name, position in model.config.still.items():
        positions[model.joint_names.index(name)] = position
    return model.followed(positions)


def patch_faults(model: RobotModel) -> Iterator[str]:
    """Patches that do not lie on their link, or do not face outward."""
    config = model.config
    for name, patch in config.patches.items():
        link, pose = model.link_of(patch.frame), model.pose_on_link(patch.frame)
        if link not in model.parts:
            yield f"patch '{name}' is on link '{link}', which has no surface"
            continue
        part = model.parts[link]
        taxels = points_in(pose, patch.centres())
        solid = Solid(getattr(model.urdf.links[link], config.shapes))
        away = float(solid.distances(taxels).max())
        if away > NEAR:
            yield (
                f"a taxel of patch '{name}' lies {away * 1000:.0f} mm from the surface of "
                f"link '{link}'"
            )
            continue
        # of a thin link the nearest point may lie on the other side, so that all near ones count
        reach = np.asarray(part.tree.query(taxels)[0]) + config.spacing
        facing = part.normals @ pose[:3, 2] >= FACING
        faces = [facing[rows].any() for rows in part.tree.query_ball_point(taxels, reach)]
        if np.mean(faces) < 0.5:
            yield f"the z of patch '{name}' does not point out of link '{link}'"


def wrist_faults(model: RobotModel) -> Iterator[str]:
    """Wrists whose load has no mass."""
    for name, wrist in model.config.wrists.items():
        links = {link: model.urdf.links[link] for link in model.beyond(wrist.frame)}
        for link, part in links.items():
            if part.is_shaped and not part.mass:
                yield f"link '{link}' hangs on wrist '{name}' and has a shape, but no mass"
        if not any(part.mass for part in links.values()):
            yield f"nothing that hangs on wrist '{name}' has a mass"


def mass_faults(model: RobotModel) -> Iterator[str]:
    """Links without a mass, where efforts of joints are known."""
    hanging = {link for wrist in model.config.wrists.values() for link in model.beyond(wrist.frame)}
    for link in sorted(model.moved_links - hanging) if model.config.efforts else ():
        if model.urdf.links[link].is_shaped and not model.carried_by(link):
            yield f"link '{link}' has a shape, but no mass, so its weight would be a contact"


def camera_faults(robot: PosedRobot) -> Iterator[str]:
    """Cameras that lie inside the robot."""
    from scipy.spatial import KDTree

    surface = robot.surface
    tree = KDTree(surface.points)
    for name, camera in robot.model.config.cameras.items():
        origin = robot.pose_of(camera.frame)[:3, 3]
        distance, row = tree.query(origin)
        depth = min(distance, (surface.points[row] - origin) @ surface.normals[row])
        if depth > NEAR:
            link = surface.link_names[surface.links[row]]
            yield f"camera '{name}' lies {depth * 1000:.0f} mm inside link '{link}'"


def finger_faults(model: RobotModel) -> Iterator[str]:
    """Links of fingers that none of the finger's joints moves."""
    urdf = model.urdf
    for name, finger in model.config.fingers.items():
        moved = {link for joint in finger.joints for link in urdf.hanging_on(urdf.children[joint])}
        for link in finger.links:
            if link not in moved:
                yield f"link '{link}' of finger '{name}' hangs on none of its joints"


def _print_links(model: RobotModel) -> None:
    spheres = np.bincount(model.spheres.links, minlength=len(model.link_names))
    width = max(map(len, model.link_names))
    say(f"  {'link':{width}}  mass [kg]  points  spheres")
    for name, count in zip(model.link_names, spheres, strict=True):
        points = len(model.parts[name].points) if name in model.parts else 0
        say(f"  {name:{width}}  {model.urdf.links[name].mass:9.3f}  {points:6}  {count:7}")
    total = sum(link.mass for link in model.urdf.links.values())
    points = sum(len(part.points) for part in model.parts.values())
    say(f"  {'together':{width}}  {total:9.3f}  {points:6}  {spheres.sum():7}")
    say(
        f"spheres reach out of their links by {model.spheres.protrusion * 1000:.1f} mm at most, "
        f"and leave {model.spheres.gap * 1000:.1f} mm bare at most"
    )


def _print_joints(robot: PosedRobot) -> None:
    model = robot.model
    width = max((len(name) for name in model.joint_names), default=0)
    rows = zip(model.joint_names, model.limits, model.units, robot.positions, strict=True)
    for name, (low, high), unit, at in rows:
        ends = f"{low:.3f} .. {high:.3f} [{unit}]" if np.isfinite(low) else "without ends"
        still = f", stays at {at:.3f}" if name in model.config.still else _mimicry(model, name)
        say(f"  joint {name:{width}}  {ends}{still}")


def _mimicry(model: RobotModel, name: str) -> str:
    if name not in model.urdf.mimics:
        return ""
    driver, multiplier, offset = model.urdf.mimics[name]
    return f", follows {driver}: {multiplier:g} times its position, plus {offset:g}"


def _print_sensors(robot: PosedRobot) -> None:
    """Print the poses of the sensors, one line each: they are compared by eye."""
    config, model = robot.model.config, robot.model
    if not (config.patches or config.cameras or config.wrists or config.fingers):
        return
    say(f"in '{robot.frame}', with the joints at the middle of their limits [m]:")
    for name, patch in config.patches.items():
        pose = robot.pose_of(patch.frame)
        say(
            f"  patch {name}: on {model.link_of(patch.frame)} at {triple(pose[:3, 3])}, "
            f"{len(patch.centres())} taxels, z along {triple(pose[:3, 2])}"
        )
    for name, camera in config.cameras.items():
        pose = robot.pose_of(camera.frame)
        say(
            f"  camera {name}: on {model.link_of(camera.frame)} at {triple(pose[:3, 3])}, "
            f"looks along {triple(pose[:3, 2])}"
        )
    for name, wrist in config.wrists.items():
        pose = robot.pose_of(wrist.frame)
        mass, centre = robot.load_on(wrist.frame)
        centre = points_in(inverse(pose), centre[None])[0]
        say(
            f"  wrist {name}: on {model.link_of(wrist.frame)} at {triple(pose[:3, 3])}, "
            f"{mass:.3f} kg hang on it, their centre at {triple(centre)} in its frame"
        )
    for name, finger in config.fingers.items():
        say(f"  finger {name}: joints {', '.join(finger.joints)}")


def triple(vector: FloatArray) -> str:
    """Three numbers as text."""
    rounded = np.round(vector, 3) + 0.0  # no -0
    return "(" + ", ".join(f"{number:.3f}" for number in rounded) + ")"


def recorded_wrenches(model: RobotModel, path: Path) -> dict[str, list[Sample]]:
    """The wrenches of a recording by the name of their sensor, with the joints' positions.

    Raises:
        RecordingError: the recording cannot be read.
        RobotError: joints of the robot are missing in it.
    """
    history, samples = StateBuffer(), dict[str, list[Sample]]()
    unknown: RobotError | None = None
    for reading in open_recording(path).readings():
        history.add(reading)
        if isinstance(reading, Wrench):
            try:
                positions = model.positions(history.joints(reading.stamp))
            except RobotError as error:  # the first wrench may come before the first joints
                unknown = error
                continue
            samples.setdefault(reading.sensor, []).append(Sample(reading, positions))
    if not samples and unknown is not None:
        raise RobotError(f"{path}: {unknown}")
    if not samples:
        raise RecordingError(f"{path} holds no wrench")
    return samples


def weigh(
    model: RobotModel, wrist: str, samples: Mapping[str, Sequence[Sample]]
) -> tuple[list[str], list[str]]:
    """Find the sign of a wrist by gravity, and compare its load with the URDF's.

    Args:
        model: the robot.
        wrist: the name of the wrist in the description.
        samples: by the name of the sensor, in the order of their stamps.

    Returns:
        Lines of the report, and warnings.
    """
    sensor, config = f"wrist '{wrist}'", model.config.wrists[wrist]
    if wrist not in samples:
        hint = name_hint(wrist, samples, "wrenches of the recording")
        return [], [f"no wrench of {sensor} came: {hint}"]
    own = samples[wrist]
    if (frame := own[0].reading.frame) != config.frame:
        return [], [f"{sensor} is in '{config.frame}', but its wrenches come in '{frame}'"]
    rests = resting(own)
    robots = [PosedRobot(model, rest.positions, model.root, np.eye(4)) for rest in rests]
    to_sensor = [inverse(robot.pose_of(config.frame)) for robot in robots]
    gravities = np.array([vectors_in(pose, GRAVITY)[0] for pose in to_sensor])
    try:
        found = weighed(rests, gravities)
    except ConfigurationError as error:
        return [], [f"{sensor}: {error.problem}"]
    loads = [robot.load_on(config.frame) for robot in robots]
    centres = [points_in(to, c[None])[0] for to, (_, c) in zip(to_sensor, loads, strict=True)]
    wrong = []
    if found.sign != config.sign:
        wrong.append(
            f"{sensor}: gravity says sign {found.sign}, the description says {config.sign}"
        )
    return _compared(sensor, found, loads[0][0], np.mean(centres, axis=0)), wrong


def _compared(sensor: str, loaded: Weighed, mass: float, centre: FloatArray) -> list[str]:
    fit, found = loaded.fit, loaded.fit.compensation
    apart = np.linalg.norm(centre - found.centre_of_mass) * 1000.0
    return [
        f"{sensor} in {loaded.poses} poses at rest: gravity says sign {loaded.sign}",
        f"  mass {found.mass:.3f} kg, by the URDF {mass:.3f} kg",
        f"  centre of mass {_mm(np.array(found.centre_of_mass))}, by the URDF {_mm(centre)}: "
        f"{apart:.1f} mm apart",
        f"  left over: force {_root_mean_square(fit.force_residual):.3f} N, "
        f"torque {_root_mean_square(fit.torque_residual):.4f} N·m by axis",
        f"  compensation: {found.model_dump_json()}",
    ]


def _mm(vector: FloatArray) -> str:
    return "(" + ", ".join(f"{1000.0 * number:.1f}" for number in vector) + ") mm"


def _root_mean_square(vector: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(vector))))
