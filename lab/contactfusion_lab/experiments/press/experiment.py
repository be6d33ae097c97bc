"""`experiment press`: arms that are pressed anywhere, and what each row reports."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from contactfusion.errors import ConfigurationError
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import shared_robot
from contactfusion_lab.experiments.press.plan import ARMS, Plan, Press, arm
from contactfusion_lab.experiments.press.tables import evaluate
from contactfusion_lab.experiments.press.trial import content_of, load, run_trial
from contactfusion_lab.trials.choices import require_known, require_once
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.folder import trial_file
from contactfusion_lab.trials.runner import Experiment, Made, run


@dataclass(frozen=True)
class Options:
    """Options of the experiment.

    Attributes:
        arms: names of arms; none: all.
        forces: of the probes [N].
        touches: number of presses of each arm by each force.
        places: number of places that are pressed at once, 1 or 2.
        free: minutes of free motion of each arm.
        seed: of all chance.
        executor: the workers.
    """

    arms: Sequence[str] = ()
    forces: Sequence[float] = (10.0, 20.0)
    touches: int = 40
    places: int = 1
    free: float = 1.0
    seed: int = 0
    executor: Executor = Local()


def run_press(options: Options, out: Path) -> None:
    """Press, compare with the truth, write tables and a figure; goes on where it was stopped.

    Args:
        options: what is pressed, and how.
        out: the folder that takes the results.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds presses of other options.
        RobotError: a press could not be made; the others are kept.
    """
    require_once(options.arms, "arms")
    require_known(options.arms, ARMS, "arm", "arms")
    if options.places not in (1, 2):
        raise ConfigurationError(f"an arm is pressed at 1 or 2 places, not {options.places}")
    if any(not 0.0 < force <= 200.0 for force in options.forces):
        raise ConfigurationError("a probe presses with more than 0 N, and at most 200 N", "forces")
    require_once([f"{force:g} N" for force in options.forces], "forces")
    if not 0.0 <= options.free < math.inf:
        raise ConfigurationError(f"free motion lasts 0 minutes or more, not {options.free:g}")
    plan = Plan(
        options.arms or ARMS, options.forces, options.touches, options.places, options.free,
        options.seed,
    )  # fmt: skip
    run(PressExperiment(plan), options.executor, out)


@final
@dataclass(frozen=True)
class PressExperiment(Experiment[Press]):
    """Presses of several arms, and free motions.

    Attributes:
        plan: how each is made.
    """

    plan: Plan
    trials = "presses"
    suffix = ".json"
    addable = ("arms",)

    def tasks(self) -> dict[str, Press]:
        """The trials by name."""
        return {press.name: press for press in self.plan.presses()}

    def settings(self) -> dict[str, Any]:
        """The settings of the plan."""
        return self.plan.settings()

    def make(self, task: Press) -> Made:
        """Press once."""
        return Made(content_of(run_trial(task)))

    def evaluate(self, out: Path, settings: Mapping[str, Any], failed: Sequence[str]) -> None:
        """Evaluate the trials of this plan."""
        files = [trial_file(out, name, self.suffix) for name in self.tasks()]
        found = [load(path) for path in files if path.is_file()]
        joints = {name: _joints(name) for name in self.plan.arms}
        evaluate(found, self.plan, joints, failed, out)


def _joints(name: str) -> dict[str, frozenset[str]]:
    """By link of an arm, the joints whose efforts feel a force on it."""
    config = arm(name).pipeline
    assert config.robot is not None  # each file has one
    dynamics, known = Dynamics(shared_robot(config.robot)), config.generators["torques"]["joints"]
    names = np.array(dynamics.model.joint_names)
    felt = dynamics.supports & np.isin(names, known)
    links = dynamics.model.link_names
    return {link: frozenset(names[row].tolist()) for link, row in zip(links, felt, strict=True)}
