"""The command line. Heavy modules are imported by the command that needs them."""

import os
import signal
import sys
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.main import get_command

from contactfusion import terminal
from contactfusion.cli import recordings, running
from contactfusion.cli.experiments import experiments
from contactfusion.cli.tuning import train, tune
from contactfusion.errors import ContactFusionError

EVERYWHERE = {"--quiet"}
"""Options of the program that any command takes, too."""
app = typer.Typer(
    name="contactfusion",
    help="Where does the robot touch the world? Fuses contact hypotheses from any sensors.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for function in (
    running.demo,
    running.run,
    running.record,
    recordings.inspect,
    recordings.init,
    recordings.replay,
    recordings.explain,
    recordings.ablate,
    recordings.view,
    running.plugins,
    running.doctor,
    running.convert,
):
    app.command()(function)
for group in (experiments, tune, train):
    app.add_typer(group)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"contactfusion {version('contactfusion')}")
        raise typer.Exit


def _be_quiet(wanted: bool) -> None:
    if wanted:  # a command that does not say so again takes nothing back
        terminal.set_quiet(True)


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
) -> None:
    """Options of the program itself."""


def main() -> None:
    """Run the command line; an error is one sentence, never a traceback."""
    # products here are small: threads of the linear algebra would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what is whole is kept
    terminal.set_quiet(False)
    try:
        _command_line()()
    except ContactFusionError as error:
        print(f"contactfusion: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)


def _command_line() -> Any:
    """All commands, with the options of the program that each command takes, too."""
    whole = get_command(app)
    shared = [option for option in whole.params if EVERYWHERE.intersection(option.opts)]
    commands: list[Any] = [whole]
    while commands:
        inner = [*getattr(commands.pop(), "commands", {}).values()]
        for command in inner:
            command.params.extend(shared)
        commands += inner
    return whole
