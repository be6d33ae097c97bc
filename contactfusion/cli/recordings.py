"""Commands on recordings."""

import math
from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import (
    RECORDING,
    Changed,
    Configured,
    Ignored,
    Out,
    Topics,
    roles,
)
from contactfusion.errors import ConfigurationError
from contactfusion.terminal import say

FURTHEST, SHOWN = 1000.0, 80
"""The greatest coordinate of a place [m], and so much of what was given is shown [characters]."""
REPLAYED = (
    f"{RECORDING[:-1]}; of a run's output, or of a configuration that names its recording, no "
    "--config is needed."
)


def inspect(
    recording: Annotated[Path, typer.Argument(help=f"{RECORDING[:-1]}; or the log (CSV, …).")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show what a recording holds: topics, rates, frames, clocks, and what each can be used for."""
    from contactfusion.inspect import inspection, log_columns
    from contactfusion.recordings.opening import DESCRIBED

    if recording.suffix.lower() in DESCRIBED:
        table = log_columns.inspect_table(recording)
        say(log_columns.as_json(table) if json else log_columns.as_text(table), lines=True)
    else:
        held = inspection.inspect_recording(recording)
        say(inspection.as_json(held) if json else inspection.as_text(held), lines=True)


def init(
    source: Annotated[
        Path, typer.Argument(help="A recording as for `replay`, a log (CSV, …), or a URDF.")
    ],
    out: Annotated[Path, typer.Option(help="The YAML file to write.")],
    robot: Annotated[
        Path | None, typer.Option(help="The URDF of the robot that was recorded.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
) -> None:
    """Write a first configuration, with comments, for a recording or a robot."""
    from contactfusion.inspect.first_configuration import write_first

    write_first(source, out, robot, force)


def explain(
    recording: Annotated[Path, typer.Argument(help=REPLAYED)],
    time: Annotated[float, typer.Option(help="Time to explain, from the beginning \\[s].")],
    at: Annotated[
        str, typer.Option(help="Position X,Y,Z to explain \\[m]; default: all contacts.")
    ] = "",
    config: Configured = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    picture: Annotated[Path | None, typer.Option(help="PNG to write, with a drawing.")] = None,
) -> None:
    """Explain why there is a contact, or why there is none."""
    from contactfusion.run.asking import Source, explain_recording

    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
    explain_recording(source, time, _place(at), json, picture)


def ablate(
    recording: Annotated[Path, typer.Argument(help=REPLAYED)],
    config: Configured = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
    out: Out = Path("out/ablate"),
) -> None:
    """Ablation: how contacts change without each source, over a whole recording."""
    from contactfusion.run.asking import Source, ablate_recording

    ablate_recording(Source(recording, config, roles(topic), set_ or [], ignore or []), out)


def view(
    recording: Annotated[Path, typer.Argument(help=f"{REPLAYED[:-1]}; or an .rrd file.")],
    config: Configured = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
    screenshot: Annotated[
        Path | None, typer.Option(help="PNG to write, in place of a window; needs no screen.")
    ] = None,
    at: Annotated[
        float | None, typer.Option(help="Time of the screenshot \\[s]; default: the end.")
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Show in a browser on this machine.")] = False,
    save: Annotated[
        Path | None, typer.Option(help=".rrd file to write, for rerun's viewer.")
    ] = None,
) -> None:
    """Show a recording, its contacts and their sources in 3D."""
    from contactfusion.run.asking import Source
    from contactfusion.run.watching import view_recording

    if recording.suffix == ".rrd" and (config or topic or ignore or set_ or save):
        raise ConfigurationError(
            f"{recording} is drawn already: --config, --topic, --ignore, --set and --save are for "
            "recordings"
        )
    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
    view_recording(source, save, screenshot, at, web)


def _place(text: str) -> tuple[float, ...] | None:
    try:
        place = tuple(float(part) for part in text.split(",")) if text else None
    except ValueError:
        place = (math.nan,)
    if place and not all(abs(each) <= FURTHEST for each in place):
        raise ConfigurationError(
            f"--at takes x,y,z in metres, within {FURTHEST:g}, not '{text[:SHOWN]}'"
        )
    return place
