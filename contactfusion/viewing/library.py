"""Rerun, the viewer's library: loaded only where something is drawn or shown."""

import os
import socket
import sys
from pathlib import Path
from typing import Any

from contactfusion.errors import missing_extra

LOCAL = ("--bind", "127.0.0.1")
"""Nobody but this machine may look."""
NOWHERE = "http://127.0.0.1:9"
"""Nobody listens there."""


def loaded_rerun() -> Any:
    """Give the library.

    Raises:
        DependencyError: it is not installed.
    """
    try:
        import rerun
    except ImportError:
        raise missing_extra("rerun-sdk", "view") from None
    return rerun


def program() -> str:
    """Give the program that shows files of rerun; it comes with the library.

    Raises:
        DependencyError: it is not installed.
    """
    try:
        import rerun_cli
    except ImportError:
        raise missing_extra("rerun-sdk", "view") from None
    suffix = ".exe" if sys.platform.startswith("win") else ""
    return str(Path(str(rerun_cli.__file__)).with_name(f"rerun{suffix}"))


def quiet_environment() -> dict[str, str]:
    """Give the environment in which the program reports nothing to anyone.

    Its analytics are off where `CI` is set, so that nothing need be written to the user's home.
    What else it asks for in the internet, such as its newest version, meets a closed door.
    """
    environment = {**os.environ, "CI": "1", "HTTPS_PROXY": NOWHERE, "https_proxy": NOWHERE}
    environment.pop("FORCE_RERUN_ANALYTICS", None)
    return environment


def entity(*names: str) -> str:
    """Give the path of an entity; names may hold slashes and spaces."""
    path: str = loaded_rerun().new_entity_path(list(names))
    return path


def free_port() -> int:
    """Give a port of this machine that nobody listens on."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port
