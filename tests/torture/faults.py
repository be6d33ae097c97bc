"""Each fault of each sensor, in a touch, a push and a grasp; and clocks that leap."""

import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from contactfusion.readings.messages import Message
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import defined, typestore
from contactfusion.recordings.recording import RawMessage
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.step_messages import OURS
from tests.torture.trial import Row, command

SCENES = Path("examples/scenes")
PLAYED: Mapping[str, tuple[str, Sequence[str]]] = {
    "touch": ("touch_box.yaml", ("palm", "tip_1", "wrist", "joints", "forehead", "")),
    "push": ("push_five.yaml", ("skin", "lidar", "camera", "wheels", "odometry", "")),
    "grasp": ("grasp_bottle.yaml", ("wrist", "joints", "")),
}
"""The scene of each task, and its sensors; the empty name is all of them."""
FAULTS: Sequence[Mapping[str, Any]] = (
    {"fault": "silent", "start": 1.0},
    {"fault": "dropout", "probability": 0.5},
    {"fault": "delay", "seconds": 0.4},
    {"fault": "zeros", "start": 1.0},
    {"fault": "stuck", "start": 1.0},
    {"fault": "bias", "amount": 1e6},
    {"fault": "drift", "amount": 100.0},
    {"fault": "noise", "amount": 100.0},
    {"fault": "calibration", "mm": [500.0, 0.0, 0.0], "degrees": [0.0, 90.0, 0.0]},
)
LEAPS = (3600.0, -3600.0, 3.0, -3.0)
"""Leaps of a clock half-way [s]."""
AT_ONCE = 2


def faults(folder: Path) -> Iterator[Row]:
    """Play a recording of each task with each fault of each sensor."""
    for task, (scene, sensors) in PLAYED.items():
        recorded = _recorded(folder, scene)

        def play(change: Mapping[str, Any], scene: str = scene, recorded: Path = recorded) -> str:
            """One fault; a sentence that a sensor has no such values is as it should be."""
            setting = f"faults={json.dumps([change])}"
            out = folder / f"faults_{abs(hash(setting))}.mcap"
            done = command("run", SCENES / scene, recorded, "--set", setting, "--out", out)
            out.unlink(missing_ok=True)
            return done.fault and f"{change}: {done.fault}"

        for fault in FAULTS:
            changes = [{**fault, "sensor": sensor} if sensor else fault for sensor in sensors]
            with ThreadPoolExecutor(AT_ONCE) as pool:
                yield Row.of(f"{task}, {fault['fault']}", [*pool.map(play, changes)])


def clocks(folder: Path) -> Iterator[Row]:
    """Play a recording in which the clock of each topic leaps half-way."""
    for task, (scene, _) in PLAYED.items():
        recorded = _recorded(folder, scene)
        with Bag(recorded) as bag:
            topics = sorted(
                channel.topic
                for channel in bag.channels
                if not channel.topic.startswith((OURS, "/truth"))
            )
        found = []
        for topic in topics:
            for leap in LEAPS:
                leapt = folder / "leapt.mcap"
                _leap(recorded, leapt, topic, leap)
                done = command("run", SCENES / scene, leapt, "--out", folder / "leapt_out.mcap")
                found.append(done.fault and f"{topic}, {leap:g} s: {done.fault}")
        yield Row.of(f"{task}, a clock leaps by ±3 s, ±1 h", found)


def _recorded(folder: Path, scene: str) -> Path:
    """The first seconds of a scene, recorded once."""
    path = folder / f"{Path(scene).stem}.mcap"
    if not path.exists():
        command("record", SCENES / scene, "--duration", "3", "--out", path)
    return path


def _leap(recorded: Path, leapt: Path, topic: str, by: float) -> None:
    """Copy a recording; from half of its messages on, the stamps of a topic are others [s]."""
    with Bag(recorded) as bag, McapWriter(leapt, 0) as writer:
        messages = [
            (channel, log, bytes(channel.cdr(raw)))
            for channel, log, raw in bag.messages(bag.channels)
        ]
        half = messages[len(messages) // 2][1]
        for channel, log, cdr in messages:
            if channel.topic == topic and log > half:
                sent: Message = typestore().deserialize_cdr(cdr, channel.msgtype)
                tops = [part.header for part in getattr(sent, "transforms", [])]
                for top in tops or [sent.header] if hasattr(sent, "header") or tops else []:
                    top.stamp.sec += int(by)
                cdr = bytes(typestore().serialize_cdr(sent, channel.msgtype))
            writer.copy(
                RawMessage(channel.topic, channel.msgtype, defined(channel.msgtype), log, cdr)
            )
