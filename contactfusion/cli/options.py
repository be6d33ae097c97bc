"""Options that several commands share, and what their texts mean."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.errors import ConfigurationError

Out = Annotated[Path, typer.Option(help="The output folder.")]
Configured = Annotated[
    Path | None,
    typer.Option(
        "--config",
        help="The configuration (YAML); default: the one that `replay` stored in the recording.",
    ),
]
Topics = Annotated[
    list[str] | None,
    typer.Option(help="ROLE=/NAME: the topic that feeds a generator; may be repeated."),
]
Ignored = Annotated[
    list[str] | None,
    typer.Option("--ignore", metavar="TOPIC", help="A topic that is not read at all; several."),
]
Changed = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="FIELD=VALUE: override a field, e.g. integrator.timeout=1; may be repeated."
    ),
]


def roles(topics: list[str] | None) -> dict[str, str]:
    """Give the topic of each role.

    Args:
        topics: each as ROLE=/NAME.

    Raises:
        ConfigurationError: one is not.
    """
    told = {}
    for text in topics or []:
        role, _, name = text.partition("=")
        if not (role and name):
            raise ConfigurationError(f"--topic takes ROLE=/NAME, not '{text}'")
        told[role] = name
    return told


def listed(names: str) -> list[str]:
    """Give names that stand with commas between them."""
    return [name.strip() for name in names.split(",") if name.strip()]
