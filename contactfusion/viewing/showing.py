"""Shows files of rerun: in a window, in a browser, or as a picture without a screen."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

from contactfusion.errors import ContactFusionError
from contactfusion.files import require_file
from contactfusion.viewing.library import LOCAL, loaded_rerun, program, quiet_environment
from contactfusion.viewing.web import serve


def show(rrd: Path, web: bool = False) -> None:
    """Open a file in the viewer, and wait until it is closed.

    Args:
        rrd: the file.
        web: serve the viewer for a browser on this machine, in place of a window.

    Raises:
        ContactFusionError: there is no such file, there is no screen, or the viewer fails.
        DependencyError: rerun is not installed.
    """
    require_recording(rrd)
    if web:
        serve(rrd)
        return
    require_screen()
    command = [program(), str(rrd), *LOCAL, "--port", "auto"]
    if subprocess.run(command, env=quiet_environment()).returncode != 0:
        raise ContactFusionError(f"rerun's viewer could not show {rrd}; it says above why")


def require_screen() -> None:
    """Make sure that a window can be opened.

    Raises:
        ContactFusionError: there is no screen.
    """
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        raise ContactFusionError(
            "there is no screen to open a window on: `contactfusion view` shows it in a browser "
            "(--web), takes a picture (--screenshot FILE.png), or keeps what is drawn for a "
            "machine with a screen (--save FILE.rrd)"
        )


def require_recording(rrd: Path) -> None:
    """Make sure that a file is a recording of rerun, and whole.

    Raises:
        ContactFusionError: it is not.
        DependencyError: rerun is not installed.
    """
    loaded_rerun()
    require_file(rrd, ContactFusionError)
    from rerun.chunk import RrdReader

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # it reads what is cut off, and warns
            recordings = RrdReader(rrd).recordings()
    except (RuntimeError, Warning):
        recordings = []
    if not recordings:
        raise ContactFusionError(f"{rrd} is no recording of rerun, or it is cut off")
