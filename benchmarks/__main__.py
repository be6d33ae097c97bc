"""Measure the integrator against its twin, the naive version and public libraries.

python -m benchmarks [--rounds N] [--out bench.json]
"""

# One thread must be asked for before numpy is imported, so imports follow code here.
# ruff: noqa: E402
from benchmarks.interleave import Rounds, Spread, interleave, one_thread, timed

one_thread()

import argparse
import platform
from collections.abc import Callable, Iterator
from contextlib import closing
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from benchmarks import (
    growth,
    ours,
    over_surface,
    peers,
    perception,
    pushing,
    steady,
    torques,
    touch,
)
from benchmarks.pcl import PclPeer
from benchmarks.table import Row, write_json
from benchmarks.twin import Twin
from benchmarks.workloads import LIVE_CYCLES, Cloud, fresh_cloud, typical_cycles
from contactfusion import Integrator

CYCLES = LIVE_CYCLES + 100
STEADY = LIVE_CYCLES + 3
GROWTH = (10_000, 100_000, 1_000_000, 10_000_000)
CONDENSE_ASKED = {"Open3D cluster_dbscan": 40.0, "scipy KDTree pairs + components": 25.0}
CONDENSE_ASKED |= {"scikit-learn DBSCAN": 100.0, "cc3d + exact merge": 1.7}
PACKAGES = ["contactfusion", "numpy", "numba", "scipy", "open3d-cpu", "scikit-learn"]
PACKAGES += ["connected-components-3d"]


def main() -> None:
    """Print the table as it grows, and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="rounds that count (default 5)")
    parser.add_argument("--out", type=Path, help="write the table as JSON")
    options = parser.parse_args()
    versions = {name: _version(name) for name in PACKAGES} | {"python": platform.python_version()}
    print(", ".join(f"{name} {number}" for name, number in versions.items()))
    print("CPU time of one thread; median and range of interleaved rounds\n")
    rows = []
    sections = (_cycle, over_surface.rows, growth.rows, _fresh, _growth, _first, touch.rows)
    for section in (*sections, pushing.rows, torques.rows, perception.rows):
        for row in section(options.rounds):
            print(row, flush=True)
            rows.append(row)
    if options.out:
        write_json(options.out, rows, versions)


def _cycle(rounds: int) -> Iterator[Row]:
    """Measure the typical cycle, and its condensation alone."""
    raw = typical_cycles(np.random.default_rng(0), CYCLES, spreads=True)
    cycles = [[ours.frozen(cloud) for cloud in cycle] for cycle in raw]
    with closing(Twin(cycles)) as twin:
        lives = ours.Lives(cycles, twin)
        runs = {"ours": lives.ours(), "twin": lives.twin(), "naive": lives.naive()}
        runs["space"] = ours.Lives(cycles, twin).ours(space=True)
        often = {"ours": 30, "twin": 30, "space": 20}
        times = interleave(runs, rounds=rounds, repeats=often)
        tail = [_tail(runs["ours"]) for _ in range(rounds)]
        _compare(cycles, twin)
    yield Row("typical cycle", _ms(times, "ours"), "ms")
    yield Row("typical cycle, space looked at", _ms(times, "space"), "ms")
    yield Row("typical cycle against the C++ twin", times.ratio("ours", "twin"), "x time", 1.3)
    yield Row("the naive version against it", times.ratio("naive", "ours"), "x", 100, True)
    yield Row("p99 / p50 of the typical cycle", Spread.of(tail), "", 1.6)
    yield _ingest(rounds, cycles, runs["ours"])
    yield _memory(cycles)
    yield from _condense(rounds, cycles)


def _tail(run: Callable[[], float]) -> float:
    seconds = [run() for _ in range(200)]
    return float(np.percentile(seconds, 99) / np.median(seconds))


def _compare(cycles: ours.Cycles, twin: Twin) -> None:
    """Live some cycles on both sides: the contacts must be the same."""
    twin.reset()
    for number in range(STEADY):
        twin.cycle(number)
    fusion = ours.steady(Integrator(ours.CONFIG), cycles[:STEADY])
    np.testing.assert_allclose(twin.contacts(), ours.contact_rows(fusion), rtol=1e-9, atol=1e-12)


def _ingest(rounds: int, cycles: ours.Cycles, cycle: Callable[[], float]) -> Row:
    integrator = Integrator(ours.CONFIG)
    wrist, skin = cycles[0][1], cycles[0][0]
    fast = ours.frozen(
        Cloud(
            "fast",
            wrist.kind,
            0.0,
            np.concatenate([wrist.positions, skin.positions]),
            np.concatenate([wrist.likelihoods, skin.likelihoods]),
        )
    )

    def ingest() -> None:
        for _ in range(10):
            ours.received(integrator, fast)
        integrator.reset()

    times = interleave(
        {"ingest": timed(ingest), "cycle": cycle},
        rounds=rounds,
        repeats={"ingest": 30, "cycle": 30},
    )
    share = times.ratio("ingest", "cycle")
    percent = Spread(*(10.0 * value for value in (share.median, share.low, share.high)))
    return Row("receive 350 hypotheses", percent, "% cycle", 1.0)


def _memory(cycles: ours.Cycles) -> Row:
    integrator = Integrator(ours.CONFIG)
    empty = ours.held_bytes(integrator)
    fusion = ours.steady(integrator, cycles[:STEADY])
    held = ours.held_bytes(integrator, fusion) - empty
    size = held / len(fusion.field.entries.keys)
    return Row("held after a step, its fusion included", Spread.of([size]), "B/voxel", 220)


def _condense(rounds: int, cycles: ours.Cycles) -> Iterator[Row]:
    fusion = ours.steady(Integrator(ours.CONFIG), cycles[:STEADY])
    fused = steady.fuse(cycles[:STEADY])
    runs = {"ours": timed(ours.condense_again(fusion))}
    for name, prepare in peers.CONDENSE.items():
        peer = prepare(fused)
        found = len(np.unique(peer().labels))
        assert found == len(fusion.contacts), f"{name}: {found} clusters"
        runs[name] = timed(peer)
    with closing(PclPeer("condense", fused.positions, fused.likelihoods)) as pcl:
        runs["PCL EuclideanClusterExtraction"] = pcl.run
        times = interleave(runs, rounds=rounds, repeats={"ours": 30, "cc3d + exact merge": 9})
    yield Row(f"condense {len(fused.voxels)} voxels", _ms(times, "ours"), "ms")
    for name in list(runs)[1:]:
        asked = CONDENSE_ASKED.get(name, 40.0)
        yield Row(f"  {name} against it", times.ratio(name, "ours"), "x", asked, True)


def _fresh(rounds: int) -> Iterator[Row]:
    """Measure fusion and condensation from nothing, and fusion alone."""
    rng = np.random.default_rng(1)
    small, large = (ours.frozen(fresh_cloud(rng, count)) for count in (16_000, 100_000))
    with closing(PclPeer("fresh", small.positions, small.likelihoods)) as pcl:
        runs = {"ours": timed(ours.fresh(small)), "PCL VoxelGrid + extraction": pcl.run}
        runs["Open3D down-sample + dbscan"] = timed(peers.open3d_fresh(small))
        times = interleave(runs, rounds=rounds, repeats={"ours": 20})
    yield Row("fuse + condense 16k hypotheses", _ms(times, "ours"), "ms")
    for name in list(runs)[1:]:
        yield Row(f"  {name} against it", times.ratio(name, "ours"), "x", 7, True)
    never = timed(ours.fresh(large, threshold=1.0))  # no voxel reaches it: nothing to condense
    with closing(PclPeer("fuse", large.positions, large.likelihoods)) as pcl:
        runs = {"ours": never, "Open3D": timed(peers.open3d_fuse(large)), "PCL": pcl.run}
        times = interleave(runs, rounds=rounds, repeats={"ours": 10, "Open3D": 3, "PCL": 3})
    yield Row("fuse 100k hypotheses", _ms(times, "ours"), "ms")
    yield Row("  Open3D voxel_down_sample against it", times.ratio("Open3D", "ours"), "x", 3, True)
    yield Row("  PCL VoxelGrid against it", times.ratio("PCL", "ours"), "x")


def _growth(rounds: int) -> Iterator[Row]:
    rng = np.random.default_rng(2)
    clouds = [ours.frozen(fresh_cloud(rng, count)) for count in GROWTH]
    runs = {str(len(cloud.likelihoods)): timed(ours.fresh(cloud)) for cloud in clouds}
    often = {str(GROWTH[0]): 20, str(GROWTH[1]): 5}
    times = interleave(runs, rounds=min(rounds, 5), repeats=often)
    for few, many in zip(GROWTH, GROWTH[1:], strict=False):
        spread = times.ratio(str(many), str(few))
        yield Row(f"growth {few:,} -> {many:,}", spread, "x time", 10)


def _first(rounds: int) -> Iterator[Row]:
    seconds = [ours.first_cycle() for _ in range(rounds + 1)][1:]
    yield Row("import + first cycle, cached kernels", Spread.of(seconds), "s", 1.5)


def _ms(times: Rounds, name: str) -> Spread:
    spread = times.time(name)
    return Spread(*(1e3 * value for value in (spread.median, spread.low, spread.high)))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"


if __name__ == "__main__":
    main()
