"""What is pushed: objects by name and from files."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError
from contactfusion.robots.description import RobotConfig
from contactfusion_lab.experiments.choices import require_known, require_once
from contactfusion_lab.scenes.push.config import OTHERS, PAPER, named_object, read_object
from contactfusion_lab.scenes.push.objects import ObjectConfig, UrdfObjectConfig


def objects_of(names: Sequence[str], files: Sequence[Path]) -> dict[str, ObjectConfig]:
    """Give objects by name.

    Args:
        names: of known objects; none: those of the paper, unless there are files.
        files: of further ones.

    Raises:
        ConfigurationError: a name is unknown or stands twice, or a file holds no object.
    """
    known = {**PAPER, **OTHERS}
    names = names or ([] if files else list(PAPER))
    require_known(names, known, "object", "objects")
    require_once(names, "objects")
    objects = {name: named_object(name) for name in names}
    for path in files:
        if path.stem in {*known, *objects}:
            raise ConfigurationError(f"there is an object '{path.stem}' already: rename {path}")
        objects[path.stem] = read_object(path)
    return objects


def object_settings(thing: ObjectConfig) -> Any:
    """Give what makes up an object; of a file what is in it."""
    if not isinstance(thing, UrdfObjectConfig):
        return thing.model_dump(mode="json")
    content = RobotConfig(urdf=thing.urdf, folder=thing.folder).path().read_bytes()
    return {"urdf": Path(thing.urdf).name, "sha256": hashlib.sha256(content).hexdigest()}
