"""Commands on recordings."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Changed, Configured, Ignored, Out, Topics, roles
from contactfusion.errors import ConfigurationError


def replay(
    configuration: Annotated[Path, typer.Argument(help="A YAML file of a pipeline.")],
    recording: Annotated[
        Path, typer.Argument(help="A bag, an MCAP, a folder of them, C3D, a YAML that describes.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Takes the contacts: .mcap (with all topics), .csv, .parquet"),
    ] = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
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
    options = Options(
        configuration, recording, set_ or [], roles(topic), window, rate, out, ignore or []
    )
    if view:
        from contactfusion.replaying.watching import replay_and_show

        replay_and_show(options)
    else:
        play(options)


def explain(
    recording: Annotated[Path, typer.Argument(help="A recording.")],
    time: Annotated[float, typer.Option(help="When, in seconds from its beginning.")],
    at: Annotated[str, typer.Option(help="Where, as x,y,z in metres; default: everywhere.")] = "",
    config: Configured = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    picture: Annotated[Path | None, typer.Option(help="Draw it: the PNG to write.")] = None,
) -> None:
    """Tell why there is a contact, or why there is none."""
    from contactfusion.replaying.asking import Source, explain_recording

    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
    explain_recording(source, time, _place(at), json, picture)


def ablate(
    recording: Annotated[Path, typer.Argument(help="A recording.")],
    config: Configured = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
    out: Out = Path("out/ablate"),
) -> None:
    """Tell what contacts would be without each source, over a whole recording."""
    from contactfusion.replaying.asking import Source, ablate_recording

    ablate_recording(Source(recording, config, roles(topic), set_ or [], ignore or []), out)


def view(
    recording: Annotated[Path, typer.Argument(help="A recording, or an .rrd that was saved.")],
    config: Configured = None,
    topic: Topics = None,
    ignore: Ignored = None,
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

    source = Source(recording, config, roles(topic), set_ or [], ignore or [])
    view_recording(source, save, screenshot, at, web)


def _place(text: str) -> tuple[float, ...] | None:
    try:
        return tuple(float(part) for part in text.split(",")) if text else None
    except ValueError:
        raise ConfigurationError(f"--at takes x,y,z in metres, not '{text}'") from None
