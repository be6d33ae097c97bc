"""A package of a stranger, installed beside contactfusion, takes part by configuration alone."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.strangers import EXAMPLES, Stranger

RUN = """
import json, numpy as np, contactfusion_bumper
from contactfusion import Pipeline, PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.readings import Switch

config = PipelineConfig(
    generators={"bumper": {"type": "bumper", "u": [0, 0.02, 0], "v": [0, 0, 0.01]}},
    frames={"front": {"parent": "base", "xyz": [0.3025, 0.1, 0.05]}},
)
pipeline = Pipeline(config)
contacts = []
for stamp, closed in ((0.0, False), (0.1, True), (0.2, False)):
    pipeline.receive(Switch(stamp=stamp, frame="front", closed=closed))
    found = pipeline.step(stamp).fusion.contacts
    contacts.append([[c.position.tolist(), dict(c.shares), c.frame] for c in found])
listed = {p.name: p.distribution for p in installed_plugins().listing()}
print(json.dumps([contacts, listed["bumper"], contactfusion_bumper.__file__]))
"""


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    return Stranger(EXAMPLES / "bumper", tmp_path_factory.mktemp("stranger"))


def test_its_bumper_finds_the_contact_by_configuration_alone(stranger: Stranger) -> None:
    told: Any = json.loads(stranger.run("-P", "-c", RUN))
    (before, during, after), distribution, file = told
    assert before == after == []
    ((position, shares, frame),) = during
    assert position == pytest.approx([0.3025, 0.1, 0.05])
    assert (shares, frame) == ({"bumper": 1.0}, "base")
    assert distribution == "contactfusion-bumper 0.1.0"
    assert Path(file).is_relative_to(stranger.home)


def test_its_own_tests_pass(stranger: Stranger) -> None:
    (stranger.source / "contactfusion_bumper.py").unlink()  # the installed one is tested
    assert "3 passed" in stranger.run("-m", "pytest", "-q", "-c", os.devnull, "test_bumper.py")
