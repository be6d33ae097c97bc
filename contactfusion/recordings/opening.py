"""One way to open every recording: by a file, or by a description of what is in it."""

from collections.abc import Callable, Mapping
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any
from weakref import finalize

from contactfusion.errors import ConfigurationError, RecordingError, name_hint
from contactfusion.files import require_file
from contactfusion.recordings.c3d import C3DConfig, C3DRecording
from contactfusion.recordings.icub import IcubConfig, IcubRecording
from contactfusion.recordings.log import LogConfig, LogFile, LogRecording
from contactfusion.recordings.ouster import convert
from contactfusion.recordings.recording import Recording
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.yaml_files import read_yaml

DESCRIBED = (".csv", ".tsv", ".dat", ".npy", ".npz")
"""Files that say too little of themselves: a description must say what their columns are."""

YAML = (".yaml", ".yml")
"""Files that describe recordings, or configure pipelines."""


def _log(options: dict[str, Any], folder: Path) -> Recording:
    files = LogConfig(**options).files if "files" in options else (LogFile(**options),)
    return LogRecording(files, folder)


def _c3d(options: dict[str, Any], folder: Path) -> Recording:
    return C3DRecording(C3DConfig(**options), folder)


def _icub(options: dict[str, Any], folder: Path) -> Recording:
    return IcubRecording(IcubConfig(**options), folder)


def _ros(options: dict[str, Any], folder: Path) -> Recording:
    return RosRecording(RosConfig(**options), folder)


def _ouster(options: dict[str, Any], folder: Path) -> Recording:
    """Convert to MCAP in a folder that is removed when nobody holds the recording any more."""
    made = Path(mkdtemp(prefix="contactfusion-"))
    try:
        convert(folder / options["file"], made / "scans.mcap")
        recording = RosRecording(RosConfig(file=made / "scans.mcap"))
    except BaseException:
        rmtree(made)
        raise
    finalize(recording, rmtree, made)
    return recording


TYPES: dict[str, Callable[[dict[str, Any], Path], Recording]] = {
    "log": _log,
    "c3d": _c3d,
    "icub": _icub,
    "ros": _ros,
    "mcap": _ros,
}
"""What opens each type of recording, given the rest of its description and its folder."""
SUFFIXES: dict[str, Callable[[dict[str, Any], Path], Recording]] = {
    ".c3d": _c3d,
    ".zip": _c3d,
    ".txt": _icub,
    ".bag": _ros,
    ".active": _ros,
    ".db3": _ros,
    ".mcap": _ros,
    ".pcap": _ouster,
    ".osf": _ouster,
}
"""What opens a recording that needs no description, by the suffix of the file."""


def is_ros(path: Path) -> bool:
    """Whether a file or a folder is read as a recording of ROS."""
    return path.is_dir() or SUFFIXES.get(path.suffix) is _ros


def open_recording(what: str | Path | Mapping[str, Any], folder: Path = Path()) -> Recording:
    """Open a recording.

    Args:
        what: a recording (`.c3d`, a `.zip` that holds one, an iCub trial `.txt`, of ROS `.bag`,
            `.db3`, `.mcap` or a folder of them, of Ouster `.pcap` or `.osf`), a YAML file with the
            description of one, or that description as a mapping: its `type` (`log`, `c3d`, `icub`
            or `ros`) and the fields of `LogFile` or `LogConfig`, `C3DConfig`, `IcubConfig` or
            `RosConfig`.
        folder: where relative file names start; in a YAML file they start at its own folder.

    Raises:
        ConfigurationError: the description is wrong.
        RecordingError: the file is missing, cut off, not what it says it is, or of no known type.
        DependencyError: the package that reads it is not installed, or for a file of Ouster's the
            environment that converts it is not there.
    """
    if isinstance(what, Mapping):
        return _described(what, folder)
    path = folder / what
    if path.suffix in YAML:
        description = read_yaml(path)
        if unfit := unfit_configuration(path, description):
            raise ConfigurationError(unfit)
        try:
            return _described(description, path.parent)
        except ConfigurationError as error:
            raise ConfigurationError(f"{path}: {error}") from None
    if path.is_dir():
        return _ros({"file": path}, Path())
    require_file(path, RecordingError)
    if path.suffix in SUFFIXES:
        return SUFFIXES[path.suffix]({"file": path}, Path())
    if path.suffix in DESCRIBED:
        raise RecordingError(
            f"{path} needs a description of its columns, a YAML file with 'type: log' and "
            f"'file: {path.name}': `contactfusion inspect {path}` prints one to copy"
        )
    raise RecordingError(
        f"{path} can't be read; what can: {', '.join(SUFFIXES)}, and by a description in .yaml: "
        f"{', '.join(DESCRIBED)}"
    )


def unfit_configuration(path: Path, fields: Mapping[str, Any]) -> str:
    """The sentence on a configuration that stands where a recording is asked for.

    Args:
        path: a YAML file.
        fields: what it holds.

    Returns:
        What to give in its place; empty where it is no configuration.
    """
    if "type" in fields or fields.keys().isdisjoint(("recording", "scene", "generators")):
        return ""
    recording = fields.get("recording")
    runs = f"{path} is a configuration that `contactfusion run {path}` runs, and no recording"
    if isinstance(recording, Mapping):
        kind, file = recording.get("type"), recording.get("file")
        if kind in TYPES and kind != "log" and isinstance(file, str):
            return f"{runs}: give the one that it names, {path.parent / file}"
        return f"{runs}: give a YAML file that holds only what stands under its `recording`"
    if "scene" in fields:
        return f"{runs}: give the one that `contactfusion record {path}` makes"
    return f"{path} is a configuration, and no recording: give the recording that it is for"


def _described(description: Mapping[str, Any], folder: Path) -> Recording:
    options = dict(description)
    kind = options.pop("type", None)
    if kind not in TYPES:
        hint = name_hint(str(kind or ""), TYPES, "types of recording")
        wrong = "this field is required" if kind is None else f"unknown type '{kind}'"
        raise ConfigurationError(f"{wrong}; {hint}", "type")
    return TYPES[kind](options, folder)
