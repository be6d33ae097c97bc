"""Given a recording, a configuration's `scene` is passed over, and no laboratory is needed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from contactfusion.recordings.mcap import McapWriter
from tests.test_plugin_scenes import RUN, install
from tests.toys import wrench
from tests.urdfs import link, written

EPOCH = 1_700_000_000_000_000_000
ROOT = Path(__file__).parents[1]
COMMANDS = {
    "check": ["check", "run.yaml", "felt.mcap"],
    "replay": ["replay", "run.yaml", "felt.mcap", "--out", "out.mcap"],
    "explain": ["explain", "felt.mcap", "--time", "0.2", "--config", "run.yaml"],
    "explain kept": ["explain", "out.mcap", "--time", "0.2"],
    "ablate": ["ablate", "felt.mcap", "--config", "run.yaml", "--out", "ablate"],
    "view": ["view", "felt.mcap", "--config", "run.yaml", "--save", "felt.rrd"],
    "run": ["run", "run.yaml"],
}
"""What is asked, one after the other."""
ASKING = """
import contextlib, io, json, sys
sys.modules["contactfusion_lab"] = None  # to import it fails
from contactfusion import cli
answers = {}
for name, words in json.loads(sys.argv[1]).items():
    out, err = io.StringIO(), io.StringIO()
    sys.argv = ["contactfusion", *words]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            cli.main()
            status = 0
        except SystemExit as end:
            status = end.code or 0
    answers[name] = [status, out.getvalue(), err.getvalue()]
print(json.dumps(answers))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot, a file for `run` whose scene would be refused, and a recording."""
    path = tmp_path_factory.mktemp("recorded")
    install(path, "contactfusion-lab", {})
    written(path, link("base", '<sphere radius="0.05"/>'))
    scene = {"type": "push", "target": "no place"}
    (path / "run.yaml").write_text(yaml.safe_dump({**RUN, "scene": scene}))
    with McapWriter(path / "felt.mcap", EPOCH) as writer:
        for tick in range(5):
            writer.reading(wrench(tick / 10, 0.0, 0.0, -5.0, sensor="wrist"))
    return path


@pytest.fixture(scope="module")
def answers(folder: Path) -> dict[str, tuple[int, str, str]]:
    """Status, output and errors of each command, in a process without the laboratory."""
    paths = os.pathsep.join([str(folder), str(ROOT)])
    command = [sys.executable, "-c", ASKING, json.dumps(COMMANDS)]
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, tuple[int, str, str]] = json.loads(done.stdout)
    return found


def test_there_is_no_laboratory(answers: dict[str, tuple[int, str, str]]) -> None:
    status, _, err = answers["run"]
    assert status == 1 and "the scene 'push' comes with contactfusion-lab" in err


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("check", "recording: 'wrist' (Wrench)"),
        ("replay", "5 steps, 5 with contact, 5 contacts"),
        ("explain", "0.200 s: 1 contact in 'base'"),
        ("explain kept", "0.200 s: 1 contact in 'base'"),
        ("ablate", "5 -> 0 of 5"),
        ("view", "results: felt.rrd"),
    ],
)
def test_a_command_on_a_recording_passes_over_the_scene(
    command: str, told: str, answers: dict[str, tuple[int, str, str]]
) -> None:
    status, out, err = answers[command]
    assert (status, err) == (0, "") and told in out
