"""All of it, section by section, as a table: `make torture`.

    python -m tests.torture [SECTION ...] [--out DIR]

What is made is kept, so it goes on where it was stopped.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path

from contactfusion.files import write_whole
from tests.torture.faults import clocks, faults
from tests.torture.kills import COMMANDS, kills
from tests.torture.life import cycles, many, plugs
from tests.torture.live import live_faults, live_kills, live_stops
from tests.torture.plugins import plugins
from tests.torture.trial import Row
from tests.torture.wants import wants

SECTIONS: Mapping[str, Callable[[Path], Iterator[Row]]] = {
    "many": many,
    "wants": wants,
    "faults": faults,
    "clocks": clocks,
    "plugins": plugins,
    "plugs": plugs,
    "live faults": live_faults,
    "live stops": live_stops,
    "live kills": live_kills,
    "cycles": cycles,
    **{f"kills of {name}": partial(kills, names=[name]) for name in COMMANDS},
}


def main() -> int:
    """Make the sections that are not made yet; 1 where anything did not survive."""
    parser = argparse.ArgumentParser(prog="python -m tests.torture", description=__doc__)
    parser.add_argument("sections", nargs="*", help=f"of {', '.join(SECTIONS)}; default: all")
    parser.add_argument("--out", type=Path, default=Path("out/torture"))
    options = parser.parse_args()
    if unknown := [name for name in options.sections if name not in SECTIONS]:
        parser.error(f"unknown {', '.join(unknown)}; there are {', '.join(SECTIONS)}")
    options.out.mkdir(parents=True, exist_ok=True)
    rows = list[Row]()
    for name in options.sections or SECTIONS:
        kept = options.out / f"{name.replace(' ', '_')}.json"
        if not kept.exists():
            began = time.monotonic()
            made = [asdict(row) for row in SECTIONS[name](options.out)]
            write_whole(kept, json.dumps(made, indent=1) + "\n")
            print(f"{name}: {time.monotonic() - began:.0f} s", flush=True)
        rows += [Row(**row) for row in json.loads(kept.read_text(encoding="utf-8"))]
    print("| what | tried | survived | |")
    print("|---|---|---|---|")
    for row in rows:
        print(f"| {row.what} | {row.tried} | {row.survived} | {'; '.join(row.notes)} |")
    return any(row.survived < row.tried for row in rows)


if __name__ == "__main__":
    sys.exit(main())
