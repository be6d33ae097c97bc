"""A baseline: pushing by an inverse model that is learnt while it pushes."""

import math
from collections.abc import Mapping

from pydantic import Field

from contactfusion.controllers.object_pushing import (
    Motion,
    ObjectPushing,
    ObjectPushingConfig,
    Place,
    Sight,
)
from contactfusion.controllers.pushing_law import wrapped
from contactfusion.hooks import hookimpl
from contactfusion.units import Angle, Spread


class InverseModelConfig(ObjectPushingConfig):
    """The options of `inverse_model`."""

    spread: Angle = Field(default=0.5, gt=0)
    """Standard deviation of α before anything is learnt [rad]."""
    least_spread: Angle = Field(default=0.1, gt=0)
    """It never becomes less than this [rad]."""
    prior: float = Field(default=100.0, ge=1)
    """What was believed before counts as much as so many pushes."""
    stride: Spread = Field(default=0.02, gt=0)
    """An object that moved less than this has not moved [m]."""
    bias_gain: float = Field(default=0.05, ge=0)
    """K_1: how much the direction is turned against the mean of γ."""
    error_gain: float = Field(default=0.1, ge=0)
    """K_2: how much the direction is turned against γ."""


class InverseModel(ObjectPushing[InverseModelConfig]):
    """Pushes from where pushes have moved the object as expected, and goes there when it is not.

    Krivić and Piater, "Pushing corridors for delivering unknown objects with a mobile robot"
    (Autonomous Robots 43, 2019). Only abstract, introduction and the first author's program
    (DynamicPush of the project SQUIRREL) were at hand, so no equations are cited by number.

    Kept, the adaptive controller and its local inverse model:

    - α is the angle between the direction from robot to object and that from object to goal, here
      0 straight behind (theirs differs by π). A Gaussian over α, of mean μ and deviation σ, tells
      which pushes move the object as they should.
    - ψ_push = exp(-(α - μ)²/2σ²), at most |cos α|, and 0 in front of the object;
      ψ_relocate = √(1 - ψ_push²). The robot moves along ψ_push · (to the object)
      + ψ_relocate · (round the object, to where α = μ).
    - γ is the angle from the direction in which the object moved to that in which it should have.
      Where |γ| has become less, the push was a good one: μ and σ take in its α, by running mean and
      variance. The direction is turned by -(K_1 · mean of γ + K_2 · γ), and the speed divided by
      1 + |mean of γ|.
    - Out of contact, it goes straight to where it believes the object.

    Left out: the corridor, the choice of a point on the path ahead, and the map of what is
    occupied. The floor is free here and the path is the straight line to the target. The stop of
    all translation while the face points elsewhere is left out too: the contact would be lost.

    The object's place and motion are theirs by markers; here the place is believed beyond the
    contact (see `ObjectPushing`), so that a contact that slides along the object looks like an
    object that moves. The model is learnt from that, which is the point of the comparison.
    """

    Config = InverseModelConfig

    def reset(self) -> None:
        """Forget the object, and what was learnt."""
        super().reset()
        self._count, self._mean, self._variance = self.options.prior, 0.0, self.options.spread**2
        self._errors, self._bias, self._error = 0, 0.0, math.pi
        self._before: tuple[Place, float, float] | None = None

    def move(self, sight: Sight) -> Motion:
        """Learn from the last push, then blend pushing and going round."""
        options = self.options
        alpha = wrapped(sight.bearing - sight.way)
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
        """Take in how the object moved since it was last looked at."""
        if self._before is None:
            self._before = sight.thing, sight.way, alpha
            return
        (x, y), expected, pushed = self._before
        x, y = sight.thing[0] - x, sight.thing[1] - y
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
        self._before = sight.thing, sight.way, alpha


@hookimpl
def contactfusion_controllers() -> Mapping[str, type[InverseModel]]:
    """Offer pushing by a learnt inverse model."""
    return {"inverse_model": InverseModel}
