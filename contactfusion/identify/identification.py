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
from contactfusion.identify.wrists import SIGNS, Rest, Weighed, resting, weighed
from contactfusion.robots.posed import PosedRobot
from contactfusion.run.configuration import setting_of_file

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
    try:
        load = weighed(rests, gravities)
    except ConfigurationError as error:
        found.kept.append(f"{name}: {error.problem}")
        return
    sign = "on_robot" if config.on_robot() else "by_robot"
    if load.sign != sign:
        found.warnings.append(
            f"{name}: gravity says sign {load.sign}, the configuration says {sign}; "
            "nothing of it is identified"
        )
        return
    fitted, frame = load.fit.compensation, recorded.wrenches[name][0].reading.frame
    options: dict[str, Any] = {"compensation": plain(fitted)}
    if config.load == "robot":
        options["compensation"] = _bias(recorded, frame, load, rests, gravities)
    options["force_noise"] = rounded(float(np.sqrt(np.mean(load.noise[:3] ** 2))))
    options["torque_noise"] = rounded(float(np.sqrt(np.mean(load.noise[3:] ** 2))))
    found.fields["generators"][name] = options
    found.lines.append(f"{name}, {load.poses} poses at rest")
    for field, unit in UNITS.items():
        values, errors = np.atleast_1d(getattr(fitted, field)), load.errors[field]
        cells = (stated(*pair, unit) for pair in zip(values, errors, strict=True))
        found.lines.append(f"  {field}  {', '.join(cells)}")
    found.lines.append(
        f"  noise of a sample  {options['force_noise']:.3g} N, {options['torque_noise']:.3g} N·m"
    )


def _bias(
    recorded: Recorded, frame: str, load: Weighed, rests: Sequence[Rest], gravities: FloatArray
) -> dict[str, Any]:
    """The compensation beside a load that follows from the robot's URDF: biases alone."""
    model = recorded.model
    if model is None:
        raise ConfigurationError("a load of the robot needs a robot by URDF")
    left = []
    for rest, gravity in zip(rests, gravities, strict=True):
        robot = PosedRobot(model, rest.positions, model.root, np.eye(4))
        mass, centre = robot.load_on(frame)
        x, y, z = points_in(inverse(robot.pose_of(frame)), centre[None])[0].tolist()
        carried = Compensation(mass=mass, centre_of_mass=(x, y, z))
        left.append(SIGNS[load.sign] * rest.wrench - carried.contactless(gravity))
    bias = np.mean(left, axis=0)
    return {"force_bias": rounded(bias[:3].tolist()), "torque_bias": rounded(bias[3:].tolist())}
