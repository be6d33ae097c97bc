"""Compares, byte by byte, what this checkout and another commit write: `make goldens BASE=REV`.

The other commit is cloned and set up in out/goldens/REV. What it writes is kept beside it, and made
anew only after `make clean`. Bytes differ between CPUs, so that none are committed.
"""

import argparse
import filecmp
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parents[1]
GOLDENS = HERE / "out" / "goldens"
DONE = "done"
"""The file that holds the lines of a case that have all ended."""
TIMED = ("*.png", "*.gif", "*.html", "settings.json", "summary.json", "timing.json")
"""Pictures, and what holds wall-clock times or folders: not compared."""
CONFIGURATION = "/contactfusion/configuration"
"""The topic with the text that names folders of the checkout."""

COMMANDS = (
    *("", "demo", "run", "record", "replay", "explain", "ablate", "view", "plugins", "doctor"),
    *("check", "inspect", "init", "experiment", "experiment recordings", "experiment touch"),
    *("experiment push", "experiment grasp", "train", "train cpm", "tune", "tune fusion"),
    "tune push",
)
SCENES = sorted(
    path.stem
    for path in (HERE / "examples" / "scenes").glob("*.yaml")
    if "\nscene:" in path.read_text()
)
CASES: dict[str, tuple[str, ...]] = {
    "help": tuple(
        f"{command} --help > contactfusion_{command.replace(' ', '_')}.txt" for command in COMMANDS
    ),
    "replay": (
        "record ../examples/scenes/push_five.yaml --duration 8 --out record.mcap",
        "replay ../examples/scenes/push_five.yaml record.mcap --out replay.mcap",
        "replay ../examples/scenes/push_five.yaml record.mcap --out replay.csv",
        *(f"explain replay.mcap --time {time} > explain_{time}.txt" for time in (1, 4, 7)),
        "explain replay.mcap --time 7 --json > explain_7.json",
        "replay ../examples/scenes/push_five.yaml record.mcap --out de_morgan.mcap"
        " --set integrator.rule=de_morgan",
        "explain de_morgan.mcap --time 7 > explain_de_morgan.txt",
        "replay ../examples/scenes/push_five.yaml record.mcap --out modes.csv"
        " --set integrator.rule=posterior --set integrator.condensation=modes",
    ),
    **{name: (f"run ../examples/scenes/{name}.yaml --out .",) for name in SCENES},
    "touch": ("experiment touch --objects box --directions 2 --repeats 1 --out .",),
    "push": (
        "experiment push --targets random:2 --friction mu1 --objects box --sensing fused"
        " --sensing skin --record box-mu1-random-000 --out .",
        "experiment push --targets random:2 --friction mu1 --objects box --sensing fused"
        " --noise prototype+timing --out own_rates",
    ),
    "grasp": ("experiment grasp --repeats 1 --record bottle-000 --out .",),
}
"""Lines of the command line by case; each case works in a folder of its own."""


def main() -> int:
    """Write the cases on both sides, and list the files that differ."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("base", metavar="REV", help="the commit to compare with")
    parser.add_argument("--only", action="append", choices=CASES, help="a case; may be repeated")
    arguments = parser.parse_args()
    rev = _git("rev-parse", "--short", arguments.base)
    base = _checkout(rev)
    shutil.rmtree(GOLDENS / "here", ignore_errors=True)
    cases = arguments.only or list(CASES)
    different = 0
    for case in cases:
        there, here = GOLDENS / f"{rev}-bytes" / case, GOLDENS / "here" / case
        with ThreadPoolExecutor() as pool:
            list(pool.map(_write, (case, case), (there, here), (base, HERE)))
        lines = [*_failures(here), *_differences(there / "out", here / "out")]
        print(f"{case}: {', '.join(lines) or 'equal bytes'}", flush=True)
        different += bool(lines)
    print(f"{len(cases) - different} of {len(cases)} cases have the bytes of {rev}")
    return 1 if different else 0


def _checkout(rev: str) -> Path:
    """A clone of this repository at a commit, set up."""
    folder = GOLDENS / rev
    if not folder.exists():
        subprocess.run(["git", "clone", "--quiet", str(HERE), str(folder)], check=True)
        subprocess.run(["git", "checkout", "--quiet", rev], cwd=folder, check=True)
    subprocess.run(["make", "--silent", ".venv/.ready"], cwd=folder, check=True)
    return folder


def _write(case: str, folder: Path, checkout: Path) -> None:
    """Write the files of a case into `folder`/out, unless they are there."""
    lines, done = "\n".join(CASES[case]), folder / DONE
    if done.exists() and done.read_text() == lines:
        return
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(checkout / "examples", folder / "examples")  # recordings keep relative names
    out = folder / "out"
    out.mkdir()
    for number, line in enumerate(CASES[case]):
        command = f"{shlex.quote(str(checkout / '.venv/bin/contactfusion'))} {line}"
        with (folder / f"{number}.log").open("w") as log:
            ended = subprocess.run(
                ["sh", "-c", command], cwd=out, stdout=log, stderr=subprocess.STDOUT, check=False
            )
        (folder / f"{number}.status").write_text(f"{ended.returncode}\n")
    done.write_text(lines)


def _failures(folder: Path) -> Iterator[str]:
    """The lines that did not end with 0."""
    for path in sorted(folder.glob("*.status")):
        if (status := path.read_text().strip()) != "0":
            yield f"line {path.stem} ended with {status}"


def _differences(base: Path, here: Path) -> Iterator[str]:
    """The files that are only on a side, or whose bytes differ."""
    names = {path.relative_to(side) for side in (base, here) for path in side.rglob("*")}
    for name in sorted(names):
        sides = base / name, here / name
        if any(name.match(pattern) for pattern in TIMED) or any(path.is_dir() for path in sides):
            continue
        if not all(path.exists() for path in sides):
            yield f"{name} only {'here' if sides[1].exists() else 'there'}"
        elif not filecmp.cmp(*sides, shallow=False):
            if name.suffix != ".mcap" or _messages(sides[0]) != _messages(sides[1]):
                yield f"{name} differs"


def _messages(recording: Path) -> list[tuple[str, int, bytes]]:
    """Topic, stamp and bytes of each message; of the configuration without folders and padding."""
    from mcap.reader import make_reader

    found = []
    with recording.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            data = message.data
            if channel.topic == CONFIGURATION:
                data = re.sub(rb'"folder": "[^"]*"', b"", data[8:]).rstrip(b"\0")
            found.append((channel.topic, message.log_time, data))
    return found


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=HERE, capture_output=True, text=True, check=True)
    return done.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
