"""The commands `tune` and `train`."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Changed, Configured, Ignored, Out, Topics, roles
from contactfusion.cli.plugin_commands import PluginGroup

tune = typer.Typer(
    name="tune", help="Search parameters, and confirm the best.",
    no_args_is_help=True, cls=PluginGroup,
)  # fmt: skip
train = typer.Typer(
    name="train", help="Train networks in simulation, from scratch.", no_args_is_help=True,
)  # fmt: skip


@tune.command("push")
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
    seed: Annotated[int, typer.Option(min=0, help="Random seed.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes.")] = 2,
    out: Out = Path("out/tune"),
) -> None:
    """Search parameters of reactive pushing in a planar model; resumes where it stopped."""
    if check:
        from contactfusion.tuning.check import check_ranking

        check_ranking(trials, seed, workers, out)
        return
    from contactfusion.tuning.push import Options
    from contactfusion.tuning.push import tune_push as search

    search(Options(seed, trials, rounds, confirm, start, workers), out)


@tune.command("fusion")
def tune_fusion(
    recording: Annotated[Path, typer.Argument(help="A recording as for `replay`.")],
    labels: Annotated[
        Path, typer.Option(help="CSV of true contacts: start, end \\[s], x, y, z \\[m].")
    ],
    config: Configured = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            help="FIELD=VALUE,VALUE,…; may be repeated; default: threshold, timeout and others."
        ),
    ] = None,
    within: Annotated[
        float,
        typer.Option(min=0.0, help="Largest distance of a correct contact from its label \\[m]."),
    ] = 0.03,
    out: Out = Path("out/tune_fusion"),
) -> None:
    """Find the parameters that detect labelled contacts best; resumes where it stopped."""
    from contactfusion.replaying.asking import Source, tune_recording

    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
    tune_recording(source, labels, vary or [], within, out)


@train.command("cpm")
def train_cpm(
    rounds: Annotated[
        int, typer.Option(min=0, help="DAgger iterations: the networks drive, and learn from it.")
    ] = 3,
    varied: Annotated[
        int, typer.Option(min=0, help="Training pushes beside the paper's 156 + 36.")
    ] = 360,
    driven: Annotated[int, typer.Option(min=7, help="Pushes per iteration.")] = 160,
    tested: Annotated[int, typer.Option(min=6, help="Test pushes per LiDAR.")] = 60,
    epochs: Annotated[int, typer.Option(min=1, help="Epochs of the last iteration.")] = 150,
    early: Annotated[int, typer.Option(min=1, help="Epochs of the iterations before.")] = 50,
    stride: Annotated[int, typer.Option(min=1, help="An epoch uses every N-th window.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Random seed.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes.")] = 2,
    out: Out = Path("out/cpm"),
) -> None:
    """Train the networks that perceive contact; resumes where it stopped."""
    from contactfusion.learning.cpm import Options
    from contactfusion.learning.cpm import train_cpm as train_networks

    options = Options(rounds, varied, driven, tested, epochs, early, stride, seed, workers)
    train_networks(options, out)
