"""The command line. Heavy modules are imported by the command that needs them."""

import os
import signal
import sys

import typer

from contactfusion.cli import recordings, running
from contactfusion.cli.experiments import experiments
from contactfusion.cli.tuning import train, tune
from contactfusion.errors import ContactFusionError

app = typer.Typer(
    name="contactfusion",
    help="Where does the robot touch the world? Fuses contact hypotheses from any sensors.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
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
    """Run the command line; an error is one sentence, never a traceback."""
    # products here are small: threads of the linear algebra would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what is whole is kept
    try:
        app()
    except ContactFusionError as error:
        print(f"contactfusion: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
