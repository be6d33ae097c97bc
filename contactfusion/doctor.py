"""Checks an installation, and says the one command that mends each fault."""

import sys
import time
from collections.abc import Iterator
from importlib.metadata import version

from contactfusion.doctoring.finding import Finding
from contactfusion.doctoring.kernels import kernel_finding, touch_kernels
from contactfusion.doctoring.libraries import library_findings
from contactfusion.doctoring.packages import package_findings
from contactfusion.doctoring.parts import (
    network_finding,
    ouster_finding,
    plugin_findings,
    sphere_finding,
)
from contactfusion.plugins import installed_plugins
from contactfusion.terminal import note


def check() -> bool:
    """Print the state of the installation; a line that names a fault ends with what mends it.

    Returns:
        Whether contactfusion itself works; a missing extra is no fault of it.
    """
    print(f"python {sys.version.split()[0]}, contactfusion {version('contactfusion')}")
    sound = True
    for finding in _findings():
        print(f"  {finding}", flush=True)
        sound = sound and not finding.core
    return sound


def compile_kernels() -> None:
    """Compile every kernel, so that no control loop ever waits for the compiler."""
    note("compiling kernels (a minute, once) ...")
    start = time.perf_counter()
    touch_kernels()
    print(f"kernels are ready after {time.perf_counter() - start:.1f} s")


def _findings() -> Iterator[Finding]:
    yield from package_findings()
    yield from library_findings()
    yield ouster_finding()
    yield network_finding()
    yield from plugin_findings(installed_plugins())
    yield kernel_finding()
    yield sphere_finding()
