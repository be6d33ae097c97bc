"""A look at what may go wrong before any push is made."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial

from contactfusion.errors import ConfigurationError, ContactFusionError, name_hint
from contactfusion.pipeline import Pipeline
from contactfusion.terminal import note
from contactfusion_lab.experiments.push.plan import Plan, Push
from contactfusion_lab.experiments.workers import Died, each
from contactfusion_lab.scenes.push.scene import PushScene

KINDS = ("point_cloud", "depth_image")
"""What LiDARs and cameras give; where none is switched on, none comes."""


@dataclass(frozen=True)
class Found:
    """What setting up a push has shown.

    Attributes:
        problem: what stands against it, or nothing.
        sensors: what reads in it, by name.
        failing: which of the faults change a reading in it.
    """

    problem: str
    sensors: frozenset[str] = frozenset()
    failing: frozenset[int] = frozenset()


def check(plans: Mapping[str, Plan], controller: str) -> None:
    """Set up pushes, apart: PyBullet may crash.

    By the first sensing those to each target and of each object, by the others of each object.

    Args:
        plans: by the label of what feels.
        controller: by name.

    Raises:
        ConfigurationError: a target cannot be reached, an object not be pushed, or what fails or is
            misplaced is no sensor that there is.
    """
    sensors, failing = set[str](), set[int]()
    for number, plan in enumerate(plans.values()):
        pushes = plan.pushes()
        chosen = {push.object: push for push in reversed(pushes)}
        if plan.targets.places and number == 0:
            chosen |= {str(push.target): push for push in reversed(pushes)}
        for push, found in each(partial(_found, plan, controller), list(chosen.values()), 1):
            if isinstance(found, Died):
                found = Found(f"a world with it cannot be set up: the process {found.how}")
            if found.problem:
                raise ConfigurationError(f"{push.object} to {push.target}: {found.problem}")
            sensors |= found.sensors
            failing |= found.failing
    _require_sensors(plans, sensors, failing)


def _require_sensors(
    plans: Mapping[str, Plan], sensors: Collection[str], failing: Collection[int]
) -> None:
    """Make sure that what fails or is misplaced is there; tell of what is switched off.

    Args:
        plans: by the label of what feels.
        sensors: what reads.
        failing: which of the faults change a reading.
    """
    (plan, *_) = plans.values()
    robot, seen = plan.robot, {name for one in plans.values() for name in one.sensing.sees}
    eyes = {*robot.lidars, *robot.cameras}
    told = [
        (f"faults.{number}.sensor", str(fault.told.get("sensor")))
        for number, fault in enumerate(plan.faults)
        if number not in failing
    ]
    for path, name in told:
        if name not in {*eyes, *KINDS}:
            hint = name_hint(name, {*sensors, *eyes}, "sensors")
            raise ConfigurationError(f"no reading of '{name}' comes; {hint}", path)
    misplaced = [(f"misplaced.{name}", name) for name in plan.misplaced if name not in seen]
    for path, name in misplaced:
        if name not in eyes:
            hint = name_hint(name, eyes, "LiDARs and cameras of the robot")
            raise ConfigurationError(f"the robot has no '{name}'; {hint}", path)
    for path, name in told + misplaced:
        note(f"{path}: no sensing here uses '{name}', so that it changes nothing")


def _found(plan: Plan, controller: str, push: Push) -> Found:
    """Set up one push."""
    try:
        readings = PushScene(plan.scene_of(push), plan.robot).readings()
        pipeline = Pipeline(plan.pipeline_of(push, controller))
        pipeline.close()
    except ContactFusionError as error:
        return Found(str(error))
    except Exception as error:  # a plug-in may raise anything
        return Found(f"{type(error).__name__}: {error}")
    heard = {(reading.sensor, type(reading)) for reading in readings}
    faults = enumerate(pipeline.config.faults)
    return Found(
        "",
        frozenset(sensor for sensor, _ in heard),
        frozenset(row for row, fault in faults if any(fault.meets(*one) for one in heard)),
    )
