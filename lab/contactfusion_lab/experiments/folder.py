"""The folder of an experiment: which settings made its trials, and its figures as JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError

TRIALS = "trials"
"""The folder in it that keeps them."""


def joined(
    settings: Mapping[str, Any], out: Path, addable: Sequence[str], trials: str
) -> dict[str, Any]:
    """Add settings to those of a folder; change nothing in it.

    Args:
        settings: what makes two trials of one name equal, as JSON has it.
        out: the folder, which there need not be.
        addable: of these settings, mappings by name, a folder may take more.
        trials: what to call its trials, such as "pushes".

    Raises:
        ConfigurationError: it holds trials of others, another experiment, or nobody knows what.
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
    other = [name for name in settings if name not in addable and held[name] != settings[name]]
    for group in addable:
        if not isinstance(held[group], dict):
            raise ConfigurationError(f"{path} is damaged: {remedy}")
        together[group] = {**held[group], **settings[group]}
        changed = [name for name in held[group] if together[group][name] != held[group][name]]
        other += [f"{group} '{name}'" for name in changed]
    if other:
        raise ConfigurationError(f"{out} holds {trials} of other {' and '.join(other)}: {remedy}")
    return together


def as_json(told: object) -> str:
    """JSON that any program reads: no NaN, nothing infinite, but null."""
    return json.dumps(_finite(told), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _is_held(path: Path) -> bool:
    """Whether what lies in a folder is somebody's: other folders may hold other experiments."""
    return path.name == TRIALS or (path.is_file() and not path.name.startswith("."))


def _finite(told: Any) -> Any:
    if isinstance(told, Mapping):
        return {name: _finite(one) for name, one in told.items()}
    if isinstance(told, (list, tuple)):
        return [_finite(one) for one in told]
    return None if isinstance(told, float) and not math.isfinite(told) else told
