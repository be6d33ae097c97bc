"""The step at a time of a recording, and what was before."""

from collections.abc import Iterable
from dataclasses import dataclass

from contactfusion.errors import TimeError
from contactfusion.explaining.past import SECONDS, Past
from contactfusion.pipeline import Step

CLOSE = 1e-6
"""Stamps that differ by less are one [s]."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A step, and the seconds before it, itself included."""

    step: Step
    past: Past


def moment_at(steps: Iterable[Step], time: float, reach: float, seconds: float = SECONDS) -> Moment:
    """Give the last step until a time; no step after it is asked for more than once.

    Args:
        steps: in order.
        time: [s].
        reach: contacts of two steps that lie so near together are one [m].
        seconds: how far back is remembered [s].

    Raises:
        TimeError: the time lies outside the steps, or there are none.
    """
    past, last, first = Past(reach, seconds), None, None
    for step in steps:
        first = step if first is None else first
        if step.stamp > time + CLOSE:
            break
        past.add(step.stamp, step.fusion)
        last = step
    else:
        if first is None or last is None:
            raise TimeError("the recording leads to no step, so there is nothing to explain")
        if not time <= last.stamp + CLOSE:
            raise TimeError(
                f"there is nothing at {time:.9g} s: the steps reach from {first.stamp:.9g} s "
                f"to {last.stamp:.9g} s"
            )
    if last is None:
        raise TimeError(
            f"there is nothing at {time:.9g} s: the first step comes at {first.stamp:.9g} s"
        )
    return Moment(last, past)
