"""Small generators and controllers for the tests; this module is a plug-in that offers them."""

import gc
import os
import signal
import struct
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import EntryPoint
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.controller import Command, Controller
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import GROUP, hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.plugins import Plugins
from contactfusion.readings import DepthImage, ObjectPose, PointCloud, Reading, Wrench
from contactfusion.state import State

if TYPE_CHECKING:  # a process of a generator's own waits for no pytest
    import pytest

FUSION = [
    EntryPoint(name, f"contactfusion.integrator.{name}", GROUP)
    for name in ("rules", "condensations")
]
"""The entry points of the built-in rules and condensations."""


def offer_toys(monkeypatch: "pytest.MonkeyPatch") -> None:
    """Let pipelines find the toys, and no other generator or controller."""
    toys = Plugins(points=[EntryPoint("toys", __name__, GROUP), *FUSION], strict=True)
    monkeypatch.setattr("contactfusion.assembly.installed_plugins", lambda: toys)


def point(stamp: float, *place: float, frame: str = "base", sensor: str = "") -> PointCloud:
    """A reading of one point."""
    return PointCloud(stamp=stamp, frame=frame, sensor=sensor, points=np.array([place]))


def wrench(stamp: float, *force: float, frame: str = "base", sensor: str = "") -> Wrench:
    """A reading of a force."""
    return Wrench(
        stamp=stamp, frame=frame, sensor=sensor, force=np.array(force), torque=np.zeros(3)
    )


class Echo(Generator[GeneratorConfig]):
    """Every point is a hypothesis; it remembers the states that it was given."""

    readings = (PointCloud,)

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        super().__init__(name, config)
        self.states: list[State] = []

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        assert isinstance(reading, PointCloud)
        self.states.append(state)
        forces = np.tile([0.0, 0.0, 1.0], (len(reading.points), 1))
        return (self.cloud(reading, reading.points, 0.9, forces=forces),)

    def reset(self) -> None:
        self.states.clear()


class Looker(Generator[GeneratorConfig]):
    """Takes images, and sees nothing in them."""

    readings = (DepthImage,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        return ()


class Follower(Generator[GeneratorConfig]):
    """Takes poses of objects, and finds no contact."""

    readings = (ObjectPose,)
    outputs: Mapping[str, HypothesisKind] = {"": HypothesisKind.SUPPORT}

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        return ()


class Feeler(Generator[GeneratorConfig]):
    """Takes the force [N] for a place [m]."""

    readings = (Wrench,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        assert isinstance(reading, Wrench)
        return (self.cloud(reading, reading.force, 0.8),)


class NaughtyConfig(GeneratorConfig):
    """How it misbehaves."""

    how: str
    """The key of its sin."""


class Naughty(Generator[NaughtyConfig]):
    """Breaks one rule of the contract, beside the place of its reading."""

    Config = NaughtyConfig
    readings = (PointCloud,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        assert isinstance(reading, PointCloud)
        sins: dict[str, Callable[[PointCloud], object]] = {
            "raises": _raise,
            "exits": lambda reading: sys.exit("that is all"),
            "NaN": lambda reading: [self.cloud(reading, [np.nan, 0.0, 0.0], 0.9)],
            "wrong shape": lambda reading: [self._cloud(reading, positions=np.zeros((1, 2)))],
            "wrong frame": lambda reading: [self.cloud(reading, reading.points, 1, frame="moon")],
            "p > 1": lambda reading: [self.cloud(reading, reading.points, 1.5)],
            "nothing": lambda reading: None,
            "an iterator": lambda reading: iter([self.cloud(reading, reading.points, 1.0)]),
            "no cloud": lambda reading: [7],
            "foreign source": lambda reading: [self._cloud(reading, source="healthy")],
            "unknown kind": lambda reading: [self._cloud(reading, kind="rumour")],
            "other kind": lambda reading: [self._cloud(reading, kind=HypothesisKind.NULL)],
            "out of reach": lambda reading: [self.cloud(reading, [1e9, 0.0, 0.0], 1.0)],
        }
        return cast(Sequence[HypothesisCloud], sins[self.config.how](reading))

    def _cloud(self, reading: PointCloud, **other: Any) -> HypothesisCloud:
        fields: dict[str, Any] = {
            "source": self.name,
            "kind": HypothesisKind.REGULAR,
            "stamp": reading.stamp,
            "frame": reading.frame,
            "positions": reading.points,
            "likelihoods": np.ones(1),
        }
        return HypothesisCloud(**{**fields, **other})


def _raise(reading: PointCloud) -> None:
    raise RuntimeError("out of order")


class Slow(Generator[GeneratorConfig]):
    """Takes as long as the first coordinate of its reading says, by the clock that it is lent."""

    readings = (PointCloud,)
    pass_time: Callable[[float], None]

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        assert isinstance(reading, PointCloud)
        self.pass_time(float(reading.points[0, 0]))
        return ()


class Remote(Generator[GeneratorConfig]):
    """Does what the name of the sensor says; its note tells what it knows of the last step."""

    readings = (PointCloud,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        assert isinstance(reading, PointCloud)
        match reading.sensor:
            case "sleep":
                time.sleep(2.0)
            case "hang":
                time.sleep(600.0)
            case "raise":
                raise RuntimeError("out of order")
            case "exit":
                sys.exit("that is all")
            case "numbers":
                return cast(Sequence[HypothesisCloud], [7])
            case "die":
                os._exit(3)
            case "half":
                _answer_half()
            case "stop":
                os.kill(os.getpid(), signal.SIGSTOP)
        known = f"{len(state.contacts)} contacts, {len(state.evidence(without=self.name))} places"
        return (self.cloud(reading, reading.points, 0.9, notes=(known,)),)


def _answer_half() -> None:
    """Begin an answer of the process, and never end it."""
    (pipe,) = (one for one in gc.get_objects() if isinstance(one, Connection) and not one.closed)
    os.write(pipe.fileno(), struct.pack("!i", 1 << 20) + b"the beginning")
    time.sleep(600.0)


class Tallying(Echo):
    """Says which readings it absorbed before each that it answers."""

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        super().__init__(name, config)
        self.absorbed: list[float] = []

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        time.sleep(0.3)
        (cloud,) = super().generate(reading, state)
        notes, self.absorbed = tuple(map(str, self.absorbed)), []
        return (replace(cloud, notes=notes),)

    def absorb(self, reading: Reading, state: State) -> None:
        if reading.sensor == "raise":
            raise RuntimeError("out of order")
        self.absorbed.append(reading.stamp)

    @property
    def waits_for(self) -> str:
        return f"more than {len(self.states)} readings"


class Worn(Echo):
    """Can be neither prepared nor reset."""

    def prepare(self, robot: object) -> None:
        raise RuntimeError("cannot be prepared")

    def reset(self) -> None:
        raise RuntimeError("cannot be reset")


class Forceful(Generator[GeneratorConfig]):
    """Writes to its reading, or to the array beneath it, whatever its flags say."""

    readings = (Wrench,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        assert isinstance(reading, Wrench)
        array = reading.force if reading.sensor == "" else cast(Any, reading.force.base)
        array.flags.writeable = True
        array[:] = 9.0
        return ()


class Unpicklable(Echo):
    """Holds what cannot travel."""

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        super().__init__(name, config)
        self.hook = lambda: None


class PilotConfig(GeneratorConfig):
    """How it steers."""

    how: Literal["well", "raises", "exits", "nothing"] = "well"
    """What it does."""


class Pilot(Controller):
    """Says how many contacts it sees."""

    Config = PilotConfig

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.steps = 0

    def command(self, contacts: Sequence[Contact], state: State) -> Command:
        how = cast(PilotConfig, self.config).how
        if how == "raises":
            raise RuntimeError("out of order")
        if how == "exits":
            sys.exit("that is all")
        self.steps += 1
        told = Command(mode=f"step {self.steps}", reason=f"{len(contacts)} contacts")
        return told if how == "well" else cast(Command, None)

    def reset(self) -> None:
        self.steps = 0


@hookimpl
def contactfusion_generators() -> Mapping[str, Any]:
    kinds = (
        Echo,
        Looker,
        Follower,
        Feeler,
        Naughty,
        Slow,
        Remote,
        Tallying,
        Worn,
        Forceful,
        Unpicklable,
    )
    return {"stranger": int, **{kind.__name__.lower(): kind for kind in kinds}}


@hookimpl
def contactfusion_controllers() -> Mapping[str, type[Controller]]:
    return {"pilot": Pilot}
