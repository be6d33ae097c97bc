"""How late contacts are on a running robot, and what is lost: a robot, DDS, `live`.

python -m benchmarks.live_latency ROBOT [--seconds S] [--rate HZ]; ROBOT is an interpreter with
rclpy, or the program that scripts/interop.sh makes of Fast DDS in C++, which sends for 5 s. A skin
of 24 taxels at 100 Hz is sent by this process, as its message is ours.
"""

import argparse
import atexit
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from contactfusion.live.clock import machine_time
from contactfusion.live.control import ask
from contactfusion.live.dds import DdsTransport
from contactfusion.live.transport import Quality
from contactfusion.readings.messages import Message, header, message
from contactfusion.recordings.messages import typestore

CONFIGURATION = """\
surface: {frame: probe, shapes: [{shape: sphere, radius: 0.05}], spacing: 0.003}
generators:
  wrist: {type: force_torque, sensor: wrist, sign: on_robot}
  skin:
    type: tactile
    sensor: skin
    patch: {places: [%s], size: [0.005, 0.005]}
  eye: {type: range, sensor: eye}
integrator: {frame: probe}
cycle: {on: wrist}
"""
TAXELS = 24
NAME = "latency"
STRONGEST = "/contactfusion/contacts/strongest"
WRENCH = "geometry_msgs/msg/WrenchStamped"
PROGRAM = "peer"
"""The name of the program of Fast DDS; it sends on its first topic, and hears on its second."""
SENT = 5000
"""Number of wrenches that it sends."""


def main() -> None:
    """Print what was sent, heard and lost, and how late contacts were; exit 1 if any was lost."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live_latency", description=__doc__)
    parser.add_argument("robot", type=Path, help="an interpreter with rclpy, or a program")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=1000.0, help="of wrenches [Hz]")
    options = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "0")
    angles = np.linspace(0.0, 2.0 * np.pi, TAXELS, endpoint=False)
    ring = [f"[{0.05 * np.cos(a):.4f}, {0.05 * np.sin(a):.4f}, 0]" for a in angles]
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"{NAME}.yaml"
        file.write_text(CONFIGURATION % ", ".join(ring), encoding="utf-8")
        command = [sys.executable, "-m", "contactfusion", "-q", "live", str(file), "--wait", "20"]
        ended = threading.Event()
        skin = threading.Thread(target=_skin, args=(ended,), daemon=True)
        skin.start()
        live = subprocess.Popen(command)
        atexit.register(live.terminate)  # also after an error
        is_program = options.robot.name == PROGRAM
        words = ["/wrist", STRONGEST] if is_program else [
            str(Path(__file__).with_name("live_peer.py")), str(options.seconds), str(options.rate)
        ]  # fmt: skip
        late, listening = _heard_here() if is_program else ([], None)
        peer = subprocess.Popen([options.robot, *words], stdout=subprocess.PIPE, text=True)
        memory = _memory(live.pid, peer)
        printed = peer.communicate()[0]
        if listening is not None:
            p50, p99 = (1e3 * float(np.quantile(late, q)) for q in (0.5, 0.99))
            contacts = sum(line.startswith("wrench") for line in printed.splitlines())
            counts = {"wrenches": SENT, "clouds": 0, "contacts": contacts}
            heard = {**counts, "p50": p50, "p99": p99}
            listening.close()
        else:
            heard = json.loads(printed)
        state = json.loads(ask("status", NAME))
        ended.set()
        live.terminate()
        live.wait()
        skin.join()
    came = {each["topic"]: each for each in state["topics"]}
    lost = {
        "wrenches": heard["wrenches"] - came["/wrist"]["messages"],
        "clouds": heard["clouds"] - came.get("/eye", {"messages": 0})["messages"],
        "contacts": state["sent"]["/contactfusion/contacts/strongest"] - heard["contacts"],
    }
    print(f"sent: {heard['wrenches']} wrenches, {heard['clouds']} clouds", end="; ")
    print(f"{came['/skin']['messages']} images of the skin came")
    print(f"contacts heard: {heard['contacts']} of {state['cycle']['rate']:.0f} steps a second")
    print(f"lost on the way: {lost}; dropped by the loop: {[c['dropped'] for c in came.values()]}")
    print(f"from sensor to contact: p50 {heard['p50']:.2f} ms, p99 {heard['p99']:.2f} ms")
    print(f"a step took {state['cycle']['took']:.2f} ms, p99 {state['cycle']['slowest']:.2f} ms")
    print(f"memory: {memory[0]:.0f} MB at first, {memory[1]:.0f} MB at the end")
    sys.exit(any(lost.values()))


def _heard_here() -> tuple[list[float], DdsTransport]:
    """How late contacts are in this process [s], as they come, and what hears them."""
    late, transport = list[float](), DdsTransport()

    def hear(cdr: bytes, arrived: int) -> None:
        contact: Message = typestore().deserialize_cdr(cdr, WRENCH)
        stamp = contact.header.stamp
        late.append((machine_time() - stamp.sec * 10**9 - stamp.nanosec) / 1e9)

    transport.listen(STRONGEST, WRENCH, Quality(True, False), hear)
    return late, transport


def _skin(ended: threading.Event) -> None:
    """Send images of a skin at 100 Hz, of which no taxel is pressed."""
    transport = DdsTransport()
    send = transport.advertise("/skin", "contactfusion_msgs/msg/TactileImage")
    noise = np.random.default_rng(0)
    while not ended.wait(0.01):
        image = message(
            "contactfusion_msgs/TactileImage",
            header=header(time.time_ns(), "probe"),
            values=noise.uniform(0.0, 1.0, TAXELS),
        )
        send(typestore().serialize_cdr(image, image.__msgtype__))
    transport.close()


def _memory(pid: int, peer: "subprocess.Popen[str]") -> tuple[float, float]:
    """The resident memory of a process 10 s after the start, and when the peer ends [MB]."""
    sizes, began = [0.0], time.monotonic()
    while peer.poll() is None:
        time.sleep(0.5)
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="utf-8").split()[1])
        size = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
        sizes = [size] if time.monotonic() - began < 10.0 else [*sizes[:1], size]
    return sizes[0], sizes[-1]


if __name__ == "__main__":
    main()
