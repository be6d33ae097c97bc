"""The configuration of a run: from a file, or from the recording that an earlier run wrote."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import relpath
from pathlib import Path
from typing import Any, Final, Self, final

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, RecordingError, naming
from contactfusion.files import named_files, require_file
from contactfusion.live.config import LiveConfig
from contactfusion.model import Model
from contactfusion.pipeline_config import (
    PipelineConfig,
    overridden,
    pipeline_fields,
    with_identified,
)
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.opening import (
    DESCRIBED,
    SUFFIXES,
    YAML,
    is_bag,
    unfit_configuration,
)
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.step_messages import OURS
from contactfusion.yaml_files import read_yaml, require_shallow

TOPIC: Final = f"{OURS}configuration"
"""Where a run keeps its configuration, as std_msgs/String."""


class RunConfig(PipelineConfig):
    """A pipeline, and what it listens to: a recording or a scene, or a running robot."""

    recording: dict[str, Any] = Field(default_factory=dict)
    """The `type` of the recording and its options."""
    scene: dict[str, Any] = Field(default_factory=dict)
    """The `type` of the scene and its options."""
    live: LiveConfig = LiveConfig()
    """For `contactfusion live`: where commands go, and when they are zero."""

    @model_validator(mode="after")
    def _one_stream(self) -> Self:
        if not self.recording and not self.scene:
            raise ConfigurationError("give a recording, or a scene", "recording")
        if self.recording and self.scene:
            raise ConfigurationError("give a recording or a scene, not both", "scene")
        if self.scene and self.robot is None:
            raise ConfigurationError("a scene needs a robot by URDF", "robot")
        return self


class Kept(Model):
    """What a recording holds of the run that wrote it."""

    configuration: dict[str, Any]
    """The fields of the pipeline's configuration."""
    folder: Path
    """Where relative file names in them start, from the folder of the recording."""
    topics: dict[str, str]
    """Topics by role."""
    ignored: tuple[str, ...] = ()
    """Topics that are not read at all."""


@final
@dataclass(frozen=True)
class Setting:
    """The fields of a configuration, and where they come from.

    Attributes:
        fields: of `RunConfig`, or of `PipelineConfig` alone.
        folder: where relative file names in them start.
        topics: topics by role, as on the command line of this or of an earlier run.
        origin: the file, for sentences.
        ignored: topics that are not read at all, likewise.
        within: the folder that all files they name have to lie in, of a recording; None: they may
            lie anywhere.
    """

    fields: Mapping[str, Any]
    folder: Path
    topics: Mapping[str, str]
    origin: Path
    ignored: tuple[str, ...] = ()
    within: Path | None = None

    def config(self, generators: Mapping[str, Any] | None = None) -> PipelineConfig:
        """The configuration of the pipeline, with other options of its generators.

        Raises:
            ConfigurationError: a field is wrong; the sentence names the file.
        """
        fields = {**self._rooted, **({} if generators is None else {"generators": generators})}
        with naming(self.origin):
            return PipelineConfig(**pipeline_fields(fields))

    def run_config(self) -> RunConfig:
        """The configuration with the recording or the scene that it names.

        Raises:
            ConfigurationError: it names none, or a field is wrong; the sentence names the file.
        """
        with naming(self.origin):
            return RunConfig(**self._rooted)

    @property
    def _rooted(self) -> dict[str, Any]:
        within = {} if self.within is None else {"files_within": self.within}
        return {"folder": self.folder, **self.fields, **within}

    def changed(self, overrides: Sequence[str]) -> "Setting":
        """The setting with fields changed as by "a.b=c"."""
        return replace(self, fields=overridden(self.fields, overrides))

    def choosing(self, topics: Mapping[str, str], ignored: Sequence[str]) -> "Setting":
        """The setting with further topics by role, and further ones that are not read."""
        return replace(self, topics={**self.topics, **topics}, ignored=(*self.ignored, *ignored))

    def files(self, recording: Path | None) -> list[Path]:
        """The files that are read: the configuration, the recording, and those that they name.

        Descriptions in YAML, as of a robot or a log, name files of their own.

        Args:
            recording: what is played, a file or a folder; None: what the configuration names.

        Raises:
            ConfigurationError: one of them is no YAML, though its name says so.
        """
        files = [*named_files(self.fields, self.folder, self.within)]
        if self.origin.suffix in YAML and self.origin.is_file():
            identified = read_yaml(self.origin).get("identified")  # its content stands in `fields`
            files += [self.folder / identified] if isinstance(identified, str) else []
        if recording is not None:
            files.append(recording)
        described = [path for path in files if path.suffix in YAML and path.is_file()]
        for path in described:
            files += named_files(read_yaml(path), path.parent)
        return [self.origin, *files]

    def text(self, beside: Path) -> str:
        """The text that a recording keeps of it.

        Args:
            beside: the folder of the recording; that of the files is stated from there.
        """
        folder = relpath(self.folder.resolve(), beside.resolve())
        fields = pipeline_fields(self.fields)
        kept: dict[str, Any] = {"folder": folder, "topics": dict(self.topics)}
        kept["configuration"] = fields
        if self.ignored:
            kept["ignored"] = self.ignored
        return json.dumps(kept, indent=1, sort_keys=True, default=str)


def read_fields(path: Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Read the fields of a configuration.

    Args:
        path: a YAML file.
        overrides: fields to change, as "a.b=c".

    Raises:
        ConfigurationError: the file, or that of `identified`, is missing, a recording, or no
            YAML, or a change is none.
    """
    if not (is_recording := is_bag(path)):
        require_file(path, ConfigurationError)
    if is_recording or path.suffix.lower() in (*DESCRIBED, *SUFFIXES):
        raise ConfigurationError(
            f"{path} is a recording, and no configuration: `contactfusion init {path} --out "
            f"{path.stem}.yaml` writes a first configuration for it"
        )
    return overridden(with_identified(read_yaml(path), path.parent), overrides)


def setting_of_file(path: Path, overrides: Sequence[str] = (), seed: int | None = None) -> Setting:
    """Read a configuration.

    Args:
        path: the file; relative names in it start at its folder.
        overrides: fields to change, as "a.b=c".
        seed: in place of the file's; None: that of the file.

    Raises:
        ConfigurationError: the file is missing, a recording, or no YAML, or a change is none.
    """
    fields = read_fields(path, overrides)
    return Setting(fields if seed is None else {**fields, "seed": seed}, path.parent, {}, path)


def names_stream(path: Path) -> bool:
    """Whether a file is a configuration that names the recording or the scene that it plays."""
    if path.suffix not in YAML or not path.is_file():
        return False
    fields = read_yaml(path)
    return "type" not in fields and not fields.keys().isdisjoint(("recording", "scene"))


def setting_of_recording(path: Path, overrides: Sequence[str] = ()) -> Setting:
    """Read the configuration that a run left in its recording.

    Whoever made the recording wrote it: the files that it names lie beside the recording, or in
    packages that are installed, and nothing is imported to find them.

    Raises:
        RecordingError: there is none, or it is not what a run writes.
        ConfigurationError: the path is that of a configuration.
        DependencyError: rosbags is not installed.
    """
    if not is_bag(path):
        require_file(path, RecordingError)
    setting = kept_setting(path)
    if setting is None:
        unfit = path.suffix in YAML and unfit_configuration(path, read_yaml(path))
        if unfit:
            raise ConfigurationError(f"{unfit}, and the configuration by --config {path}")
        raise RecordingError(
            f"{path} holds no configuration, as `contactfusion run CONFIG {path.name} --out "
            f"FILE.mcap` keeps one: run it first, or name a configuration with --config"
        )
    return setting.changed(overrides)


def kept_setting(path: Path) -> Setting | None:
    """Read the configuration that a run left in its recording; None where none did.

    Raises:
        RecordingError: the recording can't be read, or holds what no run writes.
        DependencyError: rosbags is not installed.
    """
    text = _kept_text(path) if path.suffix == ".mcap" and path.is_file() else None
    if text is None:
        return None
    try:
        kept = Kept(**json.loads(text))
        require_shallow(kept.configuration)
    except (ConfigurationError, ValueError, TypeError, RecursionError) as error:
        raise RecordingError(f"{path}: {TOPIC} is not what a run writes: {error}") from None
    folder = path.parent / kept.folder
    return Setting(kept.configuration, folder, kept.topics, path, kept.ignored, path.parent)


def _kept_text(path: Path) -> str | None:
    with Bag(path) as bag:
        here = [channel for channel in bag.channels if channel.topic == TOPIC]
        for channel, _, raw in bag.messages(here) if here else ():
            try:
                message: Any = typestore().deserialize_cdr(channel.cdr(raw), channel.msgtype)
                return str(message.data)
            except Exception as error:  # rosbags meets damage with errors of many kinds
                raise RecordingError(f"{path}: {TOPIC} can't be read: {error}") from None
    return None
