"""`experiment push`: its targets and plan, one push, and how it goes on."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.controllers.pushing_parameters import SETS
from contactfusion.errors import ConfigurationError, ContactFusionError, RobotError
from contactfusion.robots.description import PatchOnLink
from contactfusion_lab.experiments.push import experiment
from contactfusion_lab.experiments.push.experiment import Options, run_push
from contactfusion_lab.experiments.push.plan import (
    GRID,
    NAMED,
    Plan,
    Push,
    Targets,
    read_plan,
    read_targets,
)
from contactfusion_lab.experiments.push.suites import controller_options
from contactfusion_lab.experiments.push.trial import ARRAYS, KINDS, content_of, load, run_trial
from contactfusion_lab.scenes.push.config import (
    PushConfig,
    SkinConfig,
    named_object,
    read_object,
)
from contactfusion_lab.scenes.push.objects import outlines
from contactfusion_lab.scenes.push.sensors import with_taxels
from contactfusion_lab.scenes.push.world import PushWorld
from lab.tests.here import Here

ROOT = Path(__file__).parents[2]
CONTACTFUSION = Path(sys.executable).with_name("contactfusion")
NEAR = ((0.4, 0.0), (0.35, 0.1))
TO_NEAR = Targets("near", NEAR)


@pytest.fixture
def targets(tmp_path: Path) -> str:
    return target_file(tmp_path / "near.yaml", *NEAR)


def target_file(path: Path, *places: tuple[float, float]) -> str:
    path.write_text(f"targets: {[list(place) for place in places]}\n")
    return str(path)


def plan(targets: Targets = TO_NEAR, **changes: Any) -> Plan:
    fields: dict[str, Any] = {
        "sensing": "skin",
        "objects": (),
        "files": (),
        "frictions": (),
        "targets": targets,
        "starts": "nominal",
        "taxels": 12,
        "skin": SkinConfig(),
        "faults": (),
        "seed": 3,
    }
    return read_plan(**{**fields, **changes})


def small(targets: str, **changes: Any) -> Options:
    options = Options(
        objects=("box",), frictions=("mu1",), targets=targets, seed=5, executor=Here()
    )
    return replace(options, **changes)


def content(out: Path) -> dict[str, bytes]:
    """Read all results; their timing is kept apart."""
    files = [path for path in out.rglob("*") if path.is_file() and path.name != "timing.json"]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


WALL = "<collision><geometry><mesh filename='wall.obj'/></geometry></collision>"


def urdf_file(folder: Path, shape: str = "") -> Path:
    """Write a URDF of one link, of 5 kg, without a collision shape unless given."""
    (folder / "wall.obj").write_text("v 0 0 0\nv 0 1 0\nv 0 1 1\nf 1 2 3\n")
    inertia = "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    link = f"<link name='a'><inertial><mass value='5'/>{inertia}</inertial>{shape}</link>"
    path = folder / "bare.urdf"
    path.write_text(f"<robot name='bare'>{link}</robot>")
    return path


class TestTargets:
    def test_the_named_sets_are_those_of_the_method_and_share_no_target(self) -> None:
        sets = [NAMED[name] for name in ("grid", "validation", "new", "far")]
        assert [len(places) for places in sets] == [24, 6, 12, 12]
        assert len({place for places in sets for place in places}) == 24 + 6 + 12 + 12

    def test_far_targets_are_further_than_all_others_and_can_be_reached(self) -> None:
        far = np.array(NAMED["far"])
        assert np.abs(far).max(axis=1).min() > 3.0  # outside of the square of random targets
        distances = np.hypot(*far.T)
        assert 3.0 < distances.min() < 3.5 and 4.4 < distances.max() < 5.0
        places = {place for name in NAMED if name != "far" for place in NAMED[name]}
        assert np.hypot(*np.array(list(places)).T).max() < distances.max()
        assert [PushConfig(target=place).target for place in NAMED["far"]] == list(NAMED["far"])

    @pytest.mark.parametrize(("name", "far"), [("real", 2.0), ("real_near", 1.5)])
    def test_the_real_robots_pushed_to_six_targets(self, name: str, far: float) -> None:
        assert set(NAMED[name]) == {(x, y) for x in (-far, 0.0, far) for y in (-far, far)}
        assert len(NAMED[name]) == 6

    def test_a_file_names_targets(self, targets: str) -> None:
        assert read_targets(targets) == Targets("near", NEAR)

    def test_random_targets_are_drawn_for_each_push(self) -> None:
        assert read_targets("random:500") == Targets("random", None, 500)

    @pytest.mark.parametrize(
        ("text", "problem"),
        [
            ("gird", "did you mean 'grid'"),
            ("random", "write random:N"),
            ("random:0", "write random:N"),
            ("random:x", "write random:N"),
            ("missing.yaml", "no file 'missing.yaml'"),
        ],
    )
    def test_what_is_no_set_of_targets_is_reported(self, text: str, problem: str) -> None:
        with pytest.raises(ConfigurationError, match=problem):
            read_targets(text)

    @pytest.mark.parametrize(
        "text", ["targets: [[.nan, 1.0]]", "targets: [[1.0]]", "targets: []", "places: [[1, 1]]"]
    )
    def test_a_target_is_a_pair_of_finite_numbers(self, text: str, tmp_path: Path) -> None:
        path = tmp_path / "odd.yaml"
        path.write_text(text)
        with pytest.raises(ConfigurationError, match=r"odd\.yaml: targets|odd\.yaml: places"):
            read_targets(str(path))

    def test_the_name_of_a_file_may_not_be_that_of_a_set(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigurationError, match="rename"):
            read_targets(target_file(tmp_path / "grid.yaml", (1.0, 1.0)))


class TestPlan:
    def test_every_object_is_pushed_to_every_target_by_every_friction(self) -> None:
        pushes = plan(Targets("grid", GRID)).pushes()
        assert len({push.name for push in pushes}) == len(pushes) == 144
        assert {push.target for push in pushes} == set(GRID)
        assert {(push.offset, push.yaw) for push in pushes} == {(0.0, 0.0)}
        assert len({push.seed for push in pushes}) == 144

    def test_random_targets_are_dealt_evenly(self) -> None:
        pushes = plan(Targets("random", None, 500)).pushes()
        counts = [sum(push.object == name for push in pushes) for name in ("box", "nonuniform")]
        assert len(pushes) == 500 and counts == [168, 166]

    def test_random_targets_are_apart_from_contact_and_robot(self) -> None:
        pushes = plan(Targets("random", None, 3000), starts="random").pushes()
        places = np.array([push.target for push in pushes])
        assert np.abs(places).max() <= 3.0 and np.abs(places).max() > 2.95
        assert not ((places[:, 0] < 0) & (places[:, 0] > -0.72) & (abs(places[:, 1]) < 0.3)).any()
        names = ["box", "nonuniform", "lshape"]
        made = plan(Targets("random", None, 300), objects=names, starts="random")
        checked = [made.push(name, "mu1", number) for name in names for number in range(5)]
        first = [PushWorld(made.scene_of(each), made.robot).first_contact[1] for each in checked]
        computed = [made.first_contact(each.object, each.offset, each.yaw) for each in checked]
        assert computed == pytest.approx(first, abs=0.02)
        assert np.abs(np.subtract(first, [each.offset for each in checked])).max() > 0.1
        every = [made.first_contact(push.object, push.offset, push.yaw) for push in made.pushes()]
        targets = np.array([push.target for push in made.pushes()])
        assert np.hypot(targets[:, 0], targets[:, 1] - every).min() >= 0.5

    def test_random_starts_are_within_20_cm_and_45_degrees(self) -> None:
        pushes = plan(Targets("grid", GRID), starts="random").pushes()
        offsets, yaws = np.array([(push.offset, push.yaw) for push in pushes]).T
        assert 0.17 < np.abs(offsets).max() <= 0.2 and 40.0 < np.abs(yaws).max() <= 45.0

    def test_far_starts_lie_beyond_random_ones_and_the_face_still_meets_the_object(self) -> None:
        things = ["box", "wedge", "cross", "stool"]
        made = plan(Targets("grid", GRID), starts="far", objects=things)
        offsets, yaws = np.abs([(one.offset, one.yaw) for one in made.pushes()]).T
        assert 0.2 <= offsets.min() and 0.27 < offsets.max() <= 0.28
        assert 45.0 <= yaws.min() and 87.0 < yaws.max() <= 90.0
        for push in made.pushes()[::8]:
            assert abs(PushWorld(made.scene_of(push), made.robot).first_contact[1]) <= 0.3

    def test_noise_reaches_the_scene_and_the_settings_but_for_the_default(self) -> None:
        made = plan(noise="prototype+odometry")
        assert made.scene_of(made.pushes()[0]).noise.odometry.slip == 0.02
        (name, fields), *_ = made.settings(["tuned"])["noise"].items()
        assert name == "prototype+odometry" and fields["odometry"]["slip"] == 0.02
        assert "noise" not in plan().settings(["tuned"])
        assert made.pushes() == plan().pushes()

    def test_an_unknown_noise_is_told(self) -> None:
        with pytest.raises(
            ConfigurationError, match=r"unknown noise 'soft'.*hard, none, prototype"
        ):
            plan(noise="soft")

    def test_a_push_is_the_same_in_a_larger_experiment(self) -> None:
        small = plan(Targets("random", None, 4), objects=["box"], frictions=["mu1"])
        large = plan(Targets("random", None, 90), starts="nominal")
        assert set(small.pushes()) < set(large.pushes())

    def test_pushes_differ_by_seed_and_by_nothing_that_is_compared(self) -> None:
        targets = Targets("random", None, 12)
        same = plan(targets, taxels=48, skin=SkinConfig(activation=3.0)).pushes()
        assert same == plan(targets).pushes()
        assert not set(plan(targets, seed=4).pushes()) & set(same)

    def test_the_face_blurs_as_much_as_the_taxels(self) -> None:
        assert plan(taxels=12).face.blur == pytest.approx(0.125)
        assert plan(taxels=48).face.blur == pytest.approx(0.125 / 4.0)

    def test_scene_and_pipeline_have_the_same_taxels(self) -> None:
        planned = plan(taxels=24)
        options = planned.pipeline_of(planned.pushes()[0], "tuned")
        assert options.robot is not None and options.robot == planned.robot
        assert planned.robot.patches["skin"].grids[0].columns == 24

    def test_a_controller_is_a_set_of_parameters_or_a_plugin(self) -> None:
        face = plan().face
        options = controller_options("paper_neither", (1.0, 2.0), face)
        assert (options["type"], options["parameters"]) == ("reactive_pushing", "paper_neither")
        assert (
            controller_options("reactive_pushing", (1.0, 2.0), face)["type"] == "reactive_pushing"
        )

    @pytest.mark.parametrize(
        ("changes", "problem"),
        [
            ({"objects": ["bax"]}, "did you mean 'box'"),
            ({"objects": ["box", "box"]}, "stands twice"),
            ({"frictions": ["mu3"]}, "unknown friction 'mu3'"),
            ({"frictions": ["mu1", "mu1"]}, "'mu1' stands twice among the frictions"),
            ({"seed": -1}, "seed: a seed is 0 or more, not -1"),
            ({"sensing": "lidra"}, "unknown sensing 'lidra'; did you mean 'lidar'"),
            ({"starts": "odd"}, "unknown starts 'odd'"),
            ({"files": [Path("thing.urdf")]}, "no file 'thing.urdf'"),
        ],
    )
    def test_unknown_names_are_reported(self, changes: dict[str, Any], problem: str) -> None:
        with pytest.raises(ConfigurationError, match=problem):
            plan(**changes)

    def test_an_object_comes_from_a_file(self, tmp_path: Path) -> None:
        (tmp_path / "crate.yaml").write_text("{shape: box, size: [0.3, 0.5, 0.4], mass: 9}")
        made = plan(files=[tmp_path / "crate.yaml"])
        assert list(made.objects) == ["crate"]
        assert list(plan(objects=["box"], files=[tmp_path / "crate.yaml"]).objects) == [
            "box", "crate"
        ]  # fmt: skip


class TestTaxels:
    def patch(self, columns: int) -> PatchOnLink:
        return plan(taxels=columns).robot.patches["skin"]

    def test_strips_keep_their_length_and_share_one_pitch(self) -> None:
        for columns in (6, 12, 24, 48):
            front, *sides = self.patch(columns).grids
            assert front.columns == columns
            assert front.columns * front.pitch[1] == pytest.approx(0.6)
            for side in sides:
                assert side.pitch == front.pitch
                assert side.columns * side.pitch[1] == pytest.approx(0.7, abs=front.pitch[1] / 2)

    def test_as_many_as_there_are_changes_nothing(self) -> None:
        patch = self.patch(12)
        assert with_taxels(patch, 12).centres() == pytest.approx(patch.centres())


class TestOutlines:
    def test_a_box_has_four_corners(self) -> None:
        (corners,) = outlines(named_object("box"))
        assert np.abs(corners) == pytest.approx(np.full((4, 2), 0.2))

    def test_a_urdf_is_seen_from_above(self) -> None:
        pieces = outlines(read_object(ROOT / "examples" / "objects" / "bracket.urdf"))
        low = np.min([piece.min(axis=0) for piece in pieces], axis=0)
        high = np.max([piece.max(axis=0) for piece in pieces], axis=0)
        assert low == pytest.approx([-0.06, -0.04]) and high == pytest.approx([0.06, 0.04])

    @pytest.mark.parametrize(
        ("shape", "problem"),
        [("", "it has no collision shape"), (WALL, "a collision shape is flat seen from above")],
    )
    def test_a_urdf_that_cannot_be_seen_from_above_is_reported(
        self, shape: str, problem: str, tmp_path: Path
    ) -> None:
        path = urdf_file(tmp_path, shape)
        with pytest.raises(RobotError, match=f"^{path}: {problem}$"):
            outlines(read_object(path))


class TestTrial:
    @pytest.mark.slow
    def test_the_same_push_gives_the_same_bytes(self, tmp_path: Path) -> None:
        made = plan(objects=["cylinder"], starts="random")
        for name in ("one", "other"):
            track, _ = run_trial(made, made.pushes()[0], "tuned")
            (tmp_path / name).write_bytes(content_of(track))
        assert (tmp_path / "one").read_bytes() == (tmp_path / "other").read_bytes()

    def test_a_track_is_what_happened(self, tmp_path: Path) -> None:
        made = plan()
        push = made.pushes()[0]
        track, cost = run_trial(made, push, "tuned")
        assert track.ending == "arrived" and track.modes[track.mode[-1]] == "arrived"
        assert track.distance[-1] <= SETS["tuned"].arrival + 0.02
        x, y, yaw = track.base[-1]
        forward, lateral = track.contact[-1]
        there = (x + np.cos(yaw) * forward - np.sin(yaw) * lateral,
                 y + np.sin(yaw) * forward + np.cos(yaw) * lateral)  # fmt: skip
        assert np.hypot(*np.subtract(push.target, there)) == pytest.approx(track.distance[-1])
        touching = track.kind > 0
        assert (touching == ~np.isnan(track.contact[:, 1])).all()
        assert np.abs(track.lateral - track.contact[:, 1])[touching][5:].max() < 0.05
        assert KINDS[track.estimate[0]] == "none" and np.isnan(track.lateral[0])
        assert len(cost.fused) == len(track.stamp) and 0.0 < cost.fused.sum() < cost.cpu
        assert cost.simulated == track.stamp[-1]
        (tmp_path / "track.npz").write_bytes(content_of(track))
        again = load(tmp_path / "track.npz")
        assert again.push == push and again.modes == track.modes
        np.testing.assert_array_equal(again.command, track.command)

    def test_a_file_that_is_no_track_is_reported(self, tmp_path: Path) -> None:
        np.savez(tmp_path / "odd.npz", told="{}")
        with pytest.raises(ConfigurationError, match=r"odd\.npz lacks"):
            load(tmp_path / "odd.npz")
        for text in ("3", "[" * 100_000):
            held: dict[str, Any] = {"told": text, **dict.fromkeys(ARRAYS, [0.0])}
            np.savez(tmp_path / "odd.npz", **held)
            with pytest.raises(ConfigurationError, match=r"odd\.npz is no push"):
                load(tmp_path / "odd.npz")


class TestExperiment:
    @pytest.mark.slow
    def test_results_are_files(self, targets: str, tmp_path: Path) -> None:
        out = tmp_path / "out"
        run_push(small(targets, controllers=("tuned", "paper")), out)
        assert {path.name for path in out.iterdir()} == {
            "trials", "settings.json", "results.csv", "summary.json", "table.md", "timing.json",
            "bars.png", "map_skin_tuned.png", "map_skin_paper.png", "paths_skin_tuned.png",
            "paths_skin_paper.png",
        }  # fmt: skip
        rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
        assert [(row["controller"], row["trial"]) for row in rows] == [
            (name, f"box-mu1-near-{number:03d}") for name in ("tuned", "paper") for number in (0, 1)
        ]
        assert {row["success_true"] for row in rows[:2]} == {"1"}
        summary = json.loads((out / "summary.json").read_text())
        assert summary["reached"]["skin/tuned"]["all"]["success_true"]["share"] == 1.0
        assert {comparison["case"] for comparison in summary["tests"]} == {"skin/paper"}

    def test_what_is_there_is_not_made_again(self, targets: str, tmp_path: Path) -> None:
        out = tmp_path / "out"
        run_push(small(targets), out)
        held = content(out)
        first, second = sorted((out / "trials" / "skin" / "tuned").iterdir())
        kept = first.stat().st_mtime_ns
        second.unlink()
        run_push(small(targets), out)
        assert content(out) == held and first.stat().st_mtime_ns == kept

    @pytest.mark.slow
    def test_a_folder_takes_more_controllers_objects_and_targets(
        self, targets: str, tmp_path: Path
    ) -> None:
        out = tmp_path / "out"
        run_push(small(targets), out)
        held = content(out / "trials")
        run_push(small(targets, controllers=("paper",), objects=("prism",)), out)
        run_push(small(target_file(tmp_path / "others.yaml", (0.45, 0.0))), out)
        assert len(content(out / "trials")) == 5
        assert held.items() < content(out / "trials").items()
        rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
        assert [(row["controller"], row["trial"]) for row in rows] == [
            ("tuned", "box-mu1-near-000"), ("tuned", "box-mu1-near-001"),
            ("tuned", "box-mu1-others-000"),
            ("paper", "prism-mu1-near-000"), ("paper", "prism-mu1-near-001"),
        ]  # fmt: skip
        summary = json.loads((out / "summary.json").read_text())
        assert {comparison["case"] for comparison in summary["tests"]} == {"skin/paper"}

    @pytest.mark.parametrize(
        ("change", "text"),
        [
            ({"seed": 6}, "seed"),
            ({"starts": "random"}, "starts"),
            ({"taxels": 24}, "sensings 'skin'"),
            ({"skin": SkinConfig(activation=2.0)}, "skin"),
            ({"faults": ROOT / "examples" / "faults" / "stuck_taxel.yaml"}, "faults"),
        ],
    )
    def test_the_folder_of_another_experiment_is_refused(
        self, change: dict[str, Any], text: str, targets: str, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:  # fmt: skip
        out = tmp_path / "out"
        options = small(targets)
        made = plan(read_targets(targets), objects=["box"], frictions=["mu1"], seed=5)
        (out / "trials").mkdir(parents=True)
        (out / "settings.json").write_text(json.dumps(made.settings(["tuned"]), default=str))
        monkeypatch.setattr(experiment, "check", lambda *_: None)
        with pytest.raises(ConfigurationError, match=f"holds pushes of other .*{text}"):
            run_push(replace(options, **change), out)

    def test_parameters_that_have_changed_are_another_experiment(
        self, targets: str, tmp_path: Path
    ) -> None:
        out = tmp_path / "out"
        run_push(small(targets), out)
        settings = json.loads((out / "settings.json").read_text())
        settings["controllers"]["tuned"]["parameters"]["eta"] = 1.5
        (out / "settings.json").write_text(json.dumps(settings))
        with pytest.raises(ConfigurationError, match="other controllers 'tuned'"):
            run_push(small(targets), out)

    def test_a_folder_of_unknown_content_is_refused(self, targets: str, tmp_path: Path) -> None:
        (tmp_path / "out" / "trials" / "tuned").mkdir(parents=True)
        with pytest.raises(ConfigurationError, match=r"no settings\.json"):
            run_push(small(targets), tmp_path / "out")
        for text in ("[]", "{"):
            (tmp_path / "out" / "settings.json").write_text(text)
            with pytest.raises(ConfigurationError, match="damaged"):
                run_push(small(targets), tmp_path / "out")

    @pytest.mark.parametrize(
        ("name", "text", "problem"),
        [
            ("settings.json", '{"seed": 5, "objects": {}}', "holds another experiment"),
            ("settings.json", '{"seed": 5, "trials": 60, "sets": {}}', "holds another experiment"),
            ("notes.txt", "mine", r"holds files, but no settings\.json"),
        ],
    )
    def test_the_folder_of_another_program_is_refused_and_left_as_it_is(
        self, name: str, text: str, problem: str, targets: str, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:  # fmt: skip
        out = tmp_path / "out"
        out.mkdir()
        (out / name).write_text(text)
        monkeypatch.setattr(experiment, "check", lambda *_: pytest.fail("set up a world"))
        with pytest.raises(ConfigurationError, match=problem) as caught:
            run_push(small(targets), out)
        assert "remove" not in str(caught.value)
        assert content(out) == {name: text.encode()} and len(list(out.iterdir())) == 1

    @pytest.mark.slow
    def test_other_experiments_may_lie_in_folders_below(self, targets: str, tmp_path: Path) -> None:
        run_push(small(targets), tmp_path / "out" / "first")
        run_push(small(targets), tmp_path / "out")
        assert (tmp_path / "out" / "table.md").is_file()

    def test_a_push_whose_process_dies_twice_is_reported_and_the_others_are_kept(
        self, targets: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        with pytest.raises(
            RobotError, match="1 of 2 pushes were not made: skin/tuned/box-mu1-near-000"
        ):
            run_push(small(targets, executor=Here(crashing=(0,))), tmp_path / "out")
        assert "1/1" in capsys.readouterr().out
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        assert summary["reached"]["skin/tuned"]["all"]["n"] == 1
        assert "killed by SIGSEGV, twice" in summary["not made"][0]

    def test_a_controller_that_fails_costs_its_pushes(
        self, targets: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def broken(*_: Any) -> Any:
            raise ZeroDivisionError("oh")

        monkeypatch.setattr(experiment, "run_trial", broken)
        with pytest.raises(RobotError, match="2 of 2 pushes .*ZeroDivisionError: oh"):
            run_push(small(targets), tmp_path / "out")

    @pytest.mark.parametrize(
        ("places", "problem"),
        [
            ([(-0.3, 0.1)], "lies under the robot"),
            ([(0.4, 0.0), (9.0, 0.0)], "out of reach"),
        ],
    )
    def test_a_target_that_cannot_be_reached_is_reported_before_anything_is_made(
        self, places: list[tuple[float, float]], problem: str, tmp_path: Path
    ) -> None:
        with pytest.raises(ConfigurationError, match=problem):
            run_push(small(target_file(tmp_path / "beyond.yaml", *places)), tmp_path / "out")
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize(
        ("text", "name", "problem"),
        [
            ("{shape: box, size: [1, 1, 1], mass: 300}", "heavy.yaml", "too heavy"),
            ("<robot name='x'>", "broken.urdf", "broken.urdf"),
            ("{shape: ball}", "odd.yaml", "odd.yaml"),
        ],
    )
    def test_an_object_that_cannot_be_pushed_is_reported(
        self, text: str, name: str, problem: str, targets: str, tmp_path: Path
    ) -> None:
        (tmp_path / name).write_text(text)
        options = small(targets, objects=(), files=[tmp_path / name])
        with pytest.raises(ContactFusionError, match=problem):
            run_push(options, tmp_path / "out")

    @pytest.mark.parametrize("to", ["grid", "random:2"])
    def test_a_urdf_without_a_collision_shape_is_reported_before_anything_is_made(
        self, to: str, tmp_path: Path
    ) -> None:
        options = small(to, objects=(), files=[urdf_file(tmp_path)])
        with pytest.raises(ContactFusionError, match=r"bare\.urdf.*collision shape") as caught:
            run_push(options, tmp_path / "out")
        assert "\n" not in str(caught.value) and not (tmp_path / "out").exists()

    def test_whatever_a_world_raises_is_reported_before_anything_is_made(
        self, targets: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def broken(*_: Any) -> Any:
            raise ZeroDivisionError("oh")

        monkeypatch.setattr(experiment, "PushScene", broken)
        with pytest.raises(ConfigurationError, match=r"box to .*: ZeroDivisionError: oh"):
            run_push(small(targets), tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def test_a_fault_of_no_sensor_is_reported(self, targets: str, tmp_path: Path) -> None:
        path = ROOT / "examples" / "faults" / "dead_wrench.yaml"
        with pytest.raises(ConfigurationError, match="no reading of 'wrist' comes"):
            run_push(small(targets, faults=path), tmp_path / "out")

    @pytest.mark.parametrize(
        ("changes", "problem"),
        [
            ({"controllers": ("tunde",)}, "did you mean 'tuned'"),
            ({"controllers": ("tuned", "tuned")}, "stands twice"),
            ({"record": ("box-mu1-near-007",)}, "unknown trial 'box-mu1-near-007'"),
            ({"frictions": ("mu1", "mu1")}, "stands twice among the frictions"),
            ({"seed": -1}, "a seed is 0 or more, not -1"),
        ],
    )
    def test_unknown_names_are_reported(
        self, changes: dict[str, Any], problem: str, targets: str, tmp_path: Path
    ) -> None:
        with pytest.raises(ConfigurationError, match=problem):
            run_push(small(targets, **changes), tmp_path / "out")

    @pytest.mark.slow
    def test_a_push_is_filmed_and_recorded(
        self, targets: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from PIL import Image

        names = ("box-mu1-near-000", "tuned/box-mu1-near-000")
        run_push(small(targets, record=names), tmp_path / "out")
        assert capsys.readouterr().out.count("film: ") == 1
        folder = tmp_path / "out" / "recordings" / "skin" / "tuned"
        with Image.open(folder / "box-mu1-near-000.gif") as film:
            assert film.format == "GIF"
            assert getattr(film, "n_frames", 0) > 20
        assert (folder / "box-mu1-near-000.mcap").read_bytes().startswith(b"\x89MCAP")

    def test_a_push_that_was_not_made_is_not_recorded_and_its_failure_is_reported(
        self, targets: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:  # fmt: skip
        def fails(made: Plan, push: Push, controller: str) -> Any:
            if push.number == 0:
                raise RobotError("oh")
            return run_trial(made, push, controller)

        monkeypatch.setattr(experiment, "run_trial", fails)
        monkeypatch.setattr(experiment, "record", lambda *_: pytest.fail("recorded"))
        with pytest.raises(RobotError, match="^1 of 2 pushes were not made: .*000: oh$"):
            run_push(small(targets, record=("box-mu1-near-000",)), tmp_path / "out")
        assert "not filmed: skin/tuned/box-mu1-near-000" in capsys.readouterr().out
        assert (tmp_path / "out" / "table.md").is_file()

    def test_a_recording_that_fails_is_reported_after_the_results(
        self, targets: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def broken(*_: Any) -> Any:
            raise ZeroDivisionError("oh")

        monkeypatch.setattr(experiment, "record", broken)
        names = ("box-mu1-near-000", "box-mu1-near-001")
        expected = (
            "^2 of 2 films were not made: skin/tuned/box-mu1-near-000: ZeroDivisionError: oh$"
        )
        with pytest.raises(RobotError, match=expected):
            run_push(small(targets, record=names), tmp_path / "out")
        assert (tmp_path / "out" / "table.md").is_file()


@pytest.mark.slow
def test_killed_and_gone_on_with_it_gives_the_bytes_of_an_undisturbed_run(
    targets: str, tmp_path: Path
) -> None:
    more = target_file(tmp_path / "near.yaml", *NEAR, (0.5, 0.0), (0.4, -0.1), (0.45, 0.1))
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    command = [str(CONTACTFUSION), "experiment", "push", "--objects", "box", "--targets", more]
    command += ["--friction", "mu1", "--seed", "5", "--out", str(killed), "--workers"]
    running = subprocess.Popen([*command, "2"], stdout=subprocess.DEVNULL)
    while not list(killed.glob("trials/*/*/*.npz")):
        assert running.poll() is None
        time.sleep(0.01)
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    assert not (killed / "results.csv").exists()
    subprocess.run([*command, "1"], check=True, stdout=subprocess.DEVNULL)
    run_push(small(more), whole)
    assert content(killed) == content(whole)


def test_zero_workers_are_refused(targets: str) -> None:
    command = [str(CONTACTFUSION), "experiment", "push", "--workers", "0"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode != 0 and "workers" in done.stderr
