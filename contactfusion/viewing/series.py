"""Draws time lines: how the sources do, how likely contacts are, what the controller does."""

from collections.abc import Mapping
from itertools import cycle
from typing import Any

from contactfusion.controller import Command
from contactfusion.integrator.sources import EventKind, SourceReport
from contactfusion.pipeline import Step
from contactfusion.viewing.colours import CONTACT, LINES, Colour
from contactfusion.viewing.library import entity, loaded_rerun
from contactfusion.viewing.recorder import Recorder

CALM = (EventKind.PLUGGED, EventKind.BACK)
"""Events that are no warnings."""

STATES = {"active": (45, 125, 80), "silent": (170, 60, 50), "not heard yet": (85, 85, 95)}
"""How a source does, and the colour of that."""
MODES = ((40, 105, 160), (150, 100, 20), (110, 75, 165), (20, 120, 115), (150, 65, 115))
"""The colours of what a controller does, in the order in which it is done first."""


class Series:
    """The time lines of one recording.

    Args:
        recorder: to draw with.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._mode = ""
        self._modes: list[str] = []
        self.sources: set[str] = set()
        """All that were ever heard of."""
        recorder.draw("contacts/count", None, _line(CONTACT, "how many"))
        recorder.draw("contacts/likelihood", None, _line(CONTACT, "likelihood"))

    def draw(self, step: Step) -> None:
        """Go on with all lines by one step."""
        contacts, stamp, recorder = step.fusion.contacts, step.stamp, self._recorder
        recorder.plot("contacts/count", stamp, len(contacts))
        recorder.plot("contacts/likelihood", stamp, contacts[0].likelihood if contacts else 0.0)
        for name, report in step.fusion.report.sources.items():
            share = contacts[0].shares.get(name, 0.0) if contacts else 0.0
            self._introduce(name)
            path = entity(*name.split("/"))
            recorder.plot(f"shares{path}", stamp, share)
            recorder.plot(f"rates{path}", stamp, report.rate)
            recorder.plot(f"ages{path}", stamp, report.age)
            recorder.enter(f"states{path}", stamp, _state(report))
        for event in step.events:
            level = "INFO" if event.kind in CALM else "WARN"
            recorder.say(entity("events", event.source), stamp, level, event.message)
        if step.command is not None:
            self._draw_mode(step.command, stamp)

    def _introduce(self, name: str) -> None:
        """Give a source its colour in all plots, and the states that it can be in."""
        if name in self.sources:
            return
        colour = LINES[len(self.sources) % len(LINES)]
        self.sources.add(name)
        path = entity(*name.split("/"))
        for lines in ("shares", "rates", "ages"):
            self._recorder.draw(f"{lines}{path}", None, _line(colour, name))
        self._recorder.draw(f"states{path}", None, _states(STATES))

    def _draw_mode(self, command: Command, stamp: float) -> None:
        mode = command.mode or "no mode"
        if mode not in self._modes:
            self._modes.append(mode)
            colours = dict(zip(self._modes, cycle(MODES), strict=False))
            self._recorder.draw("states/controller", None, _states(colours))
        self._recorder.enter("states/controller", stamp, mode)
        if mode != self._mode:
            self._mode = mode
            text = ": ".join(filter(None, (mode, command.reason)))
            self._recorder.say("events/controller", stamp, "INFO", text)


def _states(colours: Mapping[str, Colour]) -> Any:
    """Say what states there are, and their colours."""
    opaque = [(*colour, 255) for colour in colours.values()]
    return loaded_rerun().StateConfiguration(values=list(colours), colors=opaque)


def _line(colour: Colour, name: str) -> Any:
    """Draw what stays until the next step says otherwise."""
    return loaded_rerun().SeriesLines(colors=colour, names=name, interpolation_mode="StepAfter")


def _state(report: SourceReport) -> str:
    """Say in a word how a source does."""
    if not report.accepted:
        return "not heard yet"
    return "active" if report.active else "silent"
