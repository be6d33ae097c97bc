"""How fast pushes are made, and what part of it is fusion; told apart from the results."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from contactfusion.files import write_whole
from contactfusion.terminal import note
from contactfusion_lab.experiments.push.watches import Cost


def tell_costs(costs: Mapping[str, Sequence[Cost]], out: Path) -> None:
    """Print what pushes took, and write it to timing.json.

    Args:
        costs: of the pushes of this run, by what felt.
        out: the folder of the results.
    """
    told = {label: costs_of(part) for label, part in costs.items()}
    write_whole(out / "timing.json", json.dumps(told, indent=1) + "\n")
    for label, one in told.items():
        note(
            f"{label}: {one['trials_per_cpu_minute']:.0f} pushes a minute of CPU time, "
            f"{one['simulated_s_per_cpu_s']:.0f} times as fast as real; sensors take "
            f"{one['sensing_share']:.0%} of it, generators, fusion and controller "
            f"{one['fusion_share']:.0%}: {one['cycle_p50_ms']:.2f} ms a cycle, "
            f"p99 {one['cycle_p99_ms']:.2f} ms"
        )


def costs_of(costs: Sequence[Cost]) -> dict[str, float]:
    """Give rates, shares and quantiles of what pushes took.

    Args:
        costs: of pushes that were felt in one way.
    """
    cpu, simulated = sum(one.cpu for one in costs), sum(one.simulated for one in costs)
    cycles = np.concatenate([one.fused for one in costs])
    p50, p99 = np.quantile(cycles, [0.5, 0.99]).tolist()
    return {
        "trials": len(costs),
        "cpu_s": cpu,
        "trials_per_cpu_minute": 60.0 * len(costs) / cpu,
        "simulated_s_per_cpu_s": simulated / cpu,
        "sensing_share": sum(one.sensed for one in costs) / cpu,
        "fusion_share": float(cycles.sum()) / cpu,
        "cycle_p50_ms": p50 * 1e3,
        "cycle_p99_ms": p99 * 1e3,
    }
