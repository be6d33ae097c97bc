"""What ezc3d reads of a C3D file, as plain data: it is called in a process with limits.

On broken files ezc3d crashes, loops, and takes memory without bounds. It stands apart from the
reader, of which that process would load a second's worth of modules.
"""

from collections.abc import Mapping
from typing import Any


def content(path: str) -> dict[str, Any]:
    """Header, parameters and data of a file, with those of its force plates.

    Raises:
        Exception: of several kinds: it can't be read.
    """
    import ezc3d

    read = ezc3d.c3d(path)
    plates = read["parameters"].get("FORCE_PLATFORM", {}).get("USED")
    if plates and any(plates["value"]):
        read = ezc3d.c3d(path, extract_forceplat_data=True)
    kept = {"header": ("points", "analogs"), "data": ("points", "platform")}
    parts = {part: {name: read[part].get(name, ()) for name in kept[part]} for part in kept}
    parts["parameters"] = read["parameters"]
    return {part: _plain(held) for part, held in parts.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(held) for key, held in value.items() if not key.startswith("__")}
    if isinstance(value, list | tuple):
        return [_plain(held) for held in value]
    return value
