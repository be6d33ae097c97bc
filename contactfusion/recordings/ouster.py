"""Ouster files (.pcap, .osf, bags of packets): converted to MCAP in an environment of its own.

ouster-sdk holds an old rosbags fast, so it can't be installed beside contactfusion.
"""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

from contactfusion.errors import DependencyError, RecordingError
from contactfusion.files import make_folder, write_whole
from contactfusion.terminal import note

REQUIREMENTS = ("ouster-sdk==1.0.0", "mcap>=1.2,<2")
"""What the environment holds; ouster-sdk brings numpy and rosbags."""
CONVERTER = Path(__file__).with_name("ouster_converter.py")
COMMAND = "contactfusion doctor --ouster"
"""What makes the environment."""
CONVERT = "contactfusion convert SOURCE OUT.mcap"
"""What converts, then."""


def environment() -> Path:
    """Give the folder of the environment, below that of the user's data."""
    home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(home) / "contactfusion" / "ouster"


def is_ready() -> bool:
    """Tell whether the environment is there and holds what is needed."""
    mark = _mark()
    return _python().exists() and mark.is_file() and mark.read_text() == _content()


def make_environment() -> None:
    """Make the environment unless it is there, and say what is done.

    Raises:
        DependencyError: it can't be made.
    """
    folder = environment()
    if is_ready():
        print(f"{REQUIREMENTS[0]} is in {folder}; convert by: {CONVERT}")
        return
    note(f"making an environment for {REQUIREMENTS[0]} in {folder} (about 230 MB) ...")
    make_folder(folder.parent)
    _run(sys.executable, "-m", "venv", "--clear", str(folder))
    _run(str(_python()), "-I", "-m", "pip", "install", "--quiet", *REQUIREMENTS)
    write_whole(_mark(), _content())
    print(f"done; convert by: {CONVERT}")


def convert(source: Path, out: Path, every_nth_row: int = 1, meta: Path | None = None) -> str:
    """Convert a file of Ouster's to MCAP.

    Args:
        source: a .pcap with its .json beside it, an .osf, or a bag of packets.
        out: the MCAP file; one that exists is replaced.
        every_nth_row: only these rows of the scans are kept, from the first on.
        meta: the sensor's description, when it is neither in the file nor beside it.

    Returns:
        What was written, as a sentence.

    Raises:
        DependencyError: the environment is not there.
        RecordingError: the file can't be converted.
    """
    if not is_ready():
        raise DependencyError(
            f"Ouster files need an environment of their own; make it by: {COMMAND}"
        )
    options = ["--every-nth-row", str(every_nth_row), *(["--meta", str(meta)] if meta else [])]
    # isolated: or the modules beside the converter would hide the packages of the same names
    command = [str(_python()), "-I", str(CONVERTER), *options, "--", str(source), str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    said = _lines(done.stderr)
    if done.returncode:
        raise RecordingError(said[-1] if said else f"{source} can't be converted")
    for warning in said:  # such as that a file is cut off
        print(warning, file=sys.stderr)
    return done.stdout.strip()


def _python() -> Path:
    scripts = Path(sysconfig.get_path("scripts")).name
    return environment() / scripts / ("python.exe" if os.name == "nt" else "python")


def _mark() -> Path:
    """Give the file that is written when all is installed, and says what."""
    return environment() / "contactfusion.txt"


def _content() -> str:
    return "\n".join(REQUIREMENTS) + "\n"


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        said = _lines(done.stderr) or _lines(done.stdout) or ["no reason was given"]
        errors = [line for line in said if line.startswith("ERROR: ")] or said[-1:]
        raise DependencyError(
            f"the environment for Ouster files can't be made: {errors[-1].removeprefix('ERROR: ')}"
        )


def _lines(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip()]
