"""Questions to a recording that a replay wrote, and to one with a configuration beside it."""

import json
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from contactfusion.errors import ConfigurationError, ContactFusionError, RecordingError
from contactfusion.readings import Wrench
from contactfusion.run.asking import (
    Source,
    ablate_recording,
    explain_recording,
    tune_recording,
)
from contactfusion.run.execute import run_file
from contactfusion.run.watching import view_recording
from tests.test_run import CONFIG, PLACE, recorded, touching
from tests.toys import offer_toys


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture
def replayed(config: Path, tmp_path: Path) -> Source:
    recording = recorded(tmp_path / "drive.mcap", touching(4.0))
    run_file(config, recording, out=tmp_path / "contacts.mcap")
    return Source(tmp_path / "contacts.mcap")


Printed = pytest.CaptureFixture[str]


def test_a_contact_is_explained_by_its_sources(replayed: Source, capsys: Printed) -> None:
    capsys.readouterr()
    explain_recording(replayed, 0.5, None, as_json=False, picture=None)
    told = capsys.readouterr().out
    assert "0.500 s: 1 contact in 'base'" in told
    assert "1.00 over time; of this step P(contact) 0.98 by eye 0.90 and hand 0.80" in told


def test_the_same_as_json_and_as_a_picture(replayed: Source, capsys: Printed) -> None:
    capsys.readouterr()
    picture = replayed.recording.with_name("why.png")
    explain_recording(replayed, 0.5, PLACE, as_json=True, picture=picture)
    assert json.loads(capsys.readouterr().out)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_recording_without_a_configuration_needs_one(replayed: Source, config: Path) -> None:
    raw = config.with_name("drive.mcap")
    with pytest.raises(RecordingError, match="holds no configuration"):
        explain_recording(Source(raw), 0.5, None, as_json=False, picture=None)
    explain_recording(Source(raw, config), 0.5, None, as_json=False, picture=None)


def test_a_time_outside_the_recording_is_refused(replayed: Source) -> None:
    with pytest.raises(ContactFusionError, match="there is nothing at 9 s: the steps reach from"):
        explain_recording(replayed, 9.0, None, as_json=False, picture=None)


def test_fields_can_be_changed(replayed: Source, capsys: Printed) -> None:
    capsys.readouterr()
    changed = Source(replayed.recording, overrides=["integrator.threshold=1.0"])
    explain_recording(changed, 0.5, None, as_json=False, picture=None)
    assert "no contact at" in capsys.readouterr().out


def test_each_source_is_left_out(replayed: Source, tmp_path: Path, capsys: Printed) -> None:
    capsys.readouterr()
    ablate_recording(replayed, tmp_path / "ablate")
    assert "0 of 40" in capsys.readouterr().out
    assert json.loads((tmp_path / "ablate/ablation.json").read_text())
    assert (tmp_path / "ablate/ablation.csv").exists()


def test_without_matplotlib_there_is_a_table_and_no_picture(
    replayed: Source, tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    capsys.readouterr()
    ablate_recording(replayed, tmp_path / "ablate")
    printed = capsys.readouterr().out
    assert "0 of 40" in printed and "no picture is drawn: matplotlib is not installed" in printed
    assert {file.name for file in (tmp_path / "ablate").iterdir()} == {
        "ablation.csv", "ablation.json"
    }  # fmt: skip


def test_values_are_tuned_on_labels(replayed: Source, tmp_path: Path, capsys: Printed) -> None:
    labels = tmp_path / "labels.csv"
    x, y, z = PLACE
    labels.write_text(f"start,end,x,y,z\n0.1,1.5,{x},{y},{z}\n2.0,3.5,{x},{y},{z}\n")
    tune_recording(replayed, labels, ["integrator.threshold=0.5,0.99"], 0.03, tmp_path / "tuned")
    assert "integrator.threshold" in capsys.readouterr().out
    assert (tmp_path / "tuned/tuning.json").exists()


@pytest.fixture
def chosen(config: Path, tmp_path: Path) -> Source:
    """What a replay wrote that was told which of two wrists feeds the hand."""
    both = [
        reading
        for one in touching(4.0)
        for reading in (one, *([replace(one, sensor="spare")] if isinstance(one, Wrench) else []))
    ]
    recording, out = recorded(tmp_path / "both.mcap", both), tmp_path / "chosen.mcap"
    run_file(config, recording, topics={"hand": "/wrist"}, out=out)
    return Source(out)


@pytest.mark.parametrize("changes", [{}, {"configuration": Path("robot.yaml")}])
def test_topics_are_those_of_the_replay_that_wrote_the_recording(
    chosen: Source, config: Path, changes: dict[str, Path], capsys: Printed
) -> None:
    """With a configuration of its own, too; roles that this one has not are left out."""
    if changes:
        config.write_text(CONFIG.replace("eye: {type: echo, sensor: eye}", "eyes: {type: echo}"))
        chosen = replace(chosen, configuration=config)
    explain_recording(chosen, 0.5, None, as_json=False, picture=None)
    assert "0.500 s: 1 contact in 'base'" in capsys.readouterr().out


def test_topics_of_the_command_line_go_before_those_of_the_replay(chosen: Source) -> None:
    with closing(replace(chosen, topics={"hand": "/spare"}).session()) as session:
        assert session.inputs.generators["hand"]["sensor"] == "spare"


def test_ignored_topics_are_those_of_the_replay_and_more(chosen: Source, config: Path) -> None:
    out = config.with_name("fewer.mcap")
    run_file(config, chosen.recording, out=out, ignored=["/spare"])
    for source in (Source(out), Source(out, config)):
        with closing(source.session()) as session:
            assert session.inputs.sensors == {"eye": "eye", "wrist": "wrist"}
        with closing(replace(source, ignored=["/eye"]).session()) as session:
            assert session.inputs.sensors == {"wrist": "wrist"}


def test_what_is_drawn_can_be_kept(replayed: Source, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    kept = tmp_path / "kept.rrd"
    view_recording(replayed, kept, screenshot=None, at=None, web=False)
    assert kept.stat().st_size > 10_000


def test_a_time_without_a_picture_is_refused(replayed: Source) -> None:
    with pytest.raises(ConfigurationError, match="--screenshot"):
        view_recording(replayed, None, screenshot=None, at=1.0, web=False)
