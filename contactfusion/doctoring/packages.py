"""Python packages: those that the core needs, and those of the extras."""

import re
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec

from contactfusion.doctoring.finding import Finding
from contactfusion.extras import EXTRAS, installs


def package_findings() -> Iterator[Finding]:
    """Look for each package of the core, then for the extras; a missing extra is no fault."""
    for requirement in requires("contactfusion") or []:
        if "extra ==" not in requirement:
            name = re.split(r"[^A-Za-z0-9._-]", requirement)[0]
            found = found_version(name)
            if found is None:
                yield Finding(f"{name} is missing", f"pip install {name}", core=True)
            else:
                yield Finding(f"{name} {found}")
    for extra, packages in EXTRAS.items():
        if all(is_importable(module) for module in packages.values()):
            yield Finding(f"extra {extra}: installed")
        else:
            yield Finding(f"extra {extra}: not installed", installs(extra))


def is_importable(module: str) -> bool:
    """Whether a top-level module is installed, whichever package brought it; imports nothing."""
    return find_spec(module) is not None


def found_version(package: str) -> str | None:
    """Give the version of an installed package; None: it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
