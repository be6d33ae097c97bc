"""Sensors that fail on purpose: readings pass through faults before anybody hears of them."""

import heapq
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import final

import numpy as np

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.fault_config import Fault, read_faults
from contactfusion.readings import (
    READING_TYPES,
    JointCommand,
    JointState,
    ObjectPose,
    Odometry,
    Reading,
    Transform,
)
from contactfusion.time import to_nanoseconds

__all__ = ["Faults", "read_faults", "unmet"]

Stream = tuple[str, ...]
"""What tells the readings of one sensor from those of others, also where sensors have no name."""


@final
class Faults:
    """Lets readings through faults, one after the other in their order.

    Each fault remembers each sensor apart, with randomness of its own, so that what comes of one
    sensor does not depend on the others: only when a delayed reading is released does.

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
        self._held: dict[tuple[int, Stream], Reading] = {}
        self._random: dict[tuple[int, Stream], np.random.Generator] = {}
        self._waiting: list[list[tuple[int, int, Reading]]] = [[] for _ in self._faults]

    def apply(self, reading: Reading) -> Sequence[Reading]:
        """Give what comes when a healthy sensor has given a reading.

        Args:
            reading: the newest reading of any sensor.

        Returns:
            Delayed readings whose time has come, and what the faults leave of this one.

        Raises:
            ConfigurationError: a fault makes no sense for the reading.
        """
        if not self._faults:
            return (reading,)
        self._now = max(self._now, to_nanoseconds(reading.stamp))
        readings = [reading]
        for number in range(len(self._faults)):
            passed = [self._passed(number, one) for one in readings]
            readings = self._released(number) + [one for one in passed if one is not None]
        return readings

    def _passed(self, number: int, reading: Reading) -> Reading | None:
        """Give what comes at once of a reading; None: it is lost, or waits."""
        fault = self._faults[number]
        if not fault.meets(reading.sensor, type(reading)) or (
            fault.end is not None and reading.stamp > fault.end
        ):
            return reading
        key = (number, _stream(reading))
        if fault.start is not None and reading.stamp < fault.start:
            self._held[key] = reading
            return reading
        held = self._held.setdefault(key, reading)
        try:
            fault.check(type(reading), reading.label)
            changed = fault.act(reading, held, self._generator(key))
        except ConfigurationError as error:
            raise error.under(f"faults.{number}") from None
        if changed is None or not fault.late:
            return changed
        due = to_nanoseconds(reading.stamp) + to_nanoseconds(fault.late)
        self._count += 1
        heapq.heappush(self._waiting[number], (due, self._count, changed))
        return None

    def _released(self, number: int) -> list[Reading]:
        """Give the readings that have waited long enough, in the order in which they were due."""
        waiting, released = self._waiting[number], []
        while waiting and waiting[0][0] <= self._now:
            released.append(heapq.heappop(waiting)[2])
        return released

    def _generator(self, key: tuple[int, Stream]) -> np.random.Generator:
        if key not in self._random:
            number, stream = key
            entropy = [self._seed, number, *"\n".join(stream).encode()]
            self._random[key] = np.random.default_rng(entropy)
        return self._random[key]


def unmet(faults: Iterable[Fault], heard: Collection[tuple[str, type[Reading]]]) -> Iterator[str]:
    """Report the faults of sensors that there are not.

    Args:
        faults: in their order.
        heard: the sensor and the type of each reading that came, before any faults.
    """
    types = {kind for _, kind in heard}
    for row, fault in enumerate(faults):
        if not any(fault.meets(*one) for one in heard):
            known = {sensor for sensor, _ in heard if sensor}
            known |= {name for name, kind in READING_TYPES.items() if kind in types}
            hint = name_hint(str(fault.sensor), known, "sensors and types")
            yield f"faults.{row}.sensor: no reading of '{fault.sensor}' came; {hint}"


def _stream(reading: Reading) -> Stream:
    match reading:
        case JointState() | JointCommand():
            whose = reading.names
        case Odometry() | Transform():
            whose = (reading.child_frame,)
        case ObjectPose():
            whose = (reading.name,)
        case _:
            whose = ()
    return type(reading).__name__, reading.sensor, reading.frame, *whose
