"""Commands that run pipelines, and look after the installation."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Changed, Out, Topics, roles
from contactfusion.errors import ConfigurationError, listed_once


def run(
    configuration: Annotated[
        Path, typer.Argument(help="The configuration (YAML), with `recording` or `scene`.")
    ],
    set_: Changed = None,
    out: Out = Path("out/run"),
    seed: Annotated[int | None, typer.Option(help="Random seed; overrides the file's.")] = None,
) -> None:
    """Run a pipeline on a recording or in a scene: writes contacts.csv and summary.json."""
    from contactfusion.running import run_file

    run_file(configuration, set_ or [], out, seed)


def check(
    configuration: Annotated[Path, typer.Argument(help="A YAML file for `run` or `replay`.")],
    recording: Annotated[
        Path | None, typer.Argument(help="What `replay` would play: its topics are matched, too.")
    ] = None,
    topic: Topics = None,
    set_: Changed = None,
) -> None:
    """Build all that a configuration names, run nothing: what it holds, and every fault."""
    from contactfusion.check import check_file

    found = check_file(configuration, recording, set_ or [], roles(topic))
    for line in found.lines:
        print(line)
    for fault in listed_once(found.faults):
        print(f"contactfusion: {fault}", file=sys.stderr)
    if found.faults:
        raise typer.Exit(1)
    print("OK")


def record(
    configuration: Annotated[Path, typer.Argument(help="The configuration (YAML), with `scene`.")],
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="FIELD=VALUE: override a field, e.g. scene.camera_rate=1; may be repeated.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The MCAP file to write; default: out/NAME.mcap, by the name of the YAML file."
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0.0, help="Length of the recording \\[s]; default: until the scene ends."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; overrides the file's.")] = None,
) -> None:
    """Record the sensor readings of a scene, and the ground truth, as MCAP."""
    from contactfusion.recording_scene import record_scene

    file = out or Path("out") / f"{configuration.stem}.mcap"
    record_scene(configuration, set_ or [], file, seed, duration)


def plugins(
    context: typer.Context,
    name: Annotated[str | None, typer.Argument(help="Show the options of this one.")] = None,
    strict: Annotated[bool, typer.Option(help="Import all; fail if one cannot be used.")] = False,
) -> None:
    """List the installed plug-ins, or the options of one."""
    from contactfusion.cli.plugin_commands import import_failures, installed_commands
    from contactfusion.cli.plugin_listing import describe_plugin, list_plugins

    if name is None:
        broken = import_failures() if strict else {}
        list_plugins(strict, installed_commands(), {**context.obj, **broken})
    else:
        describe_plugin(name)


def doctor(
    robot: Annotated[
        str | None,
        typer.Argument(
            help="ROBOT.yaml, configuration or URDF: check this robot in place of the installation."
        ),
    ] = None,
    warm: Annotated[bool, typer.Option("--warm", help="Compile all kernels now.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="PNG to write, with a drawing of the robot.")
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            help="A recording of wrenches at rest and joints: estimates the load of each wrist."
        ),
    ] = None,
    ouster: Annotated[
        bool, typer.Option("--ouster", help="Install the environment that converts Ouster files.")
    ] = False,
) -> None:
    """Check the installation, or a robot description, and name what to repair."""
    if robot is not None:
        from contactfusion.doctor.robot import check_robot

        if not check_robot(robot, out, recording):
            raise typer.Exit(1)
        return
    from contactfusion.doctor.installation import check, compile_kernels

    if out or recording:
        raise ConfigurationError("name the ROBOT.yaml that --out and --recording are for")
    if ouster:
        from contactfusion.recordings.ouster import make_environment

        make_environment()
    elif warm:
        compile_kernels()
    elif not check():
        raise typer.Exit(1)


def convert(
    source: Annotated[Path, typer.Argument(help="An Ouster .pcap, .osf, or bag of lidar packets.")],
    out: Annotated[Path, typer.Argument(help="The MCAP file to write.")],
    every_nth_row: Annotated[
        int, typer.Option(min=1, help="Keep every N-th ring, from the first on.")
    ] = 1,
    meta: Annotated[
        Path | None,
        typer.Option(help="The sensor's metadata (.json), where it is not beside the file."),
    ] = None,
) -> None:
    """Convert an Ouster file to MCAP, a PointCloud2 per scan; needs `doctor --ouster` once."""
    from contactfusion.recordings import ouster

    print(ouster.convert(source, out, every_nth_row, meta))
