"""Replays a recording of some gigabytes, and tells the memory that it takes.

    python -m benchmarks.long_recording --gigabytes 5 --folder /tmp/long

What is in it can hardly be compressed: LiDAR turns of chance, odometry and joints between them.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from contactfusion.readings import Odometry, PointCloud, Reading, Twist
from contactfusion.recordings.mcap import McapWriter

POINTS = 32 * 1024
RATE = 10.0
"""LiDAR turns a second, as of an Ouster OS0-32."""
CONFIG = """
robot: contactfusion.robots:mobile_base.yaml
generators:
  lidar: {type: lidar_rule, sensor: lidar}
  motion: {type: motion, sensor: wheels}
integrator: {frame: base, voxel_size: 0.0125}
cycle: {every: 0.1}
"""


def readings(gigabytes: float) -> Iterator[Reading]:
    """Give readings of so many gigabytes."""
    rng = np.random.default_rng(0)
    turns = round(gigabytes * 1e9 / (12 * POINTS))
    for turn in range(turns):
        points = rng.normal(0.0, 3.0, (POINTS, 3))
        yield PointCloud(stamp=turn / RATE, frame="lidar", sensor="lidar", points=points)
        for part in range(10):
            stamp = (turn + part / 10.0) / RATE
            yield Odometry(
                stamp=stamp,
                frame="odom",
                child_frame="base",
                sensor="odometry",
                position=np.array([0.1 * stamp, 0.0, 0.0]),
                orientation=np.array([0.0, 0.0, 0.0, 1.0]),
            )
            forward = np.array([0.1, 0.0, 0.0])
            yield Twist(
                stamp=stamp, frame="base", sensor="wheels", linear=forward, angular=np.zeros(3)
            )


def write(path: Path, gigabytes: float) -> None:
    """Write the recording."""
    with McapWriter(path, 1_700_000_000_000_000_000) as writer:
        for reading in readings(gigabytes):
            writer.reading(reading)


def peak(*command: str | Path) -> tuple[float, float]:
    """Run a command; give the most memory that it took [MB], and how long it took [s]."""
    began = time.perf_counter()
    with subprocess.Popen(command) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(process.returncode)
    return usage.ru_maxrss / 1024.0, time.perf_counter() - began


def main() -> None:
    """Write recordings, one a tenth as long, and replay both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=5.0)
    parser.add_argument("--folder", type=Path, default=Path("out/long"))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    config = options.folder / "robot.yaml"
    config.write_text(CONFIG)
    for part, size in (("tenth", options.gigabytes / 10.0), ("whole", options.gigabytes)):
        recording = options.folder / f"{part}.mcap"
        if not recording.exists():
            write(recording, size)
        gigabytes = recording.stat().st_size / 1e9
        for suffix in ("csv", "mcap"):
            out = options.folder / f"{part}_out.{suffix}"
            command = (Path(sys.executable).with_name("contactfusion"), "replay", config, recording)
            memory, took = peak(*command, "--out", out)
            print(f"{gigabytes:.2f} GB to .{suffix}: at most {memory:.0f} MB, {took:.0f} s")


if __name__ == "__main__":
    main()
