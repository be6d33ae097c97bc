"""Noise `prototype` beside `hard`, and each part of `hard` by itself: `make show-hard`.

`make show-hard ONLY=push` makes the folders of an experiment alone.

Two experiments run at a time, of one worker each, as a single process fuses all touches of one.
What is made is kept, so it goes on where it was stopped. Figures of all folders that are ready
stand side by side in out/hard/table.md.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError
from contactfusion.files import write_whole
from contactfusion_lab.scenes.noise import PARTS
from contactfusion_lab.scenes.push.noise import PARTS as PUSH_PARTS
from contactfusion_lab.trials.choices import require_known
from contactfusion_lab.trials.tables import cell, markdown

OUT = Path("out/hard")
CONTACTFUSION = Path(sys.executable).with_name("contactfusion")
LANES = 2
"""Number of experiments that run at a time."""
NOISES = ("prototype", "hard")
SECONDS = {"touch": 3.0, "push": 4.0, "grasp": 12.0}
"""Of one core, for a trial and its evaluation."""

RULES = ("sets/members", "de_morgan", "de_morgan_tuned", "posterior/modes")
OTHERS = ("de_morgan", "posterior/modes")
"""Rules that are shown beside the default one where nothing was tuned."""
FURTHER = "examples/objects/mug.urdf,examples/objects/bracket.urdf"
SENSINGS = ("skin", "lidar", "rgbd", "fused")
UNSEEN = "wedge,cross,stool"
ODD = "duck,cup,blob,cross,dumbbell"
ROWS = ("force", "all", "all + simulator", "every generator")
"""Rows of the touch experiment that are shown."""
Column = tuple[str, str, float, str]
"""A heading, a metric, its scale and its form."""
TOUCH_COLUMNS: tuple[Column, ...] = (
    ("detected %", "detected", 100.0, ".0f"),
    ("ε median cm", "ε median", 100.0, ".2f"),
    ("p90", "ε p90", 100.0, ".2f"),
    ("GOSPA cm", "GOSPA", 100.0, ".2f"),
    ("missed a touch", "GOSPA missed", 1.0, ".2f"),
    ("false a touch", "GOSPA false", 1.0, ".2f"),
    ("in 95 % region: %", "within 95%", 100.0, ".0f"),
    ("its radius cm", "radius of 95 %", 100.0, ".2f"),
    ("ECE of P(contact)", "ECE", 1.0, ".3f"),
    ("first report s", "latency median", 1.0, ".2f"),
    ("alarms in air %", "false alarms in free air", 100.0, ".0f"),
    ("alarms a minute", "alarms a minute", 1.0, ".1f"),
)
PUSH_COLUMNS: tuple[Column, ...] = (
    ("true success %", "success_true", 100.0, ".0f"),
    ("by estimate %", "success_estimate", 100.0, ".0f"),
    ("time s", "time", 1.0, ".1f"),
    ("GOSPA cm", "gospa", 100.0, ".2f"),
    ("missed %", "missed", 100.0, ".1f"),
    ("false %", "false", 100.0, ".1f"),
    ("location RMSE cm", "location_rmse", 100.0, ".2f"),
    ("type %", "type_accuracy", 100.0, ".1f"),
    ("contact or none %", "contact_accuracy", 100.0, ".1f"),
)
GRASP_COLUMNS: tuple[Column, ...] = (
    ("success %", "success", 100.0, ".0f"),
    ("moved before cm", "moved", 100.0, ".1f"),
    ("corrections", "corrections", 1.0, ".2f"),
    ("time s", "time", 1.0, ".1f"),
    ("greatest push N", "force", 1.0, ".1f"),
)


@dataclass(frozen=True)
class Case:
    """A folder of an experiment.

    Attributes:
        experiment: its name.
        folder: name in that of the experiment.
        options: of the command.
        trials: number of trials.
    """

    experiment: str
    folder: str
    options: tuple[str, ...]
    trials: int

    @property
    def out(self) -> Path:
        """The folder."""
        return OUT / self.experiment / self.folder

    @property
    def missing(self) -> int:
        """Number of trials to make; with all made but not evaluated, of all.

        What could not be made, such as a push that starts out of sight, stands in the summary.
        """
        made = sum(path.is_file() for path in (self.out / "trials").rglob("*"))
        if not self.is_evaluated:
            return max(self.trials - made, 0) or self.trials
        summary = json.loads((self.out / "summary.json").read_text())
        return max(self.trials - made - len(summary.get("not made", ())), 0)

    @property
    def is_evaluated(self) -> bool:
        """Whether there are tables of it."""
        return (self.out / "summary.json").is_file()

    @property
    def hours(self) -> float:
        """Hours on all cores until it is made."""
        return self.missing * SECONDS[self.experiment] / 3600.0 / LANES


def options(**given: object) -> tuple[str, ...]:
    """Options of a command; those with several values are repeated."""
    return tuple(
        part
        for name, values in given.items()
        for value in (values if isinstance(values, list | tuple) else [values])
        for part in (f"--{name}", str(value))
    )


def touch(
    folder: str, noise: str, directions: int, repeats: int, minutes: int, objects: str = ""
) -> Case:
    """Touches of objects, of three unless they are named, and free motion."""
    count = len(objects.split(",")) if objects else 3
    given = options(
        rule=RULES, seed=2014, noise=noise, directions=directions, repeats=repeats, free=minutes
    )
    chosen = options(objects=objects) if objects else ()
    trials = 2 * count * directions * repeats + 6 * minutes
    return Case("touch", folder, given + chosen, trials)


def push(folder: str, noise: str, cases: int, each: int, **given: object) -> Case:
    """Pushes of random starts and targets, unless others are given."""
    chosen: dict[str, object] = {"seed": 900, "starts": "random", "targets": f"random:{each}"}
    return Case("push", folder, options(**{**chosen, "noise": noise, **given}), cases * each)


def grasp(folder: str, noise: str, columns: int, each: int, **given: object) -> Case:
    """Grasps of bottles, unless other objects are given."""
    count = len(str(given.get("objects", "")).split(","))
    chosen = options(seed=5100, noise=noise, repeats=each, **given)
    return Case("grasp", folder, chosen, columns * each * count)


def cases() -> Iterator[Case]:
    """All folders, in the order in which they are made."""
    parts = {part: f"prototype+{part}" for part in PARTS}
    for noise in NOISES:
        yield touch(noise, noise, 15, 5, 10)
        yield push(noise, noise, 4, 100, sensing=SENSINGS)
        yield push(f"{noise}_rules", noise, 2, 100, sensing="fused", rule=OTHERS)
    for part, noise in {"prototype": "prototype", **parts}.items():
        yield touch(f"parts/{part}", noise, 10, 2, 2)
    for part in ("prototype", *PUSH_PARTS):
        noise = part if part in NOISES else f"prototype+{part}"
        yield push(f"parts/{part}", noise, 2, 40, sensing=("skin", "fused"))
    for noise in NOISES:
        yield touch(f"{noise}_unseen", noise, 15, 2, 1, FURTHER)
        yield push(
            f"{noise}_unseen", noise, 4, 72, sensing=SENSINGS, objects=UNSEEN, targets="far",
            starts="far",
        )  # fmt: skip
        yield grasp(noise, noise, 4, 100, sources="all", rule=RULES)
        papers = ("force_torque+motion", "none")
        yield grasp(f"{noise}_papers", noise, 2, 100, sources=papers, rule="de_morgan")
        yield grasp(
            f"{noise}_unseen", noise, 4, 20, objects=ODD, sources=("all", "none"),
            rule=("sets/members", *OTHERS),
        )  # fmt: skip
    for part, noise in {"prototype": "prototype", **parts}.items():
        yield grasp(f"parts/{part}", noise, 1, 30, sources="all")


def made(case: Case) -> bool:
    """Make a folder; whether it is whole."""
    if case.missing:
        case.out.mkdir(parents=True, exist_ok=True)
        command = [str(CONTACTFUSION), "experiment", case.experiment, *case.options]
        began = time.monotonic()
        with case.out.with_name(f"{case.out.name}.log").open("wb") as log:
            subprocess.run(
                [*command, "--workers", "1", "--out", str(case.out)],
                stdout=log, stderr=log, check=False,
            )  # fmt: skip
        left = f", {case.missing} of {case.trials} trials are not made" if case.missing else ""
        print(f"{case.out}: {(time.monotonic() - began) / 60.0:.0f} min{left}", flush=True)
    return not case.missing


def touch_lines(summary: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """The shown rows by every rule, each with its figures."""
    found = {(each["case"], each["metric"]): each for each in summary["measures"]}
    rules = dict.fromkeys(case.partition(", ")[2] for case, _ in found if case.startswith("force,"))
    for row in ROWS:
        for rule in rules:
            measures = [found.get((f"{row}, {rule}", metric)) for _, metric, _, _ in TOUCH_COLUMNS]
            yield f"{row}, {rule}", _cells(measures, TOUCH_COLUMNS)


def push_lines(summary: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """Every case with its figures."""
    for case, reached in summary["reached"].items():
        (perceived,) = summary["perceived"].values()
        pooled = {
            name: dict(zip(("value", "low", "high"), figures, strict=True))
            for name, figures in perceived[case].items()
        }
        figures = {**reached["all"], **pooled}
        yield case, _cells([figures[name] for _, name, _, _ in PUSH_COLUMNS], PUSH_COLUMNS)


def grasp_lines(summary: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """Every column with its figures."""
    for case, reached in summary["reached"].items():
        figures = [reached["all"][name] for _, name, _, _ in GRASP_COLUMNS]
        yield case, _cells(figures, GRASP_COLUMNS)


def _cells(figures: Sequence[Mapping[str, Any] | None], columns: Sequence[Column]) -> list[str]:
    cells = []
    for figure, (_, _, scale, form) in zip(figures, columns, strict=True):
        if figure is None:
            cells.append("-")
            continue
        keys = ("value", "share", "median", "mean")
        value = next(figure[key] for key in keys if key in figure)
        cells.append(cell(value, figure["low"], figure["high"], scale, form))
    return cells


Lines = Callable[[Mapping[str, Any]], Iterator[tuple[str, list[str]]]]
TABLES: dict[str, tuple[Lines, tuple[Column, ...]]] = {
    "touch": (touch_lines, TOUCH_COLUMNS),
    "push": (push_lines, PUSH_COLUMNS),
    "grasp": (grasp_lines, GRASP_COLUMNS),
}
"""Of each experiment: its lines, and its columns."""


def table_text(ready: Sequence[Case]) -> str:
    """The figures of folders side by side, a table for each experiment."""
    texts = []
    for experiment, (lines_of, columns) in TABLES.items():
        by_name = dict[str, list[list[str]]]()
        for case in ready:
            if case.experiment == experiment:
                summary = json.loads((case.out / "summary.json").read_text())
                for name, cells in lines_of(summary):
                    by_name.setdefault(name, []).append([name, case.folder, *cells])
        headings = ["", "folder", *(heading for heading, _, _, _ in columns)]
        lines = [line for part in by_name.values() for line in part]
        texts.append(f"## {experiment}\n\n{markdown(headings, lines)}\n")
    return "\n".join(texts)


def main() -> int:
    """Make what is missing, of the named experiments or of all, and write the table."""
    only = sys.argv[1:] or list(TABLES)
    try:
        require_known(only, TABLES, "experiment", "experiments")
    except ConfigurationError as error:
        sys.exit(f"show-hard: {error}")
    chosen = [case for case in cases() if case.experiment in only]
    missing, hours = sum(case.missing for case in chosen), sum(case.hours for case in chosen)
    print(
        f"{missing} of {sum(case.trials for case in chosen)} trials are to be made, about "
        f"{hours:.1f} hours on {LANES} cores; started again, it goes on where it was stopped",
        flush=True,
    )
    with ThreadPoolExecutor(LANES) as lanes:
        whole = list(lanes.map(made, chosen))
    ready = [case for case in cases() if case.is_evaluated]
    write_whole(OUT / "table.md", table_text(ready))
    print(f"table: {OUT / 'table.md'}")
    for case, is_whole in zip(chosen, whole, strict=True):
        if not is_whole:
            print(f"not whole: {case.out}, see {case.out}.log", file=sys.stderr)
    return 0 if all(whole) else 1


if __name__ == "__main__":
    sys.exit(main())
