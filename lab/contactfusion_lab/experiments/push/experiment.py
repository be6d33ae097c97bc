"""`experiment push`: pushes by several controllers, and what comes of them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, final

from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.pipeline import Pipeline
from contactfusion.terminal import note
from contactfusion_lab.experiments.push.failing import read_failing
from contactfusion_lab.experiments.push.film import record
from contactfusion_lab.experiments.push.plan import (
    PROTOTYPE,
    Plan,
    Push,
    read_plan,
    read_targets,
)
from contactfusion_lab.experiments.push.suites import Change, Sensing, controller_options
from contactfusion_lab.experiments.push.tables import evaluate
from contactfusion_lab.experiments.push.trial import Cost, content_of, report_costs, run_trial
from contactfusion_lab.scenes.push.config import SkinConfig
from contactfusion_lab.scenes.push.scene import PushScene
from contactfusion_lab.trials.choices import require_once
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.runner import Experiment, Made, ordered, run

Task = tuple[str, str, Push]
"""A sensor suite, by its label; a controller; and a push."""
KINDS = ("point_cloud", "depth_image")
"""Names of readings of LiDARs and cameras; none comes where none is switched on."""


@dataclass(frozen=True)
class Options:
    """Options of the experiment.

    Attributes:
        sensings: sensor suites by name; the others are compared with the first.
        controllers: names of sets of parameters, or of installed controllers; the others are
            compared with the first.
        rules: fusion rules, RULE or RULE/CONDENSATION; none: those of the files of the suites.
        without: sources that are left out.
        lidar: the LiDAR that replaces any other.
        camera: the camera likewise.
        weights: of contact networks, a file or the name of some of the package; None: as the file
            of a sensing says.
        preset: the preset that replaces options of the file of every sensing; empty: none.
        objects: names; none: those of the paper, unless there are files.
        files: of further objects, URDF or YAML.
        frictions: names; none: both.
        targets: `grid`, `validation`, `new`, `far`, `random:N`, or a YAML file.
        starts: `nominal`, `random` or `far`.
        taxels: of the front.
        skin: sensitivity of the skin.
        noise: of the sensors: `none`, `prototype`, `hard`, or `prototype` with parts of `hard`.
        faults: a YAML file of how sensors fail, or None.
        seed: of all random draws.
        executor: the workers.
        record: trials to film and record: NAME, CONTROLLER/NAME or SENSING/CONTROLLER/NAME.
    """

    sensings: Sequence[str] = ("skin",)
    controllers: Sequence[str] = ("tuned",)
    rules: Sequence[str] = ()
    without: Sequence[str] = ()
    lidar: str = ""
    camera: str = ""
    weights: Path | str | None = None
    preset: str = ""
    objects: Sequence[str] = ()
    files: Sequence[Path] = ()
    frictions: Sequence[str] = ()
    targets: str = "grid"
    starts: str = "nominal"
    taxels: int = 12
    skin: SkinConfig = SkinConfig()
    noise: str = PROTOTYPE
    faults: Path | None = None
    seed: int = 0
    executor: Executor = Local()
    record: Sequence[str] = ()


def run_push(options: Options, out: Path) -> None:
    """Push, measure, write tables and figures; goes on where it was stopped.

    Args:
        options: what is pushed, where to, by whom.
        out: the folder that takes the results: a file a push and controller, results.csv,
            summary.json, table.md, figures.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds pushes of other options.
        RobotError: a push or a film could not be made; the others are kept.
    """
    require_once(options.controllers, "controllers")
    plans = read_plans(options)
    face = next(iter(plans.values())).face
    for name in options.controllers:
        controller_options(name, (0.0, 0.0), face)
    run(PushExperiment(plans, options.controllers), options.executor, out, options.record)


@final
@dataclass(frozen=True)
class PushExperiment(Experiment[Task]):
    """Pushes that differ in what feels, and by what controller they are steered.

    Attributes:
        plans: by the label of their sensor suite.
        controllers: their names.
    """

    plans: Mapping[str, Plan]
    controllers: Sequence[str]
    trials = "pushes"
    suffix = ".npz"
    addable = ("sensings", "controllers", "objects", "targets")

    def tasks(self) -> dict[str, Task]:
        """Each push by each controller in each plan: SENSING/CONTROLLER/NAME."""
        pushes = self._first.pushes()
        return {
            f"{label}/{name}/{push.name}": (label, name, push)
            for label in self.plans
            for name in self.controllers
            for push in pushes
        }

    def settings(self) -> dict[str, Any]:
        """The settings of plans that differ in their sensor suites only."""
        settings = [plan.settings(self.controllers) for plan in self.plans.values()]
        sensings = {label: suite for each in settings for label, suite in each["sensings"].items()}
        return {**settings[0], "sensings": sensings}

    def check(self, out: Path, missing: Sequence[str], executor: Executor) -> None:
        """Set up pushes, when any is to be made; see `check`."""
        if missing:
            check(self.plans, self.controllers[0], executor)

    def make(self, task: Task) -> Made:
        """Push once."""
        label, controller, push = task
        track, cost = run_trial(self.plans[label], push, controller)
        return Made(content_of(track), cost)

    def report(self, costs: Mapping[str, Cost], out: Path) -> None:
        """Report what pushes took, by what felt."""
        by_label = dict[str, list[Cost]]()
        for name, cost in costs.items():
            by_label.setdefault(name.split("/")[0], []).append(cost)
        report_costs(by_label, out)

    def evaluate(self, out: Path, settings: Mapping[str, Any], failed: Sequence[str]) -> None:
        """Evaluate all pushes of the folder."""
        learned = {label: plan.sensing.learned for label, plan in self.plans.items()}
        evaluate(self._first, settings, failed, out, learned)

    def film(self, task: Task, out: Path) -> tuple[Path, Path]:
        """Push once more."""
        label, controller, push = task
        folder = out / "recordings" / label / controller
        return record(self.plans[label], push, controller, folder)

    @property
    def _first(self) -> Plan:
        return next(iter(self.plans.values()))


def read_plans(options: Options) -> dict[str, Plan]:
    """A plan for each sensor suite by each rule, by the label of the suite.

    Raises:
        ContactFusionError: an option is wrong.
    """
    require_once(options.sensings, "sensings")
    require_once(options.rules, "rules")
    require_once(options.without, "sources that are left out")
    faults, misplaced = read_failing(options.faults) if options.faults else ((), {})
    change = Change(
        "", tuple(options.without), options.lidar, options.camera, options.weights, options.preset
    )
    targets, plans = read_targets(options.targets), {}
    for sensing, rule in product(options.sensings, options.rules or [""]):
        plan = read_plan(
            sensing,
            options.objects,
            options.files,
            options.frictions,
            targets,
            options.starts,
            options.taxels,
            options.skin,
            faults,
            options.seed,
            replace(change, rule=rule),
            misplaced,
            options.noise,
        )
        plans[plan.sensing.label] = plan
    _require_use(options, [plan.sensing for plan in plans.values()])
    return plans


def _require_use(options: Options, sensings: Sequence[Sensing]) -> None:
    """Make sure that no option is given that no sensor suite uses."""
    used = {name for sensing in sensings for name in sensing.sees}
    labels = " and ".join(sensing.label for sensing in sensings)
    for name in filter(None, (options.lidar, options.camera)):
        if name not in used:
            raise ConfigurationError(f"'{name}' was chosen, but what feels here is {labels}")
    for name, changed in (
        ("--taxels", options.taxels != Options.taxels),
        ("--activation", options.skin != Options.skin),
    ):
        if changed and not any(sensing.has_skin for sensing in sensings):
            raise ConfigurationError(f"{name} is of the skin, but what feels here is {labels}")
    if options.weights and not any(sensing.networks for sensing in sensings):
        raise ConfigurationError(
            f"{options.weights} was given, but there are no networks in {labels}"
        )


@dataclass(frozen=True)
class Found:
    """Sensors and faults found by setting up a push.

    Attributes:
        sensors: what reads in it, by name.
        failing: which of the faults change a reading in it.
    """

    sensors: frozenset[str]
    failing: frozenset[int]


def check(plans: Mapping[str, Plan], controller: str, executor: Executor) -> None:
    """Set up pushes, apart: PyBullet may crash.

    By the first suite those to each target and of each object, by the others of each object.

    Args:
        plans: by the label of their sensor suite.
        controller: by name.
        executor: the workers.

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
        tasks = {f"{push.object} to {push.target}": push for push in chosen.values()}
        try:
            for found in ordered(partial(_found, plan, controller), tasks, executor):
                sensors |= found.sensors
                failing |= found.failing
        except RobotError as error:
            raise ConfigurationError(str(error)) from None
    _require_sensors(plans, sensors, failing)


def _require_sensors(
    plans: Mapping[str, Plan], sensors: Collection[str], failing: Collection[int]
) -> None:
    """Make sure that what fails or is misplaced is there; note what is switched off.

    Args:
        plans: by the label of their sensor suite.
        sensors: names of those that read.
        failing: which of the faults change a reading.
    """
    (plan, *_) = plans.values()
    robot, seen = plan.robot, {name for each in plans.values() for name in each.sensing.sees}
    exteroceptive = {*robot.lidars, *robot.cameras}
    failing_at = [
        (f"faults.{number}.sensor", str(fault.fields.get("sensor")))
        for number, fault in enumerate(plan.faults)
        if number not in failing
    ]
    for path, name in failing_at:
        if name not in {*exteroceptive, *KINDS}:
            hint = name_hint(name, {*sensors, *exteroceptive}, "sensors")
            raise ConfigurationError(f"no reading of '{name}' comes; {hint}", path)
    misplaced = [(f"misplaced.{name}", name) for name in plan.misplaced if name not in seen]
    for path, name in misplaced:
        if name not in exteroceptive:
            hint = name_hint(name, exteroceptive, "LiDARs and cameras of the robot")
            raise ConfigurationError(f"the robot has no '{name}'; {hint}", path)
    for path, name in failing_at + misplaced:
        note(f"{path}: no sensing here uses '{name}', so that it changes nothing")


def _found(plan: Plan, controller: str, push: Push) -> Found:
    """Set up one push."""
    readings = PushScene(plan.scene_of(push), plan.robot).readings()
    pipeline = Pipeline(plan.pipeline_of(push, controller))
    pipeline.close()
    sensors = {(reading.sensor, type(reading)) for reading in readings}
    faults = enumerate(pipeline.config.faults)
    return Found(
        frozenset(sensor for sensor, _ in sensors),
        frozenset(row for row, fault in faults if any(fault.meets(*sensor) for sensor in sensors)),
    )
