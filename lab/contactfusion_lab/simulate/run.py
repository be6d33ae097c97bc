"""`contactfusion simulate`: the robot of a scene in real time, as nodes of ROS 2."""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError, RobotError, naming
from contactfusion.faults import unmet
from contactfusion.live.dds import DdsTransport
from contactfusion.run.configuration import RunConfig, setting_of_file
from contactfusion.scene import open_scene
from contactfusion_lab.scenes.push.scene import Pushing, PushScene
from contactfusion_lab.simulate import Part
from contactfusion_lab.simulate.base import run_base
from contactfusion_lab.simulate.sensors import run_sensors

PATIENCE = 10.0
"""The longest wait for the sensors to end [s]."""


def simulate(
    path: Path,
    part: Part = Part.ALL,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    domain: int | None = None,
) -> None:
    """Be the robot of a scene until Ctrl-C or SIGTERM.

    Args:
        path: a YAML file as for `contactfusion run`, with a scene of type push.
        part: which of its parts.
        overrides: fields to change, as "a.b=c".
        seed: in place of the file's; None: that of the file.
        domain: of ROS; None: `ROS_DOMAIN_ID`, or 0.

    Raises:
        ConfigurationError: the file has no such scene, a fault is of no sensor of it, or there is
            no such domain.
        DependencyError: what the scene, or ROS, needs is not installed.
        RobotError: the sensors ended by themselves.
    """
    config = setting_of_file(path, overrides, seed).run_config()
    with naming(path):
        if config.scene.get("type") != "push":
            raise ConfigurationError("only a scene of type push runs in real time", "scene.type")
        if part is Part.SENSORS:
            scene = _opened(config, window=False)
            _require_met(config, scene)
        else:  # which casts no rays
            scene = _opened(config, sees=[], misplaced={})
    with closing(DdsTransport(domain)) as transport, _ended_by_signals() as ended:
        if part is Part.SENSORS:
            run_sensors(scene, config, transport, ended)
        elif part is Part.BASE:
            run_base(scene, config, transport, ended)
        else:
            with _beside(_command(path, overrides, seed, domain), ended):
                run_base(scene, config, transport, ended)


def _opened(config: RunConfig, **changed: Any) -> PushScene:
    """The scene of a configuration at its start, with other options."""
    assert config.robot is not None  # a scene needs one
    opened = open_scene({**config.scene, **changed}, config.robot, config.seed, config.folder)
    assert isinstance(opened, Pushing)
    return opened.scene


def _require_met(config: RunConfig, scene: PushScene) -> None:
    """Refuse faults of sensors that a scene at its start, where all are due, has not."""
    if not config.faults:
        return
    came = {(reading.sensor, type(reading)) for reading in scene.readings()}
    if missing := [*unmet(config.faults, came)]:
        raise ConfigurationError("; ".join(missing))


@contextmanager
def _ended_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set."""
    ended = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda *_: ended.set()) for number in numbers}
    try:
        yield ended
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _command(
    path: Path, overrides: Sequence[str], seed: int | None, domain: int | None
) -> list[str]:
    """The command that runs the sensors."""
    options = [("--set", each) for each in overrides]
    options += [(f"--{name}", str(value)) for name, value in (("seed", seed), ("domain", domain))
                if value is not None]  # fmt: skip
    words = [word for option in options for word in option]
    own = [sys.executable, "-m", "contactfusion", "simulate", str(path), "--part", Part.SENSORS]
    return [*own, *words]


@contextmanager
def _beside(command: Sequence[str], ended: threading.Event) -> Iterator[None]:
    """Run a command beside what is done here; where one of both ends, so does the other.

    Raises:
        RobotError: it failed.
    """
    process, failed = subprocess.Popen(command), list[int]()

    def wait() -> None:
        process.wait()
        if not ended.is_set():
            failed.append(process.returncode)
            ended.set()

    watcher = threading.Thread(target=wait, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        process.terminate()
        watcher.join(PATIENCE)
    if any(failed):
        raise RobotError(f"the sensors ended with exit status {failed[0]}")
