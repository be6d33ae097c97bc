"""A simulated base and `live` beside it: sensors that fail or stop, and kills of `live`."""

import random
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from contactfusion.errors import RecordingError
from contactfusion.readings.messages import Message
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.ros.files import Bag
from tests.torture.faults import FAULTS, SCENES
from tests.torture.trial import CONTACTFUSION, Row, command

SCENE = SCENES / "push_fused.yaml"
SENSORS = ("skin", "lidar", "wheels", "odometry", "")
"""Of the scene; the empty name is all of them."""
SENSELESS = {"calibration": ("skin", "wheels", "odometry", "")}
"""Sensors that a fault makes no sense for."""
FAILING, STOPPED, FOUND = 4.0, 12.0, 8.0
"""How long `live` runs, how long sensors stop, and in what time DDS finds them again [s]."""
KILLS, STOPS = 60, 5
CONTACTS = "/contactfusion/contacts"
"""The topic of the contacts of each step in a recording."""


def live_faults(_: Path) -> Iterator[Row]:
    """Push beside each fault of each sensor; `live` goes on until it is ended."""
    for fault in FAULTS:
        found = []
        for sensor in SENSORS:
            if sensor in SENSELESS.get(fault["fault"], ()):
                continue
            change = {**fault, "start": 1.0, **({"sensor": sensor} if sensor else {})}
            with _base(f"faults=[{change}]"):
                done = command("live", SCENE, "--duration", str(FAILING))
            found.append(done.fault or ("" if done.status == 0 else done.error[-200:]))
            found[-1] = found[-1] and f"{sensor}: {found[-1]}"
        yield Row.of(f"live, {fault['fault']}", found)


def live_stops(folder: Path) -> Iterator[Row]:
    """Stop the sensors while the base pushes, and let them go on: contacts come again."""
    found = []
    for number in range(STOPS):
        recorded = folder / f"stopped_{number}.mcap"
        with _base() as sensors:
            with _recording(recorded) as live:
                time.sleep(FAILING)
                sensors.send_signal(signal.SIGSTOP)
                time.sleep(STOPPED)
                sensors.send_signal(signal.SIGCONT)
                went_on = time.time_ns()
                time.sleep(FOUND)
                live.send_signal(signal.SIGINT)
                status = live.wait(STOPPED)
        late = _contacts_after(recorded, went_on)
        found.append("" if status == 0 and late else f"status {status}, {late} contacts came again")
        recorded.unlink(missing_ok=True)
    yield Row.of("live, sensors stopped for 12 s", found)


def live_kills(folder: Path) -> Iterator[Row]:
    """Kill `live` while it records: what is left is read, and lacks a second at most."""
    rng, found = random.Random(0), []
    recorded = folder / "killed_live.mcap"
    with _base():
        for _ in range(KILLS):
            with _recording(recorded) as live:
                began = time.time_ns()
                time.sleep(rng.uniform(0.0, FAILING))
                ended = time.time_ns()
                live.kill()
            found.append(_left(folder, began, ended))
            for left in folder.glob(".killed_live.mcap.*"):
                shutil.rmtree(left)
    yield Row.of("live, SIGKILL while it records", found)


def _left(folder: Path, began: int, ended: int) -> str:
    """What is wrong with the recording that a killed `live` has left."""
    if (folder / "killed_live.mcap").exists():
        return "the recording has its name, and is not whole"
    left = [*folder.glob(".killed_live.mcap.*/recording/*.mcap")]
    if not left or not left[0].stat().st_size:
        return ""  # it was killed before it began
    done = command("inspect", left[0])
    if done.fault:
        return done.fault
    last = began  # the configuration is recorded before anything is heard
    with Bag(left[0]) as bag, suppress(RecordingError):  # which says that it is cut off
        for _, log, _ in bag.messages(bag.channels):
            last = max(last, log)
    lacks = (ended - last) / 1e9
    return "" if lacks < 1.5 else f"it lacks the last {lacks:.1f} s"


def _contacts_after(recorded: Path, stamp: int) -> int:
    """Number of steps with contacts after a moment [ns since 1970]."""
    with Bag(recorded) as bag:
        channels = [each for each in bag.channels if each.topic == CONTACTS]
        found: list[Message] = [
            typestore().deserialize_cdr(bytes(channel.cdr(raw)), channel.msgtype)
            for channel, log, raw in bag.messages(channels)
            if log > stamp
        ]
    return sum(len(each.contacts) > 0 for each in found)


@contextmanager
def _base(*changes: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A simulated base, ended in the end; yields the process of its sensors."""
    options = [word for change in changes for word in ("--set", change)]
    words = ("simulate", str(SCENE), *options, "--part")
    with _beside(*words, "base"), _beside(*words, "sensors") as sensors:
        yield sensors


@contextmanager
def _recording(path: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """`live` while it records; yields once it has begun."""
    with _beside("live", str(SCENE), "--record", str(path), "--wait", "30") as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(b"live as"):
                break
        yield process


@contextmanager
def _beside(*words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A command beside what is done here; it is ended in the end."""
    process = subprocess.Popen(
        [*CONTACTFUSION, *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(STOPPED)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
