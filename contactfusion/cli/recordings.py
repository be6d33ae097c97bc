"""Commands on recordings."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Changed, Configured, Ignored, Out, Topics, roles
from contactfusion.errors import ConfigurationError

RECORDING = "A ROS bag, MCAP, folder of them, C3D, or YAML file that describes a log."
REPLAYED = f"{RECORDING[:-1]}; of a replay's output no --config is needed."


def inspect(
    recording: Annotated[Path, typer.Argument(help=f"{RECORDING[:-1]}; or the log (CSV, …).")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show what a recording holds: topics, rates, frames, clocks, and what each can be used for."""
    from contactfusion.recordings.opening import DESCRIBED
    from contactfusion.replaying import inspection, log_columns

    if recording.suffix in DESCRIBED:
        table = log_columns.inspect_table(recording)
        print(log_columns.as_json(table) if json else log_columns.as_text(table))
    else:
        held = inspection.inspect_recording(recording)
        print(inspection.as_json(held) if json else inspection.as_text(held))


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
    from contactfusion.replaying.first_configuration import write_first

    write_first(source, out, robot, force)


def replay(
    configuration: Annotated[Path, typer.Argument(help="The configuration (YAML).")],
    recording: Annotated[Path | None, typer.Argument(help=RECORDING)] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File for the contacts: .mcap (with all topics), .csv or .parquet."),
    ] = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
    start: Annotated[
        float, typer.Option(min=0.0, help="Time to start at, from the beginning \\[s].")
    ] = 0.0,
    duration: Annotated[
        float | None,
        typer.Option(min=0.0, help="Length of the part to play \\[s]; default: to the end."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=1e-3, help="Speed as a multiple of real time; default: as fast as possible."
        ),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Open the viewer at the end.")] = False,
) -> None:
    """Find contacts in a recording, and report which inputs came and which are missing."""
    from contactfusion.replaying.replay import Options
    from contactfusion.replaying.replay import replay as play
    from contactfusion.replaying.session import Window

    if recording is None:
        raise ConfigurationError(
            f"give the recording after {configuration}, or play the one that it names with "
            f"`contactfusion run {configuration}`"
        )
    window = Window(start, duration)
    options = Options(
        configuration, recording, set_ or [], roles(topic), window, rate, out, ignore or []
    )
    if view:
        from contactfusion.replaying.watching import replay_and_show

        replay_and_show(options)
    else:
        play(options)


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
    from contactfusion.replaying.asking import Source, explain_recording

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
    from contactfusion.replaying.asking import Source, ablate_recording

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
    from contactfusion.replaying.asking import Source
    from contactfusion.replaying.watching import view_recording

    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
    view_recording(source, save, screenshot, at, web)


def _place(text: str) -> tuple[float, ...] | None:
    try:
        return tuple(float(part) for part in text.split(",")) if text else None
    except ValueError:
        raise ConfigurationError(f"--at takes x,y,z in metres, not '{text}'") from None
