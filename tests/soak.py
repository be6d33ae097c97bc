"""Live random lives with the integrator and the oracle, and compare them at every step.

    python -m tests.soak --scenarios 2000 --seed 0 --workers 2
    python -m tests.soak --only 137

Exit status 0: no difference, and every rare case came often enough to mean something.
"""

import argparse
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from contactfusion import Contact, ContactFusionError, Fusion, Integrator, IntegratorConfig
from tests.oracle import (
    MARGIN,
    ExpectedContact,
    ExpectedFusion,
    Oracle,
    Refused,
    Vector,
    clusters,
    nanoseconds,
    reach,
    squared_offset,
)
from tests.scenarios import Action, Plug, Ready, Receive, Reset, Scenario, Step, Unplug, scenario

RARE = (
    "late",
    "early",
    "unplugged",
    "nulled",
    "support only",
    "exact timeout",
    "exact threshold",
    "exact tolerance",
)
"""What must come at least once in every two scenarios, over the whole soak."""


@dataclass
class Life:
    """What came of one scenario."""

    seed: int
    steps: int = 0
    events: Counter[str] = field(default_factory=Counter)
    differences: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Look:
    """A result that is still to be looked at."""

    place: str
    expected: ExpectedFusion
    actual: Fusion
    without: str | None

    def differences(self) -> Iterator[str]:
        for found in differences(self.expected, self.actual):
            yield f"{self.place}: {found}"
        if self.without is not None:
            expected = self.expected.without(self.without)
            for found in fused_differences(expected, self.actual.without(self.without)):
                yield f"{self.place}, without '{self.without}': {found}"


def live(
    life: Scenario,
    integrator: Callable[[IntegratorConfig], Integrator] = Integrator,
) -> Life:
    """Let oracle and integrator live one scenario, up to the first step at which they differ."""
    result = Life(life.seed)
    oracle, subject = Oracle(life.config), integrator(life.config)
    waiting: list[_Look] = []
    for number, action in enumerate(life.actions):
        place = f"seed {life.seed}, step {result.steps}, action {number} ({type(action).__name__})"
        looks = _live_through(action, oracle, subject, place, result)
        for look in waiting if isinstance(action, Step) else ():
            result.differences.extend(look.differences())
        if isinstance(action, Step):
            waiting = []
            result.steps += 1
        for look in looks:
            if isinstance(action, Step) and action.look_later:
                waiting.append(look)
            else:
                result.differences.extend(look.differences())
        if result.differences:
            return result
    for look in waiting:
        result.differences.extend(look.differences())
    return result


def _live_through(
    action: Action, oracle: Oracle, subject: Integrator, place: str, result: Life
) -> list[_Look]:
    before = {name: (source.late, source.early) for name, source in oracle.sources.items()}
    if isinstance(action, Unplug):
        result.events["unplugged"] += 1
    expected = _outcome(action, oracle)
    actual = _outcome(action, subject)
    if isinstance(expected, Refused):
        result.events["refused"] += 1
        if not isinstance(actual, expected.reasons):
            result.differences.append(f"{place}: expected {expected}, not {actual!r}")
    elif isinstance(actual, Exception):
        result.differences.append(f"{place}: raised {actual!r}")
    elif isinstance(expected, bool):
        result.events["ready"] += expected
        if bool(actual) is not expected:
            result.differences.append(f"{place}: ready is {actual}, not {expected}")
    elif isinstance(expected, ExpectedFusion) and isinstance(action, Step):
        assert isinstance(actual, Fusion)
        for name, (late, early) in before.items():
            result.events["late"] += oracle.sources[name].late - late
            result.events["early"] += oracle.sources[name].early - early
        result.events.update(events_of(expected))
        return [_Look(place, expected, actual, action.without)]
    return []


def _outcome(action: Action, subject: Oracle | Integrator) -> object:
    try:
        return _perform(action, subject)
    except (Refused, ContactFusionError) as refusal:
        return refusal
    except Exception as error:  # an integrator that crashes differs, and the soak goes on
        if isinstance(subject, Oracle):
            raise
        return error


def _perform(action: Action, subject: Oracle | Integrator) -> object:
    match action:
        case Plug(name, kind, timeout, stale_after, replace):
            return subject.plug(
                name, kind=kind, timeout=timeout, stale_after=stale_after, replace=replace
            )
        case Unplug(name):
            return subject.unplug(name)
        case Receive(cloud):
            return subject.receive(cloud)
        case Ready(now):
            return subject.ready(now)
        case Step(now):
            return subject.step(now)
        case Reset():
            return subject.reset()


def events_of(expected: ExpectedFusion) -> Counter[str]:
    """Count the rare cases of one step: once each, however many voxels they touch."""
    config, rows = expected.config, expected.rows
    timeout = nanoseconds(config.timeout)
    exact_timeout = any(
        expected.now - max(entry.stamp for entry in there.values()) == timeout
        if config.expiry == "voxel"
        else any(expected.now - e.stamp == expected.timeouts[n] for n, e in there.items())
        for there in expected.entries.values()
    )
    verdicts = {row.verdict for row in rows}
    exact_threshold = any(
        row.verdict == "contact" and abs(row.likelihood - config.threshold) <= MARGIN
        for row in rows
    )
    joined = [row for row in rows if row.verdict == "contact"]
    limit = reach(config)
    exact_tolerance = (
        config.condensation == "cluster_centroid"
        and limit > 0
        and any(squared_offset(a.voxel, b.voxel) == limit for a, b in combinations(joined, 2))
        and len(clusters(joined, limit)) < len(clusters(joined, limit - 1))
    )
    return Counter(
        {
            "nulled": "nulled" in verdicts,
            "support only": "support_only" in verdicts,
            "exact timeout": exact_timeout,
            "exact threshold": exact_threshold,
            "exact tolerance": exact_tolerance,
            "voxels": len(rows),
            "sources meet": any(len(row.likelihoods) > 1 for row in rows),
            "contacts": len(expected.contacts),
            "contacts of several voxels": sum(one.voxels > 1 for one in expected.contacts),
            "contacts with force": sum(one.force is not None for one in expected.contacts),
            "inactive sources": sum(not one.active for one in expected.sources.values()),
        }
    )


def differences(expected: ExpectedFusion, actual: Fusion) -> Iterator[str]:
    """Say in what the result of a step is not what the law gives."""
    yield from fused_differences(expected, actual)
    told = actual.report.sources
    if set(told) != set(expected.sources):
        yield f"report of {sorted(told)}, not {sorted(expected.sources)}"
        return
    for name, source in expected.sources.items():
        for what in ("accepted", "late", "early", "invalid", "active"):
            have, want = getattr(told[name], what), getattr(source, what)
            if have != want:
                yield f"report of '{name}': {what} is {have}, not {want}"


def fused_differences(expected: ExpectedFusion, actual: Fusion) -> Iterator[str]:
    """Say in what space and contacts differ."""
    yield from _space_differences(expected, actual)
    yield from _contacts_differences(expected, actual.contacts)


def _space_differences(expected: ExpectedFusion, actual: Fusion) -> Iterator[str]:
    space, rows, names = actual.space, expected.rows, sorted(expected.kinds)
    voxels = [row.voxel for row in rows]
    if list(space.sources) != names:
        yield f"sources {list(space.sources)}, not {names}"
        return
    if [tuple(voxel) for voxel in np.asarray(space.voxels).tolist()] != voxels:
        yield f"voxels {np.asarray(space.voxels).tolist()}, not {voxels}"
        return
    if np.shape(space.voxels) != (len(rows), 3):
        yield f"voxels have shape {np.shape(space.voxels)}"
    wanted = [row.verdict for row in rows]
    if (verdicts := [str(verdict) for verdict in space.verdicts]) != wanted:
        yield f"verdicts {_first_apart(verdicts, wanted, voxels)}"
    side = expected.config.voxel_size
    places = (np.array(voxels).reshape(-1, 3) + 0.5) * side
    likelihoods = np.array([row.likelihood for row in rows])
    given = [[row.likelihoods.get(name, np.nan) for name in names] for row in rows]
    forces = np.array([_or_nan(row.force) for row in rows]).reshape(-1, 3)
    for what, have, want, relative, absolute in (
        ("positions", space.positions, places, 1e-9, 1e-9 * side),
        ("likelihoods", space.likelihoods, likelihoods, 0.0, MARGIN),
        (
            "source likelihoods",
            space.source_likelihoods,
            np.array(given).reshape(len(rows), len(names)),
            0.0,
            0.0,
        ),
        ("forces", space.forces, forces, 1e-6, 1e-6),
    ):
        if not _close(have, want, relative, absolute):
            yield f"{what} {np.asarray(have).tolist()}, not {want.tolist()}, of {voxels}"


def _contacts_differences(expected: ExpectedFusion, actual: Sequence[Contact]) -> Iterator[str]:
    wanted = reconciled(expected.contacts, actual, expected.config.voxel_size)
    if len(actual) != len(wanted):
        yield f"{len(actual)} contacts, not {len(wanted)}: {_told(actual)}, not {_told(wanted)}"
        return
    for place, (want, have) in enumerate(zip(wanted, actual, strict=True)):
        for what in contact_differences(want, have, expected.config):
            yield f"contact {place} of {len(wanted)}: {what}"


def contact_differences(
    want: ExpectedContact, have: Contact, config: IntegratorConfig
) -> Iterator[str]:
    """Say in what two contacts differ."""
    side = config.voxel_size
    scale = max(side, *(abs(component) for component in want.position))
    checks: list[tuple[str, ArrayLike, ArrayLike, float, float]] = [
        ("position", have.position, want.position, 0.0, 1e-9 * scale),
        ("likelihood", have.likelihood, want.likelihood, 0.0, MARGIN),
        ("dispersion", have.dispersion, want.dispersion, 1e-6, 1e-6 * side + 1e-9 * scale),
        ("covariance", have.covariance, want.covariance, 1e-6, 1e-6 * side**2),
        ("force", have.force, _or_nan(want.force), 1e-6, 1e-6),
    ]
    for name in {*want.shares, *have.shares}:
        shares = have.shares.get(name, 0.0), want.shares.get(name, 0.0)
        checks.append((f"share of '{name}'", *shares, 0.0, 1e-6))
    for what, got, law, relative, absolute in checks:
        if not _close(got, law, relative, absolute):
            yield f"{what} {got!r}, not {law!r}"
    if have.voxels != want.voxels:
        yield f"{have.voxels} voxels, not {want.voxels}"
    if nanoseconds(have.stamp) != nanoseconds(want.stamp / 1e9):
        yield f"stamp {have.stamp}, not {want.stamp / 1e9}"
    if have.frame != config.frame:
        yield f"frame '{have.frame}', not '{config.frame}'"
    if np.shape(have.extent) != (2, 3):
        yield f"extent of shape {np.shape(have.extent)}"
    elif want.extent is not None:
        tolerance = 1e-6 * side + 1e-9 * scale
        ends = (want.extent, want.extent[::-1])
        if not any(_close(have.extent, pair, 0.0, tolerance) for pair in ends):
            yield f"extent {have.extent}, not {want.extent}"


def reconciled(
    wanted: Sequence[ExpectedContact], actual: Sequence[Contact], side: float
) -> list[ExpectedContact]:
    """Let neighbours change places where the law leaves it to the last bits of a likelihood.

    Likelihoods are rounded to 1e-6 before they are ordered. One that lies on the edge of that
    rounding to within 1e-10 may fall to either side of it.
    """
    order = list(wanted)
    for place in range(min(len(order), len(actual)) - 1):
        first, second = order[place], order[place + 1]
        swapped = _same_place(actual[place], second, side) and _same_place(
            actual[place + 1], first, side
        )
        stands = _same_place(actual[place], first, side)
        either = _may_precede(first, second) and _may_precede(second, first)
        if either and swapped and not stands:
            order[place : place + 2] = [second, first]
    return order


def _same_place(contact: Contact, expected: ExpectedContact, side: float) -> bool:
    return _close(contact.position, expected.position, 1e-9, 1e-6 * side)


def _may_precede(one: ExpectedContact, other: ExpectedContact) -> bool:
    return any(
        (-a, one.first) < (-b, other.first)
        for a in _roundings(one.likelihood)
        for b in _roundings(other.likelihood)
    )


def _roundings(likelihood: float) -> set[int]:
    return {round((likelihood + slip) * 1e6) for slip in (-1e-10, 0.0, 1e-10)}


def _close(have: ArrayLike, want: ArrayLike, relative: float, absolute: float) -> bool:
    a, b = np.asarray(have, dtype=np.float64), np.asarray(want, dtype=np.float64)
    if a.shape != b.shape:
        return False
    alike = np.abs(a - b) <= absolute + relative * np.abs(b)
    return bool((alike | (np.isnan(a) & np.isnan(b))).all())


def _or_nan(force: Vector | None) -> Vector:
    return (np.nan, np.nan, np.nan) if force is None else force


def _told(contacts: Sequence[Contact] | Sequence[ExpectedContact]) -> str:
    return ", ".join(
        f"{one.voxels} voxels around {np.round(one.position, 6).tolist()}" for one in contacts
    )


def _first_apart(have: Sequence[str], want: Sequence[str], voxels: Sequence[object]) -> str:
    if len(have) != len(want):
        return f"{len(have)} of them, not {len(want)}"
    at = next(i for i, pair in enumerate(zip(have, want, strict=True)) if pair[0] != pair[1])
    return f"at {voxels[at]}: {have[at]}, not {want[at]}"


def lives(seeds: Sequence[int], workers: int) -> Iterator[Life]:
    """Live the scenarios of these seeds, in `workers` processes."""
    if workers <= 1:
        yield from map(live_seed, seeds)
        return
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap_unordered(live_seed, seeds, chunksize=10)


def live_seed(seed: int) -> Life:
    return live(scenario(seed))


def table(finished: Iterable[Life], seconds: Callable[[], float]) -> bool:
    """Print what came of all lives; True when the integrator has held."""
    count, steps, events, wrong = 0, 0, Counter[str](), 0
    for life in finished:
        count, steps = count + 1, steps + life.steps
        events.update(life.events)
        if life.differences:
            wrong += 1
            print(f"seed {life.seed} (replay: --only {life.seed}):", *life.differences, sep="\n  ")
    needed = count // 2
    print(f"\n{'scenarios':28}{count:>10,}\n{'steps':28}{steps:>10,}")
    short = [name for name in RARE if events[name] < needed]
    for name in RARE:
        print(f"{name:28}{events[name]:>10,}  {f'too few, {needed:,} needed' * (name in short)}")
    for name in sorted(set(events) - set(RARE)):
        print(f"{name:28}{events[name]:>10,}")
    print(f"{'scenarios that differ':28}{wrong:>10,}\n{'seconds':28}{seconds():>10.1f}")
    return not short and not wrong


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tests.soak", description="Oracle against integrator.")
    parser.add_argument("--scenarios", type=int, default=2000, help="how many lives")
    parser.add_argument("--seed", type=int, default=0, help="the seed of the first")
    parser.add_argument("--workers", type=int, default=1, help="how many processes")
    parser.add_argument("--only", type=int, metavar="SEED", help="replay one life")
    options = parser.parse_args(arguments)
    start = time.perf_counter()
    seconds = partial(_since, start)
    if options.only is not None:
        life = live_seed(options.only)
        table([life], seconds)
        return 1 if life.differences else 0
    seeds = range(options.seed, options.seed + options.scenarios)
    return 0 if table(lives(seeds, options.workers), seconds) else 1


def _since(start: float) -> float:
    return time.perf_counter() - start


if __name__ == "__main__":
    sys.exit(main())
