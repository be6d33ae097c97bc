"""Libraries of the system that packages of extras load, and the line that installs them.

Each is asked for by the name by which the package itself would load it, so that what the loader
knows is known here, too; the package, which may take seconds, is not imported.
"""

import ctypes
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from contactfusion.doctoring.finding import Finding
from contactfusion.doctoring.packages import is_importable

VULKAN_DRIVER = "a driver for Vulkan"
"""What libvulkan needs beside itself; its file tells where the library is."""
DRIVER_FOLDERS = ("/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d", "/usr/share/vulkan/icd.d")
"""Where libvulkan looks for drivers, unless the environment names one."""
DRIVER_VARIABLES = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")


@dataclass(frozen=True)
class Need:
    """What a module needs of the system.

    Attributes:
        module: of Python.
        purpose: what does not work without, for people.
        libraries: for each library the package of Debian that brings it.
    """

    module: str
    purpose: str
    libraries: Mapping[str, str]


NEEDS = (
    Need(
        "open3d",
        "open3d",
        {"libEGL.so.1": "libegl1", "libGL.so.1": "libgl1", "libusb-1.0.so.0": "libusb-1.0-0"},
    ),
    Need("pinocchio", "pin", {"libgomp.so.1": "libgomp1"}),
    Need(
        "rerun",
        "view --screenshot",
        {"libvulkan.so.1": "libvulkan1", VULKAN_DRIVER: "mesa-vulkan-drivers"},
    ),
)
"""Proven on a bare Debian 12."""


def library_findings() -> Iterator[Finding]:
    """Look for the libraries of the packages that are installed; one line, all that is missing."""
    if sys.platform != "linux":
        return
    needs = [need for need in NEEDS if is_importable(need.module)]
    missing = [
        (library, debian, need.purpose)
        for need in needs
        for library, debian in need.libraries.items()
        if not _is_there(library)
    ]
    if missing:
        named = ", ".join(f"{library} (for {purpose})" for library, _, purpose in missing)
        packages = " ".join(debian for _, debian, _ in missing)
        yield Finding(f"system libraries are missing, {named}", apt(packages))
    elif needs:
        yield Finding(f"system libraries: there for {', '.join(need.purpose for need in needs)}")


def apt(packages: str) -> str:
    """Give the line that installs packages of Debian, separated by spaces."""
    return f"{'' if os.geteuid() == 0 else 'sudo '}apt-get install -y {packages}"


def _is_there(library: str) -> bool:
    if library == VULKAN_DRIVER:
        return _has_driver()
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _has_driver() -> bool:
    named = [os.environ[name] for name in DRIVER_VARIABLES if os.environ.get(name)]
    if named:
        return all(Path(file).is_file() for file in named[0].split(os.pathsep))
    return any(any(Path(folder).glob("*.json")) for folder in DRIVER_FOLDERS)
