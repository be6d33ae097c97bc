"""The commands `tune`."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Changed, Configured, Ignored, Out, Topics, roles
from contactfusion.cli.plugin_commands import PluginGroup

tune = typer.Typer(
    name="tune", help="Search parameters, and confirm the best.",
    no_args_is_help=True, cls=PluginGroup,
)  # fmt: skip


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
    from contactfusion.run.asking import Source, tune_recording

    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
    tune_recording(source, labels, vary or [], within, out)
