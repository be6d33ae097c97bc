"""The folder of an experiment: where its pushes are kept, and the settings of several plans."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from contactfusion_lab.experiments.folder import TRIALS
from contactfusion_lab.experiments.push.plan import Plan, Push

ADDABLE = ("sensings", "controllers", "objects", "targets")
"""Of these a folder may take more."""


def trial_file(out: Path, sensing: str, controller: str, push: Push) -> Path:
    """Give the file of a trial."""
    return out / TRIALS / sensing / controller / f"{push.name}.npz"


def trial_files(out: Path, sensing: str, controller: str) -> list[Path]:
    """Give the files of all trials that were made with a sensing and a controller."""
    return sorted((out / TRIALS / sensing / controller).glob("*.npz"))


def settings_of(plans: Mapping[str, Plan], controllers: Sequence[str]) -> dict[str, Any]:
    """Give the settings of plans that differ in what feels only."""
    told = [plan.settings(controllers) for plan in plans.values()]
    sensings = {label: one for each in told for label, one in each["sensings"].items()}
    return {**told[0], "sensings": sensings}
