"""How well a set of parameters pushes: the same random pushes for every set."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from contactfusion.controllers.pushing_parameters import PushingParameters
from contactfusion.controllers.reactive_pushing import ReactivePushing, ReactivePushingConfig
from contactfusion.errors import ConfigurationError
from contactfusion.pipeline import Pipeline
from contactfusion_lab.experiments.measures import proportion
from contactfusion_lab.experiments.push.plan import Plan, Push, Targets, read_plan
from contactfusion_lab.experiments.push.trial import push_cycles
from contactfusion_lab.scenes.push.config import FrictionConfig, PushConfig, SkinConfig
from contactfusion_lab.scenes.push.planar import planar_trial
from contactfusion_lab.scenes.push.scene import Ending

REPORTED = (500, 2025)
"""Seeds of trials that results are reported on; nothing is tuned on them."""
FAILED = 600.0
"""A push that fails counts as if it had taken so long: twice the longest [s]."""
VARIED = 0.2
"""In the plane each friction is varied by so much either way, so that none is fitted."""


@dataclass(frozen=True, slots=True)
class Rating:
    """What came of pushes with one set of parameters.

    Attributes:
        success: of each push, whether it was a true one.
        time: of each push [s].
    """

    success: tuple[bool, ...]
    time: tuple[float, ...]

    @property
    def cost(self) -> float:
        """The mean time, failures at `FAILED` [s]: the smaller, the better."""
        return float(np.where(self.success, self.time, FAILED).mean())

    @property
    def rate(self) -> tuple[float, float, float]:
        """The rate of true success, and its Wilson interval."""
        return proportion(np.array(self.success, np.bool_))

    @property
    def mean_time(self) -> float:
        """Of the pushes that succeed [s]; NaN if none does."""
        times = np.array(self.time)[np.array(self.success, np.bool_)]
        return float(times.mean()) if len(times) else float("nan")


def random_pushes(trials: int, seed: int) -> tuple[Plan, list[Push]]:
    """Draw pushes of the paper's objects from random starts to random targets.

    Raises:
        ConfigurationError: results are reported on this seed.
    """
    if seed in REPORTED:
        raise ConfigurationError(
            f"results are reported on the seeds {REPORTED[0]} and {REPORTED[1]}: nothing is tuned "
            "on them",
            "seed",
        )
    targets = Targets("random", None, trials)
    plan = read_plan("skin", [], [], [], targets, "random", 12, SkinConfig(), (), seed)
    return plan, plan.pushes()


def rate_in_plane(
    plan: Plan, pushes: Sequence[Push], vary: bool, parameters: PushingParameters
) -> Rating:
    """Push in the plane.

    Args:
        plan: of the pushes.
        pushes: what to push where.
        vary: whether frictions are varied.
        parameters: of the controller.
    """
    outcomes = []
    for push in pushes:
        config = plan.scene_of(push)
        options = ReactivePushingConfig(target=push.target, face=plan.face, parameters=parameters)
        outcomes.append(
            planar_trial(_varied(config, push) if vary else config, ReactivePushing(options))
        )
    return Rating(tuple(one.success_true for one in outcomes), tuple(one.time for one in outcomes))


def rate_in_bullet(plan: Plan, pushes: Sequence[Push], parameters: PushingParameters) -> Rating:
    """Push in PyBullet, through skin, generator and integrator."""
    success, times = [], []
    for push in pushes:
        options: dict[str, Any] = {
            "type": "reactive_pushing",
            "target": push.target,
            "face": plan.face.model_dump(),
            "parameters": parameters.model_dump(),
        }
        update = {"controller": options, "seed": push.seed}
        *_, last = push_cycles(plan, push, Pipeline(plan.pipeline.model_copy(update=update)))
        near = last.truth.distance <= plan.scene_of(push).within
        success.append(bool(near and last.ending == Ending.ARRIVED))
        times.append(float(last.truth.stamp))
    return Rating(tuple(success), tuple(times))


def _varied(config: PushConfig, push: Push) -> PushConfig:
    ground, robot = np.random.default_rng(push.seed).uniform(1.0 - VARIED, 1.0 + VARIED, 2)
    friction = FrictionConfig(
        ground=config.friction.ground * float(ground), robot=config.friction.robot * float(robot)
    )
    return config.model_copy(update={"friction": friction})
