"""The state of a running pipeline, as diagnostics, `ctl status` and the page show it."""

import math
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.changes import tares
from contactfusion.integrator.sources import EventKind, SourceReport
from contactfusion.live.stream import LiveStream
from contactfusion.pipeline import Pipeline, Step, takes

SHOWN = 0.2
"""The least time between two updates of the robot's surface [s]."""
REMEMBERED = 5.0
"""So long a refusal or a disagreement marks its source [s]."""
EVENTS = 50
"""Number of newest events that are kept."""
STEPS = 256
"""Number of newest steps over which their rate is measured."""
POINTS = 4000
"""The most points of the robot's surface that are shown."""


@final
class Status:
    """Collects what was last found, and how sources and loop do.

    Args:
        name: of the configuration.
        pipeline: which listens.
        stream: its topics.
    """

    def __init__(self, name: str, pipeline: Pipeline, stream: LiveStream) -> None:
        self._name, self._pipeline, self._stream = name, pipeline, stream
        self._step: Step | None = None
        self._marks: dict[str, tuple[float, str, str]] = {}
        """By source when it was last refused or disagreed, which, and why."""
        self._events = deque[dict[str, Any]](maxlen=EVENTS)
        self._stepped = deque[float](maxlen=STEPS)
        self._drawn = -math.inf
        self.surface: tuple[int, FloatArray] = 0, np.empty((0, 3))
        """A version, and points of the robot's surface, shape (n, 3) [m], at most 4,000."""
        self.snapshot: dict[str, Any] = {}
        """What `fields` gave last, for other threads."""
        self.sent: Mapping[str, int] = {}
        """Number of messages of results by topic."""
        self.stopped = ""
        """Why commands are zero; empty where they are not."""
        self.recording = ""
        """The file that is recorded to; empty: none."""

    def step(self, step: Step) -> None:
        """Take note of a step."""
        self._step = step
        self._stepped.append(time.monotonic())
        for event in step.events:
            if event.kind in (EventKind.REFUSED, EventKind.DISAGREES):
                self._marks[event.source] = step.stamp, str(event.kind), event.message

    def event(self, level: str, text: str) -> None:
        """Take note of an event: its level, info, warning or error, and a sentence."""
        self._events.append({"time": round(self._stream.now(), 3), "text": text, "level": level})

    def draw(self) -> None:
        """Take note of the robot's surface, right after a step."""
        now = time.monotonic()
        if self._step is None or now - self._drawn < SHOWN:
            return
        self._drawn = now
        surface = self._pipeline.state(self._step.stamp).surface
        if surface is not None:
            version, known = self.surface
            points = surface.points[:: max(1, math.ceil(len(surface.points) / POINTS))]
            if not np.array_equal(points, known):
                self.surface = version + 1, points

    def fields(self) -> dict[str, Any]:
        """All of it, as JSON can hold it, from the thread of the loop."""
        now = self._stream.now()
        step = self._step
        contacts = () if step is None or self.stopped else step.fusion.contacts
        reports = {} if step is None else step.fusion.report.sources
        self.snapshot = {
            "now": round(now, 3),
            "configuration": self._name,
            "stopped": self.stopped,
            "cycle": self._cycle(),
            "recording": self.recording,
            "controller": "" if step is None or step.command is None else step.command.mode,
            "frame": self._pipeline.grid.frame,
            "contacts": [
                {
                    "track": contact.track,
                    "position": contact.position.tolist(),
                    "probability": float(contact.likelihood),
                    "force": contact.force.tolist() if np.isfinite(contact.force).all() else None,
                    "since": None if math.isnan(contact.since) else contact.since,
                    "sources": dict(contact.shares),
                }
                for contact in contacts
            ],
            "sources": [self._source(name, report, now) for name, report in reports.items()],
            "topics": [
                {
                    "topic": topic,
                    "messages": state.tally.messages,
                    "dropped": self._stream.queue.dropped[topic],
                }
                for topic, state in self._stream.states.items()
            ],
            "sent": dict(self.sent),
            "events": list(self._events),
            "surface": self.surface[0],
        }
        return self.snapshot

    def diagnostics(self) -> list[tuple[str, int, str, dict[str, str]]]:
        """Name, level, sentence and values of the loop and of each source."""
        fields = self.fields()
        cycle = fields["cycle"]
        states = [
            (
                "cycle",
                2 if self.stopped else 0,
                self.stopped or f"{cycle['rate']:.1f} steps a second",
                {name: f"{value:.4g}" for name, value in cycle.items()},
            )
        ]
        levels = {"ok": 0, "waiting": 1, "refused": 1, "disagrees": 1, "silent": 3}
        for source in fields["sources"]:
            values = {name: str(source[name]) for name in ("kind", "topic", "rate", "age", "share")}
            text = source["reason"] or source["health"]
            states.append((source["name"], levels[source["health"]], text, values))
        for trouble in self._stream.troubles():
            states.append((f"/{trouble.sensor}", 1, trouble.note, {}))
        return states

    def _cycle(self) -> dict[str, float]:
        span = self._stepped[-1] - self._stepped[0] if len(self._stepped) > 1 else 0.0
        took = np.array(self._stream.took or [0.0])
        return {
            "rate": round((len(self._stepped) - 1) / span, 2) if span else 0.0,
            "took": round(float(np.median(took)), 6),
            "slowest": round(float(np.quantile(took, 0.99)), 6),
            "overruns": self._stream.overruns,
        }

    def _source(self, name: str, report: SourceReport, now: float) -> dict[str, Any]:
        generator = self._pipeline.generators.get(name.partition("/")[0])
        shares = [c.shares.get(name, 0.0) for c in self._step.fusion.contacts] if self._step else []
        health, reason = "ok", ""
        mark = self._marks.get(name)
        if math.isnan(report.age):
            waits = self._pipeline.waits_for(generator.name) if generator is not None else ""
            health, reason = "waiting", waits or "nothing has come yet"
        elif not report.active:
            health, reason = "silent", f"nothing for {report.age:.2f} s"
        elif report.notes:
            reason = "; ".join(report.notes)
        if mark is not None and now - mark[0] < REMEMBERED:
            _, health, reason = mark
        topics = [
            topic
            for topic, state in self._stream.states.items()
            if generator is not None
            and state.listener.kind is not None
            and takes(generator, self._sensor(topic), state.listener.kind)
        ]
        return {
            "name": name,
            "kind": str(report.kind),
            "topic": ", ".join(topics),
            "rate": 0.0 if math.isnan(report.rate) else round(report.rate, 2),
            "age": None if math.isnan(report.age) else round(report.age, 3),
            "share": round(float(np.mean(shares)), 3) if shares else 0.0,
            "health": health,
            "reason": reason,
            "tares": generator is not None and tares(generator),
        }

    def _sensor(self, topic: str) -> str:
        return next((s for s, names in self._stream.sensors.items() if topic in names), "")
