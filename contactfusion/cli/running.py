"""Commands that run pipelines, and look after the installation."""

from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import Changed, Out
from contactfusion.errors import ConfigurationError


def demo(out: Out = Path("out/demo")) -> None:
    """Push a box with skin and LiDAR; the skin dies half-way: a page, a film, a recording."""
    from contactfusion.demo.run import show

    show(out)


def run(
    configuration: Annotated[Path, typer.Argument(help="A YAML file with `recording` or `scene`.")],
    set_: Changed = None,
    out: Out = Path("out/run"),
    seed: Annotated[int | None, typer.Option(help="Of chance, in place of the file's.")] = None,
) -> None:
    """Run a pipeline on a recording or in a scene: contacts.csv and summary.json."""
    from contactfusion.running import run_file

    run_file(configuration, set_ or [], out, seed)


def record(
    configuration: Annotated[Path, typer.Argument(help="A YAML file with `scene`.")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Change a field, e.g. scene.camera_rate=1.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The MCAP file; default: out/NAME.mcap, named as the scene.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(min=0.0, help="End after so many seconds; default: all of it.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of chance, in place of the file's.")] = None,
) -> None:
    """Record what the sensors of a scene read, and the truth, as MCAP."""
    from contactfusion.recording_scene import record_scene

    file = out or Path("out") / f"{configuration.stem}.mcap"
    record_scene(configuration, set_ or [], file, seed, duration)


def plugins(
    name: Annotated[str | None, typer.Argument(help="Show the options of this one.")] = None,
    strict: Annotated[bool, typer.Option(help="Import all; fail if one cannot be used.")] = False,
) -> None:
    """List the installed plug-ins, or the options of one."""
    from contactfusion.listing import describe_plugin, list_plugins

    if name is None:
        list_plugins(strict)
    else:
        describe_plugin(name)


def doctor(
    robot: Annotated[
        str | None, typer.Argument(help="Look over this ROBOT.yaml, configuration or URDF.")
    ] = None,
    warm: Annotated[bool, typer.Option(help="Compile the kernels now.")] = False,
    out: Annotated[Path | None, typer.Option(help="Draw the robot: the PNG to write.")] = None,
    recording: Annotated[
        Path | None, typer.Option(help="Weigh what wrists carry: wrenches at rest, and joints.")
    ] = None,
    ouster: Annotated[
        bool, typer.Option(help="Make the environment that converts Ouster files.")
    ] = False,
) -> None:
    """Check the installation, or a robot's description, and say what to mend."""
    if robot is not None:
        from contactfusion.robots.checkup import check_robot

        if not check_robot(robot, out, recording):
            raise typer.Exit(1)
        return
    from contactfusion.doctor import check, compile_kernels

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
    source: Annotated[Path, typer.Argument(help="An Ouster .pcap, .osf, or bag of packets.")],
    out: Annotated[Path, typer.Argument(help="The MCAP file to write.")],
    every_nth_row: Annotated[
        int, typer.Option(min=1, help="Keep these rings only, from the first on.")
    ] = 1,
    meta: Annotated[
        Path | None, typer.Option(help="The sensor's .json, when it is not beside the file.")
    ] = None,
) -> None:
    """Convert an Ouster file to MCAP: one PointCloud2 a scan; first run `doctor --ouster`."""
    from contactfusion.recordings import ouster

    print(ouster.convert(source, out, every_nth_row, meta))
