"""How fast pushes are made, and what part of it is fusion; told apart from the results."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contactfusion.experiments.push.trial import Cost
from contactfusion.files import write_whole


def tell_costs(costs: Sequence[Cost], out: Path) -> None:
    """Print what pushes took, and write it to timing.json.

    Args:
        costs: of the pushes of this run.
        out: the folder of the results.
    """
    cpu, simulated = sum(one.cpu for one in costs), sum(one.simulated for one in costs)
    cycles = np.concatenate([one.fused for one in costs])
    p50, p99 = np.quantile(cycles, [0.5, 0.99]).tolist()
    told = {
        "trials": len(costs),
        "cpu_s": cpu,
        "trials_per_cpu_minute": 60.0 * len(costs) / cpu,
        "simulated_s_per_cpu_s": simulated / cpu,
        "fusion_share": float(cycles.sum()) / cpu,
        "cycle_p50_ms": p50 * 1e3,
        "cycle_p99_ms": p99 * 1e3,
    }
    write_whole(out / "timing.json", json.dumps(told, indent=1) + "\n")
    print(
        f"{told['trials_per_cpu_minute']:.0f} pushes a minute of CPU time, "
        f"{told['simulated_s_per_cpu_s']:.0f} times as fast as real; generators, fusion and "
        f"controller take {told['fusion_share']:.0%} of it, {told['cycle_p50_ms']:.2f} ms a cycle, "
        f"p99 {told['cycle_p99_ms']:.2f} ms"
    )
