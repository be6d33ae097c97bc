"""Robots as other implementations of ROS 2 and DDS make them, as processes of their own.

Each is a program that takes two topics, OUT and IN. Once OUT is read and IN is written, it sends
for 5 s: 1,000 wrenches a second on OUT, reliably, and the same on OUT_best_effort; 10 clouds of
120 kB a second on OUT_cloud. The number of a wrench is 1e9 times its force.x, that of a cloud its
row_step. It prints the numbers of what it hears on IN and IN_cloud, and ends 2 s after the last.
"""

import os
import subprocess
from pathlib import Path
from typing import NamedTuple

from contactfusion.live.dds import LOOPBACK

HERE = Path(__file__).parent
MADE = HERE.parents[1] / ".interop"
"""What scripts/interop.sh has made."""
COMMANDS = {
    "jazzy": [MADE / "jazzy/bin/python", HERE / "peer.py"],
    "kilted": [MADE / "kilted/bin/python", HERE / "peer.py"],
    "fastdds": [MADE / "fastdds/peer"],
    "cyclonedds": [MADE / "cyclonedds/peer"],
}
"""The programs, by the name of the implementation."""
OF_ROS = ("jazzy", "kilted")
WRENCHES, CLOUDS, BYTES = 5000, 50, 120_000


class Heard(NamedTuple):
    """What a robot heard.

    Attributes:
        wrenches: their numbers.
        clouds: their numbers.
        sizes: those of the clouds [bytes].
        hashes: of the type of what is written on IN, as the robot sees it.
    """

    wrenches: list[int]
    clouds: list[int]
    sizes: set[int]
    hashes: list[str]


class Robot:
    """A robot that has started.

    Args:
        name: of its implementation.
        out: the topic on which it sends.
        into: the topic on which it listens.
    """

    def __init__(self, name: str, out: str, into: str) -> None:
        command = [*map(str, COMMANDS[name]), out, into]
        # what leads to the libraries of another ROS is left out
        environment = {
            name: value
            for name, value in os.environ.items()
            if name in ("HOME", "PATH") or name.startswith("ROS_")
        }
        self._process = subprocess.Popen(
            command,
            env={**environment, "CYCLONEDDS_URI": LOOPBACK},
            stdout=subprocess.PIPE,
            text=True,
        )

    def heard(self) -> Heard:
        """What it heard, once it ends."""
        printed = self._process.communicate(timeout=60.0)[0]
        assert self._process.returncode == 0
        lines = [line.split() for line in printed.splitlines()]
        clouds = [(int(line[1]), int(line[2])) for line in lines if line[0] == "cloud"]
        return Heard(
            [int(line[1]) for line in lines if line[0] == "wrench"],
            [number for number, _ in clouds],
            {size for _, size in clouds},
            [line[1] for line in lines if line[0] == "hash"],
        )

    def close(self) -> None:
        """End it, where it has not ended by itself."""
        self._process.kill()
        self._process.communicate()
