"""The folder of an experiment: its settings, the files of its trials, figures and films."""

import io
import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from contactfusion.errors import ConfigurationError, missing_extra
from contactfusion.files import make_folder, read_json, write_whole

TRIALS = "trials"
"""The folder in it that keeps them."""
SHOWN = 0.08
"""Duration of a frame [s]."""


def trial_file(out: Path, name: str, suffix: str) -> Path:
    """The file of a trial; the parts of its name that end with "/" are folders.

    Raises:
        ConfigurationError: the name, of an object or the like, leads elsewhere.
    """
    if not name.isprintable() or any(part in ("", ".", "..") for part in name.split("/")):
        raise ConfigurationError(
            f"{name!r} would be the name of a trial, and can't be that of a file"
        )
    return out / TRIALS / f"{name}{suffix}"


def claim(
    settings: Mapping[str, Any], out: Path, addable: Sequence[str], trials: str
) -> dict[str, Any]:
    """Take a folder for trials of some settings, see `joined`, and keep these in it."""
    together = joined(settings, out, addable, trials)
    make_folder(out)
    write_whole(out / "settings.json", json.dumps(together, indent=1) + "\n")
    return together


def joined(
    settings: Mapping[str, Any], out: Path, addable: Sequence[str], trials: str
) -> dict[str, Any]:
    """Add settings to those of a folder; change nothing in it.

    Args:
        settings: what makes two trials of one name equal.
        out: the folder, which there need not be.
        addable: of these settings, mappings by name, a folder may take more.
        trials: what to call its trials, such as "pushes".

    Returns:
        All settings, as JSON has them.

    Raises:
        ConfigurationError: it holds trials of others, another experiment, or unknown files.
    """
    path = out / "settings.json"
    together: dict[str, Any] = json.loads(json.dumps(settings, default=str))
    remedy = "give another --out, or remove it"
    if not path.is_file():
        if out.is_dir() and any(map(_is_held, out.iterdir())):
            raise ConfigurationError(f"{out} holds files, but no settings.json: give another --out")
        return together
    held: Any = None
    with suppress(ConfigurationError):
        held = read_json(path)
    if not isinstance(held, dict):
        raise ConfigurationError(f"{path} is damaged: {remedy}")
    if held.keys() != together.keys():
        differing = ", ".join(sorted(held.keys() ^ together.keys()))
        raise ConfigurationError(
            f"{out} holds another experiment, or one with other {differing}: give another --out"
        )
    other = [name for name in together if name not in addable and held[name] != together[name]]
    for group in addable:
        if not isinstance(held[group], dict):
            raise ConfigurationError(f"{path} is damaged: {remedy}")
        together[group] = {**held[group], **together[group]}
        changed = [name for name in held[group] if together[group][name] != held[group][name]]
        other += [f"{group} '{name}'" for name in changed]
    if other:
        raise ConfigurationError(f"{out} holds {trials} of other {' and '.join(other)}: {remedy}")
    return together


def as_npz(**arrays: ArrayLike) -> bytes:
    """The content of a npz file."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **{name: np.asarray(a) for name, a in arrays.items()})
    return content.getvalue()


def as_json(value: object) -> str:
    """JSON that any program reads: no NaN, nothing infinite, but null."""
    return json.dumps(_finite(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def save_figure(figure: Any, path: Path, dpi: int = 110) -> Path:
    """Write a figure as PNG; the path."""
    content = io.BytesIO()
    figure.savefig(content, dpi=dpi, format="png")
    write_whole(path, content.getvalue())
    return path


def save_film(frames: Sequence[Any], path: Path, last: float, **how: Any) -> Path:
    """Write frames as an animated GIF.

    Args:
        frames: pictures of few colours.
        path: the GIF to write.
        last: how long the last frame is shown [s].
        how: options of `PIL.Image.Image.save`.

    Returns:
        The path.
    """
    first, *others = frames
    durations = [round(SHOWN * 1e3)] * len(others) + [round(last * 1e3)]
    content = io.BytesIO()
    first.save(
        content, format="GIF", save_all=True, append_images=others, duration=durations, loop=0,
        **how,
    )  # fmt: skip
    write_whole(path, content.getvalue())
    return path


def loaded_pillow() -> Any:
    """Pillow's module of images.

    Raises:
        DependencyError: matplotlib, with which it comes, is not installed.
    """
    try:
        from PIL import Image
    except ImportError:
        raise missing_extra("matplotlib", "plot") from None
    return Image


def _is_held(path: Path) -> bool:
    """Whether what lies in a folder is in use: other folders may hold other experiments."""
    return path.name == TRIALS or (path.is_file() and not path.name.startswith("."))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _finite(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
