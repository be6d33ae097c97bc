"""Commands that run pipelines, and look after the installation."""

import sys
from contextlib import closing
from os.path import relpath
from pathlib import Path
from typing import Annotated

import typer

from contactfusion.cli.options import (
    RECORDING,
    Changed,
    Domain,
    Duration,
    Ignored,
    JoinedBy,
    Rate,
    Results,
    Ros,
    Seed,
    Start,
    Topics,
    View,
    joined,
    roles,
)
from contactfusion.errors import ConfigurationError, listed_once
from contactfusion.terminal import say


def run(
    configuration: Annotated[Path, typer.Argument(help="The configuration (YAML).")],
    recording: Annotated[
        Path | None,
        typer.Argument(help=f"{RECORDING[:-1]}; default: what the configuration names."),
    ] = None,
    set_: Changed = None,
    out: Results = Path("out/run"),
    seed: Seed = None,
    topic: Topics = None,
    ignore: Ignored = None,
    start: Start = 0.0,
    duration: Duration = None,
    rate: Rate = None,
    view: View = False,
) -> None:
    """Find contacts in a recording or a scene, and report which inputs came and which did not."""
    from contactfusion.recordings.recording import Window
    from contactfusion.run.execute import Watch, run_file

    def played(watch: Watch | None = None) -> None:
        run_file(
            configuration,
            recording,
            overrides=set_ or [],
            out=out,
            seed=seed,
            topics=roles(topic),
            ignored=ignore or [],
            window=Window(start, duration),
            rate=rate,
            watch=watch,
        )

    if not view:
        return played()
    from contactfusion.run.watching import shown

    with shown((recording or configuration).stem) as watch:
        played(watch)


def replay(
    configuration: Annotated[Path, typer.Argument(help="The configuration (YAML).")],
    recording: Annotated[Path | None, typer.Argument(help=RECORDING)] = None,
    set_: Changed = None,
    out: Results = None,
    seed: Seed = None,
    topic: Topics = None,
    ignore: Ignored = None,
    start: Start = 0.0,
    duration: Duration = None,
    rate: Rate = None,
    view: View = False,
) -> None:
    """Run on a recording, as `run` does; without --out nothing is written."""
    if recording is None:
        raise ConfigurationError(
            f"give the recording after {configuration}, or play the one that it names with "
            f"`contactfusion run {configuration}`"
        )
    run(configuration, recording, set_, out, seed, topic, ignore, start, duration, rate, view)


def check(
    configuration: Annotated[Path, typer.Argument(help="The configuration (YAML).")],
    recording: Annotated[
        Path | None, typer.Argument(help="What `run` would play: its topics are matched, too.")
    ] = None,
    topic: Topics = None,
    set_: Changed = None,
) -> None:
    """Build all that a configuration names, play the beginning: what it holds, and every fault."""
    from contactfusion.check import check_file

    found = check_file(configuration, recording, set_ or [], roles(topic))
    for line in found.lines:
        say(line)
    for fault in listed_once(found.faults):
        say(f"contactfusion: {fault}", file=sys.stderr)
    if found.faults:
        raise typer.Exit(1)
    say("OK")


def identify(
    configuration: Annotated[Path, typer.Argument(help="The configuration (YAML).")],
    recording: Annotated[
        Path, typer.Argument(help=f"Of free motion, without contact. {RECORDING}")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="YAML file to write, for the configuration's field `identified`."),
    ] = None,
    topic: Topics = None,
    ignore: Ignored = None,
    set_: Changed = None,
) -> None:
    """Identify friction, offsets, payload and noise of joints, and the load of wrists."""
    from contactfusion.identify.identification import identify_file

    found = identify_file(
        configuration,
        recording,
        out,
        overrides=set_ or [],
        topics=roles(topic),
        ignored=ignore or [],
    )
    for line in found.report():
        say(line)
    if out is not None:
        named = relpath(out.resolve(), configuration.resolve().parent)
        say(f"results: {out}; it counts once {configuration} has `identified: {named}`")


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
    seed: Seed = None,
) -> None:
    """Record the sensor readings of a scene, and the ground truth, as MCAP."""
    from contactfusion.run.recorder import record_scene

    file = out or Path("out") / f"{configuration.stem}.mcap"
    record_scene(configuration, set_ or [], file, seed, duration)


def plugins(
    context: typer.Context,
    name: Annotated[str | None, typer.Argument(help="Show the options of this plug-in.")] = None,
    strict: Annotated[bool, typer.Option(help="Import all; fail if any cannot be used.")] = False,
) -> None:
    """List the installed plug-ins, or the options of a plug-in."""
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
    live: Annotated[
        bool, typer.Option("--live", help="Check what is on the ROS 2 network, for 6 s.")
    ] = False,
    ros: JoinedBy = Ros.DDS,
    domain: Domain = None,
) -> None:
    """Check the installation, a robot description or a network, and name what to repair."""
    checks = {"a robot": robot is not None, "--ouster": ouster, "--warm": warm, "--live": live}
    if sum(checks.values()) > 1:
        named = " and ".join(name for name, is_given in checks.items() if is_given)
        raise ConfigurationError(f"doctor does one of these at a time: {named}")
    if (ros is not Ros.DDS or domain is not None) and not live:
        raise ConfigurationError("--ros and --domain are for the network: add --live")
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
    elif live:
        from contactfusion.doctor.live import check_network

        with closing(joined(ros, domain)) as transport:
            if not check_network(transport):
                raise typer.Exit(1)
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

    say(ouster.convert(source, out, every_nth_row, meta))
