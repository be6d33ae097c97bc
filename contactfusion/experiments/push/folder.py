"""The folder of an experiment: where its pushes are kept, and which settings made them."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError
from contactfusion.experiments.push.plan import Plan, Push

ADDABLE = ("sensings", "controllers", "objects", "targets")
"""Of these a folder may take more."""
TRIALS = "trials"


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


def joined(settings: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Add settings to those of a folder; change nothing in it.

    Raises:
        ConfigurationError: it holds pushes of others, another experiment, or nobody knows what.
    """
    path, together = out / "settings.json", dict(settings)
    remedy = "give another --out, or remove it"
    if not path.is_file():
        if out.is_dir() and any(map(_is_held, out.iterdir())):
            raise ConfigurationError(f"{out} holds files, but no settings.json: give another --out")
        return together
    try:
        held = json.loads(path.read_text())
    except ValueError:
        held = None
    if not isinstance(held, dict):
        raise ConfigurationError(f"{path} is damaged: {remedy}")
    if held.keys() != settings.keys():
        raise ConfigurationError(f"{out} holds another experiment: give another --out")
    other = [name for name in settings if name not in ADDABLE and held[name] != settings[name]]
    for group in ADDABLE:
        if not isinstance(held[group], dict):
            raise ConfigurationError(f"{path} is damaged: {remedy}")
        together[group] = {**held[group], **settings[group]}
        changed = [name for name in held[group] if together[group][name] != held[group][name]]
        other += [f"{group} '{name}'" for name in changed]
    if other:
        raise ConfigurationError(f"{out} holds pushes of other {' and '.join(other)}: {remedy}")
    return together


def _is_held(path: Path) -> bool:
    """Say whether what lies in a folder is somebody's: other folders may hold other experiments."""
    return path.name == TRIALS or (path.is_file() and not path.name.startswith("."))
