"""The commands of the laboratory: demo, experiment, simulate, train, tune push."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from contactfusion.cli.options import Changed, Out, listed
from contactfusion.cli.options import Seed as FileSeed
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion_lab.simulate import Part

if TYPE_CHECKING:
    from contactfusion_lab.trials.executor import Executor

Seed = Annotated[int, typer.Option(min=0, help="Random seed.")]
Workers = Annotated[int | None, typer.Option(min=1, show_default="2", help="Number of processes.")]
Executed = Annotated[
    str,
    typer.Option(
        "--executor", help="local: processes on this machine; dask: workers of --scheduler."
    ),
]
Scheduler = Annotated[str, typer.Option(help="Address of a dask scheduler, e.g. tcp://HOST:8786.")]
Faults = Annotated[Path | None, typer.Option(help="Faults of sensors (YAML).")]
Noise = Annotated[
    str | None,
    typer.Option(
        help="Noise: none, prototype, full, hard, or parts of hard as in prototype+wrist+clutter; "
        "default: that of the scene."
    ),
]

PresetName = Annotated[
    str, typer.Option("--preset", help="paper: what the papers print, in place of ours.")
]

experiments = typer.Typer(
    name="experiment", help="Run an experiment: writes results.csv, summary.json, figures.",
    no_args_is_help=True,
)  # fmt: skip
train = typer.Typer(
    name="train", help="Train networks in simulation, from scratch.", no_args_is_help=True,
)  # fmt: skip


def _executor(name: str, workers: int | None, scheduler: str) -> "Executor":
    """The workers that the options name.

    Raises:
        ConfigurationError: an option does not fit, or no scheduler answers.
        DependencyError: distributed is not installed.
    """
    if name == "dask":
        if workers is not None:
            raise ConfigurationError("--executor dask has the workers of its scheduler", "workers")
        from contactfusion_lab.trials.cluster import Dask

        return Dask(scheduler)
    from contactfusion_lab.trials.executor import Local

    if name != "local":
        raise ConfigurationError(
            f"unknown executor '{name}'; {name_hint(name, ('dask', 'local'), 'executors')}"
        )
    if scheduler:
        raise ConfigurationError("only --executor dask has a scheduler", "scheduler")
    return Local(workers or 2)


def _preset(name: str) -> str:
    """The name of a preset, or nothing.

    Raises:
        ConfigurationError: there is none of that name.
    """
    from contactfusion.preset import preset_named

    if name:
        preset_named(name)
    return name


def demo(out: Out = Path("out/demo")) -> None:
    """Push a box with skin and LiDAR; the skin fails half-way; writes a page and a film."""
    from contactfusion_lab.demo.run import show

    show(out)


def simulate(
    configuration: Annotated[
        Path, typer.Argument(help="The configuration (YAML), with a scene of type push.")
    ],
    part: Annotated[Part, typer.Option(help="The part of the robot that this process is.")] = (
        Part.ALL
    ),
    set_: Changed = None,
    domain: Annotated[
        int | None,
        typer.Option(min=0, max=232, help="The ROS domain; default: ROS_DOMAIN_ID, or 0."),
    ] = None,
    seed: FileSeed = None,
) -> None:
    """Run the robot of a scene in real time, as ROS 2 nodes: twists in, readings out."""
    from contactfusion_lab.simulate.run import simulate as run

    run(configuration, part, set_ or [], seed, domain)


def tune_push(
    start: Annotated[str, typer.Option(help="Parameter set to start from.")] = "tuned",
    trials: Annotated[int, typer.Option(min=6, help="Pushes per parameter set and round.")] = 60,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of 24 parameter sets.")] = 10,
    confirm: Annotated[
        int, typer.Option(min=6, help="Pushes in PyBullet to confirm each of the best sets.")
    ] = 150,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Only compare the ranking by the planar model with that by PyBullet."
        ),
    ] = False,
    seed: Seed = 0,
    workers: Workers = None,
    executor: Executed = "local",
    scheduler: Scheduler = "",
    out: Out = Path("out/tune"),
) -> None:
    """Search parameters of reactive pushing in a planar model; resumes where it stopped."""
    if check:
        if (start, rounds, confirm) != ("tuned", 10, 150):
            raise ConfigurationError(
                "--check searches nothing: leave --start, --rounds, --confirm out"
            )
        from contactfusion_lab.tune_push.push import check_ranking

        check_ranking(trials, seed, _executor(executor, workers, scheduler), out)
        return
    from contactfusion_lab.tune_push.push import Options
    from contactfusion_lab.tune_push.push import tune_push as search

    shared = _executor(executor, workers, scheduler)
    search(Options(seed, trials, rounds, confirm, start, shared), out)


@train.command("cpm")
def train_cpm(
    rounds: Annotated[
        int | None,
        typer.Option(
            min=0,
            show_default="3",
            help="DAgger iterations: the networks drive, and learn from it.",
        ),
    ] = None,
    varied: Annotated[
        int | None,
        typer.Option(
            min=0, show_default="360", help="Training pushes beside the paper's 156 + 36."
        ),
    ] = None,
    driven: Annotated[int, typer.Option(min=7, help="Pushes per iteration.")] = 160,
    tested: Annotated[
        int | None, typer.Option(min=6, show_default="60", help="Test pushes per LiDAR.")
    ] = None,
    epochs: Annotated[
        int | None,
        typer.Option(min=1, show_default="150", help="Epochs of the last iteration."),
    ] = None,
    early: Annotated[int, typer.Option(min=1, help="Epochs of the iterations before.")] = 50,
    stride: Annotated[int, typer.Option(min=1, help="An epoch uses every N-th window.")] = 4,
    preset: PresetName = "",
    seed: Seed = 0,
    workers: Workers = None,
    executor: Executed = "local",
    scheduler: Scheduler = "",
    out: Out = Path("out/cpm"),
) -> None:
    """Train the networks that perceive contact; resumes where it stopped."""
    from contactfusion_lab.learning.cpm import PRESETS
    from contactfusion_lab.learning.cpm import train_cpm as train_networks

    sized = {"rounds": rounds, "varied": varied, "tested": tested, "epochs": epochs}
    given: dict[str, Any] = {name: count for name, count in sized.items() if count is not None}
    shared = _executor(executor, workers, scheduler)
    options = replace(
        PRESETS[_preset(preset)],
        **given, driven=driven, early=early, stride=stride, seed=seed, executor=shared,
    )  # fmt: skip
    train_networks(options, out)


@experiments.command("feet")
def experiment_feet(
    trials: Annotated[int, typer.Option(min=1, help="Number of scripts of each kind.")] = 10,
    seed: Seed = 100,
    out: Out = Path("out/feet"),
) -> None:
    """Lift the feet of a quadruped, and find which touch the ground by joint torques."""
    from contactfusion_lab.experiments.feet import run_feet

    run_feet(trials, seed, out)


@experiments.command("recordings")
def experiment_recordings(
    data: Annotated[Path | None, typer.Option(help="Folder of the real recordings.")] = None,
    only: Annotated[
        list[str] | None, typer.Option(help="A data set, repeatable; default: all.")
    ] = None,
    rule: Annotated[
        str | None, typer.Option(help="RULE or RULE/CONDENSATION; default: the integrator's.")
    ] = None,
    out: Out = Path("out/recordings"),
) -> None:
    """Locate contacts in real recordings with known ground truth."""
    from contactfusion_lab.experiments.methods import Method
    from contactfusion_lab.experiments.recordings import run_recordings

    run_recordings(data, Method.named(rule) if rule else None, out, only or ())


@experiments.command("touch")
def experiment_touch(
    config: Annotated[
        Path | None,
        typer.Option(help="Configuration (YAML) as for `run`, with a scene of type touch."),
    ] = None,
    objects: Annotated[
        str, typer.Option(help="Objects of the scene, or URDF or mesh files, separated by commas.")
    ] = "",
    directions: Annotated[int, typer.Option(min=1, help="Number of approach directions.")] = 15,
    repeats: Annotated[int, typer.Option(min=1, help="Touches per direction.")] = 5,
    rule: Annotated[
        list[str] | None,
        typer.Option(
            help="RULE, RULE/CONDENSATION or de_morgan_tuned; may be repeated; default: "
            "sets, de_morgan, de_morgan_tuned and posterior/modes."
        ),
    ] = None,
    spreads: Annotated[
        list[float] | None,
        typer.Option(help="Factor on the stated spreads, fused once more; may be repeated."),
    ] = None,
    noise: Noise = None,
    faults: Faults = None,
    preset: PresetName = "",
    seed: Seed = 0,
    workers: Workers = None,
    executor: Executed = "local",
    scheduler: Scheduler = "",
    draw: Annotated[
        list[str] | None, typer.Option(help="A touch to draw, e.g. box-03-0; may be repeated.")
    ] = None,
    free: Annotated[
        float, typer.Option(help="Minutes of free motion, in which any contact is a false alarm.")
    ] = 1.0,
    places: Annotated[
        int | None,
        typer.Option(min=1, max=5, help="Number of places at which the hand is touched at once."),
    ] = None,
    out: Out = Path("out/touch"),
) -> None:
    """Touch objects in simulation, and compare with the truth; resumes where it stopped."""
    from contactfusion_lab.experiments.methods import DE_MORGAN, Method
    from contactfusion_lab.experiments.touch.experiment import METHODS, Options, run_touch
    from contactfusion_lab.experiments.touch.plan import DEFAULT

    options = Options(
        config=config or DEFAULT,
        objects=listed(objects),
        directions=directions,
        repeats=repeats,
        methods=[Method.named(name) for name in rule or ()] or ([DE_MORGAN] if preset else METHODS),
        spreads=spreads or (),
        noise=noise,
        faults=faults,
        seed=seed,
        preset=_preset(preset),
        executor=_executor(executor, workers, scheduler),
        draw=draw or (),
        free=free,
        places=places,
    )
    run_touch(options, out)


@experiments.command("skin")
def experiment_skin(
    touches: Annotated[
        int, typer.Option(min=1, help="Number of touches of each number of presses.")
    ] = 120,
    apart: Annotated[
        float,
        typer.Option(min=0.005, max=0.025, help="The least distance between presses \\[m]."),
    ] = 0.02,
    rule: Annotated[
        list[str] | None,
        typer.Option(
            help="RULE or RULE/CONDENSATION; may be repeated; default: sets, de_morgan, the same "
            "tuned, and posterior/modes."
        ),
    ] = None,
    seed: Seed = 0,
    out: Out = Path("out/skin"),
) -> None:
    """Press a flat skin at one to six places at once, and compare with the truth."""
    from contactfusion_lab.experiments.methods import Method
    from contactfusion_lab.experiments.skin import METHODS, run_skin

    methods = [Method.named(name) for name in rule or ()] or METHODS
    run_skin(touches, apart, seed, methods, out)


@experiments.command("press")
def experiment_press(
    arms: Annotated[
        str, typer.Option(help="Arms, separated by commas: panda, ur10e, kuka; default: all.")
    ] = "",
    force: Annotated[
        list[float] | None,
        typer.Option(help="Force of a probe \\[N]; may be repeated; default: 10 and 20."),
    ] = None,
    touches: Annotated[
        int, typer.Option(min=1, help="Number of presses of each arm by each force.")
    ] = 40,
    places: Annotated[
        int, typer.Option(min=1, max=2, help="Number of places that are pressed at once.")
    ] = 1,
    free: Annotated[float, typer.Option(min=0.0, help="Minutes of free motion of each arm.")] = 1.0,
    seed: Seed = 0,
    workers: Workers = None,
    executor: Executed = "local",
    scheduler: Scheduler = "",
    out: Out = Path("out/press"),
) -> None:
    """Press arms in motion anywhere, felt by joint torques; resumes where it stopped."""
    from contactfusion_lab.experiments.press.experiment import Options, run_press

    options = Options(
        arms=listed(arms),
        forces=force or (10.0, 20.0),
        touches=touches,
        places=places,
        free=free,
        seed=seed,
        executor=_executor(executor, workers, scheduler),
    )
    run_press(options, out)


@experiments.command("push")
def experiment_push(
    sensing: Annotated[
        list[str] | None,
        typer.Option(help="Sensor suite: skin, lidar, rgbd, rule, fused, …; may be repeated."),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            help="Parameter set of reactive_pushing, or a controller; may be repeated; default: "
            "tuned, or that of the preset."
        ),
    ] = None,
    rule: Annotated[
        list[str] | None,
        typer.Option(help="RULE or RULE/CONDENSATION, for every sensor suite; may be repeated."),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(help="A source to leave out, e.g. motion; may be repeated.")
    ] = None,
    lidar: Annotated[str, typer.Option(help="LiDAR of the robot, by name.")] = "",
    camera: Annotated[str, typer.Option(help="Camera of the robot, by name.")] = "",
    weights: Annotated[
        str | None,
        typer.Option(
            help="Weights of the contact networks: a .safetensors file, or contact, paper or "
            "paper_lstm."
        ),
    ] = None,
    objects: Annotated[str, typer.Option(help="Objects, separated by commas.")] = "",
    friction: Annotated[str, typer.Option(help="Friction sets, separated by commas.")] = "mu1,mu2",
    targets: Annotated[
        str,
        typer.Option(
            help="Target set: grid, validation, new, far, random:N (N in total), or a YAML file."
        ),
    ] = "grid",
    starts: Annotated[str, typer.Option(help="Start poses: nominal, random or far.")] = "nominal",
    object_: Annotated[
        list[Path] | None,
        typer.Option("--object", help="A URDF or YAML file of an object; may be repeated."),
    ] = None,
    taxels: Annotated[
        int, typer.Option(min=2, max=240, help="Number of taxels on the front of the skin.")
    ] = 12,
    activation: Annotated[
        float, typer.Option(min=0.0, help="Activation threshold of a taxel [N].")
    ] = 1.0,
    noise: Annotated[
        str,
        typer.Option(
            help="Sensor noise: none, prototype, hard, or prototype+PART+… with parts of hard."
        ),
    ] = "prototype",
    faults: Faults = None,
    preset: PresetName = "",
    seed: Seed = 0,
    workers: Workers = None,
    executor: Executed = "local",
    scheduler: Scheduler = "",
    record: Annotated[
        list[str] | None,
        typer.Option(help="A trial to film, e.g. box-mu1-grid-007; may be repeated."),
    ] = None,
    out: Out = Path("out/push"),
) -> None:
    """Push objects to targets in simulation by contact feedback; resumes where it stopped."""
    from contactfusion_lab.experiments.push.experiment import Options, run_push
    from contactfusion_lab.scenes.push.config import SkinConfig

    options = Options(
        sensings=sensing or ["skin"],
        controllers=controller or [preset or "tuned"],
        rules=rule or (),
        without=without or (),
        lidar=lidar,
        camera=camera,
        weights=weights,
        preset=_preset(preset),
        objects=listed(objects),
        files=object_ or (),
        frictions=listed(friction),
        targets=targets,
        starts=starts,
        taxels=taxels,
        skin=SkinConfig(activation=activation),
        noise=noise,
        faults=faults,
        seed=seed,
        executor=_executor(executor, workers, scheduler),
        record=record or (),
    )
    run_push(options, out)


@experiments.command("grasp")
def experiment_grasp(
    config: Annotated[
        Path | None,
        typer.Option(help="Configuration (YAML), with a scene of type grasp and objects."),
    ] = None,
    objects: Annotated[
        str,
        typer.Option(help="Objects of the configuration, separated by commas; default: the first."),
    ] = "",
    repeats: Annotated[int, typer.Option(min=1, help="Grasps per object.")] = 20,
    sources: Annotated[
        list[str] | None,
        typer.Option(
            help="Generators by name or type, e.g. wrist+motion; none; all; may be repeated."
        ),
    ] = None,
    rule: Annotated[
        list[str] | None,
        typer.Option(help="RULE, RULE/CONDENSATION or de_morgan_tuned; may be repeated."),
    ] = None,
    noise: Noise = None,
    faults: Faults = None,
    seed: Seed = 0,
    workers: Workers = None,
    executor: Executed = "local",
    scheduler: Scheduler = "",
    record: Annotated[
        list[str] | None, typer.Option(help="A grasp to film, e.g. bottle-003; may be repeated.")
    ] = None,
    out: Out = Path("out/grasp"),
) -> None:
    """Grasp objects in simulation by contact feedback; resumes where it stopped."""
    from contactfusion_lab.experiments.grasp.experiment import Options, run_grasp
    from contactfusion_lab.experiments.grasp.plan import DEFAULT
    from contactfusion_lab.experiments.methods import Method

    options = Options(
        config=config or DEFAULT,
        objects=listed(objects),
        repeats=repeats,
        sources=sources or (),
        rules=[Method.named(name) for name in rule or ()],
        noise=noise,
        faults=faults,
        seed=seed,
        executor=_executor(executor, workers, scheduler),
        record=record or (),
    )
    run_grasp(options, out)
