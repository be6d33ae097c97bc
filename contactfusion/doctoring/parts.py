"""Plug-ins, networks and the converter of Ouster files: what of them can be used."""

from collections.abc import Iterator

from contactfusion.doctoring.finding import Finding
from contactfusion.doctoring.kernels import can_be_written
from contactfusion.errors import ContactFusionError
from contactfusion.generators.networks import read_networks, shipped
from contactfusion.plugins import HOME, NOBODY, Plugins
from contactfusion.recordings import ouster
from contactfusion.robots.sphere_cache import sphere_folder

AGAIN = f"pip install --force-reinstall --no-deps {HOME}"
"""What brings back parts of the package itself."""


def plugin_findings(plugins: Plugins) -> Iterator[Finding]:
    """Import every plug-in; say why one cannot be used, and what mends it.

    One of contactfusion itself that breaks by itself is a fault of the core. One that lacks an
    extra says so itself; one of another package harms no other.
    """
    plugins.offers("generators")
    for failed, why in plugins.failures.items():
        told = f"plug-in {failed} cannot be used: {why}"
        package = _package(plugins, failed)
        if "pip install " in why:
            yield Finding(told)
        elif package == HOME:
            yield Finding(told, AGAIN, core=True)
        elif package:
            yield Finding(f"{told}; mend it, or take it out", f"pip uninstall {package}")
        else:
            yield Finding(told)
    usable = sum(plugin.name not in plugins.failures for plugin in plugins.listing())
    yield Finding(f"{usable} plug-ins can be used")


def network_finding() -> Finding:
    """Look whether the networks that come with the package are there, and are those of the card."""
    path = shipped()
    try:
        read_networks(path)
    except ContactFusionError as error:
        return Finding(f"networks: {error}", AGAIN, core=True)
    return Finding(f"networks: {path.name} is sound")


def ouster_finding() -> Finding:
    """Tell whether Ouster files can be converted."""
    if ouster.is_ready():
        return Finding(f"Ouster files can be converted: {ouster.CONVERT}")
    return Finding("Ouster files need", ouster.COMMAND)


def sphere_finding() -> Finding:
    """Report where the spheres of robots are kept, and of how many."""
    folder = sphere_folder()
    if folder is None or not can_be_written(folder):
        return Finding("spheres of robots cannot be kept, and are fitted anew by every command")
    count = len([*folder.glob("*.npz")])
    return Finding(f"spheres of {count} robot{'s' * (count != 1)} are kept in {folder}")


def _package(plugins: Plugins, failed: str) -> str:
    """Give the package of a plug-in that failed; empty where no package brought it.

    Args:
        plugins: which have listed it.
        failed: its name; "NAME (PACKAGE VERSION)" when its name was taken, "NAME: KEY" when that of
            something that it offers was.
    """
    name, _, rest = failed.partition(" (")
    if rest:
        return rest.split(" ")[0]
    owners = {plugin.name: plugin.distribution for plugin in plugins.listing()}
    owner = owners.get(name.partition(": ")[0], NOBODY)
    return "" if owner == NOBODY else owner.split(" ")[0]
