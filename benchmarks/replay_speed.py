"""Replays recordings of five sensors, and tells how many times faster than they were made.

    python -m benchmarks.replay_speed --folder /tmp/speed

A slow push of about four minutes, felt by a skin and seen by a LiDAR and a camera, with wheels and
odometry; and the same with a second LiDAR in place of the camera. Beside each the time that
mcap-ros2-support takes to decode the same file, and to do nothing with it.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from contactfusion.yaml_files import read_yaml

SCENE = Path(__file__).parents[1] / "examples" / "scenes" / "push_five.yaml"
TARGET = [3.0, 1.0]
SLOW = {"like": "tuned", "fastest": 0.015, "slowest": 0.015}
"""Parameters of the controller with which the push takes four minutes."""
ASKED = 20.0
"""So many times faster than it was made, at least."""


def scenes() -> dict[str, dict[str, Any]]:
    """Give the scenes by what is beside skin, LiDAR, wheels and odometry."""
    camera = read_yaml(SCENE)
    camera["controller"] = {**camera["controller"], "target": TARGET, "parameters": SLOW}
    camera["scene"]["target"] = TARGET
    lidars = {**camera, "generators": dict(camera["generators"]), "scene": dict(camera["scene"])}
    del lidars["generators"]["camera"]
    lidars["generators"]["lidar_side"] = {"type": "lidar_cpm", "sensor": "lidar_side"}
    lidars["scene"]["sees"] = ["lidar", "lidar_side"]
    return {"camera": camera, "lidar_side": lidars}


def decoded(path: Path) -> float:
    """Give how long mcap-ros2-support decodes all messages of a file [s]."""
    began = time.perf_counter()
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _ in reader.iter_decoded_messages():
            pass
    return time.perf_counter() - began


def command(*arguments: str | Path) -> str:
    """Run contactfusion, and give the last line but one that it prints."""
    words = (Path(sys.executable).with_name("contactfusion"), *arguments)
    told = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True)
    return str(told.stdout.splitlines()[-2])


def main() -> None:
    """Record, replay, tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="takes the recordings")
    parser.add_argument("--rounds", type=int, default=3, help="so often each is replayed")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, fields in scenes().items():
        scene, path = (options.folder / f"{name}.{end}" for end in ("yaml", "mcap"))
        scene.write_text(yaml.safe_dump(fields), encoding="utf-8")
        if not path.is_file():
            command("record", scene, "--out", path)
        print(f"skin, lidar, {name}, wheels, odometry, 10 times a second; asked: {ASKED:g} times")
        for _ in range(options.rounds):
            print(f"  {command('replay', scene, path, '--out', path.with_suffix('.out.mcap'))}")
        print(f"  mcap-ros2-support decodes it in {decoded(path):.1f} s")


if __name__ == "__main__":
    main()
