"""The result of the push: the numbers of summary.json, and an explanation in sentences."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from contactfusion_lab.demo.scene import Moment, sources_of
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import Ending

NAMES = {"skin": "the skin", "lidar": "the LiDAR", "motion": "the base's own motion"}
"""Names of the sources in sentences."""


@dataclass(frozen=True, eq=False)
class Story:
    """The data of the demo.

    Attributes:
        fields: of the scene.
        moments: of the push.
        alone: moments of the same push with the skin as the only sensor.
    """

    fields: Mapping[str, Any]
    moments: Sequence[Moment]
    alone: Sequence[Moment]

    @property
    def push(self) -> PushConfig:
        """The push: object, start and target."""
        return PushConfig(**self.fields["scene"])

    @property
    def dies(self) -> float:
        """Time at which the skin falls silent [s]."""
        return float(self.fields["faults"][0]["start"])

    @property
    def last(self) -> Moment:
        """The last moment."""
        return self.moments[-1]

    @property
    def arrived(self) -> bool:
        """Whether arrival was declared, and the true contact is within the target."""
        return self.last.ending == Ending.ARRIVED and (self.last.truth.distance <= self.push.within)

    @property
    def sources(self) -> list[str]:
        """Sources with a share in contacts: evidence before support, larger shares first."""
        report = self.last.fusion.report.sources
        return sorted(
            sources_of(self.last),
            key=lambda name: (report[name].kind, -self.share(name, True)),
        )

    def part(self, before: bool) -> list[Moment]:
        """The moments before the skin's death, or those after its last hypotheses have expired."""
        timeout = float(self.fields["integrator"]["timeout"])
        if before:
            return [moment for moment in self.moments if moment.stamp < self.dies]
        return [moment for moment in self.moments if moment.stamp >= self.dies + timeout]

    def share(self, source: str, before: bool) -> float:
        """The mean share of a source in the contact, before or after the skin's death."""
        shares = [moment.shares.get(source, 0.0) for moment in self.part(before) if moment.contact]
        return float(np.mean(shares)) if shares else 0.0

    def error(self, before: bool) -> float:
        """Root mean square error of the contact's lateral position on the face [m]."""
        errors = [
            moment.touch.lateral - moment.truth.contact[1]
            for moment in self.part(before)
            if moment.touch and moment.truth.kind != "none"
        ]
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan

    def unfelt(self) -> float:
        """Time without a believed contact after the skin's death [s]."""
        period = self.moments[1].stamp - self.moments[0].stamp
        return period * sum(
            moment.touch is None for moment in self.moments if moment.stamp >= self.dies
        )

    def at(self, stamp: float) -> Moment:
        """The moment with a contact that is nearest to a stamp [s]."""
        touching = [moment for moment in self.moments if moment.contact] or self.moments
        return min(touching, key=lambda moment: abs(moment.stamp - stamp))


def summary(story: Story) -> dict[str, Any]:
    """The result of the push as fields of summary.json [m, s]; deterministic."""
    last, alone = story.last, story.alone[-1]
    parts = {"before": True, "after": False}
    return {
        "ending": str(last.ending),
        "time": _rounded(last.stamp),
        "success_true": story.arrived,
        "success_estimate": last.ending == Ending.ARRIVED,
        "distance_true": _rounded(last.truth.distance),
        "distance_estimate": _rounded(last.left),
        "within": story.push.within,
        "target": list(story.push.target),
        "skin_dies": story.dies,
        "without_contact_after": _rounded(story.unfelt()),
        "shares": {
            when: {name: _rounded(story.share(name, before)) for name in story.sources}
            for when, before in parts.items()
        },
        "lateral_error": {when: _rounded(story.error(before)) for when, before in parts.items()},
        "skin_alone": {
            "ending": str(alone.ending),
            "time": _rounded(alone.stamp),
            "distance_true": _rounded(alone.truth.distance),
        },
    }


def sentences(story: Story) -> list[str]:
    """Explanation of the push, in sentences."""
    touching = [moment for moment in story.part(True) if moment.truth.kind != "none"]
    left = f", {touching[-1].truth.distance:.2f} m from the target" if touching else ""
    lines = [
        f"Until {story.dies:.1f} s the contact was reported by {_felt(story, True)}, and its place "
        f"along the robot's front was known to {story.error(True) * 100.0:.1f} cm (root mean "
        "square).",
        f"Then the skin fell silent{left}.",
    ]
    if len(story.part(False)):
        unfelt = story.unfelt()
        lost = f"it was lost for {unfelt:.1f} s in all" if unfelt else "it was never lost"
        lines.append(
            f"From then on the contact was reported by {_felt(story, False)}, to "
            f"{story.error(False) * 100.0:.1f} cm; {lost}."
        )
    return [*lines, _end(story), _alone(story)]


def _end(story: Story) -> str:
    last = story.last
    if last.ending != Ending.ARRIVED:
        return f"The base did not arrive: {last.ending} after {last.stamp:.1f} s."
    return (
        f"The base arrived after {last.stamp:.1f} s with the contact "
        f"{last.truth.distance * 100.0:.1f} cm from the target; the robot itself believed "
        f"{last.left * 100.0:.1f} cm."
    )


def _alone(story: Story) -> str:
    last = story.alone[-1]
    if last.ending == Ending.ARRIVED:
        return f"With the skin alone it would have arrived, too, after {last.stamp:.1f} s."
    return (
        f"With nothing but the skin the same push does not arrive: once it is silent the base "
        f"searches blindly, and is stopped after {last.stamp:.0f} s."
    )


def _felt(story: Story, before: bool) -> str:
    shares = [(name, story.share(name, before)) for name in story.sources]
    named = [f"{NAMES.get(name, name)} ({share:.0%})" for name, share in shares if share >= 0.005]
    return " and ".join(filter(None, [", ".join(named[:-1]), *named[-1:]])) or "no source"


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else round(float(value), 4)
