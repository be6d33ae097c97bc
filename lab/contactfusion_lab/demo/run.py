"""The demo: a base pushes a box to a target behind it; its skin dies, its LiDAR goes on."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from contactfusion.errors import ContactFusionError, DependencyError
from contactfusion.figures import new_figure
from contactfusion.files import make_folder, write_whole
from contactfusion.pipeline_config import pipeline_fields
from contactfusion.recordings.mcap import McapWriter
from contactfusion.results import (
    COLUMNS,
    COMMAND_COLUMNS,
    command_rows,
    contact_rows,
    table_file,
)
from contactfusion.run.configuration import TOPIC, Setting
from contactfusion.terminal import is_quiet, note, say
from contactfusion_lab.demo.account import Story, sentences, summary
from contactfusion_lab.demo.film import distance_figure, film, lateral_figure, shares_figure
from contactfusion_lab.demo.page import page
from contactfusion_lab.demo.scene import (
    DIES,
    LEARNED,
    Moment,
    as_yaml,
    by_skin_alone,
    push_moments,
    scene_fields,
    sources_of,
)

EVERY = 2.0
"""Time between two lines [s]."""
DEAF = 0.05
"""Age of the skin's last cloud under which it is healthy [s]."""
BAR = 30
"""Length of a share of 1 [characters]."""
COLOURS = {"skin": "dark_orange3", "lidar": "dodger_blue1", "motion": "green3"}


def show(out: Path, lidar: str = LEARNED) -> None:
    """Push, print progress meanwhile, and write a page about it.

    Args:
        out: the folder that takes index.html and all that it links to.
        lidar: the type of the generator that reads the LiDAR.

    Raises:
        ContactFusionError: something that the demo needs is missing, or the box did not arrive.
    """
    make_folder(out)
    new_figure(1.0, 1.0)  # fails now if matplotlib is missing, not after the push
    fields = scene_fields(lidar)
    console = Console()
    console.quiet = is_quiet()
    moments = list(reported(push_moments(fields), console))
    _print(console, "the same push once more, by the skin alone ...")
    story = Story(fields, moments, list(push_moments(by_skin_alone(fields))))
    _print(console, "figures and film ...")
    written = list(write(story, out, console))
    for sentence in sentences(story):
        _print(console, sentence)
    say(f"results: {', '.join(str(out / name) for name in written)}")
    note(f"look at: {out / 'index.html'}")
    if not story.arrived:
        raise ContactFusionError("the box did not arrive at its target")


def write(story: Story, out: Path, console: Console) -> Iterator[str]:
    """Write everything; the page comes last.

    Args:
        story: of the push.
        out: the folder.
        console: receives what could not be written.

    Yields:
        The name of each file.
    """
    tables = {
        "contacts.csv": (COLUMNS, contact_rows),
        "commands.csv": (COMMAND_COLUMNS, command_rows),
    }
    for name, made in tables.items():
        with table_file(out / name, *made) as table:
            for moment in story.moments:
                table.step(moment.step)
    contents: dict[str, str | bytes] = {
        "summary.json": json.dumps(summary(story), indent=2) + "\n",
        "scene.yaml": as_yaml(story.fields),
        "distance.png": distance_figure(story),
        "lateral.png": lateral_figure(story),
        "shares.png": shares_figure(story),
    }
    written = [*tables, *contents, "film.gif", "death.png"]
    for name, content in contents.items():
        write_whole(out / name, content)
    size = film(story, out / "film.gif", out / "death.png")
    try:
        record(story, out / "demo.mcap")
        written.append("demo.mcap")
    except DependencyError as error:
        _print(console, f"no recording: {error}")
    write_whole(out / "index.html", page(story, written, size))
    yield from [*written, "index.html"]


def record(story: Story, path: Path) -> None:
    """Write what arrived from the sensors, contacts, commands and configuration, as ROS 2 does.

    Raises:
        DependencyError: rosbags is not installed.
    """
    setting = pipeline_fields(story.fields)
    setting.pop("faults", None)
    with McapWriter(path) as writer:
        writer.text(TOPIC, Setting(setting, path.parent, {}, path).text(beside=path.parent))
        for moment in story.moments:
            for reading in moment.readings:
                writer.reading(reading)
            writer.step(moment.step)


def _print(console: Console, text: str) -> None:
    console.print(text, soft_wrap=True, markup=False, highlight=False)


def reported(moments: Iterable[Moment], console: Console) -> Iterator[Moment]:
    """The moments, each printed as it passes.

    Args:
        moments: of the push.
        console: to print to.
    """
    if not console.is_terminal:
        yield from _lines(moments, console)
        return
    with Live(console=console, auto_refresh=False) as live:
        for moment in moments:
            live.update(_table(moment), refresh=True)
            yield moment


def line(moment: Moment) -> str:
    """A moment in one line."""
    shares = sorted(moment.shares.items(), key=lambda pair: -pair[1])
    felt = ", ".join(f"{name} {share:.0%}" for name, share in shares if share > 0.0)
    parts = [
        f"{moment.stamp:5.1f} s",
        _left(moment),
        _contact(moment) + (f" by {felt}" if felt else ""),
        f"skin {_health(moment)}",
        f"{moment.mode}: {moment.reason}",
    ]
    return " | ".join(parts)


def _lines(moments: Iterable[Moment], console: Console) -> Iterator[Moment]:
    due, mode, died = 0.0, "", False
    for moment in moments:
        if moment.stamp >= DIES and not died:
            died = True
            _print(console, f"{moment.stamp:5.1f} s | --- the skin falls silent ---")
        if moment.stamp >= due or moment.mode != mode or moment.ending is not None:
            _print(console, line(moment))
            due = moment.stamp + EVERY - 1e-6
        mode = moment.mode
        yield moment


def _table(moment: Moment) -> Table:
    rows: list[tuple[str, Any]] = [
        ("time", f"{moment.stamp:.1f} s"),
        ("target", _left(moment)),
        ("contact", _contact(moment)),
    ]
    for source in sources_of(moment):
        share, colour = moment.shares.get(source, 0.0), COLOURS.get(source, "white")
        bar = "█" * round(share * BAR)
        rows.append((f"  by {source}", f"[{colour}]{bar:{BAR}}[/] {share:4.0%}"))
    health = _health(moment)
    rows.append(("skin", health if health == "well" else f"[bold red]{health}[/]"))
    rows.append(("controller", f"{moment.mode}: {moment.reason}"))
    table = Table.grid(padding=(0, 2))
    for name, value in rows:
        table.add_row(f"[dim]{name}[/]", value)
    return table


def _left(moment: Moment) -> str:
    return f"{moment.left:.2f} m to go" if moment.touch else "far from it: no contact"


def _contact(moment: Moment) -> str:
    if moment.touch is None:
        return "no contact"
    side = "left" if moment.touch.lateral > 0.0 else "right"
    position = f"{abs(moment.touch.lateral) * 100.0:.1f} cm {side} of the middle"
    return f"{moment.touch.kind} {position}, likelihood {moment.touch.likelihood:.2f}"


def _health(moment: Moment) -> str:
    return "well" if moment.silent < DEAF else f"silent for {moment.silent:.1f} s"
