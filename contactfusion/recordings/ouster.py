"""Ouster files (.pcap, .osf, bags of packets): converted to MCAP in an environment of its own.

ouster-sdk pins an old rosbags, so it can't be installed beside contactfusion.
"""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

from contactfusion.confined import LimitError, completed, ending
from contactfusion.errors import ConfigurationError, DependencyError, RecordingError
from contactfusion.files import make_folder, require_spared, write_whole
from contactfusion.limits import raised
from contactfusion.terminal import note, say

REQUIREMENTS = ("ouster-sdk==1.0.0", "mcap>=1.2,<2")
"""Packages of the environment; ouster-sdk installs numpy and rosbags."""
SECONDS = 10.0
"""The time that the conversion of a small file may take [s]."""
SLOWEST = 1e5
"""The least speed of the conversion of a large one [bytes/s]."""
MEMORY = 2**32
"""The addresses that the conversion of a small file may take, with its libraries [bytes]."""
TIMES = 10
"""The addresses that a large one may take beside that, as a multiple of its size."""
CONVERTER = Path(__file__).with_name("ouster_converter.py")
COMMAND = "contactfusion doctor --ouster"
"""The command that makes the environment."""
CONVERT = "contactfusion convert SOURCE OUT.mcap"
"""The command that converts, then."""


def environment() -> Path:
    """The folder of the environment, below that of the user's data."""
    home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(home) / "contactfusion" / "ouster"


def is_ready() -> bool:
    """Whether the environment exists and holds what is needed."""
    mark = _mark()
    return _python().exists() and mark.is_file() and mark.read_text() == _content()


def make_environment() -> None:
    """Make the environment unless it exists, and print progress.

    Raises:
        DependencyError: it can't be made.
    """
    folder = environment()
    if is_ready():
        say(f"{REQUIREMENTS[0]} is in {folder}; convert by: {CONVERT}")
        return
    note(f"making an environment for {REQUIREMENTS[0]} in {folder} (about 230 MB) ...")
    make_folder(folder.parent)
    _run(sys.executable, "-m", "venv", "--clear", str(folder))
    _run(str(_python()), "-I", "-m", "pip", "install", "--quiet", *REQUIREMENTS)
    write_whole(_mark(), _content())
    say(f"done; convert by: {CONVERT}")


def convert(source: Path, out: Path, every_nth_row: int = 1, meta: Path | None = None) -> str:
    """Convert a file of Ouster's to MCAP; a sentence on what was written.

    Args:
        source: a .pcap with its .json beside it, an .osf, or a bag of packets.
        out: the MCAP file; an existing one is replaced.
        every_nth_row: number of rows from one that is kept to the next, from the first on.
        meta: the sensor's metadata, when it is neither in the file nor beside it.

    Returns:
        The converter's sentence.

    Raises:
        ConfigurationError: the output is no MCAP file, or would replace what is read.
        DependencyError: there is no environment.
        RecordingError: the file can't be converted.
    """
    require_spared("OUT", out, [source, *([meta] if meta else [])])
    if out.suffix != ".mcap":
        raise ConfigurationError(f"'{out}' is no name for an MCAP file; let it end in .mcap")
    if not is_ready():
        raise DependencyError(
            f"Ouster files need an environment of their own; make it by: {COMMAND}"
        )
    options = ["--every-nth-row", str(every_nth_row), *(["--meta", str(meta)] if meta else [])]
    # isolated: else the modules beside the converter would hide the packages of the same names
    command = [str(_python()), "-I", str(CONVERTER), *options, "--", str(source), str(out)]
    size = source.stat().st_size if source.is_file() else 0
    try:
        status, output, errors = completed(
            command,
            seconds=raised(SECONDS + size / SLOWEST),
            memory=round(raised(MEMORY + TIMES * size)),
        )
    except LimitError as error:
        raise RecordingError(f"{source} can't be converted: {error}") from None
    messages = _lines(errors.decode(errors="replace"))
    if status < 0:
        raise RecordingError(f"{source} can't be converted: {ending(status)}")
    if status:
        raise RecordingError(messages[-1] if messages else f"{source} can't be converted")
    for warning in messages:  # such as that a file is cut off
        say(warning, file=sys.stderr)
    return output.decode(errors="replace").strip()


def _python() -> Path:
    scripts = Path(sysconfig.get_path("scripts")).name
    return environment() / scripts / ("python.exe" if os.name == "nt" else "python")


def _mark() -> Path:
    """The file that lists what is installed, written once all is."""
    return environment() / "contactfusion.txt"


def _content() -> str:
    return "\n".join(REQUIREMENTS) + "\n"


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        messages = _lines(done.stderr) or _lines(done.stdout) or ["no reason was given"]
        errors = [line for line in messages if line.startswith("ERROR: ")] or messages[-1:]
        raise DependencyError(
            f"the environment for Ouster files can't be made: {errors[-1].removeprefix('ERROR: ')}"
        )


def _lines(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip()]
