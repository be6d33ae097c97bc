"""`experiment recordings`: contacts in real recordings whose truth is known."""

import dataclasses
import json
import os
from pathlib import Path

from contactfusion.errors import RecordingError
from contactfusion.experiments import eflesh, force_plates, hub, icub
from contactfusion.experiments.measures import Measure, results_csv
from contactfusion.files import make_folder, write_whole

VARIABLE = "CONTACTFUSION_DATA"
NEIGHBOUR = Path("../shared/data")
EXPERIMENTS = {
    "force_plates": force_plates.measure,
    "eflesh": eflesh.measure,
    "icub_grasp": icub.measure,
    "hub": hub.measure,
}
"""What runs on which part of the recordings."""


def run_recordings(data: Path | None, out: Path) -> None:
    """Measure on every recording; write results.csv, summary.json and a figure each.

    Args:
        data: the folder of the recordings; None: where `CONTACTFUSION_DATA` points.
        out: the folder that takes the results.

    Raises:
        RecordingError: a recording is not there, or not what it should be.
    """
    folder = data or data_folder()
    make_folder(out)
    measures: list[Measure] = []
    for name, measure in EXPERIMENTS.items():
        print(f"{name} ...", flush=True)
        part = folder / ("force_plates" if name == "hub" else name)
        if not part.is_dir():
            raise RecordingError(f"there is no folder '{part}'; the recordings of {name} lie there")
        found = measure(part, out)
        for one in found:
            print(f"  {one}")
        measures += found
        write_whole(out / "results.csv", results_csv(measures))
    summary = [{**dataclasses.asdict(one), "met": one.met} for one in measures]
    write_whole(out / "summary.json", json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    asked = [one for one in measures if one.met is not None]
    print(f"{sum(bool(one.met) for one in asked)} of {len(asked)} figures as asked; results: {out}")


def data_folder() -> Path:
    """Give the folder of the real recordings.

    Raises:
        RecordingError: it is nowhere to be found.
    """
    named = os.environ.get(VARIABLE)
    folder = Path(named) if named else NEIGHBOUR
    if not folder.is_dir():
        raise RecordingError(
            f"the real recordings are not in '{folder}': give --data, or set {VARIABLE}"
        )
    return folder
