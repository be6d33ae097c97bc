"""The demo: a base pushes a box to a target behind it; its skin dies, its LiDAR goes on."""

import json
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from contactfusion.errors import ContactFusionError, DependencyError
from contactfusion.figures import new_figure
from contactfusion.files import make_folder, write_whole
from contactfusion.recordings.mcap import McapWriter
from contactfusion.replaying.configuration import NOT_OURS, TOPIC, Setting
from contactfusion.run_results import commands_csv, contacts_csv
from contactfusion.terminal import is_quiet, note
from contactfusion_lab.demo.account import Story, sentences, summary
from contactfusion_lab.demo.figures import distance_figure, lateral_figure, shares_figure
from contactfusion_lab.demo.film import film
from contactfusion_lab.demo.moments import push_moments
from contactfusion_lab.demo.page import page
from contactfusion_lab.demo.scene import LEARNED, as_yaml, by_skin_alone, scene_fields
from contactfusion_lab.demo.telling import told


def show(out: Path, lidar: str = LEARNED) -> None:
    """Push, tell of it while it goes on, and write a page of it.

    Args:
        out: the folder that takes index.html and all that it links to.
        lidar: the type of the generator that reads the LiDAR.

    Raises:
        ContactFusionError: something that the demo needs is missing, or the box did not arrive.
    """
    make_folder(out)
    new_figure(1.0, 1.0)  # whether matplotlib is there is told now, not after the push
    fields = scene_fields(lidar)
    console = Console()
    console.quiet = is_quiet()
    moments = list(told(push_moments(fields), console))
    _say(console, "the same push once more, by the skin alone ...")
    story = Story(fields, moments, list(push_moments(by_skin_alone(fields))))
    _say(console, "figures and film ...")
    written = list(write(story, out, console))
    for sentence in sentences(story):
        _say(console, sentence)
    print(f"results: {', '.join(str(out / name) for name in written)}")
    note(f"look at: {out / 'index.html'}")
    if not story.arrived:
        raise ContactFusionError("the box did not arrive at its target")


def write(story: Story, out: Path, console: Console) -> Iterator[str]:
    """Write everything; the page comes last.

    Args:
        story: of the push.
        out: the folder.
        console: where to say what could not be written.

    Yields:
        The name of each file.
    """
    steps = [one.step for one in story.moments]
    contents: dict[str, str | bytes] = {
        "contacts.csv": contacts_csv(steps),
        "commands.csv": commands_csv(steps),
        "summary.json": json.dumps(summary(story), indent=2) + "\n",
        "scene.yaml": as_yaml(story.fields),
        "distance.png": distance_figure(story),
        "lateral.png": lateral_figure(story),
        "shares.png": shares_figure(story),
    }
    written = [*contents, "film.gif", "death.png"]
    for name, content in contents.items():
        write_whole(out / name, content)
    size = film(story, out / "film.gif", out / "death.png")
    try:
        record(story, out / "demo.mcap")
        written.append("demo.mcap")
    except DependencyError as error:
        _say(console, f"no recording: {error}")
    write_whole(out / "index.html", page(story, written, size))
    yield from [*written, "index.html"]


def record(story: Story, path: Path) -> None:
    """Write what arrived from the sensors, contacts, commands and configuration, as ROS 2 does.

    Raises:
        DependencyError: rosbags is not installed.
    """
    had = {name: value for name, value in story.fields.items() if name not in (*NOT_OURS, "faults")}
    with McapWriter(path) as writer:
        writer.text(TOPIC, Setting(had, path.parent, {}, path).text(beside=path.parent))
        for moment in story.moments:
            for reading in moment.readings:
                writer.reading(reading)
            writer.step(moment.step)


def _say(console: Console, text: str) -> None:
    console.print(text, soft_wrap=True, markup=False, highlight=False)
