"""`contactfusion identify`: what joints and wrists report without contact, from a recording."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.files import require_spared, write_whole
from contactfusion.frames import inverse, points_in
from contactfusion.generators.compensation import Compensation
from contactfusion.generators.force_torque import ForceTorqueConfig
from contactfusion.identify.arm import Arm
from contactfusion.identify.recorded import Recorded
from contactfusion.identify.report import Identification, plain, rounded, stated
from contactfusion.identify.wrists import SIGNS, Rest, Weighed, resting, unloaded, weighed
from contactfusion.robots.description import LinkMassConfig, PayloadConfig, RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.run.configuration import setting_of_file
from contactfusion.vendors import WRENCHES

BIASES = ("force_bias", "torque_bias")
CERTAIN = 5.0
"""A mass of so many standard errors is one."""
UNITS = {"mass": "kg", "centre_of_mass": "m", "force_bias": "N", "torque_bias": "N·m"}


def identify_file(
    path: Path,
    recording: Path,
    out: Path | None = None,
    *,
    overrides: Sequence[str] = (),
    topics: Mapping[str, str] | None = None,
    ignored: Sequence[str] = (),
) -> Identification:
    """Identify the `joint_torque` and `force_torque` generators of a configuration.

    Args:
        path: the configuration.
        recording: of free motion, without contact; for wrists with some rests in it.
        out: the YAML file for the field `identified` of the configuration; None: none is written.
        overrides: fields to change, as "a.b=c".
        topics: topics of the recording by role.
        ignored: topics that are not read at all.

    Raises:
        ContactFusionError: the configuration or the recording is not what it should be, or they do
            not fit.
    """
    setting = setting_of_file(path, overrides).choosing(topics or {}, ignored)
    if out is not None:
        require_spared("--out", out, setting.files(recording))
    recorded, found = Recorded(setting, recording), Identification()
    for name, config in recorded.joints.items():
        Arm(recorded, name, config).identify(found)
    for name, wrist in recorded.wrists.items():
        _identify_wrist(recorded, name, wrist, found)
    if out is not None:
        fields = {part: held for part, held in found.fields.items() if held}
        text = yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, width=100)
        head = f"# Identified from {recording.name}; {path.name} takes it by `identified: FILE`."
        write_whole(out, f"{head}\n{text}")
    return found


def _identify_wrist(
    recorded: Recorded, name: str, config: ForceTorqueConfig, found: Identification
) -> None:
    """Add load, bias and noise of a wrist's sensor to the report and to the fields."""
    rests = resting(recorded.wrenches[name])
    middles = [rest.first + len(rest.wrenches) // 2 for rest in rests]
    gravities = np.array([recorded.gravities[name][row] for row in middles])
    sign = "on_robot" if config.on_robot() else "by_robot"
    weightless = config.vendor is not None and WRENCHES[config.vendor].compensated
    try:
        load = _beside_driver(rests, gravities, sign) if weightless else weighed(rests, gravities)
    except ConfigurationError as error:
        found.kept.append(f"{name}: {error.problem}")
        return
    if load.sign != sign:
        found.warnings.append(
            f"{name}: gravity says sign {load.sign}, the configuration says {sign}; "
            "nothing of it is identified"
        )
        return
    fitted = load.fit.compensation
    options: dict[str, Any] = {"compensation": plain(fitted)}
    if config.load == "robot":
        options["compensation"] = _bias(recorded, found, name, load, rests, gravities)
    elif weightless:
        options["compensation"] = {each: options["compensation"][each] for each in BIASES}
        if fitted.mass:
            found.warnings.append(
                f"{name}: it carries {fitted.mass:.2f} kg that its driver does not take off: tell "
                "the driver its payload"
            )
    options["force_noise"] = rounded(float(np.sqrt(np.mean(load.noise[:3] ** 2))))
    options["torque_noise"] = rounded(float(np.sqrt(np.mean(load.noise[3:] ** 2))))
    found.fields["generators"][name] = options
    found.lines.append(f"{name}, {load.poses} poses at rest")
    for field, unit in UNITS.items():
        if weightless and field not in BIASES:
            continue
        values, errors = np.atleast_1d(getattr(fitted, field)), load.errors[field]
        cells = (stated(*pair, unit) for pair in zip(values, errors, strict=True))
        found.lines.append(f"  {field}  {', '.join(cells)}")
    found.lines.append(
        f"  noise of a sample  {options['force_noise']:.3g} N, {options['torque_noise']:.3g} N·m"
    )


def _beside_driver(rests: Sequence[Rest], gravities: FloatArray, sign: str) -> Weighed:
    """The bias of a wrist whose driver takes its load off, and weight that it leaves."""
    try:
        load = weighed(rests, gravities)
    except ConfigurationError:  # no weight explains anything
        return unloaded(rests, sign)
    (error,) = load.errors["mass"]
    return load if load.fit.compensation.mass > CERTAIN * error else unloaded(rests, sign)


def _bias(
    recorded: Recorded,
    found: Identification,
    name: str,
    load: Weighed,
    rests: Sequence[Rest],
    gravities: FloatArray,
) -> dict[str, Any]:
    """The compensation beside a load that follows from the robot: biases alone."""
    if recorded.config.robot is None:
        raise ConfigurationError("a load of the robot needs a robot by URDF")
    link, mount = recorded.mounts[name]
    model, left = _as_identified(recorded.config.robot, found), list[FloatArray]()
    for rest, gravity in zip(rests, gravities, strict=True):
        robot = PosedRobot(model, rest.positions, model.root, np.eye(4))
        mass, centre = robot.load_on(link)
        x, y, z = points_in(inverse(robot.poses[link] @ mount), centre[None])[0].tolist()
        carried = Compensation(mass=mass, centre_of_mass=(x, y, z))
        left.append(SIGNS[load.sign] * rest.wrench - carried.contactless(gravity))
    bias = np.mean(left, axis=0)
    return {"force_bias": rounded(bias[:3].tolist()), "torque_bias": rounded(bias[3:].tolist())}


def _as_identified(config: RobotConfig, found: Identification) -> RobotModel:
    """The robot with the payload and the masses that it will have by what was identified."""
    fields, update = found.fields["robot"], dict[str, Any]()
    if "payload" in fields:
        update["payload"] = PayloadConfig(**fields["payload"])
    if "masses" in fields:
        masses = {name: LinkMassConfig(**each) for name, each in fields["masses"].items()}
        update["masses"] = {**config.masses, **masses}
    return RobotModel(config.model_copy(update=update))
