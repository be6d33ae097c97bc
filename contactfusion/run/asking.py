"""Questions to a recording: why is there a contact, who is worth what, which values do best."""

import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from contactfusion.errors import DependencyError, TimeError
from contactfusion.files import require_spared, write_whole
from contactfusion.pipeline import Pipeline
from contactfusion.run.configuration import (
    Setting,
    kept_setting,
    names_stream,
    setting_of_file,
    setting_of_recording,
)
from contactfusion.run.inputs import roles_of
from contactfusion.run.session import Session
from contactfusion.run.summary import Summary, refuse, refused_at_once
from contactfusion.terminal import followed, note, progress, say


@final
@dataclass(frozen=True)
class Source:
    """A recording, and the configuration that listens to it.

    Attributes:
        recording: the file or folder, or a configuration that names what it plays.
        configuration: a YAML file; None: the configuration that a run left in the recording, or the
            one in the recording's place.
        topics: topics by role.
        overrides: fields of the configuration to change, as "a.b=c".
        ignored: topics that are not read at all.
    """

    recording: Path
    configuration: Path | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    overrides: Sequence[str] = ()
    ignored: Sequence[str] = ()

    @property
    def _is_whole(self) -> bool:
        """Whether the configuration names the recording, too."""
        return self.configuration is None and names_stream(self.recording)

    def setting(self) -> Setting:
        """Read the configuration; topics are those of the run that wrote the recording, if any.

        Raises:
            ContactFusionError: there is none, or it is not what it should be.
        """
        if self._is_whole:
            setting = setting_of_file(self.recording, self.overrides)
        elif self.configuration is None:
            setting = setting_of_recording(self.recording, self.overrides)
        else:
            setting = setting_of_file(self.configuration, self.overrides)
            if kept := kept_setting(self.recording):
                roles = roles_of(setting.config().generators)
                known = {role: topic for role, topic in kept.topics.items() if role in roles}
                setting = setting.choosing(known, kept.ignored)
        return setting.choosing(self.topics, self.ignored)

    def files(self) -> list[Path]:
        """The files that are read: the recording, the configuration, and those that they name.

        Raises:
            ContactFusionError: the configuration is not what it should be.
        """
        return [self.recording, *self.setting().files(self.recording)]

    def session(self, watched: bool = False) -> Session:
        """Open the recording.

        Args:
            watched: whether to play what no generator listens to, too.

        Raises:
            ContactFusionError: it, or the configuration, is not what it should be.
        """
        with progress(f"opening {self.recording}"):
            played = None if self._is_whole else self.recording
            session = Session(self.setting(), played, watched=watched)
        for line in session.inputs.taken:
            note(line, file=sys.stderr)  # stdout may be JSON
        return session


def explain_recording(
    source: Source,
    time: float,
    at: tuple[float, ...] | None,
    as_json: bool,
    picture: Path | None,
) -> None:
    """Print why there are contacts at a time, and why there are none where there might be.

    Args:
        source: what is explained.
        time: [s] from the beginning of the recording.
        at: the place that is asked for, x, y, z [m]; None: all contacts, and where one was near.
        as_json: whether to print JSON.
        picture: takes a picture; None: none does.

    Raises:
        ContactFusionError: the time lies outside the recording, or nothing is near the place.
    """
    if picture is not None:
        require_spared("--picture", picture, source.files())
    from contactfusion.explain import explanation, text
    from contactfusion.explain.moment import Settings, moment_at

    with closing(source.session()) as session:
        settings = Settings.of(session.pipeline)
        try:
            task = f"playing {source.recording}"
            with closing(followed(session.steps(), task, time)) as steps:
                moment = moment_at(steps, time, settings.tolerance)
        except TimeError:
            session.complain()  # when it broke off before that time
            raise
        explained = explanation.explanation_of(moment, settings, at)
    say(explanation.as_json(explained) if as_json else text.as_text(explained), lines=True)
    if picture is not None:
        from contactfusion.explain.picture import picture as drawn

        write_whole(picture, drawn(explained, moment.step.fusion))
    session.complain()


def ablate_recording(source: Source, out: Path) -> None:
    """Print and write what contacts would be without each source, over a whole recording.

    Where matplotlib is not installed there is no picture, and a line says so.

    Args:
        source: what is played.
        out: the folder that takes ablation.csv, ablation.json and a picture.

    Raises:
        ContactFusionError: there is no step, or source is not what it should be.
    """
    from contactfusion.explain.ablation import FILES, ablated, table, write_ablation, write_picture

    read = source.files()
    for name in FILES:
        require_spared("--out", out / name, read)
    with closing(source.session()) as session:
        task = f"leaving sources out of {source.recording}"
        summary = Summary(session.pipeline)
        steps = followed(session.steps(summary.observer), task, session.stream.end)
        worths = ablated(steps)
        refused = [why for _, why in summary.refused()]
    paths = write_ablation(worths, out)
    note(table(worths), lines=True)
    try:
        paths.append(write_picture(worths, out))
    except DependencyError as error:
        note(f"no picture is drawn: {error}")
    say(f"results: {', '.join(map(str, paths))}")
    session.complain()
    refuse(source.configuration or source.recording, refused)


def tune_recording(
    source: Source, labels: Path, vary: Sequence[str], within: float, out: Path
) -> None:
    """Print and write which values find labelled contacts best; goes on where it stopped.

    Args:
        source: what is played.
        labels: a CSV of when and where there truly were contacts.
        vary: fields and their values, as "a.b=1,2,3"; empty: the usual ones.
        within: a contact that is nearer to a label counts [m].
        out: the folder that takes the results.

    Raises:
        ContactFusionError: a field, the labels, or source is not what it should be.
    """
    from contactfusion.tune.fusion import fingerprint, tune_fusion
    from contactfusion.tune.report import table, write_picture, write_tuning

    with closing(source.session()) as session:
        refused = refused_at_once(session.pipeline, session.readings())
        refuse(source.configuration or source.recording, refused)
        chosen = {"topics": dict(session.setting.topics), "ignored": list(session.setting.ignored)}
        # of the configuration the fields count, not the text
        files = [file for file in source.files() if file != source.configuration]

        def pipeline(overrides: Sequence[str]) -> Pipeline:
            setting = session.setting.changed(overrides)
            varied = Pipeline(setting.config(session.fed(setting)))
            varied.conflates = session.pipeline.conflates
            return varied

        tuned = tune_fusion(
            pipeline,
            session.readings,
            labels,
            out,
            vary=vary,
            within=within,
            inputs={
                **fingerprint(source.recording, files),
                **{name: topics for name, topics in chosen.items() if topics},
            },
        )
    paths = write_tuning(tuned, out)
    note(table(tuned), lines=True)
    try:
        paths.append(write_picture(tuned, out))
    except DependencyError as error:
        note(f"no picture is drawn: {error}")
    say(f"results: {', '.join(map(str, paths))}")
    session.complain()
