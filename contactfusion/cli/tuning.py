"""The commands `tune` and `train`."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Changed, Configured, Ignored, Out, Topics, roles

tune = typer.Typer(
    name="tune", help="Search parameters in simulation, and confirm what was found.",
    no_args_is_help=True,
)  # fmt: skip
train = typer.Typer(
    name="train", help="Train networks in simulation, from nothing.", no_args_is_help=True,
)  # fmt: skip


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
    ignore: Ignored = None,
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

    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
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
