"""The commands `experiment`."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Out, listed

experiments = typer.Typer(
    name="experiment", help="Run an experiment: results.csv, summary.json, figures.",
    no_args_is_help=True,
)  # fmt: skip


@experiments.command("recordings")
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


@experiments.command("touch")
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
        objects=listed(objects),
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


@experiments.command("push")
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
        objects=listed(objects),
        files=object_ or (),
        frictions=listed(friction),
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


@experiments.command("grasp")
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
        objects=listed(objects),
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
