"""The command line. Heavy modules are imported by the command that needs them."""

import errno
import logging
import os
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from types import FrameType
from typing import Annotated, Any, TextIO

import typer
from typer.main import get_command

from contactfusion import terminal
from contactfusion.cli import live, recordings, running
from contactfusion.cli.plugin_commands import PluginGroup, add_commands
from contactfusion.cli.tuning import tune
from contactfusion.errors import ContactFusionError, cause_in
from contactfusion.terminal import say

EVERYWHERE = {"--debug", "--quiet"}
"""Options of the program that any command takes, too."""
INTERRUPTED = 130
"""The exit status after Ctrl-C or SIGTERM."""
LINGER = 10.0
"""The longest wait at the end for threads of plug-ins [s]."""
RETRY = 0.01
"""The time after which a signal that came inside numba is handled again [s]."""
LOG = logging.getLogger("contactfusion")
app = typer.Typer(
    name="contactfusion",
    help="Where does the robot touch the world? Fuses contact hypotheses from any sensors.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    cls=PluginGroup,
)
for function in (
    running.run,
    running.check,
    running.identify,
    running.record,
    recordings.inspect,
    recordings.init,
    running.replay,
    recordings.explain,
    recordings.ablate,
    recordings.view,
    running.plugins,
    live.live,
    live.ctl,
    running.doctor,
    running.convert,
):
    app.command()(function)
app.add_typer(tune)


def _show_version(wanted: bool) -> None:
    if wanted:
        say(f"contactfusion {version('contactfusion')}")
        raise typer.Exit


def _be_quiet(wanted: bool) -> None:
    if wanted:  # a command that does not say so again takes nothing back
        terminal.set_quiet(True)


def _show_tracebacks(wanted: bool) -> None:
    if wanted:
        LOG.setLevel(logging.DEBUG)


@app.callback()
def program(
    _version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Print the version.",
            callback=_show_version,
            is_eager=True,
            expose_value=False,
        ),
    ] = False,
    _quiet: Annotated[
        bool,
        typer.Option(
            "--quiet",
            "-q",
            help="Print results and errors only: no progress, no summary.",
            callback=_be_quiet,
            expose_value=False,
        ),
    ] = False,
    _debug: Annotated[
        bool,
        typer.Option(
            "--debug",
            help="Show the traceback of an error.",
            callback=_show_tracebacks,
            expose_value=False,
        ),
    ] = False,
) -> None:
    """Options of the program itself."""


def main() -> None:
    """Run the command line; an error is one sentence, with a traceback by `--debug` alone."""
    terminal.open_streams()
    logging.basicConfig(format="%(message)s", handlers=[_Lines()])
    LOG.setLevel(logging.WARNING)
    # products here are small: threads of the linear algebra would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, interrupt)  # as Ctrl-C: what is whole is kept
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, interrupt)
    terminal.set_quiet(False)
    warnings.showwarning = _Warnings().show
    try:
        program, left_out = command_line()
        program(obj=left_out)
    except (KeyboardInterrupt, SystemExit) as end:  # typer turns the former into the latter
        status = getattr(end, "code", INTERRUPTED)
        if status == INTERRUPTED:
            say("contactfusion: interrupted", file=sys.stderr)
        _leave_threads(status)
        sys.exit(status)
    except Exception as error:
        if LOG.isEnabledFor(logging.DEBUG):
            say(traceback.format_exc(), end="", file=sys.stderr, lines=True)
        if isinstance(error, ContactFusionError):
            text = str(error)
        elif isinstance(error, OSError) and (error.filename or error.errno == errno.ENOSPC):
            # such as a file that may not be read, or stdout on a disk that is full
            text = f"{error.filename or 'the output'}: {error.strerror}"
        else:
            text = _unexpected(error)
        say(f"contactfusion: {text}", file=sys.stderr)
        _leave_threads(1)
        sys.exit(1)


def interrupt(number: int, frame: FrameType | None) -> None:
    """End the program on a signal; inside numba, whose C code would lose it or crash, after that.

    Raises:
        KeyboardInterrupt: unless functions of numba or LLVM are on the stack.
    """
    while frame is not None:
        if frame.f_globals.get("__name__", "").startswith(("numba.", "llvmlite.")):
            signal.signal(signal.SIGALRM, interrupt)
            signal.setitimer(signal.ITIMER_REAL, RETRY)
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _leave_threads(status: object) -> None:
    """Let the program end though a thread of a plug-in, which Python would wait for, does not."""
    others = [
        thread
        for thread in threading.enumerate()
        if not thread.daemon and thread is not threading.current_thread()
    ]
    if not others:
        return

    def end() -> None:
        time.sleep(LINGER)
        left = ", ".join(repr(thread.name) for thread in others if thread.is_alive())
        if left:
            try:
                say(f"contactfusion: threads that did not end are left: {left}", file=sys.stderr)
                sys.stdout.flush()
            finally:
                os._exit(status if isinstance(status, int) else int(status is not None))

    threading.Thread(target=end, daemon=True).start()


class _Lines(logging.StreamHandler[TextIO]):
    """Prints what is logged as text that no terminal obeys."""

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        return terminal.printable(super().format(record), lines=bool(record.exc_info))


class _Warnings:
    """Shows each warning once: a sentence where it is for users, else as Python writes it."""

    def __init__(self) -> None:
        self._shown: set[str] = set()

    def show(
        self,
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        """Take the place of `warnings.showwarning`."""
        for_users = issubclass(category, FutureWarning)
        text = warnings.formatwarning(message, category, filename, lineno, line).rstrip("\n")
        if for_users:
            text = f"contactfusion: {message}"
        if text not in self._shown:
            self._shown.add(text)
            say(text, file=file or sys.stderr, lines=not for_users)


def _unexpected(error: Exception) -> str:
    return f"failed with {cause_in(error, __name__)}; run it with --debug for the traceback"


def command_line() -> tuple[Any, Mapping[str, str]]:
    """The program with the commands of plug-ins.

    Returns:
        All commands, each with the options of the program that any command takes, too; and why
        a plug-in's command was left out, by its name.
    """
    program: Any = get_command(app)
    shared = [option for option in program.params if EVERYWHERE.intersection(option.opts)]

    def share(command: Any) -> None:
        if command is not program:
            command.params.extend(shared)
        for inner in getattr(command, "commands", {}).values():
            share(inner)

    share(program)
    return program, add_commands(program, share)
