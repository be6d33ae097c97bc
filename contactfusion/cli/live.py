"""Commands of a pipeline that runs on a robot."""

import shlex
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import (
    Changed,
    Domain,
    Ignored,
    JoinedBy,
    Ros,
    Topics,
    joined,
    roles,
)
from contactfusion.terminal import say


def live(
    configuration: Annotated[Path, typer.Argument(help="The configuration (YAML).")],
    set_: Changed = None,
    topic: Topics = None,
    ignore: Ignored = None,
    ros: JoinedBy = Ros.DDS,
    domain: Domain = None,
    name: Annotated[
        str | None, typer.Option(help="What `ctl` calls it; default: the name of the file.")
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(help="The MCAP file that takes all that comes; `run` plays it as it was."),
    ] = None,
    wait: Annotated[
        float,
        typer.Option(min=0.0, help="Longest wait for missing topics, before it starts \\[s]."),
    ] = 5.0,
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Take the time from /clock, as of a simulation.")
    ] = False,
    web: Annotated[
        str | None,
        typer.Option(
            metavar="[HOST:]PORT", help="Serve a page that shows it; default of HOST: 127.0.0.1."
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Open that page in a browser of this machine.")
    ] = False,
    duration: Annotated[
        float | None, typer.Option(min=0.0, help="End after so long \\[s]; default: by Ctrl-C.")
    ] = None,
) -> None:
    """Find contacts on a running robot: ROS 2 topics in, contacts and commands out."""
    from contactfusion.live.page import Address
    from contactfusion.live.run import run_live

    run_live(
        configuration,
        partial(joined, ros, domain),
        overrides=set_ or [],
        topics=roles(topic),
        ignored=ignore or [],
        name=name,
        record=record,
        wait=wait,
        duration=duration,
        sim_time=sim_time,
        web=None if web is None else Address.of(web),
        view=view,
    )


def ctl(
    order: Annotated[
        list[str],
        typer.Argument(
            help="status, threshold VALUE, plug NAME [OPTION=VALUE]…, unplug NAME, tare NAME, "
            "restart NAME, isolate NAME, record start [FILE.mcap], or record stop."
        ),
    ],
    name: Annotated[
        str | None, typer.Option(help="What runs, by its name; default: the only one.")
    ] = None,
) -> None:
    """Change what `contactfusion live` runs, or ask how it does."""
    from contactfusion.live.control import ask

    say(ask(shlex.join(order), name), lines=True)
