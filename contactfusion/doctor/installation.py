"""Checks of an installation, each fault with the one command that mends it."""

import ctypes
import os
import re
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path

from contactfusion.doctor.kernels import MODULES, called, is_kept, touch_kernels
from contactfusion.errors import ContactFusionError
from contactfusion.extras import EXTRAS, installs
from contactfusion.generators.networks import read_networks, shipped
from contactfusion.plugins import HOME, NO_DISTRIBUTION, Plugins, installed_plugins
from contactfusion.recordings import ouster
from contactfusion.robots.spheres import sphere_folder
from contactfusion.terminal import note, say

VULKAN_DRIVER = "a driver for Vulkan"
"""A driver that libvulkan needs; its JSON file names the library."""
DRIVER_FOLDERS = ("/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d", "/usr/share/vulkan/icd.d")
"""Folders in which libvulkan finds drivers, unless the environment names one."""
DRIVER_VARIABLES = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")
WARM = "contactfusion doctor --warm"
"""The command that compiles the kernels."""
AGAIN = f"pip install --force-reinstall --no-deps {HOME}"
"""The command that restores files of the package itself."""


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes:
        text: what was found.
        mend: the command that mends it; empty: there is nothing to mend.
        core: whether contactfusion itself does not work without it.
    """

    text: str
    mend: str = ""
    core: bool = False

    def __str__(self) -> str:
        """The line, with the command at its end."""
        return f"{self.text}: {self.mend}" if self.mend else self.text


def check() -> bool:
    """Print the state of the installation; a line that names a fault ends with what mends it.

    Returns:
        Whether contactfusion itself works; a missing extra is no fault of it.
    """
    say(f"python {sys.version.split()[0]}, contactfusion {version('contactfusion')}")
    sound = True
    for finding in _findings():
        say(f"  {finding}")
        sound = sound and not finding.core
    return sound


def compile_kernels() -> None:
    """Compile every kernel, so that no control loop ever waits for the compiler."""
    note("compiling kernels (a minute, once) ...")
    start = time.perf_counter()
    touch_kernels()
    say(f"kernels are ready after {time.perf_counter() - start:.1f} s")


def _findings() -> Iterator[Finding]:
    yield from package_findings()
    yield from library_findings()
    yield ouster_finding()
    yield network_finding()
    yield from plugin_findings(installed_plugins())
    yield kernel_finding()
    yield sphere_finding()


def package_findings() -> Iterator[Finding]:
    """Packages of the core, then the extras; a missing extra is no fault."""
    for requirement in requires("contactfusion") or []:
        if "extra ==" not in requirement:
            name = re.split(r"[^A-Za-z0-9._-]", requirement)[0]
            found = _found_version(name)
            if found is None:
                yield Finding(f"{name} is missing", f"pip install {name}", core=True)
            else:
                yield Finding(f"{name} {found}")
    for extra, packages in EXTRAS.items():
        if all(_is_importable(module) for module in packages.values()):
            yield Finding(f"extra {extra}: installed")
        else:
            yield Finding(f"extra {extra}: not installed", installs(extra))


def _is_importable(module: str) -> bool:
    """Whether a top-level module is installed, whichever package brought it; imports nothing."""
    return find_spec(module) is not None


def _found_version(package: str) -> str | None:
    """The version of an installed package; None: it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@dataclass(frozen=True)
class Need:
    """System libraries that a module needs.

    Attributes:
        module: its import name.
        purpose: what does not work without them, for people.
        libraries: for each library the package of Debian that holds it.
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
"""Verified on a bare Debian 12."""


def library_findings() -> Iterator[Finding]:
    """System libraries of the installed packages; all that are missing in one line."""
    if sys.platform != "linux":
        return
    needs = [need for need in NEEDS if _is_importable(need.module)]
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
    """The line that installs packages of Debian, separated by spaces."""
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


def plugin_findings(plugins: Plugins) -> Iterator[Finding]:
    """Plug-ins that cannot be used, with the cause and what mends it; every plug-in is imported.

    A fault in contactfusion's own plug-ins is a fault of the core. A plug-in without its extra
    names it; one of another package harms no other.
    """
    plugins.offers("generators")
    for failed, why in plugins.failures.items():
        problem = f"plug-in {failed} cannot be used: {why}"
        package = _package(plugins, failed)
        if "pip install " in why:
            yield Finding(problem)
        elif package == HOME:
            yield Finding(problem, AGAIN, core=True)
        elif package:
            yield Finding(f"{problem}; mend it, or take it out", f"pip uninstall {package}")
        else:
            yield Finding(problem)
    usable = sum(plugin.name not in plugins.failures for plugin in plugins.listing())
    yield Finding(f"{usable} plug-ins can be used")


def network_finding() -> Finding:
    """Whether the networks of the package are present and match their card."""
    path = shipped()
    try:
        read_networks(path)
    except ContactFusionError as error:
        return Finding(f"networks: {error}", AGAIN, core=True)
    return Finding(f"networks: {path.name} is sound")


def ouster_finding() -> Finding:
    """Whether Ouster files can be converted."""
    if ouster.is_ready():
        return Finding(f"Ouster files can be converted: {ouster.CONVERT}")
    return Finding("Ouster files need", ouster.COMMAND)


def sphere_finding() -> Finding:
    """The folder in which spheres of robots are kept, and their number."""
    folder = sphere_folder()
    if folder is None or not _can_be_written(folder):
        return Finding("spheres of robots cannot be kept, and are fitted anew by every command")
    count = len([*folder.glob("*.npz")])
    return Finding(f"spheres of {count} robot{'s' * (count != 1)} are kept in {folder}")


def kernel_finding() -> Finding:
    """Whether kernels can be cached, and are; nothing is compiled."""
    kernels = [kernel for name in MODULES for kernel in called(import_module(name))]
    folders = {kernel.stats.cache_path for kernel in kernels}
    if not all(folder and _can_be_written(Path(folder)) for folder in folders):
        return Finding(
            "kernels cannot be kept on disk, and are compiled again by every process",
            f"export NUMBA_CACHE_DIR={_any_folder()}",
            core=True,
        )
    where = _named(sorted(folders))
    missing = sum(not is_kept(kernel) for kernel in kernels)
    if missing:
        return Finding(f"{missing} of {len(kernels)} kernels are not compiled in {where}", WARM)
    return Finding(f"{len(kernels)} kernels are compiled, in {where}")


def _package(plugins: Plugins, failed: str) -> str:
    """The package of a plug-in that failed; empty where no package brought it.

    Args:
        plugins: which have listed it.
        failed: its name; "NAME (PACKAGE VERSION)" when its name was taken, "NAME: KEY" when that of
            something that it offers was.
    """
    name, _, rest = failed.partition(" (")
    if rest:
        return rest.split(" ")[0]
    owners = {plugin.name: plugin.distribution for plugin in plugins.listing()}
    owner = owners.get(name.partition(": ")[0], NO_DISTRIBUTION)
    return "" if owner == NO_DISTRIBUTION else owner.split(" ")[0]


def _can_be_written(folder: Path) -> bool:
    """Whether files can be put into a folder, which may have to be made."""
    while not os.path.exists(folder) and folder != folder.parent:
        folder = folder.parent
    return os.path.isdir(folder) and os.access(folder, os.W_OK)


def _any_folder() -> Path:
    """A folder that can take the cache."""
    home = Path.home() / ".cache"
    return (home if _can_be_written(home) else Path(tempfile.gettempdir())) / "contactfusion"


def _named(folders: list[str]) -> str:
    more = f" and {len(folders) - 1} more folders" if len(folders) > 1 else ""
    return f"{folders[0]}{more}"
