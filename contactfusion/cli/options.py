"""Options that several commands share, and what their texts mean."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactfusion.errors import ConfigurationError

if TYPE_CHECKING:
    from contactfusion.live.transport import Transport

RECORDING = "A ROS bag, MCAP, folder of them, C3D, or YAML file that describes a log."
Out = Annotated[Path, typer.Option(help="The output folder.")]
Configured = Annotated[
    Path | None,
    typer.Option(
        "--config",
        help="The configuration (YAML); default: what `run` stored in the recording.",
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
Results = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="A folder for contacts.csv, commands.csv and summary.json; or a file for the "
        "contacts: .mcap (with all topics), .csv or .parquet.",
    ),
]
Seed = Annotated[int | None, typer.Option(help="Random seed; overrides the file's.")]
Start = Annotated[float, typer.Option(min=0.0, help="Time to start at, from the beginning \\[s].")]
Duration = Annotated[
    float | None,
    typer.Option(min=0.0, help="Length of the part to play \\[s]; default: to the end."),
]
Rate = Annotated[
    float | None,
    typer.Option(min=1e-3, help="Speed as a multiple of real time; default: as fast as possible."),
]
View = Annotated[bool, typer.Option("--view", help="Open the viewer at the end.")]


class Ros(StrEnum):
    """How ROS 2 is joined."""

    DDS = "dds"
    RCLPY = "rclpy"


JoinedBy = Annotated[
    Ros,
    typer.Option(
        "--ros", help="Join ROS by Cyclone DDS, without an installation of it, or by rclpy."
    ),
]
Domain = Annotated[
    int | None, typer.Option(min=0, max=232, help="The ROS domain; default: ROS_DOMAIN_ID, or 0.")
]


def joined(ros: Ros, domain: int | None) -> "Transport":
    """The network of a ROS domain.

    Raises:
        DependencyError: what joins it is not installed.
        ConfigurationError: there is no such domain, or it can't be joined.
    """
    if ros is Ros.RCLPY:
        from contactfusion.live.node import NodeTransport

        return NodeTransport(domain)
    from contactfusion.live.dds import DdsTransport

    return DdsTransport(domain)


def roles(topics: list[str] | None) -> dict[str, str]:
    """The topic of each role.

    Args:
        topics: each as ROLE=/NAME.

    Raises:
        ConfigurationError: an option is not.
    """
    chosen = {}
    for text in topics or []:
        role, _, name = text.partition("=")
        if not (role and name):
            raise ConfigurationError(f"--topic takes ROLE=/NAME, not '{text}'")
        chosen[role] = name
    return chosen


def listed(names: str) -> list[str]:
    """Names that are separated by commas."""
    return [name.strip() for name in names.split(",") if name.strip()]
