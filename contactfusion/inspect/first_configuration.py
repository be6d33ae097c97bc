"""A first configuration for a recording or a robot, which runs as it is; comments explain it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import final

import yaml

from contactfusion.errors import ConfigurationError, ContactFusionError, RecordingError
from contactfusion.files import make_folder, require_spared, write_whole
from contactfusion.inspect.first_lines import (
    force_torque_lines,
    free_space_lines,
    indented,
    integrator_lines,
    motion_lines,
    named_from,
    range_lines,
    robot_lines,
    stand_in_lines,
    switch_lines,
    tactile_lines,
    text_of,
)
from contactfusion.inspect.inspection import (
    Inspection,
    TopicInspection,
    inspect_readings,
    inspect_recording,
)
from contactfusion.inspect.joint_columns import JointColumns
from contactfusion.inspect.log_columns import (
    BLANK,
    TableInspection,
    inspect_table,
    sensor_of,
    shown,
)
from contactfusion.inspect.log_columns import described as described_table
from contactfusion.inspect.sensor_uses import Start, generator_name, start_of, uses_of
from contactfusion.pipeline_config import PipelineConfig, pipeline_fields
from contactfusion.readings import (
    Wrench,
)
from contactfusion.readings.messages import Message
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.opening import DESCRIBED, is_ros, open_recording
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.ros.topics import last
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.terminal import note, printable, say

URDF = (".urdf", ".xacro", ".xml")
"""Suffixes of files that describe robots."""
C3D = (".c3d", ".zip")
DESCRIPTION, STRING = "robot_description", "std_msgs/msg/String"
"""The last part of the topic that holds a URDF, and the type of its message."""


def write_first(source: Path, out: Path, robot: Path | None = None, force: bool = False) -> None:
    """Write a first configuration for a recording or a URDF, and print what to do next.

    Args:
        source: a recording as `open_recording` takes it, a table without a description, or a URDF.
        out: the YAML file.
        robot: the URDF of the recorded robot; None: that in the recording.
        force: whether to replace files that exist.

    Raises:
        ConfigurationError: a file exists already, or no generator takes any of the readings.
        ContactFusionError: the recording or the URDF is not valid.
    """
    _refuse_existing(out, force)
    read = [
        *(source.iterdir() if source.is_dir() else (source,)),
        *(() if robot is None else (robot,)),
    ]
    require_spared("--out", out, read)
    if source.suffix in URDF:
        if robot is not None:
            raise ConfigurationError(f"--robot is for recordings, and {source} is a robot itself")
        first = _of_robot(source, out)
    elif source.suffix.lower() in DESCRIBED:
        first = _of_table(source, out, robot)
    else:
        first = _of_recording(source, out, robot)
    fields = yaml.safe_load(first.text)
    PipelineConfig(**pipeline_fields(fields))
    files = {out: first.text}
    if first.urdf:
        beside = out.with_suffix(".urdf")
        files[beside] = first.urdf
        _refuse_existing(beside, force)
        require_spared("--out", beside, read)
    for path, content in files.items():
        write_whole(path, content)
    for remark in first.remarks:
        note(remark)
    say(f"results: {', '.join(map(str, files))}")
    note(f"next: {first.then}")


@final
@dataclass(frozen=True)
class _First:
    """A first configuration.

    Attributes:
        text: of the YAML file.
        then: the next step for the user.
        remarks: further sentences for the user.
        urdf: of the robot, where the recording holds it and it is to be written beside the YAML.
    """

    text: str
    then: str
    remarks: tuple[str, ...] = ()
    urdf: str = ""


def _joined(lines: Iterable[str]) -> str:
    """Lines as a file; names in recordings and URDFs end none, and so begin no field."""
    return "".join(printable(line) + "\n" for line in lines)


def _refuse_existing(path: Path, force: bool) -> None:
    if path.exists() and not force:
        raise ConfigurationError(f"{path} exists already; --force replaces it")


# Of a robot


def _of_robot(urdf: Path, out: Path) -> _First:
    name, model = named_from(urdf, out), RobotModel(RobotConfig(urdf=str(urdf)))
    lines = [
        f"# A first configuration for {urdf.name}, by `contactfusion init`.",
        "# For the sensors that you have, take away the # before `generators` and their generator,",
        "# and put in your names and figures. `contactfusion plugins TYPE` lists more options.",
        "",
        *robot_lines(name, model, ()),
        "",
        *(f"# {line}" for line in _examples(model)),
        "",
        *integrator_lines(model.root),
    ]
    return _First(_joined(lines), f"contactfusion replay {out} RECORDING")


def _examples(model: RobotModel) -> Iterator[str]:
    """A generator for each kind of sensor, as lines of YAML."""
    shaped = [name for name, link in model.urdf.links.items() if link.collision]
    link = text_of([*shaped, model.root][-1] if not shaped else shaped[-1])
    yield "generators:"
    yield from indented(force_torque_lines("wrist", "wrist", None))
    yield from indented(tactile_lines("skin", "skin", 24))
    yield "  pad:  # a skin without taxels, calibrated by presses"
    yield "    type: taxel_map"
    yield "    sensor: pad"
    yield "    map: pad_map.npz  # of TaxelMap.fit"
    yield "    min_signal: 100.0  # in the sensor's unit"
    yield from indented(switch_lines("foot", "foot", link))
    yield from indented(range_lines("cloud", "cloud", link))
    yield from indented(free_space_lines("air", "camera", link))
    yield from indented(motion_lines("ahead", "joint_states"))
    if model.joint_names:
        joint = text_of(model.joint_names[-1])
        yield "  fingers:  # compliant fingers: a push moves their joints"
        yield "    type: finger_pose"
        yield "    sensor: joint_states"
        yield f"    fingers: {{finger: {{joints: [{joint}], links: [{link}]}}}}"


# Of a recording


@final
@dataclass(frozen=True)
class _Held:
    """A recording, and how it is played.

    Attributes:
        inspection: its topics.
        start: its first seconds.
        shown: its contents as lines of a comment.
        recording: the `recording` of the configuration, as lines of YAML.
        play: the command that plays it.
    """

    inspection: Inspection
    start: Start
    shown: Sequence[str]
    recording: Sequence[str]
    play: str


def _of_recording(path: Path, out: Path, robot: Path | None) -> _First:
    play = f"contactfusion replay {out} {path} --out contacts.csv"
    inspection, start = inspect_recording(path), start_of(open_recording(path).readings())
    described = tuple(_recording(path, out))
    return _of_sensors(
        _Held(inspection, start, tuple(_held(inspection)), described, play), out, robot
    )


def _of_table(path: Path, out: Path, robot: Path | None) -> _First:
    """A first configuration of a table; what its columns leave open is a blank."""
    moved = RobotModel(RobotConfig(urdf=str(robot))).joint_names if robot else ()
    table, remarks = inspect_table(path, moved), list[str]()
    if table.joints:
        table, remark = _of_joints(table, table.joints, robot)
        remarks.append(remark)
    described = tuple(described_table(table, named_from(path, out)))
    if table.known:
        fields = yaml.safe_load("\n".join(described_table(table, str(path.resolve()))))
        recording = open_recording(fields)
        inspection, start = inspect_readings(path, recording), start_of(recording.readings())
        play = f"contactfusion run {out} --out results"
    else:
        sensor = sensor_of(path)
        topic = TopicInspection(
            name=sensor,
            type="",
            messages=table.rows,
            frames=(sensor,),
            sensor=sensor,
            reading=Wrench.__name__,
            generators=("force_torque",),
        )
        inspection, start = Inspection(path, 0, 0.0, (topic,), ()), Start()
        play = f"put in what {BLANK} stands for, then: contactfusion check {out}"
    lines = ("recording:", *indented(described), "")
    first = _of_sensors(_Held(inspection, start, tuple(shown(table)), lines, play), out, robot)
    return replace(first, remarks=(*remarks, *first.remarks))


def _of_joints(
    table: TableInspection, joints: JointColumns, robot: Path | None
) -> tuple[TableInspection, str]:
    """The table with its joints named as those of the robot, or without them; a remark on that.

    Raises:
        ConfigurationError: there is no robot that they move, and the table holds nothing else.
    """
    held = f"{joints.positions[0]} to {joints.positions[-1]}"
    if robot is None:
        if not table.wrenches:
            raise ConfigurationError(
                f"{table.path} holds joints ({held}) and no wrench: name the robot by --robot URDF"
            )
        return replace(table, joints=None), f"the joints {held} are left out: name --robot URDF"
    known = RobotModel(RobotConfig(urdf=str(robot))).joint_names
    count = len(joints.positions)
    names = joints.names or known[:count]
    if len(names) < count or not set(names) <= set(known):
        found = ", ".join(joints.names) or held
        raise ConfigurationError(
            f"{table.path} holds {count} joints ({found}), and {robot} has "
            f"{', '.join(known) or 'none'}"
        )
    if joints.names:
        return table, f"{held} are joints of {robot} by their names"
    named = replace(joints, names=tuple(names))
    return replace(table, joints=named), f"{held} are taken to be {', '.join(names)}, in this order"


def _of_sensors(held: _Held, out: Path, robot: Path | None) -> _First:
    inspection, start, path = held.inspection, held.start, held.inspection.path
    urdf, text, remarks = "", "", list[str]()
    model: RobotModel | None = None
    if robot is not None:
        urdf, model = named_from(robot, out), RobotModel(RobotConfig(urdf=str(robot)))
    else:
        try:
            if text := _robot_description(path, inspection):
                urdf, model = out.with_suffix(".urdf").name, _described(text, out)
        except ContactFusionError as error:
            remarks.append(f"the robot_description is left out: {error}; name a URDF by --robot")
            text = ""
    space = model.root if model else _space(inspection)
    uses = list(uses_of(inspection, start, model, space))
    if not uses:
        raise ConfigurationError(
            f"{path} holds no reading of a sensor that a generator of ours takes; "
            f"`contactfusion inspect {path}` shows what it holds"
        )
    remarks += [f"{use.sensor} is left out: {use.left_out}" for use in uses if use.left_out]
    active = [use for use in uses if not use.left_out]
    weighed = [use for use in active if any("type: force_torque" in line for line in use.lines)]
    remarks += [
        f"{generator_name(use.sensor)}: the sign is taken to be on_robot: push the tool along the "
        "sensor's -x, and the force must point to -x; else set sign: by_robot"
        for use in weighed
        if not any(line.strip().startswith("vendor:") for line in use.lines)
    ]
    lines = [
        f"# A first configuration for {path.name}, by `contactfusion init`:",
        f"#   {held.play}",
        "# `contactfusion plugins TYPE` lists the options of a type of generator.",
        "#",
        "# The recording holds, as `contactfusion inspect` shows:",
        *(f"#   {line}" for line in held.shown),
        "",
        *held.recording,
    ]
    if model is not None:
        if start.joints and not start.joints & set(model.joint_names):
            raise ConfigurationError(
                f"no joint of {urdf} is in {path}: the robot has {', '.join(model.joint_names)}; "
                f"the recording has {', '.join(sorted(start.joints))}"
            )
        unreported = sorted(set(model.joint_names) - start.joints - set(model.urdf.mimics))
        remarks += [
            f"nothing reports joint {name}: it stays at 0 in `robot.still`" for name in unreported
        ]
        lines += robot_lines(urdf, model, unreported)
    elif weighed:
        lines += stand_in_lines(active[0].sensor, _frame(inspection, active[0].sensor))
        remarks.append(
            f"no robot is known: a ball of 5 cm about {active[0].sensor} stands in for what hangs "
            "on it, and contacts lie on that ball; put its shapes under `surface`, or name a URDF "
            "by --robot"
        )
    lines += ["", "generators:" if active else "generators: {}"]
    for use in active:
        lines += indented(use.lines)
    for use in uses:
        if use.left_out:
            lines += [f"# {use.sensor} is left out: {use.left_out}"]
            lines += (f"# {line}" for line in indented(use.lines))
    lines += ["", *integrator_lines(space)]
    evidence = [use for use in active if not any("type: motion" in line for line in use.lines)]
    then = held.play if evidence else f"give {out} a generator, of those in its comments"
    return _First(_joined(lines), then, tuple(remarks), text)


def _space(inspection: Inspection) -> str:
    """The frame of the space where there is no robot: the root above the first sensor."""
    sensors = [topic for topic in inspection.topics if topic.generators and any(topic.frames)]
    sensors.sort(key=lambda topic: topic.reading != Wrench.__name__)
    return inspection.ancestors(sensors[0].frames[0])[-1] if sensors else "base"


def _frame(inspection: Inspection, sensor: str) -> str:
    return next(topic.frames[0] for topic in inspection.topics if topic.sensor == sensor)


def _robot_description(path: Path, inspection: Inspection) -> str:
    """The URDF in a recording of ROS; empty where there is none.

    Raises:
        RecordingError: its message is damaged.
    """
    names = [
        topic.name
        for topic in inspection.topics
        if last(topic.name) == DESCRIPTION and topic.type == STRING and topic.messages
    ]
    if not names:
        return ""
    with Bag(path) as bag:
        mine = [channel for channel in bag.channels if channel.topic == names[0]]
        for channel, _, raw in bag.messages(mine):
            try:
                cdr = channel.cdr(raw)
                message: Message = typestore().deserialize_cdr(cdr, channel.msgtype)
            except Exception as error:  # rosbags meets damage with errors of many kinds
                raise RecordingError(f"{names[0]} can't be read: {error}") from error
            return str(message.data)
    return ""


def _described(text: str, out: Path) -> RobotModel:
    """The robot of a URDF, as if its file stood beside the configuration.

    Raises:
        ContactFusionError: it is not valid, or its meshes are not found.
    """
    make_folder(out.parent)
    with TemporaryDirectory(prefix=".", dir=out.parent) as folder:
        file = Path(folder) / f"{DESCRIPTION}.urdf"
        file.write_text(text, encoding="utf-8")
        try:
            return RobotModel(RobotConfig(urdf=str(file.resolve())))
        except ContactFusionError as error:
            raise ContactFusionError(str(error).replace(f"{file.resolve()}: ", "")) from None


# Parts of the file


def _held(inspection: Inspection) -> Iterator[str]:
    for topic in inspection.topics:
        if topic.reading:
            rate = "" if topic.rate is None else f", {topic.rate:.4g} Hz"
            frames = ", ".join(filter(None, topic.frames))
            yield f"{topic.name}: {topic.reading}{rate}" + (f", frame {frames}" if frames else "")


def _recording(path: Path, out: Path) -> Iterator[str]:
    """The recording as `contactfusion run` reads it; `replay` takes it as an argument."""
    kind = "ros" if is_ros(path) else "c3d" if path.suffix.lower() in C3D else ""
    if kind:
        file = text_of(named_from(path, out))
        yield f"recording: {{type: {kind}, file: {file}}}  # for `contactfusion run`"
        yield ""
