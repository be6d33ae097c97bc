"""Generators that raise, exit, block, leak and die beside a healthy one, here and isolated."""

import csv
import os
from collections.abc import Iterator
from pathlib import Path

from tests.misbehaving import write_distribution
from tests.test_cli import RUN
from tests.torture.trial import Row, command

ODD = ("raises", "exits", "huge", "leaks", "dies", "hangs")
FATAL = ("dies", "hangs")
"""In this process they end or hold the whole of it."""
LENGTH = 300
"""Number of wrenches."""


def plugins(folder: Path) -> Iterator[Row]:
    """Run a log with each beside a healthy generator, whose contacts stay."""
    made = folder / "plugins"
    made.mkdir(exist_ok=True)
    write_distribution(made)
    rows = [f"{n / 100:.2f},0,0,-5,0,0,0" for n in range(LENGTH)]
    (made / "wrist.csv").write_text("\n".join(["t,fx,fy,fz,tx,ty,tz", *rows]) + "\n")
    path = os.pathsep.join([str(made.resolve()), os.getcwd(), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}

    def contacts(odd: str) -> tuple[list[list[str]], str]:
        """The contacts of a run, and what is wrong with how it ended."""
        (made / "run.yaml").write_text(RUN.replace("generators:\n", f"generators:\n{odd}"))
        out = made / "contacts.csv"
        done = command("run", made / "run.yaml", "--out", out, environment=environment)
        with out.open(encoding="utf-8") as file:
            rows = [
                [cell for name, cell in row.items() if name != "shares"]
                for row in csv.DictReader(file)
            ]
        out.unlink()
        return rows, done.fault

    alone, _ = contacts("")
    for where, options in (("here", ""), ("isolated", ", isolate: true, patience: 1")):
        found = []
        for name in ODD:
            if where == "here" and name in FATAL:
                continue
            beside, fault = contacts(f"  odd: {{type: {name}{options}}}\n")
            found.append(fault and f"{name}: {fault}")
            if not fault and beside != alone:
                found[-1] = f"{name}: other contacts than without it"
        yield Row.of(f"generators that break their contract, {where}", found)
