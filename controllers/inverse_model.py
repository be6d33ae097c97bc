"""A baseline: pushing by an inverse model that is learned while pushing."""

import math
from collections.abc import Mapping

from pydantic import Field

from contactfusion.controllers.object_pushing import (
    Motion,
    ObjectPushing,
    ObjectPushingConfig,
    Point,
    Sight,
)
from contactfusion.controllers.pushing_law import wrapped
from contactfusion.hooks import hookimpl
from contactfusion.units import Angle, Spread


class InverseModelConfig(ObjectPushingConfig):
    """The options of `inverse_model`."""

    spread: Angle = Field(default=0.5, gt=0)
    """Standard deviation of α before anything is learned [rad]."""
    least_spread: Angle = Field(default=0.1, gt=0)
    """The least standard deviation of α [rad]."""
    prior: float = Field(default=100.0, ge=1)
    """Weight of the prior, in pushes."""
    stride: Spread = Field(default=0.02, gt=0)
    """The least displacement of a moved object [m]."""
    bias_gain: float = Field(default=0.05, ge=0)
    """K_1: gain of the direction against the mean of γ."""
    error_gain: float = Field(default=0.1, ge=0)
    """K_2: gain of the direction against γ."""


class InverseModel(ObjectPushing[InverseModelConfig]):
    """Pushes from angles at which pushes moved the object as expected, or relocates there.

    Krivić and Piater, "Pushing corridors for delivering unknown objects with a mobile robot"
    (Autonomous Robots 43, 2019). Only abstract, introduction and the first author's program
    (DynamicPush of the project SQUIRREL) were at hand, so no equations are cited by number.

    Kept, the adaptive controller and its local inverse model:

    - α is the angle between the direction from robot to object and that from object to goal, here
      0 straight behind (theirs differs by π). A Gaussian over α, of mean μ and deviation σ, models
      the pushes that move the object as expected.
    - ψ_push = exp(-(α - μ)²/2σ²), at most |cos α|, and 0 in front of the object;
      ψ_relocate = √(1 - ψ_push²). The robot moves along ψ_push · (to the object)
      + ψ_relocate · (round the object, to where α = μ).
    - γ is the angle from the direction in which the object moved to the expected one. Where |γ| has
      decreased, the push was a good one: μ and σ are updated by its α, as running mean and
      variance. The direction is turned by -(K_1 · mean of γ + K_2 · γ), and the speed divided by
      1 + |mean of γ|.
    - Out of contact, it moves straight to the believed object.

    Left out: the corridor, the choice of a point further on the path, and the map of what is
    occupied. The floor is free here and the path is the straight line to the target. The stop of
    all translation while the face points elsewhere is left out too: the contact would be lost.

    They measure the object's pose and motion by markers; here its position is believed beyond the
    contact (see `ObjectPushing`), so that a contact that slides along the object looks like an
    object that moves. The model is learned from that, which is the point of the comparison.
    """

    Config = InverseModelConfig

    def reset(self) -> None:
        """Drop the object, and the learned model."""
        super().reset()
        self._count, self._mean, self._variance = self.options.prior, 0.0, self.options.spread**2
        self._errors, self._bias, self._error = 0, 0.0, math.pi
        self._before: tuple[Point, float, float] | None = None

    def move(self, sight: Sight) -> Motion:
        """Learn from the last push, then blend pushing and relocating."""
        options = self.options
        alpha = wrapped(sight.bearing - sight.course)
        if not sight.touched:
            self._before = None
            return Motion(sight.bearing, self._pace(sight), "return", "to where the object was")
        self._learn(sight, alpha)
        push = min(self._likely(alpha), max(0.0, math.cos(alpha)))
        relocate = math.sqrt(1.0 - push * push)
        turned = math.atan2(math.copysign(relocate, alpha - self._mean), push)
        if self._errors:
            turned -= options.bias_gain * self._bias + options.error_gain * self._error
        mode = "push" if push > relocate else "relocate"
        reason = (
            f"{sight.left:.2f} m to go, {math.degrees(alpha):+.0f}° from behind, best "
            f"{math.degrees(self._mean):+.0f} ± {math.degrees(math.sqrt(self._variance)):.0f}°"
        )
        return Motion(sight.bearing + turned, self._pace(sight), mode, reason)

    def _pace(self, sight: Sight) -> float:
        return max(self.speed(sight.left) / (1.0 + abs(self._bias)), self.options.slowest)

    def _likely(self, alpha: float) -> float:
        return math.exp(-((alpha - self._mean) ** 2) / (2.0 * self._variance))

    def _learn(self, sight: Sight, alpha: float) -> None:
        """Update the model by the motion of the object since the last update."""
        if self._before is None:
            self._before = sight.object, sight.course, alpha
            return
        (x, y), expected, pushed = self._before
        x, y = sight.object[0] - x, sight.object[1] - y
        if math.hypot(x, y) < self.options.stride:
            return
        error = wrapped(expected - math.atan2(y, x))
        self._errors += 1
        self._bias += (error - self._bias) / self._errors
        if abs(error) < abs(self._error):
            self._count += 1.0
            off = pushed - self._mean
            self._mean += off / self._count
            spread = off * (pushed - self._mean) - self._variance
            self._variance += spread / self._count
            self._variance = max(self._variance, self.options.least_spread**2)
        self._error = error
        self._before = sight.object, sight.course, alpha


@hookimpl
def contactfusion_controllers() -> Mapping[str, type[InverseModel]]:
    """Pushing by a learned inverse model."""
    return {"inverse_model": InverseModel}
