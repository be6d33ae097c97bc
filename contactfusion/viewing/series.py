"""Draws time lines: how the sources do, how likely contacts are, what the controller does."""

from contactfusion.integrator.report import EventKind, SourceReport
from contactfusion.pipeline import Step
from contactfusion.viewing.colours import LINES
from contactfusion.viewing.library import entity, loaded_rerun
from contactfusion.viewing.recorder import Recorder

CALM = (EventKind.PLUGGED, EventKind.BACK)
"""Events that are no warnings."""

STATES = {"active": (45, 125, 80), "silent": (170, 60, 50), "not heard yet": (85, 85, 95)}
"""How a source does, and the colour of that."""


class Series:
    """The time lines of one recording."""

    def __init__(self) -> None:
        self._mode = ""
        self.sources: set[str] = set()
        """All that were ever heard of."""

    def draw(self, recorder: Recorder, step: Step) -> None:
        """Go on with all lines by one step."""
        contacts, stamp = step.fusion.contacts, step.stamp
        recorder.plot("contacts/count", stamp, len(contacts))
        recorder.plot("contacts/likelihood", stamp, contacts[0].likelihood if contacts else 0.0)
        for name, report in step.fusion.report.sources.items():
            share = contacts[0].shares.get(name, 0.0) if contacts else 0.0
            self._introduce(recorder, name)
            path = entity(*name.split("/"))
            recorder.plot(f"shares{path}", stamp, share)
            recorder.plot(f"rates{path}", stamp, report.rate)
            recorder.plot(f"ages{path}", stamp, report.age)
            recorder.enter(f"states{path}", stamp, _state(report))
        for event in step.events:
            level = "INFO" if event.kind in CALM else "WARN"
            recorder.say(entity("events", event.source), stamp, level, event.message)
        self._draw_mode(recorder, step)

    def _introduce(self, recorder: Recorder, name: str) -> None:
        """Give a source its colour in all plots, and the states that it can be in."""
        if name in self.sources:
            return
        colour = LINES[len(self.sources) % len(LINES)]
        self.sources.add(name)
        path = entity(*name.split("/"))
        for lines in ("shares", "rates", "ages"):
            look = loaded_rerun().SeriesLines(colors=colour, names=name)
            recorder.draw(f"{lines}{path}", None, look)
        colours = [(*colour, 255) for colour in STATES.values()]
        states = loaded_rerun().StateConfiguration(values=list(STATES), colors=colours)
        recorder.draw(f"states{path}", None, states)

    def _draw_mode(self, recorder: Recorder, step: Step) -> None:
        if step.command is None:
            return
        mode = step.command.mode or "no mode"
        recorder.enter("states/controller", step.stamp, mode)
        if mode != self._mode:
            self._mode = mode
            text = ": ".join(filter(None, (mode, step.command.reason)))
            recorder.say("events/controller", step.stamp, "INFO", text)


def _state(report: SourceReport) -> str:
    """Say in a word how a source does."""
    if not report.accepted:
        return "not heard yet"
    return "active" if report.active else "silent"
