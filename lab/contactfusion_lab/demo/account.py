"""What came of the push: the numbers of summary.json, and the account of it in sentences."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from contactfusion_lab.demo.scene import Moment, sources_of
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import Ending

NAMES = {"skin": "the skin", "lidar": "the LiDAR", "motion": "the base's own motion"}
"""What sentences call the sources."""


@dataclass(frozen=True, eq=False)
class Story:
    """All that the demo tells of.

    Attributes:
        fields: of the scene.
        moments: of the push.
        alone: of the same push by nothing but the skin.
    """

    fields: Mapping[str, Any]
    moments: Sequence[Moment]
    alone: Sequence[Moment]

    @property
    def push(self) -> PushConfig:
        """What is pushed, and where to."""
        return PushConfig(**self.fields["scene"])

    @property
    def dies(self) -> float:
        """When the skin falls silent [s]."""
        return float(self.fields["faults"][0]["start"])

    @property
    def last(self) -> Moment:
        """How it ended."""
        return self.moments[-1]

    @property
    def arrived(self) -> bool:
        """Whether the box truly arrived where the robot believes that it did."""
        return self.last.ending == Ending.ARRIVED and (self.last.truth.distance <= self.push.within)

    @property
    def sources(self) -> list[str]:
        """Who can have a share in a contact: evidence before support, larger shares first."""
        report = self.last.fusion.report.sources
        return sorted(
            sources_of(self.last),
            key=lambda name: (report[name].kind, -self.share(name, True)),
        )

    def part(self, before: bool) -> list[Moment]:
        """The moments before the skin's death, or those after its last words are forgotten."""
        timeout = float(self.fields["integrator"]["timeout"])
        if before:
            return [one for one in self.moments if one.stamp < self.dies]
        return [one for one in self.moments if one.stamp >= self.dies + timeout]

    def share(self, source: str, before: bool) -> float:
        """The mean share of a source in the contact, before or after the skin's death."""
        shares = [one.shares.get(source, 0.0) for one in self.part(before) if one.contact]
        return float(np.mean(shares)) if shares else 0.0

    def error(self, before: bool) -> float:
        """How wrong the contact's place along the face is, as root mean square [m]."""
        errors = [
            one.touch.lateral - one.truth.contact[1]
            for one in self.part(before)
            if one.touch and one.truth.kind != "none"
        ]
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan

    def unfelt(self) -> float:
        """For how long after the skin's death the robot knew of no contact [s]."""
        period = self.moments[1].stamp - self.moments[0].stamp
        return period * sum(one.touch is None for one in self.moments if one.stamp >= self.dies)

    def at(self, stamp: float) -> Moment:
        """The moment with a contact that is nearest to a time."""
        touching = [one for one in self.moments if one.contact] or self.moments
        return min(touching, key=lambda one: abs(one.stamp - stamp))


def summary(story: Story) -> dict[str, Any]:
    """What came of the push, in m and s; the same push gives the same."""
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
    """What happened, in sentences."""
    touching = [one for one in story.part(True) if one.truth.kind != "none"]
    left = f", {touching[-1].truth.distance:.2f} m from the target" if touching else ""
    told = [
        f"Until {story.dies:.1f} s the contact was told by {_felt(story, True)}, and its place "
        f"along the robot's front was known to {story.error(True) * 100.0:.1f} cm (root mean "
        "square).",
        f"Then the skin fell silent{left}.",
    ]
    if len(story.part(False)):
        unfelt = story.unfelt()
        lost = f"it was lost for {unfelt:.1f} s in all" if unfelt else "it was never lost"
        told.append(
            f"From then on the contact was told by {_felt(story, False)}, to "
            f"{story.error(False) * 100.0:.1f} cm; {lost}."
        )
    return [*told, _end(story), _alone(story)]


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
    return " and ".join(filter(None, [", ".join(named[:-1]), *named[-1:]])) or "nobody"


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else round(float(value), 4)
