"""`tune push`: a search for parameters of pushing, confirmed in PyBullet, and a check of ranks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.stats import spearmanr

from contactfusion.arrays import FloatArray
from contactfusion.controllers.pushing_parameters import SETS, PushingParameters
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.files import write_whole
from contactfusion.terminal import Progress, note, say
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.folder import as_json, claim
from contactfusion_lab.trials.tables import markdown
from contactfusion_lab.tune_push.rating import (
    REPORTED,
    Rating,
    drawn_seed,
    kept_in_bullet,
    rated_in_plane,
)
from contactfusion_lab.tune_push.search import (
    LIMITS,
    POPULATION,
    Candidate,
    Search,
    changes,
    decoded,
    encoded,
    load_round,
    require_searchable,
    save_round,
)

FINAL, LAST_ROUNDS = 8, 3
"""Number of the best sets that are rated once more in the plane, and of the last rounds that they
are from."""
CONFIRMED, MORE = 3, 5
"""Number of these that are confirmed in PyBullet, and the factor on the pushes of a round by which
each is rated before."""
SEARCHING, CHOOSING, CONFIRMING = 0, 1, 2
"""Purposes of drawn pushes; each has pushes of its own."""
CHECKING = 3
"""Purpose of drawn pushes."""
CHANGED: dict[str, dict[str, Any]] = {
    "length_0.15": {"length": 0.15},
    "length_0.30": {"length": 0.30},
    "no_search": {"search": None},
    "no_escape": {"escape": None},
    "plain": {"search": None, "escape": None},
    "slow_turning": {"fastest_turn": 0.15},
}
"""Sets that differ from `tuned`."""
NAMED = (
    "paper",
    "paper_lateral_only",
    "paper_realign_only",
    "paper_neither",
    "tuned",
    "tuned_neither",
)
VERSION = 1
"""Counts up when ratings change, so that old ones are not taken for new."""


@dataclass(frozen=True)
class Options:
    """Options of the search.

    Attributes:
        seed: of all random draws.
        trials: pushes that each set of a round makes in the plane.
        rounds: number of rounds.
        confirm: pushes that each of the last sets makes in PyBullet.
        start: name of the initial set.
        executor: the workers; they change the time only.
    """

    seed: int = 0
    trials: int = 60
    rounds: int = 10
    confirm: int = 150
    start: str = "tuned"
    executor: Executor = Local()


def tune_push(options: Options, out: Path) -> None:
    """Search in the plane, confirm in PyBullet, write the best set; resumes where it was stopped.

    Args:
        options: of the search.
        out: the folder that takes parameters.yaml, tried.csv, table.md and summary.json.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds a search of other options.
        RobotError: PyBullet has crashed twice.
    """
    if options.start not in SETS:
        raise ConfigurationError(
            f"unknown set '{options.start}'; {name_hint(options.start, SETS, 'sets')}"
        )
    if options.seed in REPORTED:
        raise ConfigurationError(f"results are reported on seed {options.seed}: choose another")
    start = SETS[options.start]
    require_searchable(start)
    parameters = start.model_dump(mode="json")
    settings = {**vars(options), "version": VERSION, "parameters": parameters, "limits": LIMITS}
    del settings["executor"]
    claim(settings, out, (), "pushes")
    rounds = _searched(options, start, out)
    finals = _finals(options, start, rounds, out)
    confirmed = _confirmed(options, finals, out)
    _report(options, start, rounds, confirmed, finals, out)


def _searched(options: Options, start: PushingParameters, out: Path) -> list[list[Candidate]]:
    """All rounds; those that are not there yet are made."""
    search, rounds = Search(encoded(start), options.seed), []
    progress = Progress("sets rated in the plane", options.rounds * POPULATION)
    for number in range(options.rounds):
        path = out / "rounds" / f"{number:03d}.json"
        if path.is_file():
            candidates = load_round(path)
            progress.skip(len(candidates))
        else:
            vectors = search.draw()
            seed = drawn_seed(options.seed, SEARCHING, number)
            sets = [decoded(vector, start) for vector in vectors]
            ratings = rated_in_plane(sets, options.trials, seed, options.executor, progress)
            candidates = [_candidate(*pair) for pair in zip(vectors, ratings, strict=True)]
            save_round(candidates, path)
        search.learn(candidates)
        rounds.append(candidates)
    return rounds


def _finals(
    options: Options, start: PushingParameters, rounds: Sequence[Sequence[Candidate]], out: Path
) -> dict[str, PushingParameters]:
    """The sets to confirm: the best of the last rounds, rated on pushes of their own."""
    last = [candidate for candidates in rounds[-LAST_ROUNDS:] for candidate in candidates]
    last.sort(key=lambda candidate: candidate.cost)
    vectors = list(dict.fromkeys(candidate.vector for candidate in last))[:FINAL]
    path = out / "choice.json"
    if path.is_file():
        candidates = load_round(path)
    else:
        sets = [decoded(np.array(vector), start) for vector in vectors]
        progress = Progress("of the best sets rated once more", len(sets))
        seed = drawn_seed(options.seed, CHOOSING, 0)
        ratings = rated_in_plane(sets, MORE * options.trials, seed, options.executor, progress)
        candidates = [
            _candidate(np.array(vector), rating)
            for vector, rating in zip(vectors, ratings, strict=True)
        ]
        save_round(candidates, path)
    candidates.sort(key=lambda candidate: candidate.cost)
    chosen = {options.start: start}
    for number, candidate in enumerate(candidates[:CONFIRMED], 1):
        chosen[f"found_{number}"] = decoded(np.array(candidate.vector), start)
    return chosen


def _confirmed(
    options: Options, finals: Mapping[str, PushingParameters], out: Path
) -> dict[str, Rating]:
    """Ratings in PyBullet; pushes that are not there yet are made."""
    ratings, progress = {}, Progress("pushes in PyBullet", len(finals) * options.confirm)
    seed = drawn_seed(options.seed, CONFIRMING, 0)
    for name, parameters in finals.items():
        path = out / "confirmed" / f"{name}.json"
        ratings[name] = kept_in_bullet(
            parameters, options.confirm, seed, options.executor, progress, path
        )
    return ratings


def _report(
    options: Options,
    start: PushingParameters,
    rounds: Sequence[Sequence[Candidate]],
    confirmed: Mapping[str, Rating],
    finals: Mapping[str, PushingParameters],
    out: Path,
) -> None:
    """Write the results; the best by the lower end of its rate of true success, then by time."""
    order = sorted(confirmed, key=lambda name: (-confirmed[name].rate[1], confirmed[name].cost))
    best = order[0]
    changed = changes(finals[best], start)
    rating = confirmed[best]
    heading = (
        f"# {best} of `tune push --seed {options.seed}`: true success "
        f"{sum(rating.success)}/{len(rating.success)}, {rating.mean_time:.1f} s, in PyBullet\n"
    )
    text = yaml.safe_dump({"like": options.start, **changed}, sort_keys=False)
    write_whole(out / "parameters.yaml", heading + text)
    lines = []
    for name in order:
        each = confirmed[name]
        _, low, high = each.rate
        reached = f"{sum(each.success)}/{len(each.success)}"
        lines.append([name, reached, f"{low:.1%} to {high:.1%}", f"{each.mean_time:.1f} s"])
    table = markdown(["set", "true success in PyBullet", "95 %", "mean time"], lines)
    write_whole(out / "table.md", table + "\n")
    write_whole(out / "tried.csv", _tried(start, rounds))
    summary = {
        "best": best,
        "parameters": {"like": options.start, **changed},
        "tried": sum(map(len, rounds)),
        "confirmed": {
            name: {
                "trials": len(rating.success),
                "true_successes": sum(rating.success),
                "rate_low_high": rating.rate,
                "mean_time_s": rating.mean_time,
                "parameters": finals[name].model_dump(mode="json"),
            }
            for name, rating in confirmed.items()
        },
    }
    write_whole(out / "summary.json", as_json(summary))
    note(table, lines=True)
    say(f"the best is {best}: {out / 'parameters.yaml'}")


def _tried(start: PushingParameters, rounds: Sequence[Sequence[Candidate]]) -> str:
    rows = []
    for number, candidates in enumerate(rounds):
        for candidate in candidates:
            held: dict[str, Any] = decoded(np.array(candidate.vector), start).model_dump()
            flat = {**held, **{f"realign.{name}": v for name, v in held["realign"].items()}}
            values = [flat[name] for name in LIMITS]
            rows.append(
                [
                    number,
                    candidate.trials,
                    candidate.successes,
                    candidate.cost,
                    candidate.time,
                    *values,
                ]
            )
    names = ["round", "trials", "true_successes", "cost_s", "mean_time_s", *LIMITS]
    return pd.DataFrame(rows, columns=names).to_csv(index=False, lineterminator="\n")


def _candidate(vector: FloatArray, rating: Rating) -> Candidate:
    successes = sum(rating.success)
    time = rating.mean_time if successes else None
    return Candidate(tuple(vector.tolist()), len(rating.success), successes, rating.cost, time)


def check_sets() -> dict[str, PushingParameters]:
    """The sets that are compared, from good to bad."""
    tuned, paper = SETS["tuned"], SETS["paper"]
    changed = {name: tuned.model_copy(update=change) for name, change in CHANGED.items()}
    faster = paper.model_copy(update={"fastest": 0.3, "slowest": 0.08})
    return {**{name: SETS[name] for name in NAMED}, **changed, "paper_faster": faster}


def correlation(first: Sequence[float], second: Sequence[float]) -> float:
    """Spearman's rank correlation; NaN if one of them is constant."""
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return float("nan")
    return float(spearmanr(first, second).statistic)


def check_ranking(trials: int, seed: int, executor: Executor, out: Path) -> None:
    """Rate the same sets on the same pushes in both, and write the comparison.

    Args:
        trials: pushes of each set.
        seed: of all random draws.
        executor: the workers.
        out: takes check.csv, check.md and check.json.
    """
    sets, drawn = check_sets(), drawn_seed(seed, CHECKING, 0)
    dumped = {name: parameters.model_dump(mode="json") for name, parameters in sets.items()}
    claim({"seed": seed, "trials": trials, "sets": dumped}, out, (), "pushes")
    progress = Progress("sets rated in the plane", len(sets))
    plane = rated_in_plane(list(sets.values()), trials, drawn, executor, progress, vary=False)
    progress = Progress("pushes in PyBullet", len(sets) * trials)
    bullet = [
        kept_in_bullet(
            parameters, trials, drawn, executor, progress, out / "bullet" / f"{name}.json"
        )
        for name, parameters in sets.items()
    ]
    _write_check(dict(zip(sets, zip(plane, bullet, strict=True), strict=True)), out)


def _write_check(ratings: Mapping[str, tuple[Rating, Rating]], out: Path) -> None:
    """Write rates, costs and their correlations."""
    rates = [[rating.rate[0] for rating in pair] for pair in ratings.values()]
    costs = [[rating.cost for rating in pair] for pair in ratings.values()]
    by_rate, by_cost = (correlation(*zip(*rows, strict=True)) for rows in (rates, costs))
    rows = [[name, *rate, *cost] for name, rate, cost in zip(ratings, rates, costs, strict=True)]
    names = ["set", "rate_plane", "rate_bullet", "cost_plane_s", "cost_bullet_s"]
    lines = [
        [name, *(f"{each:.1%}" for each in rate), *(f"{each:.0f} s" for each in cost)]
        for name, rate, cost in zip(ratings, rates, costs, strict=True)
    ]
    headings = ["set", "true success, plane", "PyBullet", "cost, plane", "PyBullet"]
    table = markdown(headings, lines)
    table += f"\n\nSpearman's rank correlation: {by_rate:.2f} of rates, {by_cost:.2f} of costs."
    summary = {"spearman_rate": by_rate, "spearman_cost": by_cost, "sets": len(ratings)}
    csv = pd.DataFrame(rows, columns=names).to_csv(index=False, lineterminator="\n")
    write_whole(out / "check.csv", csv)
    write_whole(out / "check.md", table + "\n")
    write_whole(out / "check.json", as_json(summary))
    note(table, lines=True)
