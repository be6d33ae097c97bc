"""Opening of every recording: by a file, or by a description of its contents."""

from collections.abc import Mapping
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any
from weakref import finalize

from contactfusion.errors import (
    ConfigurationError,
    Guard,
    PluginError,
    RecordingError,
    name_hint,
)
from contactfusion.files import require_file
from contactfusion.model import Model
from contactfusion.plugins import class_fault, configured, installed_plugins, refuse
from contactfusion.recordings.c3d import C3DRecording
from contactfusion.recordings.icub import IcubRecording
from contactfusion.recordings.ouster import convert
from contactfusion.recordings.recording import Recording, RecordingFormat
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.yaml_files import read_yaml

DESCRIBED = (".csv", ".tsv", ".dat", ".npy", ".npz")
"""Files that need a description of their columns."""

YAML = (".yaml", ".yml")
"""Files that describe recordings, or configure pipelines."""


SUFFIXES = {
    **dict.fromkeys(C3DRecording.suffixes, "c3d"),
    **dict.fromkeys(IcubRecording.suffixes, "icub"),
    **dict.fromkeys(RosRecording.suffixes, "ros"),
    **dict.fromkeys((".pcap", ".osf"), "ouster"),
}
"""The type of a recording that needs no description, by the suffix of its file."""


def kind_of(path: Path) -> str:
    """The type of a recording by the suffix of its file; empty where that is not unique.

    Programs of other systems write upper case, but those of ROS look for lower.
    """
    kind = SUFFIXES.get(path.suffix.lower(), "")
    return "" if kind == "ros" and path.suffix not in SUFFIXES else kind


def is_ros(path: Path) -> bool:
    """Whether a file or a folder is read as a recording of ROS."""
    return path.is_dir() or kind_of(path) == "ros"


def is_bag(path: Path) -> bool:
    """Whether a folder holds recordings of ROS."""
    return path.is_dir() and any(kind_of(each) == "ros" for each in path.iterdir())


def recording_class(name: str) -> type[RecordingFormat]:
    """The class of a type of recording.

    Raises:
        ConfigurationError: no such type is installed.
        PluginError: its class breaks the contract, or cannot be imported.
    """
    plugins = installed_plugins()
    try:
        cls: type[RecordingFormat] = plugins.find("recordings", name)
    except PluginError:
        if name in plugins.failures:
            raise
        hint = name_hint(name, plugins.offers("recordings"), "types of recording")
        raise ConfigurationError(f"unknown type '{name}'; {hint}", "type") from None
    refuse(name, cls, class_fault(cls, RecordingFormat, Model))
    return cls


def open_recording(what: str | Path | Mapping[str, Any], folder: Path = Path()) -> Recording:
    """The recording of a file or of a description.

    Args:
        what: a recording (`.c3d`, a `.zip` that holds one, an iCub trial `.txt`, of ROS `.bag`,
            `.db3`, `.mcap` or a folder of them, of Ouster `.pcap` or `.osf`), a YAML file with the
            description of one, or that description as a mapping: its `type` (`log`, `c3d`, `icub`,
            `ros`, or one of a plug-in) and the fields of its `Config`.
        folder: that of relative file names; in a YAML file it is the file's own.

    Raises:
        ConfigurationError: the description is wrong.
        RecordingError: the file is missing, cut off, not of its declared format, or of no known
            type.
        DependencyError: the package that reads it is not installed, or for a file of Ouster's the
            environment that converts it does not exist.
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
        return _opened("ros", {"file": path}, Path())
    require_file(path, RecordingError)
    if kind := kind_of(path):
        return _converted(path) if kind == "ouster" else _opened(kind, {"file": path}, Path())
    if path.suffix.lower() in DESCRIBED:
        raise RecordingError(
            f"{path} needs a description of its columns, a YAML file with 'type: log' and "
            f"'file: {path.name}': `contactfusion inspect {path}` prints one to copy"
        )
    offers = installed_plugins().offers("recordings")
    for kind, cls in offers.items():
        if path.suffix and path.suffix in getattr(cls, "suffixes", ()):
            return _opened(kind, {"file": path}, Path())
    raise RecordingError(
        f"{path} can't be read; what can: {', '.join(SUFFIXES)}, and by a description in .yaml: "
        f"{', '.join(DESCRIBED)}"
    )


def unfit_configuration(path: Path, fields: Mapping[str, Any]) -> str:
    """The sentence on a configuration in place of a recording.

    Args:
        path: a YAML file.
        fields: its fields.

    Returns:
        The recording to use in its place; empty where it is no configuration.
    """
    if "type" in fields or fields.keys().isdisjoint(("recording", "scene", "generators")):
        return ""
    recording = fields.get("recording")
    runs = f"{path} is a configuration that `contactfusion run {path}` runs, and no recording"
    if isinstance(recording, Mapping):
        kind, file = recording.get("type"), recording.get("file")
        if isinstance(kind, str) and kind != "log" and isinstance(file, str):
            return f"{runs}: give the one that it names, {path.parent / file}"
        return f"{runs}: give a YAML file that holds only what stands under its `recording`"
    if "scene" in fields:
        return f"{runs}: give the one that `contactfusion record {path}` makes"
    return f"{path} is a configuration, and no recording: give the recording that it is for"


def _described(description: Mapping[str, Any], folder: Path) -> Recording:
    options = dict(description)
    kind = options.pop("type", None)
    if not isinstance(kind, str):
        hint = name_hint("", installed_plugins().offers("recordings"), "types of recording")
        wrong = "this field is required" if kind is None else f"unknown type '{kind}'"
        raise ConfigurationError(f"{wrong}; {hint}", "type")
    return _opened(kind, options, folder)


def _opened(kind: str, options: Mapping[str, Any], folder: Path) -> Recording:
    cls = recording_class(kind)
    config = configured(kind, cls, options, "")
    with Guard(f"the plug-in '{kind}'", cls):
        return cls.opened(config, folder)


def _converted(path: Path) -> Recording:
    """An Ouster file as MCAP in a folder that is removed with the recording."""
    made = Path(mkdtemp(prefix="contactfusion-"))
    try:
        convert(path, made / "scans.mcap")
        recording = RosRecording(RosConfig(file=made / "scans.mcap"))
    except BaseException:
        rmtree(made)
        raise
    finalize(recording, rmtree, made)
    return recording
