"""A base, its sensors and `contactfusion live`, with DDS between: `make show-live`.

Each push is made by three processes in real time; then sensors are killed, and `live` is ended in
each way while the base moves. What is made is kept, so it goes on where it was stopped.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, final

import numpy as np
import yaml

from contactfusion.controllers.pushing import ARRIVED
from contactfusion.files import write_whole
from contactfusion.live.dds import DdsTransport
from contactfusion.live.transport import Quality
from contactfusion.readings.messages import Message
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.ros.files import Bag
from contactfusion.run.recorder import TRUTH
from contactfusion_lab.experiments.push.plan import Push, read_plan, read_targets
from contactfusion_lab.scenes.push.config import RATE, PushConfig, SkinConfig
from contactfusion_lab.scenes.push.scene import touching
from contactfusion_lab.simulate.topics import StateListener
from contactfusion_lab.trials.measures import proportion

OUT = Path("out/live")
FILE = Path("examples/scenes/push_fused.yaml").resolve()
PUSHES, ENDS, SEED = 20, 5, 2026
"""Number of pushes, and of ends in each way."""
ASKED = 0.3
"""The longest time until zero is commanded, or the base stands [s]."""
PUSH = "push"
"""The mode of the controller while it pushes."""
LONGEST = 120.0
"""The longest push [s]."""
MOVES, STANDS = 0.05, 0.005
"""The base moves faster than the one, and stands where it is slower than the other [m/s]."""
PUSHED = 2.0
"""Time after the first contact at which something is ended [s]."""
WATCHED = {"sensors": 12.0, "live": 1.5}
"""Time after an end for which the base is watched: of sensors until DDS forgets them [s]."""
SOON: Final = 30.0
"""The longest wait for what comes soon [s]."""
LIVE = (sys.executable, "-m", "contactfusion")
FAILING = (
    sys.executable,
    "-c",
    "import signal\n"
    "def fail(*_): raise RuntimeError('a fault')\n"
    "signal.signal(signal.SIGUSR1, fail)\n"
    "from contactfusion.cli import main\n"
    "main()",
)
"""The same program, which fails by an exception wherever it is when it is asked to."""
WAYS: Mapping[str, tuple[str, int]] = {
    "sensors SIGKILL": ("sensors", signal.SIGKILL),
    "live SIGINT": ("live", signal.SIGINT),
    "live SIGTERM": ("live", signal.SIGTERM),
    "live exception": ("live", signal.SIGUSR1),
    "live SIGKILL": ("live", signal.SIGKILL),
    "live SIGSTOP": ("live", signal.SIGSTOP),
}
"""What is ended, and by which signal."""


def main() -> int:
    """Make what is not made yet, and print what came of it; 1 where something falls short."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", "77")
    OUT.mkdir(parents=True, exist_ok=True)
    targets = read_targets(f"random:{PUSHES + ENDS}")
    plan = read_plan("fused", [], [], [], targets, "random", 24, SkinConfig(), (), SEED)
    drawn = sorted(plan.pushes(), key=lambda push: push.number)
    pushes = [
        _kept(f"push_{i:02d}", partial(_push, push, i)) for i, push in enumerate(drawn[:PUSHES])
    ]
    ends = {
        way: [
            _kept(f"{way.replace(' ', '_')}_{i}", partial(_end, push, way))
            for i, push in enumerate(drawn[PUSHES:])
        ]
        for way in WAYS
    }
    return not all([_reported(pushes, ends), _plays_again()])


def _reported(pushes: list[dict[str, Any]], ends: Mapping[str, list[dict[str, Any]]]) -> bool:
    """Print the tables; whether all is as it should be."""
    hits = np.array([push["success"] for push in pushes])
    _, low, high = proportion(hits)
    print(f"pushes to random targets: {hits.sum()} of {len(hits)} [{low:.0%}, {high:.0%}]")
    for push in pushes:
        if not push["success"]:
            print(f"  {push['name']}: {push['mode']} after {push['seconds']:.0f} s")
    print("| ended | n | zero is commanded, s | the base stands, s |")
    print("|---|---|---|---|")
    good = bool(hits.all())
    for way, each in ends.items():
        rows = [[end[what] for end in each if end[what] is not None] for what in ("zero", "stands")]
        cells = [
            f"{np.median(row):.2f}, at most {max(row):.2f}" if row else "never" for row in rows
        ]
        print(f"| {way} | {len(each)} | {cells[0]} | {cells[1]} |")
        asked = rows[0] if way.startswith("sensors") else rows[1]
        good = good and len(asked) == len(each) and max(asked) <= ASKED
    return good


def _plays_again() -> bool:
    """Whether `run` finds in the recording of the first push the contacts that were found live."""
    recorded, again = OUT / "push_00.mcap", OUT / "again.mcap"
    if not again.exists():
        command = [
            *LIVE,
            "-q",
            "run",
            str(OUT / "push_00.yaml"),
            str(recorded),
            "--out",
            str(again),
        ]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    contacts = [_contacts(path) for path in (recorded, again)]
    same = contacts[0] == contacts[1]
    print(f"played again: {len(contacts[0])} steps, contacts {'the same' if same else 'DIFFER'}")
    return same


def _contacts(path: Path) -> list[bytes]:
    with Bag(path) as bag:
        channels = [each for each in bag.channels if each.topic == "/contactfusion/contacts"]
        return [bytes(channel.cdr(raw)) for channel, _, raw in bag.messages(channels)]


def _kept(name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What was made before, or is made now."""
    file = OUT / f"{name}.json"
    if not file.exists():
        made = make()
        print(f"{name}: {json.dumps(made)}", flush=True)
        write_whole(file, json.dumps(made) + "\n")
    known: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return known


def _push(push: Push, number: int) -> dict[str, Any]:
    """A push until the controller says that the object is there."""
    record = ["--record", str(OUT / "push_00.mcap")] if number == 0 else []
    with _robot(push, LIVE, f"push_{number:02d}", *record) as robot:
        began = time.monotonic()
        while robot.mode != ARRIVED and time.monotonic() - began < LONGEST:
            time.sleep(0.02)
        mode, seconds, distance = robot.mode, time.monotonic() - began, robot.distance()
        success = mode == ARRIVED and distance <= PushConfig(target=push.target).within
        return {
            "name": push.name,
            "target": push.target,
            "success": success,
            "mode": mode,
            "seconds": round(seconds, 2),
            "distance": None if np.isnan(distance) else round(distance, 4),
        }


def _end(push: Push, way: str) -> dict[str, Any]:
    """A push in which something is ended: the time until zero is commanded, and the base stands."""
    ended, number = WAYS[way]
    with _robot(push, FAILING, "ended") as robot:
        robot.wait(lambda: robot.mode == PUSH)
        time.sleep(PUSHED)
        robot.wait(lambda: robot.speeds[-1][1] > MOVES)
        at = time.time_ns()
        robot.processes[ended].send_signal(number)
        time.sleep(WATCHED[ended])
        still = {
            "zero": _from(at, robot.commanded, 0.0),
            "stands": _from(at, robot.speeds, STANDS),
        }
        if number == signal.SIGSTOP:
            robot.processes[ended].send_signal(signal.SIGCONT)
        return still


def _from(at: int, speeds: list[tuple[int, float]], still: float) -> float | None:
    """The time from an instant [ns] until speeds stay still [s]; None: they never do."""
    later = [(when, speed) for when, speed in speeds if when >= at]
    moving = [row for row, (_, speed) in enumerate(later) if speed > still]
    row = moving[-1] + 1 if moving else 0
    return round((later[row][0] - at) / 1e9, 3) if row < len(later) else None


@final
class _Robot:
    """The processes of a push, and what is heard of them."""

    def __init__(self, push: Push, transport: DdsTransport) -> None:
        self._target = push.target
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.mode = ""
        """Of the controller."""
        self.commanded: list[tuple[int, float]] = []
        """When a velocity was commanded [ns since 1970], and its norm."""
        self.speeds: list[tuple[int, float]] = [(0, 0.0)]
        """Likewise the true ones."""
        self._states = StateListener(transport)
        for topic, (msgtype, take) in {
            "/cmd_vel": ("geometry_msgs/msg/Twist", self._command),
            f"/{TRUTH}/twist": ("geometry_msgs/msg/TwistStamped", self._speed),
            "/contactfusion/events": ("std_msgs/msg/String", self._event),
        }.items():
            transport.listen(topic, msgtype, Quality(True, False), partial(_decoded, msgtype, take))

    def wait(self, true: Callable[[], bool]) -> None:
        """Wait for what comes soon."""
        ends = time.monotonic() + SOON
        while not true():
            if time.monotonic() > ends:
                sys.exit(f"it never came; the controller's mode is '{self.mode}'")
            time.sleep(0.005)

    def distance(self) -> float:
        """From the true contact to the target [m]; NaN without contact."""
        received = self._states.take(SOON)
        assert received is not None
        state = received.state
        _, (x, y) = touching(state.touches, round(RATE * PushConfig(target=self._target).period))
        cos, sin = np.cos(state.base[2]), np.sin(state.base[2])
        there = state.base[0] + cos * x - sin * y, state.base[1] + sin * x + cos * y
        return float(np.hypot(*np.subtract(self._target, there)))

    def _command(self, sent: Message, arrived: int) -> None:
        self.commanded.append((arrived, _speed_of(sent)))

    def _speed(self, sent: Message, arrived: int) -> None:
        self.speeds.append((arrived, _speed_of(sent.twist)))

    def _event(self, sent: Message, arrived: int) -> None:
        self.mode = json.loads(sent.data).get("mode", self.mode)


def _decoded(msgtype: str, take: Callable[[Message, int], None], cdr: bytes, arrived: int) -> None:
    take(typestore().deserialize_cdr(cdr, msgtype), arrived)


def _speed_of(twist: Message) -> float:
    return float(np.hypot(np.hypot(twist.linear.x, twist.linear.y), twist.angular.z))


@contextmanager
def _robot(push: Push, live: Sequence[str], name: str, *options: str) -> Iterator[_Robot]:
    """A base, its sensors, and `live`, each a process; they are ended in the end."""
    x, y = push.target
    fields = {
        "scene": {"target": [x, y], "object": push.object, "friction": push.friction,
                  "offset": push.offset, "yaw": push.yaw},
        "controller": {"target": [x, y]},
    }  # fmt: skip
    file = OUT / f"{name}.yaml"
    settings = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    for part, changed in fields.items():
        settings[part].update(changed)
    write_whole(file, yaml.safe_dump(settings, sort_keys=False))
    simulate = [*LIVE, "simulate", str(file), "--seed", str(push.seed), "--part"]
    commands = {
        "base": [*simulate, "base"],
        "sensors": [*simulate, "sensors"],
        "live": [*live, "live", str(file), "--wait", "30", *options],
    }
    with ExitStack() as stack:
        transport = stack.enter_context(closing(DdsTransport()))
        robot = _Robot(push, transport)
        for part, command in commands.items():
            log = stack.enter_context((OUT / f"{name}.{part}.log").open("wb"))
            process = subprocess.Popen(command, stdout=log, stderr=log)
            robot.processes[part] = process
            stack.callback(_ended, process)
        robot.wait(lambda: bool(robot.mode))
        yield robot


def _ended(process: "subprocess.Popen[bytes]") -> None:
    """End a process in order, or else at once."""
    process.terminate()
    try:
        process.wait(SOON)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


if __name__ == "__main__":
    sys.exit(main())
