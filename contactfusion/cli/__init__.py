"""The command line. Heavy modules are imported by the command that needs them."""

import logging
import os
import signal
import sys
import traceback
from typing import Annotated

import typer

from contactfusion.cli import recordings, running
from contactfusion.cli.experiments import experiments
from contactfusion.cli.tuning import train, tune
from contactfusion.errors import ContactFusionError, cause_in

app = typer.Typer(
    name="contactfusion",
    help="Where does the robot touch the world? Fuses contact hypotheses from any sensors.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
DEBUG = "--debug"


@app.callback()
def options(
    debug: Annotated[
        bool, typer.Option(DEBUG, help="Show the traceback of an error; also after a command.")
    ] = False,
) -> None:
    """Declare what holds for every command; `main` takes it, wherever it stands."""


for command in (
    running.demo,
    running.run,
    running.check,
    running.record,
    recordings.replay,
    recordings.explain,
    recordings.ablate,
    recordings.view,
    running.plugins,
    running.doctor,
    running.convert,
):
    app.command()(command)
for group in (experiments, tune, train):
    app.add_typer(group)


def main() -> None:
    """Run the command line; an error is one sentence, with a traceback by `--debug` alone."""
    debug = DEBUG in sys.argv
    logging.basicConfig(format="%(message)s")
    logging.getLogger("contactfusion").setLevel(logging.DEBUG if debug else logging.WARNING)
    # products here are small: threads of the linear algebra would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what is whole is kept
    try:
        app([argument for argument in sys.argv[1:] if argument != DEBUG])
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        if debug:
            traceback.print_exc()
        told = str(error) if isinstance(error, ContactFusionError) else _unexpected(error)
        print(f"contactfusion: {told}", file=sys.stderr)
        sys.exit(1)


def _unexpected(error: Exception) -> str:
    return f"failed with {cause_in(error, __name__)}; run it with {DEBUG} for the traceback"
