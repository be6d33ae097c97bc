"""The push as it goes on, in the terminal: live where it is one, else a line every two seconds."""

from collections.abc import Iterable, Iterator
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from contactfusion_lab.demo.moments import Moment, sources_of
from contactfusion_lab.demo.scene import DIES

EVERY = 2.0
"""Between two lines [s]."""
DEAF = 0.05
"""A skin that told something within this is well [s]."""
BAR = 30
"""A share of 1 is so long [characters]."""
COLOURS = {"skin": "dark_orange3", "lidar": "dodger_blue1", "motion": "green3"}


def told(moments: Iterable[Moment], console: Console) -> Iterator[Moment]:
    """Pass moments on, and tell them.

    Args:
        moments: of the push.
        console: where to.
    """
    if not console.is_terminal:
        yield from _lines(moments, console)
        return
    with Live(console=console, auto_refresh=False) as live:
        for moment in moments:
            live.update(_table(moment), refresh=True)
            yield moment


def line(moment: Moment) -> str:
    """Give a moment in one line."""
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


def _print(console: Console, text: str) -> None:
    console.print(text, soft_wrap=True, markup=False, highlight=False)


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
    place = f"{abs(moment.touch.lateral) * 100.0:.1f} cm {side} of the middle"
    return f"{moment.touch.kind} {place}, likelihood {moment.touch.likelihood:.2f}"


def _health(moment: Moment) -> str:
    return "well" if moment.silent < DEAF else f"silent for {moment.silent:.1f} s"
