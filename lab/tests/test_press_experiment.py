"""`experiment press`: its trials, its table, and what it refuses."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion_lab.experiments.press.experiment import Options, run_press
from contactfusion_lab.experiments.press.plan import ALONE, ARMS, BESIDE, Plan, Press, arm
from contactfusion_lab.experiments.press.tables import evaluate, frame_of_trials
from contactfusion_lab.experiments.press.trial import Found, Trial, content_of, load

PLAN = Plan(("panda",), (10.0, 20.0), 3, 1, 1.0, 4)
MOVED = {"panda_link2": 2, "panda_link3": 3, "panda_link5": 5, "panda_hand": 7, "panda_finger": 7}
JOINTS = {"panda": {link: frozenset("1234567"[:count]) for link, count in MOVED.items()}}


def found(row: str = ALONE, **fields: Any) -> Found:
    known = Found(
        row=row, contacts=1, found=1, false=0, error=0.02, link="panda_link5", links=(),
        probability=0.9, level=0.5, radius=0.05, latency=0.1, alarms=0,
    )  # fmt: skip
    return replace(known, **fields)


def trial(number: int, link: str, *rows: Found, force: float = 10.0) -> Trial:
    press = Press("panda", force, number, 1, 0, number)
    return Trial(press, (link,), (11.0,), rows or (found(),))


@pytest.mark.parametrize("name", ARMS)
def test_each_arm_has_all_generators_and_drives_for_its_joints(name: str) -> None:
    described = arm(name)
    used = {each for names in BESIDE.values() for each in names}
    assert used == {*described.pipeline.generators}
    joints = described.pipeline.generators["torques"]["joints"]
    assert len(described.scene.drives.noise) == len(described.scene.drives.coulomb) == len(joints)


def test_more_touches_leave_the_others_unchanged() -> None:
    more = replace(PLAN, touches=5).presses()
    assert {*PLAN.presses()} <= {*more}
    assert len(PLAN.presses()) == 2 * 3 + 3
    assert len({press.seed for press in more}) == len(more)


def test_specimens_of_another_seed_are_others() -> None:
    first = {press.specimen for press in replace(PLAN, touches=5).presses()}
    second = {press.specimen for press in replace(PLAN, touches=5, seed=5).presses()}
    assert len(first) == 5 and first.isdisjoint(second)


def test_a_trial_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "trial.json"
    one = trial(0, "panda_link5", found(links=("panda_link4", "panda_link5")))
    path.write_bytes(content_of(one))
    assert load(path) == one
    for content in ("{}", "[" * 100_000):
        path.write_text(content)
        with pytest.raises(ConfigurationError, match="is no trial of this experiment"):
            load(path)


def test_the_right_set_of_links_counts_where_one_is_not_decided() -> None:
    undecided = found(contacts=0, found=0, error=np.nan, link="", level=np.nan, radius=np.nan,
                      links=("panda_link2", "panda_link3"))  # fmt: skip
    frame = frame_of_trials([trial(0, "panda_link2", undecided), trial(1, "panda_link5")], JOINTS)
    assert frame["right_set"].tolist() == [True, True]
    assert frame["reported"].tolist() == [False, True]
    assert np.isnan(frame["right_link"][0]) and frame["right_link"][1]
    assert frame["far"].tolist() == [False, True]


def test_links_that_the_same_joints_move_count_as_the_same() -> None:
    hand = trial(0, "panda_finger", found(link="panda_hand"))
    frame = frame_of_trials([hand, trial(1, "panda_finger")], JOINTS)
    assert frame["right_link"].tolist() == [True, False]


def test_the_table_has_each_arm_force_and_part_of_the_arm(tmp_path: Path) -> None:
    free = Trial(Press("panda", 0.0, 0, 0, 0, 0), (), (), (found(contacts=0, alarms=2),))
    far = [trial(number, "panda_link5", found(error=0.01 * number)) for number in range(5)]
    near = [trial(9, "panda_link2", found(link="panda_link5", found=0, false=1))]
    evaluate([*far, *near, free], PLAN, JOINTS, ["panda-10N-007: no posture"], tmp_path)
    table = (tmp_path / "table.md").read_text()
    assert "| panda | 10 | far | joint_torque | 5 | 100 [57, 100] |" in table
    assert "| panda | 10 | near | joint_torque | 1 |" in table
    assert "6.0 |" in table  # two alarms in a third of a minute
    assert "panda-10N-007: no posture" in table
    assert (tmp_path / "press.png").stat().st_size > 0
    lines = (tmp_path / "results.csv").read_text().splitlines()
    assert len(lines) == 8 and lines[0].startswith("arm,trial,force,places,true_contacts")


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (Options(arms=("pandas",)), "unknown arm 'pandas'.*'panda'"),
        (Options(arms=("panda", "panda")), "twice"),
        (Options(places=3), "at 1 or 2 places, not 3"),
        (Options(forces=(0.0,)), "more than 0 N, and at most 200 N"),
        (Options(free=-1.0), "0 minutes or more, not -1"),
    ],
)
def test_wrong_options_are_refused(options: Options, problem: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        run_press(options, tmp_path)
