"""A replay to look at: what came, what was found, and why, in rerun's viewer."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.files import require_spared
from contactfusion.loop import Observer
from contactfusion.run.asking import Source
from contactfusion.run.execute import Watch
from contactfusion.run.session import Session
from contactfusion.terminal import followed, say
from contactfusion.view import show
from contactfusion.view.recorder import loaded_rerun
from contactfusion.view.viewer import Viewer

DRAWN = ".rrd"
"""The suffix of what is drawn already."""


@contextmanager
def drawing(session: Session, rrd: Path) -> Iterator[Observer]:
    """What draws a run into a file of rerun, and reports at the end what could not be placed."""
    with Viewer(session.pipeline.config, rrd) as viewer:
        yield Observer(
            step=lambda step: viewer.step(step, session.pipeline.state(step.stamp)),
            reading=viewer.reading,
        )
    for line in viewer.absences():
        say(line)


def view_recording(
    source: Source,
    save: Path | None,
    screenshot: Path | None,
    at: float | None,
    web: bool,
) -> None:
    """Draw a recording and what is found in it, and show that.

    Args:
        source: what is played; a `.rrd` is shown as it is.
        save: takes what is drawn (.rrd); None: it is thrown away afterwards.
        screenshot: takes a picture; then no window opens.
        at: the time of the picture [s]; None: the end.
        web: show it in a browser of this machine.

    Raises:
        ContactFusionError: something is not what it should be, or there is no screen.
        DependencyError: rerun is not installed.
    """
    if at is not None and screenshot is None:
        raise ConfigurationError("--at is the time of a picture: name its file with --screenshot")
    if web and screenshot is not None:
        raise ConfigurationError("--screenshot opens no browser: leave --web out")
    read = [source.recording] if source.recording.suffix == DRAWN else source.files()
    for option, path in (("--save", save), ("--screenshot", screenshot)):
        if path is not None:
            require_spared(option, path, read)
    loaded_rerun()  # before a screen is asked for, or a recording drawn
    if screenshot is None and save is None and not web:
        show.require_screen()
    with TemporaryDirectory() as folder:
        rrd, session = source.recording, None
        if rrd.suffix != DRAWN:
            rrd = save or Path(folder) / f"{source.recording.stem}{DRAWN}"
            session = source.session(watched=True)
            with closing(session), drawing(session, rrd) as output:
                task, end = f"drawing {source.recording}", session.stream.end
                for _ in followed(session.steps(output), task, end):
                    pass
        if screenshot is not None:
            show.screenshot(rrd, screenshot, at)
            say(f"results: {screenshot}")
        elif save is not None and not web:
            say(f"results: {save}")
        else:
            show.show(rrd, web)
    if session is not None:
        session.complain()


@contextmanager
def shown(name: str) -> Iterator[Watch]:
    """Open what draws a run, and show what came of it at the end.

    Args:
        name: of the file of rerun, as its viewer shows it.

    Raises:
        DependencyError: rerun is not installed.
        ConfigurationError: there is no screen.
    """
    loaded_rerun()
    show.require_screen()
    with TemporaryDirectory() as folder:
        rrd = Path(folder) / f"{name}{DRAWN}"
        try:
            yield lambda session: drawing(session, rrd)
        except ContactFusionError:
            if rrd.exists():  # what came before it can be looked at
                show.show(rrd)
            raise
        show.show(rrd)
