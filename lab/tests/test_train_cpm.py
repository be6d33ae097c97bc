"""`train cpm`: a whole training, small enough for a test, that repeats itself and goes on."""

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from contactfusion.errors import ConfigurationError, ContactFusionError, RobotError
from contactfusion.generators.networks import ContactNetworks, read_networks
from contactfusion_lab.experiments.push import experiment
from contactfusion_lab.learning import cpm, export, rollout, training
from contactfusion_lab.learning.cpm import Options, train_cpm
from contactfusion_lab.learning.dataset import LabelledTrial, load
from contactfusion_lab.learning.rollout import MOUNTINGS, Detour, Lesson, Split
from contactfusion_lab.trials.executor import Local
from lab.tests.here import Here
from tests.test_cli import Ask, ask, one_sentence

__all__ = ["ask"]  # a fixture
OPTIONS = [field.name for field in fields(Options) if field.name not in ("preset", "executor")]
TINY = Options(rounds=1, varied=0, driven=1, tested=6, epochs=2, early=1, stride=1, executor=Here())
FIGURES = {"lidar_lidar_success_true": 0.75}
OFFSETS: dict[Split, float] = {"training": -0.1, "validation": 0.05}
FIRST = [
    Lesson(f"{split}-{name}", split, 0, name, "mu1", (2.0, 0.0), offset=offset)
    for split, offset in OFFSETS.items()
    for name in ("box", "cylinder")
]
THEN = [Lesson("training-driven", "training", 1, "box", "mu2", (2.0, 0.0), driver="lidar_side")]
FILES = {
    "settings.json", "cpm.safetensors", "cpm.json", "curves.png",
    *(f"trials/{lesson.name}.npz" for lesson in (*FIRST, *THEN)),
    *(f"round_{iteration}/{name}" for iteration in (0, 1)
      for name in ("location.npz", "type.npz", "cpm.safetensors", "cpm.json")),
}  # fmt: skip


def make_small(patch: pytest.MonkeyPatch) -> None:
    """Make few and short pushes, no test, and no processes."""
    patch.setattr(cpm, "first_lessons", lambda varied, seed: FIRST)
    patch.setattr(cpm, "driven_lessons", lambda count, iteration, mountings, seed: THEN)
    patch.setattr(cpm, "tested", lambda *args: FIGURES)
    patch.setitem(vars(Lesson.course), "longest", 1.0)  # of every lesson that names no course


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    make_small(monkeypatch)


@pytest.fixture
def lived(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The lessons that are rolled out, and the weights that drive."""
    noted: list[str] = []

    def live(lesson: Lesson, weights: Path | None) -> LabelledTrial:
        driver = "skin" if weights is None else "/".join(weights.parts[-2:])
        noted.append(f"{lesson.name} by {driver}")
        return rollout.live(lesson, weights)

    monkeypatch.setattr(cpm, "live", live)
    return noted


def content(out: Path) -> dict[str, bytes]:
    """The bytes of all files."""
    files = (path for path in out.rglob("*") if path.is_file())
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of a training from beginning to end."""
    out = tmp_path_factory.mktemp("whole") / "cpm"
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch)
        train_cpm(TINY, out)
    return content(out)


def laid_out(files: dict[str, bytes], out: Path) -> Path:
    for name, held in files.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_bytes(held)
    return out


# What comes of it


def test_all_is_there_that_is_promised(whole: dict[str, bytes]) -> None:
    assert set(whole) == FILES
    assert whole["curves.png"].startswith(b"\x89PNG")


def test_the_card_says_what_was_learned(whole: dict[str, bytes], tmp_path: Path) -> None:
    card, weights = read_networks(laid_out(whole, tmp_path) / "cpm.safetensors")
    assert set(weights) == {"location", "type"}
    cycles = 5 * 11  # pushes of a second, at 10 Hz, with the first and the last
    assert card.data == (
        f"5 simulated pushes, {cycles} cycles, each seen from 3 places: the 156 + 36 of the paper "
        "by skin, then 1 by networks in each of 1 rounds; seed 0"
    )
    assert (card.window, card.rate, card.proximity) == (20, 10.0, rollout.PROXIMITY)
    assert card.figures["lidar_lidar_success_true"] == 0.75
    assert 0.0 <= card.figures["validation_type_accuracy"] <= 1.0
    assert card.figures["validation_location_rmse_m"] > 0.0
    assert card.seeds == {"location": 0, "type": 0}


def test_the_networks_that_are_written_are_those_of_the_last_round(
    whole: dict[str, bytes], tmp_path: Path
) -> None:
    assert whole["cpm.safetensors"] == whole["round_1/cpm.safetensors"]
    assert whole["cpm.safetensors"] != whole["round_0/cpm.safetensors"]
    before, card = json.loads(whole["round_1/cpm.json"]), json.loads(whole["cpm.json"])
    assert card == before | {"figures": before["figures"] | FIGURES}
    window = np.full((20, 12), 0.31)
    found = ContactNetworks.load(laid_out(whole, tmp_path) / "cpm.safetensors").perceive(window)
    assert found.probabilities.sum() == pytest.approx(1.0)


def test_each_round_learns_from_all_pushes_so_far(whole: dict[str, bytes], tmp_path: Path) -> None:
    out = laid_out(whole, tmp_path)
    cards = [
        read_networks(out / f"round_{iteration}" / "cpm.safetensors")[0] for iteration in (0, 1)
    ]
    assert [card.data.split(",")[0] for card in cards] == [
        "4 simulated pushes", "5 simulated pushes",
    ]  # fmt: skip
    trial = load(out / "trials" / "training-driven.npz")
    assert (trial.round, trial.split) == (1, "training")


def test_networks_drive_after_the_first_round(lived: list[str], tmp_path: Path) -> None:
    train_cpm(TINY, tmp_path / "cpm")
    assert lived == [
        "training-box by skin",
        "training-cylinder by skin",
        "validation-box by skin",
        "validation-cylinder by skin",
        "training-driven by round_0/cpm.safetensors",
    ]


def test_the_last_round_is_the_longest_and_goes_on_from_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trainings: list[tuple[str, str, int, bool]] = []
    kept = training.train

    def train(name: Any, data: Any, how: Any, folder: Path, warm: Any, sentence: Any) -> Any:
        trainings.append((folder.name, name, how.epochs, warm is not None))
        return kept(name, data, how, folder, warm, sentence)

    monkeypatch.setattr(cpm, "train", train)
    train_cpm(TINY, tmp_path / "cpm")
    assert trainings == [
        ("round_0", "location", 1, False),
        ("round_0", "type", 1, False),
        ("round_1", "location", 2, True),
        ("round_1", "type", 2, True),
    ]


def test_without_further_rounds_the_skin_is_the_only_driver(
    lived: list[str], tmp_path: Path
) -> None:
    train_cpm(replace(TINY, rounds=0), tmp_path / "cpm")
    assert len(lived) == 4 and all("skin" in text for text in lived)
    assert not (tmp_path / "cpm" / "round_1").exists()


# As printed


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> Options:
    """Options of the preset, small enough for a test."""
    brief = replace(rollout.AS_PRINTED, longest=1.0)
    monkeypatch.setattr(rollout, "AS_PRINTED", brief)
    monkeypatch.setattr(cpm, "AS_PRINTED", brief)
    return replace(cpm.PRESETS["paper"], epochs=2, stride=1, executor=Here())


def test_the_preset_trains_as_printed_and_the_type_in_both_readings(
    printed: Options, lived: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trainings: list[tuple[str, str, training.Options]] = []
    kept = training.train

    def train(name: Any, data: Any, how: Any, folder: Path, warm: Any, told: Any) -> Any:
        assert warm is None
        trainings.append((folder.name, name, how))
        return kept(name, data, how, folder, warm, told)

    monkeypatch.setattr(cpm, "train", train)
    out = tmp_path / "cpm"
    train_cpm(printed, out)
    assert len(lived) == 4 and all("skin" in told for told in lived)
    assert [(folder, name, how.design) for folder, name, how in trainings] == [
        ("round_0", "location", "lstm"), ("round_0", "type", "dense"), ("lstm", "type", "lstm"),
    ]  # fmt: skip
    assert {
        (how.rate, how.schedule, how.mirrored, how.begun, how.keenness)
        for _, _, how in trainings
    } == {(1e-3, "constant", False, 0.0, 1.0)}  # fmt: skip
    card, weights = read_networks(out / "cpm.safetensors")
    _, with_lstm = read_networks(out / "cpm_lstm.safetensors")
    assert card.proximity.occupied == 1
    assert card.data.startswith("4 simulated pushes as printed, 44 cycles, each seen from 1 place:")
    assert "dense.0.weight" in weights["type"] and "lstm.bias_hh_l1" in with_lstm["type"]
    assert all(np.array_equal(with_lstm["location"][name], one)
               for name, one in weights["location"].items())  # fmt: skip


def test_the_preset_is_what_the_paper_prints() -> None:
    paper = cpm.PRESETS["paper"]
    assert (paper.rounds, paper.varied, paper.epochs) == (0, 0, 200)


# It repeats itself, and goes on


def test_the_same_options_give_the_same_bytes(whole: dict[str, bytes], tmp_path: Path) -> None:
    train_cpm(TINY, tmp_path / "cpm")
    assert content(tmp_path / "cpm") == whole


def test_a_second_call_does_nothing_new(
    whole: dict[str, bytes], lived: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: Any) -> Any:
        raise AssertionError("an epoch was made again")

    monkeypatch.setattr(training, "_learn", never)
    train_cpm(TINY, laid_out(whole, tmp_path))
    assert not lived
    assert content(tmp_path) == whole


@pytest.mark.parametrize(
    ("lost", "again"),
    [
        (["cpm.safetensors"], []),
        (["trials/training-cylinder.npz", "cpm.safetensors"], ["training-cylinder by skin"]),
        (
            ["trials/training-driven.npz", "cpm.json", "curves.png"],
            ["training-driven by round_0/cpm.safetensors"],
        ),
        (["round_1/location.npz", "round_0/cpm.json"], []),
        (["round_0/type.npz"], []),
    ],
)
def test_what_is_lost_is_made_again_to_the_byte(
    lost: list[str], again: list[str], whole: dict[str, bytes], lived: list[str], tmp_path: Path
) -> None:
    out = laid_out(whole, tmp_path)
    for name in lost:
        (out / name).unlink()
    train_cpm(TINY, out)
    assert lived == again
    assert content(out) == whole


def test_a_training_that_was_stopped_among_its_pushes_goes_on(
    whole: dict[str, bytes], tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt):
        train_cpm(replace(TINY, executor=Here(stop=3)), tmp_path / "cpm")
    assert len(list((tmp_path / "cpm" / "trials").iterdir())) == 3
    train_cpm(TINY, tmp_path / "cpm")
    assert content(tmp_path / "cpm") == whole


@pytest.mark.slow
def test_processes_of_their_own_give_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flung = (Detour(0.0, 60.0, (2.0, 0.0, 0.0)),)  # out of the field in three seconds
    brief = [replace(lesson, offset=0.01 * row, detours=flung) for row, lesson in enumerate(FIRST)]
    monkeypatch.setattr(cpm, "first_lessons", lambda *_: brief)
    monkeypatch.setitem(vars(Lesson.course), "longest", 60.0)
    options = replace(TINY, rounds=0, epochs=1)
    train_cpm(options, tmp_path / "here")
    train_cpm(replace(options, executor=Local(2)), tmp_path / "there")
    assert content(tmp_path / "there") == content(tmp_path / "here")


# What is wrong


@pytest.mark.parametrize("field", ["rounds", "varied", "driven", "tested", "epochs", "early",
                                   "stride", "seed"])  # fmt: skip
def test_a_folder_of_other_options_is_refused(
    field: str, whole: dict[str, bytes], tmp_path: Path
) -> None:
    other = replace(TINY, **{field: getattr(TINY, field) + 1})
    with pytest.raises(ConfigurationError) as caught:
        train_cpm(other, laid_out(whole, tmp_path))
    sentence = f"{tmp_path} holds pushes of other {field}: give another --out, or remove it"
    assert str(caught.value) == sentence
    assert content(tmp_path) == whole


def test_a_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ConfigurationError) as caught:
        train_cpm(TINY, tmp_path)
    assert str(caught.value) == f"{tmp_path} holds files, but no settings.json: give another --out"
    assert content(tmp_path) == {"thesis.txt": b"mine"}


@pytest.mark.parametrize("held", [b"{", b"[]", b"\xff\xfe", b'{"collection": 0}'])
def test_settings_that_are_not_ours_are_refused(held: bytes, tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_bytes(held)
    with pytest.raises(ConfigurationError, match="is damaged|holds another experiment"):
        train_cpm(TINY, tmp_path)


def test_a_push_that_cannot_be_made_is_reported_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cpm, "first_lessons", lambda *_: [replace(FIRST[0], object="bax")])
    with pytest.raises(ContactFusionError, match=r"^training-box: .*'bax'; did you mean 'box'"):
        train_cpm(TINY, tmp_path / "cpm")


def test_a_process_that_crashes_twice_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="was killed by SIGSEGV, twice; start again"):
        train_cpm(replace(TINY, executor=Here(crashing=(1,))), tmp_path / "cpm")


def test_a_checkpoint_of_another_training_is_reported(
    whole: dict[str, bytes], tmp_path: Path
) -> None:
    out = laid_out(whole, tmp_path)
    (out / "round_1" / "type.npz").write_bytes(whole["round_0/type.npz"])
    with pytest.raises(ContactFusionError, match=r"round_1/type.npz is the checkpoint of a"):
        train_cpm(TINY, out)


def test_a_damaged_trial_is_reported(whole: dict[str, bytes], tmp_path: Path) -> None:
    out = laid_out(whole, tmp_path)
    (out / "trials" / "training-box.npz").write_bytes(b"PK")
    with pytest.raises(ConfigurationError, match=r"training-box.npz is no npz file of numbers"):
        train_cpm(TINY, out)


# The test


def test_networks_and_rule_are_tested_from_each_mounting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[experiment.Options, Path]] = []

    def run_push(options: experiment.Options, out: Path) -> None:
        asked.append((options, out))
        for sensing in options.sensings:
            for row in range(4):
                path = out / "trials" / sensing / "tuned" / f"{sensing}-{row}.npz"
                path.parent.mkdir(parents=True, exist_ok=True)
                path.touch()

    def successes(names: list[str]) -> pd.DataFrame:  # the rule misses one of four
        return pd.DataFrame({"success_true": [name != "rule-2" for name in names]})

    found = {
        "location_rmse": (0.02, 0.01, 0.03), "type_accuracy": (0.9, 0.8, 1.0),
        "contact_accuracy": (0.95, 0.9, 1.0),
    }  # fmt: skip
    monkeypatch.setattr(export, "run_push", run_push)
    monkeypatch.setattr(export, "load", lambda path: path.stem)
    monkeypatch.setattr(export, "outcomes_of", successes)
    monkeypatch.setattr(export, "perception", lambda tracks, seed: found)
    weights = tmp_path / "cpm.safetensors"
    figures = export.tested(weights, MOUNTINGS, 4, 3, Here(), tmp_path)
    assert [(options.lidar, out) for options, out in asked] == [
        (name, tmp_path / name) for name in MOUNTINGS
    ]
    for options, _ in asked:
        assert (options.weights, options.targets, options.starts) == (weights, "random:4", "random")
        assert options.seed == export.SEED + 3
    shares = {name: share for name, share in figures.items() if name.endswith("success_true")}
    assert shares == {
        f"{name}_{sensing}_success_true": share
        for name in MOUNTINGS for sensing, share in (("lidar", 1.0), ("rule", 0.75))
    }  # fmt: skip
    assert figures["lidar_side_rule_location_rmse_m"] == 0.02
    assert figures["lidar_tilted_lidar_type_accuracy"] == 0.9
    assert len(figures) == 3 * 2 * 4


# The command


def test_the_command_lists_its_options(ask: Ask) -> None:
    answer = ask("train", "cpm", "--help")
    assert answer.status == 0
    for option in OPTIONS:
        assert f"--{option}" in answer.out


def test_the_command_gives_each_option_its_place(
    ask: Ask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    received: list[tuple[Options, Path]] = []
    monkeypatch.setattr(cpm, "train_cpm", lambda *args: received.append(args))
    numbers: dict[str, Any] = {name: 20 + row for row, name in enumerate(OPTIONS)}
    options = [part for name, number in numbers.items() for part in (f"--{name}", str(number))]
    assert ask("train", "cpm", *options, "--out", str(tmp_path)).status == 0
    assert ask("train", "cpm").status == 0
    assert ask("train", "cpm", "--workers", "7").status == 0
    assert ask("train", "cpm", "--preset", "paper", "--epochs", "9").status == 0
    assert received == [
        (Options(**numbers), tmp_path),
        (Options(), Path("out/cpm")),
        (Options(executor=Local(7)), Path("out/cpm")),
        (replace(cpm.PRESETS["paper"], epochs=9), Path("out/cpm")),
    ]


def test_a_preset_that_there_is_not_is_told(ask: Ask) -> None:
    told = one_sentence(ask("train", "cpm", "--preset", "papr"))
    assert "unknown preset 'papr'; did you mean 'paper'" in told


def test_the_command_says_in_one_sentence_what_is_wrong(ask: Ask, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    sentence = one_sentence(ask("train", "cpm", "--out", str(tmp_path)))
    assert "holds files, but no settings.json: give another --out" in sentence
