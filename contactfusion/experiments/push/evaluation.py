"""What comes of all pushes: measures, tables, comparisons and figures."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from contactfusion.experiments.push import figures, tables
from contactfusion.experiments.push.comparisons import compare, comparisons_text
from contactfusion.experiments.push.outcomes import Outcome, outcome, results_csv
from contactfusion.experiments.push.plan import Plan
from contactfusion.experiments.push.trial import load
from contactfusion.files import write_whole


def evaluate(
    plan: Plan, controllers: Sequence[str], paths: Sequence[Path], failed: Sequence[str], out: Path
) -> None:
    """Measure every push; write tables, files and figures.

    Args:
        plan: the experiment.
        controllers: by name; the others are compared with the first.
        paths: the files of the pushes.
        failed: a sentence for each push that could not be made.
        out: the folder that takes the results.
    """
    found: dict[str, list[Outcome]] = {name: [] for name in controllers}
    ways: dict[str, list[figures.Way]] = {name: [] for name in controllers}
    for path in paths:
        track = load(path)
        one = outcome(track, plan.sensing)
        found[track.controller].append(one)
        ways[track.controller].append(figures.Way.of(track, one))
    found = {name: outcomes for name, outcomes in found.items() if outcomes}
    summaries = {name: tables.summary_of(outcomes, plan.seed) for name, outcomes in found.items()}
    first, *others = found.values()
    comparisons = [compare(first, other) for other in others]
    summary = {
        "sensing": plan.sensing,
        "targets": plan.targets.name,
        "starts": plan.starts,
        "controllers": summaries,
        "tests": [asdict(one) for one in comparisons],
        "not made": list(failed),
    }
    success = tables.success_text(found, plan.targets.name)
    measures = tables.measures_text(summaries)
    texts = ["## Success", success, "## Measures", measures]
    if comparisons:
        texts += ["## Compared push by push", comparisons_text(comparisons)]
    texts += ["## Failures", tables.failures_text(found)]
    if failed:
        texts += ["## Not made", "\n".join(f"- {one}" for one in failed)]
    write_whole(out / "results.csv", results_csv([one for part in found.values() for one in part]))
    write_whole(out / "summary.json", json.dumps(summary, indent=1, ensure_ascii=False) + "\n")
    write_whole(out / "table.md", "\n\n".join(texts) + "\n")
    for name, outcomes in found.items():
        figures.draw_map(outcomes, out / f"map_{name}.png")
        figures.draw_ways(ways[name], out / f"paths_{name}.png")
    figures.draw_bars(found, comparisons, out / "bars.png")
    print(success, end="\n\n")
    print(f"results: {out}/table.md, results.csv, summary.json, figures")
