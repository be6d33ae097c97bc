"""`experiment recordings`: contacts in real recordings whose truth is known."""

import dataclasses
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from contactfusion.errors import RecordingError
from contactfusion.files import make_folder, write_whole
from contactfusion.terminal import note, say
from contactfusion_lab.experiments import eflesh, force_plates, hub, icub, icub_foot, ouster
from contactfusion_lab.experiments.methods import DEFAULT_METHOD, Method
from contactfusion_lab.experiments.ur10e import experiment as ur10e
from contactfusion_lab.trials.choices import require_known
from contactfusion_lab.trials.folder import as_json
from contactfusion_lab.trials.measures import Measure
from contactfusion_lab.trials.tables import as_csv, frame_of

VARIABLE = "CONTACTFUSION_DATA"
NEIGHBOUR = Path("../shared/data")
Experiment = Callable[[Path, Path], list[Measure]]
"""Measures on recordings in one folder, and draws into another."""
Fused = Callable[[Path, Path, Method], list[Measure]]
"""The same by a method."""
FUSED: dict[str, Fused] = {
    "force_plates": force_plates.measure,
    "eflesh": eflesh.measure,
    "icub_grasp": icub.measure,
    "icub_tipping": icub_foot.measure,
}
"""Experiments by the part of the recordings that they run on."""
UNFUSED: dict[str, Experiment] = {
    "hub": hub.measure,
    "ouster": ouster.measure,
    "ur10e_currents": ur10e.measure,
}
"""Experiments without fusion."""
FOLDERS = {"hub": "force_plates"}
"""Folders of the recordings that share that of another experiment."""


def run_recordings(
    data: Path | None, method: Method | None, out: Path, only: Sequence[str] = ()
) -> None:
    """Measure on every recording; write results.csv, summary.json and a figure each.

    Args:
        data: the folder of the recordings; None: where `CONTACTFUSION_DATA` points.
        method: how hypotheses are fused, and then only what fuses is measured; None: as the
            integrator does by default.
        out: the folder that takes the results.
        only: the experiments; none: all.

    Raises:
        ConfigurationError: there is no such experiment.
        RecordingError: a recording is not there, or not what it should be.
    """
    experiments = _experiments(method, only)
    folder = data or data_folder()
    make_folder(out)
    measures: list[Measure] = []
    for name, measure in experiments.items():
        note(f"{name} ...")
        part = folder / FOLDERS.get(name, name)
        if not part.is_dir():
            raise RecordingError(f"there is no folder '{part}'; the recordings of {name} lie there")
        found = measure(part, out)
        if method is not None:
            found = [
                dataclasses.replace(figure, case=f"{figure.case}, {method}") for figure in found
            ]
        for figure in found:
            note(f"  {figure}")
        measures += found
        write_whole(out / "results.csv", _csv(measures))
        summary = [{**dataclasses.asdict(each), "met": each.met} for each in measures]
        write_whole(out / "summary.json", as_json(summary))
    asked = [figure for figure in measures if figure.met is not None]
    say(f"{sum(bool(each.met) for each in asked)} of {len(asked)} figures as asked; results: {out}")


def _csv(measures: Sequence[Measure]) -> str:
    """One row a measure."""
    frame = frame_of(measures, Measure)
    asked = ["" if figure.asked is None else f"{figure.asked:.6g}" for figure in measures]
    met = ["" if figure.met is None else str(figure.met) for figure in measures]
    return as_csv(frame.assign(asked=asked, met=met), missing="nan")


def _experiments(method: Method | None, only: Sequence[str]) -> dict[str, Experiment]:
    """The experiments by name; by a method that is given, those that fuse."""

    def by(measure: Fused) -> Experiment:
        return lambda folder, out: measure(folder, out, method or DEFAULT_METHOD)

    fused = {name: by(measure) for name, measure in FUSED.items()}
    if method is not None and not only:
        note(f"{', '.join(UNFUSED)}: nothing is fused there, left out")
    known = fused if method else {**fused, **UNFUSED}
    require_known(only, known, "experiment", "experiments")
    return {name: measure for name, measure in known.items() if not only or name in only}


def data_folder() -> Path:
    """The folder of the real recordings.

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
