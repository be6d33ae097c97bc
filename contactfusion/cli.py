"""The command line. Heavy modules are imported by the command that needs them."""

import os
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from contactfusion.errors import ConfigurationError, ContactFusionError

app = typer.Typer(
    name="contactfusion",
    help="Where does the robot touch the world? Fuses contact hypotheses from any sensors.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
experiment = typer.Typer(
    name="experiment", help="Run an experiment: results.csv, summary.json, figures.",
    no_args_is_help=True,
)  # fmt: skip
app.add_typer(experiment)
tune = typer.Typer(
    name="tune", help="Search parameters in simulation, and confirm what was found.",
    no_args_is_help=True,
)  # fmt: skip
app.add_typer(tune)
train = typer.Typer(
    name="train", help="Train networks in simulation, from nothing.", no_args_is_help=True,
)  # fmt: skip
app.add_typer(train)

Out = Annotated[Path, typer.Option(help="The folder that takes the results.")]


@app.command()
def demo(out: Out = Path("out/demo")) -> None:
    """Push a box with skin and LiDAR; the skin dies half-way: a page, a film, a recording."""
    from contactfusion.demo.run import show

    show(out)


@app.command()
def run(
    configuration: Annotated[Path, typer.Argument(help="A YAML file with `recording` or `scene`.")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Change a field, e.g. integrator.timeout=1.")
    ] = None,
    out: Out = Path("out/run"),
    seed: Annotated[int | None, typer.Option(help="Of chance, in place of the file's.")] = None,
) -> None:
    """Run a pipeline on a recording or in a scene: contacts.csv and summary.json."""
    from contactfusion.running import run_file

    run_file(configuration, set_ or [], out, seed)


@app.command()
def record(
    configuration: Annotated[Path, typer.Argument(help="A YAML file with `scene`.")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Change a field, e.g. scene.camera_rate=1.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The MCAP file; default: out/NAME.mcap, named as the scene.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(min=0.0, help="End after so many seconds; default: all of it.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of chance, in place of the file's.")] = None,
) -> None:
    """Record what the sensors of a scene read, and the truth, as MCAP."""
    from contactfusion.recording_scene import record_scene

    file = out or Path("out") / f"{configuration.stem}.mcap"
    record_scene(configuration, set_ or [], file, seed, duration)


@app.command()
def replay(
    configuration: Annotated[Path, typer.Argument(help="A YAML file of a pipeline.")],
    recording: Annotated[
        Path, typer.Argument(help="A bag, an MCAP, a folder of them, C3D, a YAML that describes.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Takes the contacts: .mcap (with all topics), .csv, .parquet"),
    ] = None,
    topic: Annotated[
        list[str] | None, typer.Option(help="ROLE=/NAME: which topic feeds a generator; several.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Change a field, e.g. integrator.timeout=1.")
    ] = None,
    start: Annotated[float, typer.Option(min=0.0, help="Begin so many seconds late.")] = 0.0,
    duration: Annotated[float | None, typer.Option(min=0.0, help="Play so many seconds.")] = None,
    rate: Annotated[
        float | None,
        typer.Option(min=1e-3, help="So many times as fast as recorded; default: at full speed."),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Look at it when it is played.")] = False,
) -> None:
    """Find contacts in a recording, and tell what came and what is missing."""
    from contactfusion.replaying.replay import Options
    from contactfusion.replaying.replay import replay as play
    from contactfusion.replaying.session import Window

    window = Window(start, duration)
    options = Options(configuration, recording, set_ or [], _roles(topic), window, rate, out)
    if view:
        from contactfusion.replaying.watching import replay_and_show

        replay_and_show(options)
    else:
        play(options)


Configured = Annotated[
    Path | None,
    typer.Option("--config", help="A YAML file; default: what `replay` left in the recording."),
]
Topics = Annotated[
    list[str] | None, typer.Option(help="ROLE=/NAME: which topic feeds a generator; several.")
]
Changed = Annotated[
    list[str] | None, typer.Option("--set", help="Change a field, e.g. integrator.timeout=1.")
]


@app.command()
def explain(
    recording: Annotated[Path, typer.Argument(help="A recording.")],
    time: Annotated[float, typer.Option(help="When, in seconds from its beginning.")],
    at: Annotated[str, typer.Option(help="Where, as x,y,z in metres; default: everywhere.")] = "",
    config: Configured = None,
    topic: Topics = None,
    set_: Changed = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    picture: Annotated[Path | None, typer.Option(help="Draw it: the PNG to write.")] = None,
) -> None:
    """Tell why there is a contact, or why there is none."""
    from contactfusion.replaying.asking import Source, explain_recording

    source = Source(recording, config, _roles(topic), set_ or [])
    explain_recording(source, time, _place(at), json, picture)


@app.command()
def ablate(
    recording: Annotated[Path, typer.Argument(help="A recording.")],
    config: Configured = None,
    topic: Topics = None,
    set_: Changed = None,
    out: Out = Path("out/ablate"),
) -> None:
    """Tell what contacts would be without each source, over a whole recording."""
    from contactfusion.replaying.asking import Source, ablate_recording

    ablate_recording(Source(recording, config, _roles(topic), set_ or []), out)


@app.command()
def view(
    recording: Annotated[Path, typer.Argument(help="A recording, or an .rrd that was saved.")],
    config: Configured = None,
    topic: Topics = None,
    set_: Changed = None,
    screenshot: Annotated[
        Path | None, typer.Option(help="Take a picture, without a screen: the PNG to write.")
    ] = None,
    at: Annotated[float | None, typer.Option(help="The picture's time; default: the end.")] = None,
    web: Annotated[bool, typer.Option("--web", help="In a browser of this machine.")] = False,
    save: Annotated[
        Path | None, typer.Option(help="Keep what is drawn: the .rrd to write.")
    ] = None,
) -> None:
    """Look at a recording, its contacts and their reasons, in 3D."""
    from contactfusion.replaying.asking import Source
    from contactfusion.replaying.watching import view_recording

    source = Source(recording, config, _roles(topic), set_ or [])
    view_recording(source, save, screenshot, at, web)


@app.command()
def plugins(
    name: Annotated[str | None, typer.Argument(help="Show the options of this one.")] = None,
    strict: Annotated[bool, typer.Option(help="Import all; fail if one cannot be used.")] = False,
) -> None:
    """List the installed plug-ins, or the options of one."""
    from contactfusion.listing import describe_plugin, list_plugins

    if name is None:
        list_plugins(strict)
    else:
        describe_plugin(name)


@app.command()
def doctor(
    robot: Annotated[
        str | None, typer.Argument(help="Look over this ROBOT.yaml, not the installation.")
    ] = None,
    warm: Annotated[bool, typer.Option(help="Compile the kernels now.")] = False,
    out: Annotated[Path | None, typer.Option(help="Draw the robot: the PNG to write.")] = None,
    recording: Annotated[
        Path | None, typer.Option(help="Weigh what wrists carry: wrenches at rest, and joints.")
    ] = None,
    ouster: Annotated[
        bool, typer.Option(help="Make the environment that converts Ouster files.")
    ] = False,
) -> None:
    """Check the installation, or a robot's description, and say what to mend."""
    if robot is not None:
        from contactfusion.robots.checkup import check_robot

        if not check_robot(robot, out, recording):
            raise typer.Exit(1)
        return
    from contactfusion.doctor import check, compile_kernels

    if out or recording:
        raise ConfigurationError("name the ROBOT.yaml that --out and --recording are for")
    if ouster:
        from contactfusion.recordings.ouster import make_environment

        make_environment()
    elif warm:
        compile_kernels()
    elif not check():
        raise typer.Exit(1)


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="An Ouster .pcap, .osf, or bag of packets.")],
    out: Annotated[Path, typer.Argument(help="The MCAP file to write.")],
    every_nth_row: Annotated[
        int, typer.Option(min=1, help="Keep these rings only, from the first on.")
    ] = 1,
    meta: Annotated[
        Path | None, typer.Option(help="The sensor's .json, when it is not beside the file.")
    ] = None,
) -> None:
    """Convert an Ouster file to MCAP: one PointCloud2 a scan; first run `doctor --ouster`."""
    from contactfusion.recordings import ouster

    print(ouster.convert(source, out, every_nth_row, meta))


@experiment.command("recordings")
def experiment_recordings(
    data: Annotated[Path | None, typer.Option(help="The folder of the real recordings.")] = None,
    rule: Annotated[
        str | None, typer.Option(help="RULE or RULE/CONDENSATION; default: each recording's own.")
    ] = None,
    out: Out = Path("out/recordings"),
) -> None:
    """Locate contacts in real recordings whose truth is known."""
    from contactfusion.experiments.methods import Method
    from contactfusion.experiments.recordings import run_recordings

    run_recordings(data, Method.named(rule) if rule else None, out)


@experiment.command("touch")
def experiment_touch(
    config: Annotated[
        Path | None, typer.Option(help="A YAML file as for `run`, with a scene of type touch.")
    ] = None,
    objects: Annotated[
        str, typer.Option(help="Objects of the scene, or URDF or mesh files; with commas between.")
    ] = "",
    directions: Annotated[int, typer.Option(min=1, help="How many directions to come from.")] = 15,
    repeats: Annotated[int, typer.Option(min=1, help="How often from each.")] = 5,
    rule: Annotated[
        list[str] | None, typer.Option(help="RULE or RULE/CONDENSATION; several; default: all.")
    ] = None,
    spreads: Annotated[
        list[float] | None,
        typer.Option(help="Fuse once more with stated spreads multiplied by this; several."),
    ] = None,
    noise: Annotated[
        str | None, typer.Option(help="none, prototype or full; default: the scene's, prototype.")
    ] = None,
    faults: Annotated[Path | None, typer.Option(help="A YAML file of faults.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all chance.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="How many processes.")] = 2,
    draw: Annotated[
        list[str] | None, typer.Option(help="Draw this touch, such as box-03-0; several.")
    ] = None,
    out: Out = Path("out/touch"),
) -> None:
    """Touch objects in simulation, compare contacts with the truth; goes on where it stopped."""
    from contactfusion.experiments.methods import Method
    from contactfusion.experiments.touch.experiment import METHODS, Options, run_touch
    from contactfusion.experiments.touch.plan import DEFAULT

    options = Options(
        config=config or DEFAULT,
        objects=[name.strip() for name in objects.split(",") if name.strip()],
        directions=directions,
        repeats=repeats,
        methods=[Method.named(name) for name in rule] if rule else METHODS,
        spreads=spreads or (),
        noise=noise,
        faults=faults,
        seed=seed,
        workers=workers,
        draw=draw or (),
    )
    run_touch(options, out)


@experiment.command("push")
def experiment_push(
    sensing: Annotated[
        list[str] | None,
        typer.Option(help="What feels the object: skin, lidar, rgbd, rule, fused, …; several."),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(help="Parameters of reactive_pushing, or a controller; several."),
    ] = None,
    rule: Annotated[
        list[str] | None,
        typer.Option(help="RULE or RULE/CONDENSATION, for every sensing; several."),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(help="Leave out this source, such as motion; several.")
    ] = None,
    lidar: Annotated[str, typer.Option(help="Use this LiDAR of the robot.")] = "",
    camera: Annotated[str, typer.Option(help="Use this camera of the robot.")] = "",
    weights: Annotated[
        Path | None, typer.Option(help="Use these contact networks (.safetensors).")
    ] = None,
    objects: Annotated[str, typer.Option(help="Names; with commas between.")] = "",
    friction: Annotated[str, typer.Option(help="Names; with commas between.")] = "mu1,mu2",
    targets: Annotated[
        str, typer.Option(help="grid, validation, new, random:N (N in all), or a YAML file.")
    ] = "grid",
    starts: Annotated[str, typer.Option(help="nominal or random.")] = "nominal",
    object_: Annotated[
        list[Path] | None, typer.Option("--object", help="A URDF or YAML file; several.")
    ] = None,
    taxels: Annotated[int, typer.Option(min=2, max=240, help="Of the skin's front.")] = 12,
    activation: Annotated[
        float, typer.Option(min=0.0, help="A taxel pressed by less tells nothing, in N.")
    ] = 1.0,
    faults: Annotated[Path | None, typer.Option(help="A YAML file of how sensors fail.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all chance.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="How many processes.")] = 2,
    record: Annotated[
        list[str] | None, typer.Option(help="Film this trial, such as box-mu1-grid-007; several.")
    ] = None,
    out: Out = Path("out/push"),
) -> None:
    """Push objects to targets in simulation by what is felt; goes on where it stopped."""
    from contactfusion.experiments.push.experiment import Options, run_push
    from contactfusion.simulation.push_config import SkinConfig

    options = Options(
        sensings=sensing or ["skin"],
        controllers=controller or ["tuned"],
        rules=rule or (),
        without=without or (),
        lidar=lidar,
        camera=camera,
        weights=weights,
        objects=_listed(objects),
        files=object_ or (),
        frictions=_listed(friction),
        targets=targets,
        starts=starts,
        taxels=taxels,
        skin=SkinConfig(activation=activation),
        faults=faults,
        seed=seed,
        workers=workers,
        record=record or (),
    )
    run_push(options, out)


@experiment.command("grasp")
def experiment_grasp(
    config: Annotated[
        Path | None, typer.Option(help="A YAML file with a scene of type grasp, and objects.")
    ] = None,
    objects: Annotated[
        str, typer.Option(help="Objects of the file; with commas between; default: the first.")
    ] = "",
    repeats: Annotated[int, typer.Option(min=1, help="How often each is grasped.")] = 20,
    sources: Annotated[
        list[str] | None,
        typer.Option(help="Names or types of generators, as wrist+motion; none; all; several."),
    ] = None,
    rule: Annotated[
        list[str] | None, typer.Option(help="RULE or RULE/CONDENSATION; several.")
    ] = None,
    noise: Annotated[
        str | None, typer.Option(help="none, prototype or full; default: the scene's, prototype.")
    ] = None,
    faults: Annotated[Path | None, typer.Option(help="A YAML file of faults.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all chance.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="How many processes.")] = 2,
    record: Annotated[
        list[str] | None, typer.Option(help="Film this grasp, such as bottle-003; several.")
    ] = None,
    out: Out = Path("out/grasp"),
) -> None:
    """Grasp objects in simulation by what the hand feels; goes on where it stopped."""
    from contactfusion.experiments.grasp.experiment import Options, run_grasp
    from contactfusion.experiments.grasp.plan import DEFAULT
    from contactfusion.experiments.methods import Method

    options = Options(
        config=config or DEFAULT,
        objects=_listed(objects),
        repeats=repeats,
        sources=sources or (),
        rules=[Method.named(name) for name in rule or ()],
        noise=noise,
        faults=faults,
        seed=seed,
        workers=workers,
        record=record or (),
    )
    run_grasp(options, out)


@tune.command("push")
def tune_push(
    start: Annotated[str, typer.Option(help="The set of parameters to begin with.")] = "tuned",
    trials: Annotated[int, typer.Option(min=6, help="Pushes of each set in a round.")] = 60,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of 24 sets.")] = 10,
    confirm: Annotated[
        int, typer.Option(min=6, help="Pushes in PyBullet of each set that is confirmed.")
    ] = 150,
    check: Annotated[
        bool, typer.Option(help="Compare the planar model's ranking with PyBullet's instead.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of all that is drawn.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="How many processes.")] = 2,
    out: Out = Path("out/tune"),
) -> None:
    """Search parameters of reactive pushing in a planar model; goes on where it stopped."""
    if check:
        from contactfusion.tuning.check import check_ranking

        check_ranking(trials, seed, workers, out)
        return
    from contactfusion.tuning.push import Options
    from contactfusion.tuning.push import tune_push as search

    search(Options(seed, trials, rounds, confirm, start, workers), out)


@tune.command("fusion")
def tune_fusion(
    recording: Annotated[Path, typer.Argument(help="A recording.")],
    labels: Annotated[
        Path, typer.Option(help="A CSV of true contacts: start, end, x, y, z (s, m).")
    ],
    config: Configured = None,
    topic: Topics = None,
    set_: Changed = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(help="FIELD=VALUE,VALUE,…; several; default: threshold, timeout and others."),
    ] = None,
    within: Annotated[
        float, typer.Option(min=0.0, help="So near to a label a contact is right, in metres.")
    ] = 0.03,
    out: Out = Path("out/tune_fusion"),
) -> None:
    """Find the values that find labelled contacts best; goes on where it stopped."""
    from contactfusion.replaying.asking import Source, tune_recording

    source = Source(recording, config, _roles(topic), set_ or [])
    tune_recording(source, labels, vary or [], within, out)


@train.command("cpm")
def train_cpm(
    rounds: Annotated[
        int, typer.Option(min=0, help="How often the networks drive, and learn from it.")
    ] = 3,
    varied: Annotated[int, typer.Option(min=0, help="Pushes beside the paper's 156 + 36.")] = 360,
    driven: Annotated[int, typer.Option(min=7, help="Pushes of each round.")] = 160,
    tested: Annotated[int, typer.Option(min=6, help="Pushes of the test, each LiDAR.")] = 60,
    epochs: Annotated[int, typer.Option(min=1, help="Of the last round.")] = 150,
    early: Annotated[int, typer.Option(min=1, help="Of the rounds before.")] = 50,
    stride: Annotated[int, typer.Option(min=1, help="An epoch sees every so-manieth window.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Of all chance.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="How many processes.")] = 2,
    out: Out = Path("out/cpm"),
) -> None:
    """Train the networks that perceive contact; goes on where it stopped."""
    from contactfusion.learning.cpm import Options
    from contactfusion.learning.cpm import train_cpm as train_networks

    options = Options(rounds, varied, driven, tested, epochs, early, stride, seed, workers)
    train_networks(options, out)


def _assigned(text: str, option: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise ConfigurationError(f"{option} takes {form}, not '{text}'")
    return name, value


def _roles(topics: list[str] | None) -> dict[str, str]:
    return dict(_assigned(one, "--topic", "ROLE=/NAME") for one in topics or [])


def _place(text: str) -> tuple[float, ...] | None:
    try:
        return tuple(float(part) for part in text.split(",")) if text else None
    except ValueError:
        raise ConfigurationError(f"--at takes x,y,z in metres, not '{text}'") from None


def _listed(names: str) -> list[str]:
    return [name.strip() for name in names.split(",") if name.strip()]


def main() -> None:
    """Run the command line; an error is one sentence, never a traceback."""
    # products here are small: threads of the linear algebra would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what is whole is kept
    try:
        app()
    except ContactFusionError as error:
        print(f"contactfusion: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
