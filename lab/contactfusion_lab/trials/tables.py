"""The table writer: one data frame of all trials, as CSV, JSON and Markdown with intervals."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pandas as pd

from contactfusion.files import write_whole
from contactfusion.terminal import say
from contactfusion_lab.trials.folder import as_json
from contactfusion_lab.trials.measures import CASE, Comparison, parts_of, proportion, resampled

Units = Mapping[str, tuple[str, float, str]]
"""Columns of a data frame: of each its heading, scale and form in a table."""
STATISTICS: dict[str, Callable[..., Any]] = {"mean": np.mean, "median": np.median}


def frame_of(rows: Iterable[Any], kind: type) -> pd.DataFrame:
    """A data frame of records, one row each.

    Args:
        rows: the records.
        kind: their dataclass.
    """
    names = [field.name for field in fields(kind)]
    return pd.DataFrame([[getattr(row, name) for name in names] for row in rows], columns=names)


def as_csv(frame: pd.DataFrame, missing: str = "") -> str:
    """A data frame as CSV: flags are 0 or 1, other numbers have six digits.

    Args:
        frame: the data frame.
        missing: what stands for NaN.
    """
    flags: dict[Any, type] = dict.fromkeys(frame.select_dtypes(bool), int)
    for name, column in frame.items():  # flags of which some are unknown
        if (
            column.dtype == object
            and column.notna().any()
            and column.dropna().map(type).isin([bool, np.bool_]).all()
        ):
            flags[name] = float
    return frame.astype(flags).to_csv(
        index=False, float_format="%.6g", na_rep=missing, lineterminator="\n"
    )


def write_results(
    out: Path, frame: pd.DataFrame, summary: object, texts: Mapping[str, str], missing: str = ""
) -> None:
    """Write results.csv, summary.json and table.md.

    Args:
        out: the folder that takes them.
        frame: of all trials; its column `CASE` is left out.
        summary: what summary.json holds.
        texts: the parts of table.md, by their headings; empty ones are left out.
        missing: what stands for NaN in results.csv.
    """
    write_whole(out / "results.csv", as_csv(frame.drop(columns=CASE), missing))
    write_whole(out / "summary.json", as_json(summary))
    parts = [f"## {heading}\n\n{text}" for heading, text in texts.items() if text]
    write_whole(out / "table.md", "\n\n".join(parts) + "\n")
    say(f"results: {out}/table.md, results.csv, summary.json, figures")


def bullets(sentences: Sequence[str]) -> str:
    """Sentences as a list in Markdown."""
    return "\n".join(f"- {sentence}" for sentence in sentences)


def markdown(headings: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    first, *others = (f"| {' | '.join(cells)} |" for cells in (headings, *lines))
    return "\n".join([first, "|" + "---|" * len(headings), *others])


def cell(value: float | None, low: float, high: float, scale: float = 1.0, form: str = "g") -> str:
    """A figure with its interval."""
    if value is None or not np.isfinite(value):
        return "-"
    return f"{value * scale:{form}} [{low * scale:{form}}, {high * scale:{form}}]"


def summary_of(
    part: pd.DataFrame,
    by: Sequence[str],
    successes: Iterable[str],
    measures: Iterable[str],
    statistic: str,
    seed: int,
) -> dict[str, dict[str, Any]]:
    """Success rates of a case: in all trials, and in each group of them.

    Successes have Wilson intervals, measures percentile bootstrap intervals over trials.

    Args:
        part: the trials of a case.
        by: the columns whose values make a group.
        successes: columns of flags.
        measures: columns of numbers; NaN is left out.
        statistic: "mean" or "median": whose interval a measure has.
        seed: of the bootstrap; each figure has chance of its own.
    """
    groups = {" ".join(key): group for key, group in parts_of(part, by).items()}
    summary = dict[str, dict[str, Any]]()
    for name, group in {"all": part, **groups}.items():
        summary[name] = {"n": len(group)}
        for success in successes:
            share, low, high = proportion(group[success].to_numpy())
            hits = int(group[success].sum())
            summary[name][success] = {"hits": hits, "share": share, "low": low, "high": high}
        for measure in measures:
            entropy = f"{group[CASE].iloc[0]}, {name}, {measure}"
            rng = np.random.default_rng([seed, crc32(entropy.encode())])
            summary[name][measure] = _measured(group[measure], statistic, rng)
    return summary


def _measured(column: "pd.Series[Any]", statistic: str, rng: np.random.Generator) -> dict[str, Any]:
    values = column[np.isfinite(column)].to_numpy(np.float64)
    figures: tuple[float | None, ...] = (None, None, None)
    if len(values):
        figures = resampled(values, STATISTICS[statistic], rng)
    value, low, high = figures
    mean = float(values.mean()) if len(values) else None
    return {"n": len(values), "mean": mean, statistic: value, "low": low, "high": high}


def success_text(
    frame: pd.DataFrame,
    by: Sequence[str],
    successes: Mapping[str, str],
    published: Iterable[Sequence[str]] = (),
) -> str:
    """The successes of each case as Markdown, by group and in all with a Wilson interval.

    Args:
        frame: of all trials.
        by: the columns whose values make a group.
        successes: columns of flags, and what is added to the case for each.
        published: rows that come first.
    """
    keys, lines = list(parts_of(frame, by)), []
    for case, part in parts_of(frame).items():
        groups = parts_of(part, by)
        for success, suffix in successes.items():
            cells = [_hits(groups[key][success]) if key in groups else "-" for key in keys]
            share, low, high = (100.0 * each for each in proportion(part[success].to_numpy()))
            whole = f"{_hits(part[success])}, {share:.2f} % [{low:.1f}, {high:.1f}]"
            lines.append([f"{case}{suffix}", *cells, whole])
    headings = [re.sub(r"\bmu(?=\d)", "µ", " ".join(key)) for key in keys]
    return markdown(["", *headings, "all"], [*published, *lines])


def _hits(flags: "pd.Series[Any]") -> str:
    return f"{flags.sum()}/{len(flags)}"


def measures_text(
    summaries: Mapping[str, Mapping[str, Any]],
    statistic: str,
    units: Units,
    counted: Sequence[str] = (),
) -> str:
    """The measures of each case over all its trials as Markdown, with their intervals.

    Args:
        summaries: of each case, as `summary_of` has them.
        statistic: as there.
        units: of the measures.
        counted: what else is in the summaries, as numbers.
    """
    lines = []
    for case, summary in summaries.items():
        whole = summary["all"]
        figures = [(whole[measure], unit) for measure, unit in units.items()]
        cells = [
            cell(each[statistic], each["low"], each["high"], scale, form)
            for each, (_, scale, form) in figures
        ]
        lines.append([case, *cells, *(str(whole[each]) for each in counted)])
    return markdown([statistic, *(unit[0] for unit in units.values()), *counted], lines)


def failures_text(frame: pd.DataFrame, success: str, sentences: Sequence[str], most: int) -> str:
    """List the trials of each case without success as Markdown.

    Args:
        frame: of all trials.
        success: a column of flags.
        sentences: one for each trial.
        most: at most so many of a case are listed.
    """
    lines = list[str]()
    listed = dict(zip(frame.index, sentences, strict=True))
    for case, part in parts_of(frame).items():
        failed = [listed[row] for row in part.index[~part[success]]]
        lines.append(f"**{case}**: {len(failed)} of {len(part)} without success")
        lines += [f"- {sentence}" for sentence in failed[:most]]
        if len(failed) > most:
            lines.append(f"- and {len(failed) - most} more, in results.csv")
        lines.append("")
    return "\n".join(lines).strip()


def comparisons_text(comparisons: Sequence[Comparison], units: Units) -> str:
    """Comparisons as Markdown; nothing without any.

    Args:
        comparisons: one row each.
        units: of their columns; one that is not named stands by its name.
    """
    lines = []
    for each in comparisons:
        heading, scale, form = units.get(each.measure, (each.measure, 1.0, "g"))
        counts = ["" if n is None else str(n) for n in (each.only_it, each.only_other)]
        difference = medians = ""
        if each.only_it is None:
            difference = "-" if each.difference is None else f"{each.difference * scale:+{form}}"
            low, high = each.low or 0.0, each.high or 0.0
            medians = cell(each.of_medians, low, high, scale, f"+{form}")
        lines.append(
            [each.case, each.against, heading, str(each.trials), *counts, difference, medians,
             f"{each.p:.2g}", f"{each.p_holm:.2g}"]
        )  # fmt: skip
    headings = ["", "against", "in", "trials", "only it", "only the other", "median difference"]
    return markdown([*headings, "difference of medians", "p", "p (Holm)"], lines) if lines else ""
