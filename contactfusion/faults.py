"""Sensors that fail on purpose: a model for each kind of fault, and readings that pass them.

What a fault changes in a kind of reading is declared by the codec of the kind
(`readings/values.py`).
"""

import heapq
import itertools
import math
from abc import abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, final

import numpy as np
from pydantic import BeforeValidator, Field, NonNegativeInt, model_validator

from contactfusion.errors import ConfigurationError, InvalidReadingError, name_hint
from contactfusion.frames import Pose, pose_at
from contactfusion.model import Model
from contactfusion.readings import Reading, Transform
from contactfusion.readings.registry import installed_kinds
from contactfusion.readings.values import Change, Values
from contactfusion.stream import Arrival
from contactfusion.time import LONGEST_SECONDS, to_nanoseconds
from contactfusion.yaml_files import read_yaml

Vector = tuple[float, float, float]
Channel = tuple[str, ...]
"""Identity of what a sensor measures, also of one without a name: kind, sensor, frame, and the
names of joints, of a frame, or of an object."""
UNKNOWN: Values[Reading] = Values()


def _numbers(value: Any) -> Any:
    """Take one number or a list of them."""
    return value if isinstance(value, list | tuple) else (value,)


Amount = Annotated[tuple[float, ...], Field(min_length=1), BeforeValidator(_numbers)]


class Fault(Model):
    """How a sensor fails between two stamps; a subclass for each kind of failure."""

    sensor: str | None = None
    """The sensor that fails, by its name, or all of a type of reading such as `wrench`; None: all
    sensors."""
    start: float | None = None
    """The first stamp at which it fails [s]; None: from the beginning."""
    end: float | None = None
    """The last stamp at which it fails [s]; None: to the end."""
    change: ClassVar[Change | None] = None
    """How it changes values; None: independently of the kind of reading."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.start is not None and self.end is not None and self.end < self.start:
            raise ConfigurationError(f"it lies before the start, {self.start} s", "end")
        if codec := installed_kinds().find(self.sensor or ""):
            self.check(codec.kind, codec.kind.__name__)
        return self

    @property
    def late(self) -> float:
        """How late readings come [s]."""
        return 0.0

    def meets(self, sensor: str, kind: type[Reading]) -> bool:
        """Whether readings of a kind are of a sensor that fails, at whatever time."""
        if self.sensor is None or self.sensor == sensor:
            return True
        failing = installed_kinds().find(self.sensor)
        return failing is not None and issubclass(kind, failing.kind)

    def check(self, kind: type[Reading], label: str) -> None:
        """Refuse a kind of reading that cannot have this fault.

        Args:
            kind: the type of the reading.
            label: the name of the reading in a sentence.

        Raises:
            ConfigurationError: the fault makes no sense for it, or a parameter does not fit it.
        """
        why = _values(kind).senseless.get(self.change) if self.change else None
        if why:
            raise ConfigurationError(f"this fault makes no sense for {label}, {why}", "fault")

    @abstractmethod
    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading | None:
        """The reading that arrives while its sensor fails.

        Args:
            reading: that of the healthy sensor.
            held: its last reading before the start, or else the first one since.
            random: for this fault of this sensor alone.

        Returns:
            The changed reading; None: none arrives.
        """


class Silent(Fault):
    """Nothing comes any more."""

    fault: Literal["silent"] = "silent"

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> None:
        """Nothing."""


class Dropout(Fault):
    """Single readings are lost."""

    fault: Literal["dropout"] = "dropout"
    probability: float = Field(ge=0, le=1)
    """Of losing a reading."""

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading | None:
        """The reading, or None: it is lost."""
        return None if random.random() < self.probability else reading


class Delay(Fault):
    """Readings come late, with their old stamps."""

    fault: Literal["delay"] = "delay"
    seconds: float = Field(ge=0, le=LONGEST_SECONDS)
    """How late they come [s]; they wait for the next reading of any sensor from then on."""

    @property
    def late(self) -> float:
        """How late readings come [s]."""
        return self.seconds

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading:
        """The reading as it is."""
        return reading


class Calibration(Fault):
    """The sensor is mounted in another pose than it is believed to be."""

    fault: Literal["calibration"] = "calibration"
    mm: Vector = (0.0, 0.0, 0.0)
    """Its readings are shifted by so much in its frame [mm], after the rotation."""
    degrees: Vector = (0.0, 0.0, 0.0)
    """Its readings are rotated by roll, pitch and yaw about its frame's fixed axes [degrees]."""
    change: ClassVar[Change | None] = Change.MOVED

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not self.model_fields_set & {"mm", "degrees"}:
            raise ValueError("give mm, degrees, or both")
        return self

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading:
        """The reading, moved rigidly."""
        return _values(type(reading)).moved(reading, self.pose())

    def pose(self) -> Pose:
        """The move [m]."""
        x, y, z = self.mm
        roll, pitch, yaw = np.deg2rad(self.degrees)
        return pose_at((x / 1000.0, y / 1000.0, z / 1000.0), (roll, pitch, yaw))


class FaultOfValues(Fault):
    """A fault of the values of a sensor, or of some of its elements."""

    elements: tuple[NonNegativeInt, ...] | None = Field(default=None, min_length=1)
    """The taxels or joints that fail, counted from 0; None: all."""

    @model_validator(mode="after")
    def _once(self) -> Self:
        if self.elements is not None and len(set(self.elements)) < len(self.elements):
            raise ConfigurationError("an element stands here twice", "elements")
        return self

    def check(self, kind: type[Reading], label: str) -> None:
        """Refuse a kind of reading that cannot have this fault."""
        super().check(kind, label)
        if self.elements is not None and not _values(kind).has_elements:
            codecs = installed_kinds().all()
            having = ", ".join(codec.kind.__name__ for codec in codecs if codec.values.has_elements)
            raise ConfigurationError(f"{label} has none; those that do: {having}", "elements")


class Zeros(FaultOfValues):
    """The values are zero."""

    fault: Literal["zeros"] = "zeros"
    change: ClassVar[Change | None] = Change.ZEROED

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading:
        """Zeros."""
        values = _values(type(reading))
        return values.repeated(reading, values.zeroed(reading), self.elements)


class Stuck(FaultOfValues):
    """The values stay what they were before the start, or else at the first reading."""

    fault: Literal["stuck"] = "stuck"

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading:
        """The old values with the new stamp."""
        return _values(type(reading)).repeated(reading, held, self.elements)


class Offset(FaultOfValues):
    """A fault that adds to the values."""

    amount: Amount
    """One number, or one for each value, in the units of the reading."""
    change: ClassVar[Change | None] = Change.ADDED

    def check(self, kind: type[Reading], label: str) -> None:
        """Refuse a kind of reading that cannot have this fault."""
        super().check(kind, label)
        _values(kind).check_amount(self.amount, label)


class Bias(Offset):
    """`amount` is added to the values."""

    fault: Literal["bias"] = "bias"

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading:
        """The reading with the bias."""
        values = _values(type(reading))
        return values.added(reading, values.changes(reading, self.amount, self.elements))


class Drift(Offset):
    """A bias that grows by `amount` in each second since the start, or else the first reading."""

    fault: Literal["drift"] = "drift"

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading:
        """The reading with what has accumulated."""
        passed = reading.stamp - (held.stamp if self.start is None else self.start)
        values = _values(type(reading))
        return values.added(reading, passed * values.changes(reading, self.amount, self.elements))


class Noise(Offset):
    """Gaussian noise with the standard deviation `amount`, independent from value to value."""

    fault: Literal["noise"] = "noise"

    @model_validator(mode="after")
    def _not_negative(self) -> Self:
        if min(self.amount) < 0.0:
            raise ConfigurationError("a standard deviation is not negative", "amount")
        return self

    def act(self, reading: Reading, held: Reading, random: np.random.Generator) -> Reading:
        """The reading with noise."""
        values = _values(type(reading))
        deviations = values.changes(reading, self.amount, self.elements)
        return values.added(reading, deviations * random.standard_normal(deviations.shape))


FAULTS: dict[str, type[Fault]] = {
    "silent": Silent,
    "zeros": Zeros,
    "stuck": Stuck,
    "dropout": Dropout,
    "delay": Delay,
    "bias": Bias,
    "drift": Drift,
    "noise": Noise,
    "calibration": Calibration,
}
"""The faults by the names that configurations use."""


def _chosen(value: Any) -> Any:
    """Build the fault of a name; the errors of pydantic's own choice would not name the nearest."""
    if isinstance(value, Fault):
        return value
    if not isinstance(value, Mapping):
        raise ConfigurationError(f"{value!r} is no fault; write it as {{fault: silent, sensor: …}}")
    name = value.get("fault")
    model = FAULTS.get(str(name))
    if model is None:
        wrong = "this field is required" if name is None else f"unknown fault '{name}'"
        raise ConfigurationError(
            f"{wrong}; {name_hint(str(name or ''), FAULTS, 'faults')}", "fault"
        )
    unknown = next((field for field in value if field not in model.model_fields), None)
    if unknown is not None:
        hint = name_hint(unknown, model.model_fields, f"fields of '{name}'")
        raise ConfigurationError(f"unknown field; {hint}", unknown)
    return model(**value)


FaultConfig = Annotated[
    Silent | Zeros | Stuck | Dropout | Delay | Bias | Drift | Noise | Calibration,
    BeforeValidator(_chosen),
]
"""Any fault, by the name in its field `fault`."""


class FaultFile(Model):
    """A file of faults."""

    faults: tuple[FaultConfig, ...]
    """In the order in which they act."""


def read_faults(path: str | Path) -> tuple[Fault, ...]:
    """Read faults from a YAML file of their own, a mapping with the one key `faults`.

    Raises:
        ConfigurationError: the file is missing, or holds something else; one sentence.
    """
    fields = read_yaml(path)
    try:
        return FaultFile(**fields).faults
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None


@final
class Faults:
    """Applies faults to readings, one after the other in their order.

    Each fault keeps a state and a random generator for each sensor, so that the readings of a
    sensor do not depend on the others: only the time at which a delayed one is released does.

    Args:
        faults: what fails.
        seed: the same seed gives the same faults.
    """

    def __init__(self, faults: Iterable[Fault], seed: int = 0) -> None:
        self._faults = tuple(faults)
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Forget all readings, and start randomness again."""
        self._now = -math.inf
        self._count = 0
        self._held: dict[tuple[int, Channel], Reading] = {}
        self._random: dict[tuple[int, Channel], np.random.Generator] = {}
        self._waiting: list[list[tuple[int, int, Reading]]] = [[] for _ in self._faults]

    def apply(self, reading: Reading) -> Sequence[Reading]:
        """The readings that arrive when a healthy sensor has given one.

        Args:
            reading: the newest reading of any sensor.

        Returns:
            Delayed readings whose time has come, and what the faults leave of this one.

        Raises:
            ConfigurationError: a fault makes no sense for the reading.
            PluginError: the plug-in of its kind fails.
        """
        if not self._faults:
            return (reading,)
        if not isinstance(reading, Transform):  # which comes ahead of what it places
            self._now = max(self._now, to_nanoseconds(reading.stamp))
        readings = [reading]
        for number in range(len(self._faults)):
            passed = [self._passed(number, arrived) for arrived in readings]
            readings = self._released(number) + [left for left in passed if left is not None]
        return readings

    def _passed(self, number: int, reading: Reading) -> Reading | None:
        """The reading that arrives at once; None: it is lost, or waits."""
        fault = self._faults[number]
        if not fault.meets(reading.sensor, type(reading)) or (
            fault.end is not None and reading.stamp > fault.end
        ):
            return reading
        key = (number, _channel(reading))
        if fault.start is not None and reading.stamp < fault.start:
            self._held[key] = reading
            return reading
        held = self._held.setdefault(key, reading)
        try:
            with _guard(type(reading)):
                fault.check(type(reading), reading.label)
                changed = fault.act(reading, held, self._generator(key))
        except ConfigurationError as error:
            raise error.under(f"faults.{number}") from None
        except InvalidReadingError as error:
            raise ConfigurationError(
                f"what it makes is no reading: {error}", f"faults.{number}"
            ) from None
        if changed is None or not fault.late:
            return changed
        due = to_nanoseconds(reading.stamp) + to_nanoseconds(fault.late)
        self._count += 1
        heapq.heappush(self._waiting[number], (due, self._count, changed))
        return None

    def _released(self, number: int) -> list[Reading]:
        """The readings that have waited long enough, in the order in which they were due."""
        waiting, released = self._waiting[number], []
        while waiting and waiting[0][0] <= self._now:
            released.append(heapq.heappop(waiting)[2])
        return released

    def _generator(self, key: tuple[int, Channel]) -> np.random.Generator:
        if key not in self._random:
            number, channel = key
            entropy = [self._seed, number, *"\n".join(channel).encode()]
            self._random[key] = np.random.default_rng(entropy)
        return self._random[key]


def broken(
    arrivals: Iterable[Arrival], faults: Sequence[Fault], seed: int = 0
) -> Iterator[Arrival]:
    """What faults leave of a stream.

    Args:
        arrivals: of a healthy stream.
        faults: what fails.
        seed: the same seed gives the same faults.

    Raises:
        ConfigurationError: a fault makes no sense for a reading.
    """
    through = Faults(faults, seed)
    for arrival in arrivals:
        left = itertools.chain.from_iterable(map(through.apply, arrival.readings))
        yield replace(arrival, readings=tuple(left))


def unmet(
    faults: Iterable[Fault], received: Collection[tuple[str, type[Reading]]]
) -> Iterator[str]:
    """A sentence for each fault of a sensor that does not exist.

    Args:
        faults: in their order.
        received: the sensor and the type of each reading that came, before any faults.
    """
    types = {kind for _, kind in received}
    for row, fault in enumerate(faults):
        if fault.sensor is None:
            continue
        if not any(fault.meets(sensor, kind) for sensor, kind in received):
            known = {sensor for sensor, _ in received if sensor}
            known |= installed_kinds().among(types)
            hint = name_hint(str(fault.sensor), known, "sensors and types")
            yield f"faults.{row}.sensor: no reading of '{fault.sensor}' came; {hint}"


def _values(kind: type[Reading]) -> Values[Reading]:
    """What faults can change in a kind of reading; nothing in one that no codec knows."""
    codec = installed_kinds().of(kind)
    return codec.values if codec else UNKNOWN


def _guard(kind: type[Reading]) -> AbstractContextManager[None]:
    codec = installed_kinds().of(kind)
    return installed_kinds().guard(codec) if codec else nullcontext()


def _channel(reading: Reading) -> Channel:
    codec = installed_kinds().of(type(reading))
    with _guard(type(reading)):
        whose = codec.whose(reading) if codec else ()
    return type(reading).__name__, reading.sensor, reading.frame, *whose
