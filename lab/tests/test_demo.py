"""The demo repeats itself exactly, and its page holds together."""

import csv
import json
import re
import sys
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from rich.console import Console

from contactfusion.cli import command_line
from contactfusion.errors import ConfigurationError, ContactFusionError, DependencyError
from contactfusion.readings.messages import known_types
from contactfusion.recordings import messages
from contactfusion.run.configuration import setting_of_recording
from contactfusion.run.execute import run_file
from contactfusion_lab.demo import run as demo
from contactfusion_lab.demo.account import Story
from contactfusion_lab.demo.run import reported, show
from contactfusion_lab.demo.scene import DIES, scene_fields

pytestmark = pytest.mark.slow

RULE = "lidar_rule"
"""In place of networks, which come with the package only once they are trained."""
PNG = b"\x89PNG\r\n\x1a\n"
Shown = tuple[Path, str, Story]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """The folder of one demo, its output, and its story."""
    out = tmp_path_factory.mktemp("shown") / "new" / "folder"
    console = StringIO()
    stories: list[Story] = []

    def kept(*parts: Any) -> Story:
        stories.append(Story(*parts))
        return stories[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "Console", lambda: Console(file=console, width=200))
        patch.setattr(demo, "Story", kept)
        show(out, RULE)
    return out, console.getvalue(), stories[0]


class Links(HTMLParser):
    """Gathers what a page links to or shows, what has no words, and what is not closed."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.wordless: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        self.links += [
            attributes[name] or "" for name in ("href", "src", "srcset") if name in attributes
        ]
        if tag == "img" and len(attributes.get("alt") or "") < 40:
            self.wordless.append(tag)
        if tag not in ("img", "meta", "source", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_skin_dies_and_the_base_arrives(shown: Shown) -> None:
    summary = json.loads((shown[0] / "summary.json").read_text())
    assert (summary["ending"], summary["success_true"]) == ("arrived", True)
    assert summary["distance_true"] <= summary["within"] == 0.05
    assert 15.0 < summary["time"] < 35.0 and summary["skin_dies"] == DIES
    assert summary["skin_alone"]["ending"] != "arrived"
    assert summary["shares"]["before"]["skin"] > 0.05
    assert summary["shares"]["after"]["skin"] == 0.0


def test_after_its_death_the_skin_has_no_share_in_any_contact(shown: Shown) -> None:
    with (shown[0] / "contacts.csv").open() as file:
        rows = list(csv.DictReader(file))
    late = [row["shares"] for row in rows if float(row["stamp"]) > DIES + 0.25]
    shares = [dict(part.split(":") for part in text.split()) for text in late]
    assert len(shares) > 50
    assert all(float(each.get("skin", 0.0)) == 0.0 for each in shares)
    assert all(float(each["lidar"]) > 0.4 for each in shares)  # the rest is predicted


def test_every_link_of_the_page_leads_to_a_file_beside_it(shown: Shown) -> None:
    out, _, _ = shown
    links = Links()
    text = (out / "index.html").read_text()
    links.feed(text)
    assert {path.name for path in out.iterdir()} == {*links.links, "index.html"}
    assert not links.wordless and not links.open
    assert "http" not in text and "<script" not in text and "$" not in text


def test_the_page_states_what_the_summary_holds(shown: Shown) -> None:
    out, printed, story = shown
    text, summary = (out / "index.html").read_text(), json.loads((out / "summary.json").read_text())
    arrival = f"arrived after {summary['time']:.1f} s with the contact"
    assert arrival in text and arrival in printed
    assert f"{summary['distance_true'] * 100:.1f} cm from the target" in text
    assert "likelihood" in text and "without lidar: no contact remains" in text
    assert story.arrived


def test_commands_on_the_page_exist(shown: Shown) -> None:
    page = (shown[0] / "index.html").read_text()
    blocks = re.findall(r"<pre>(contactfusion .*?)</pre>", page, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    program, _ = command_line()
    assert lines and {line.split()[1] for line in lines} <= {*program.commands}


def test_pictures_are_pictures_and_the_film_is_small(shown: Shown) -> None:
    out, _, _ = shown
    for name in ("distance", "lateral", "shares", "death"):
        assert (out / f"{name}.png").read_bytes().startswith(PNG)
    page = (out / "index.html").read_text()
    with Image.open(out / "film.gif") as film, Image.open(out / "distance.png") as figure:
        assert 80 < getattr(film, "n_frames", 1) < 200
        for width, height in (film.size, figure.size):
            assert f'width="{width}" height="{height}"' in page
    assert (out / "film.gif").stat().st_size < 4e6


def test_a_second_demo_gives_the_same_bytes(
    shown: Shown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, _, _ = shown
    with Image.open(out / "film.gif") as drawn:
        monkeypatch.setattr(demo, "film", lambda *args: drawn.size)
    show(tmp_path, RULE)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (out / path.name).read_bytes(), path.name
    assert {path.name for path in out.iterdir()} - {path.name for path in tmp_path.iterdir()} == {
        "film.gif",
        "death.png",
    }


def test_the_scene_runs_again_from_its_file(shown: Shown, tmp_path: Path) -> None:
    run_file(shown[0] / "scene.yaml", out=tmp_path)
    again, first = (folder / "contacts.csv" for folder in (tmp_path, shown[0]))
    assert again.read_bytes() == first.read_bytes()


def test_the_recording_holds_what_arrived_and_nothing_of_a_dead_skin(shown: Shown) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    with rosbag2.Reader(shown[0] / "demo.mcap") as reader:
        stamps = {channel.topic: stamp / 1e9 for channel, stamp, _ in reader.messages()}
    last = float(shown[2].last.stamp)
    assert stamps["/skin"] < DIES
    found = "contacts", "command"
    for topic in ("/lidar", "/wheels", "/odometry", *(f"/contactfusion/{name}" for name in found)):
        assert stamps[topic] == pytest.approx(last)


def test_the_recording_knows_how_it_was_fused_and_loses_nothing_twice(shown: Shown) -> None:
    pytest.importorskip("rosbags")
    config = setting_of_recording(shown[0] / "demo.mcap").config()
    assert set(config.generators) == {"skin", "lidar", "motion"}
    assert not config.faults


def test_lines_state_time_contact_and_the_death(shown: Shown) -> None:
    lines = shown[1].splitlines()
    assert "the skin falls silent" in shown[1]
    rows = [line for line in lines if re.match(r" *[0-9.]+ s \|", line)]
    assert 10 < len(rows) < 40
    assert "to go | " in rows[1] and "likelihood" in rows[1] and "skin well" in rows[1]
    assert "skin silent for" in rows[-1] and "arrived: " in rows[-1]


def test_in_a_terminal_the_state_is_live(shown: Shown) -> None:
    moments = shown[2].moments[95:110]
    screen = StringIO()
    console = Console(file=screen, force_terminal=True, width=100)
    assert list(reported(moments, console)) == moments
    assert "by lidar" in screen.getvalue() and "█" in screen.getvalue()
    assert "silent for" in screen.getvalue()


def test_without_the_extra_record_everything_else_is_written(
    shown: Shown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    monkeypatch.setattr(messages, "known_types", known_types.__wrapped__)
    messages.typestore.cache_clear()
    console = StringIO()
    monkeypatch.setattr(demo, "film", lambda *args: (600, 560))
    written = list(demo.write(shown[2], tmp_path, Console(file=console, width=200)))
    messages.typestore.cache_clear()
    assert "no recording: rosbags is not installed" in console.getvalue()
    assert "demo.mcap" not in written and not (tmp_path / "demo.mcap").exists()
    assert "demo.mcap" not in (tmp_path / "index.html").read_text()


@pytest.mark.parametrize(
    ("module", "extra"), [("pybullet", "sim"), ("matplotlib.figure", "plot"), ("open3d", "robot")]
)
def test_without_an_extra_it_is_one_sentence(
    module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DependencyError, match=rf"pip install 'contactfusion\[{extra}\]'"):
        show(tmp_path, RULE)


def test_without_networks_it_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nowhere() -> Path:
        return tmp_path / "contact.safetensors"

    monkeypatch.setattr("contactfusion_lab.demo.scene.shipped", nowhere)
    with pytest.raises(ConfigurationError, match="contact.safetensors is missing"):
        show(tmp_path)


def test_a_box_that_does_not_arrive_is_reported_and_is_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def short(lidar: str) -> dict[str, Any]:
        fields = scene_fields(lidar)
        return {**fields, "scene": {**fields["scene"], "longest": 11.0}}

    monkeypatch.setattr(demo, "scene_fields", short)
    monkeypatch.setattr(demo, "film", lambda *args: (600, 560))
    with pytest.raises(ContactFusionError, match="did not arrive"):
        show(tmp_path, RULE)
    page = (tmp_path / "index.html").read_text()
    assert "The base did not arrive: timeout after 11.0 s" in page
    assert "and the robot does not arrive</h1>" in page and "nan" not in page


def test_with_the_networks_of_the_package_the_base_arrives_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "film", lambda *args: (600, 560))
    show(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["success_true"] and summary["shares"]["after"]["skin"] == 0.0
