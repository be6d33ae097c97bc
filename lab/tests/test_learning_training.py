"""Training: it learns, repeats itself bit for bit, and goes on where it was stopped."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from contactfusion.errors import ConfigurationError, ContactFusionError, DependencyError
from contactfusion.files import read_arrays, write_npz
from contactfusion.generators.lstm import UNITS, Weights, dense_shapes, tensor_shapes
from contactfusion.generators.networks import OUTPUTS
from contactfusion_lab.learning import training
from contactfusion_lab.learning.dataset import WINDOW, Dataset, LabelledTrial, Split
from contactfusion_lab.learning.networks import (
    Design,
    Name,
    drawn_network,
    gathered,
    predict,
)
from contactfusion_lab.learning.training import Options, Report, Trained, train
from lab.tests.learning_toys import EMPTY, MIDDLES, toy_trial, toy_trials

DATA = Dataset.of(toy_trials(4, 2))
QUICK = Options(epochs=4, batch=64, stride=3, seed=5)
NAMES: tuple[Name, ...] = ("location", "type")


def bits(trained: Trained) -> list[bytes]:
    arrays: list[NDArray[Any]] = [trained.history]
    arrays += [array for _, array in sorted(trained.weights.items())]
    return [array.tobytes() for array in arrays]


class StoppedError(Exception):
    """What a signal would do."""


def stop_after(epochs: int) -> Report:
    def report(epoch: int, training: float, validation: float, left: float) -> None:
        if epoch == epochs:
            raise StoppedError

    return report


# It learns


@pytest.mark.slow
def test_the_location_is_learned_better_than_by_its_mean(tmp_path: Path) -> None:
    data = Dataset.of(toy_trials(30, 6))
    trained = train("location", data, Options(epochs=15, batch=64, rate=5e-3), tmp_path)
    outputs = predict("location", trained.weights, data.validation, data.length)[:, 0]
    touching = data.validation.touching
    truth = data.validation.lateral[touching]
    errors = data.lateral.unscaled(outputs[touching]) - truth
    assert np.sqrt(np.mean(errors**2)) < 0.7 * truth.std()
    validation = data.lateral.scaled(truth)
    assert np.mean((outputs[touching] - validation) ** 2) == pytest.approx(
        trained.history[:, 1].min(), rel=1e-4
    )


@pytest.mark.slow
def test_the_type_is_learned_better_than_by_its_commonest(tmp_path: Path) -> None:
    data = Dataset.of(toy_trials(60, 8))
    trained = train("type", data, Options(epochs=10, batch=64, rate=5e-3, stride=3), tmp_path)
    outputs = predict("type", trained.weights, data.validation, data.length)
    right = np.mean(outputs.argmax(axis=1) == data.validation.kind)
    assert right > 0.7 > 0.5 > np.bincount(data.validation.kind).max() / len(data.validation)


def test_the_weights_are_those_of_the_lowest_validation_loss(tmp_path: Path) -> None:
    wild = Options(epochs=8, batch=64, rate=0.03, schedule="constant")
    trained = train("location", DATA, wild, tmp_path)
    assert trained.best < wild.epochs  # so fast that the last epoch is not the best
    part = replace(DATA.validation, starts=DATA.validation.starts[DATA.validation.touching])
    outputs = predict("location", trained.weights, part, DATA.length)[:, 0]
    truth = DATA.lateral.scaled(DATA.validation.lateral[DATA.validation.touching])
    loss = np.mean((outputs - truth) ** 2)
    assert loss == pytest.approx(trained.history[trained.best - 1, 1], rel=1e-4)
    assert loss == pytest.approx(trained.history[:, 1].min(), rel=1e-4)


# It sees windows as they might as well have been


def one_sided(side: float, split: Split) -> list[LabelledTrial]:
    """Make up trials in which something touches on one side only: 1 is left, -1 is right."""
    trials = []
    for number in range(12):
        rng = np.random.default_rng([number, len(split)])
        walk = rng.uniform(0.04, 0.22) + np.cumsum(rng.normal(0.0, 0.005, 40))
        lateral = side * np.clip(walk, 0.03, 0.25)
        reached = np.abs(MIDDLES - lateral[:, None]) < 0.06
        lengths = np.where(reached, 0.0, EMPTY) + np.abs(rng.normal(0.0, 0.002, (40, 12)))
        trials.append(
            replace(
                toy_trial(number, split, cycles=40, mountings=1),
                descriptors=lengths[None],
                kind=np.ones(40, np.uint8),
                lateral=lateral,
            )
        )
    return trials


@pytest.mark.parametrize("mirrored", [True, False])
def test_trained_on_the_left_it_knows_the_right_if_it_saw_it_mirrored(
    mirrored: bool, tmp_path: Path
) -> None:
    data = Dataset.of([*one_sided(1.0, "training"), *one_sided(-1.0, "validation")])
    assert data.training.lateral.min() > 0.0 > data.validation.lateral.max()
    options = Options(epochs=15, batch=64, rate=5e-3, mirrored=mirrored)
    trained = train("location", data, options, tmp_path)
    outputs = predict("location", trained.weights, data.validation, data.length)[:, 0]
    errors = data.lateral.unscaled(outputs) - data.validation.lateral
    error = np.sqrt(np.mean(errors**2))
    assert error < 0.03 if mirrored else error > 0.1


def varied(name: Name, **options: Any) -> tuple[torch.Tensor, torch.Tensor]:
    """All windows that a network learns from, as it sees them in one epoch."""
    share = training._Share.of(name, DATA.training, DATA)
    which = torch.arange(len(share.starts))
    generator = torch.Generator().manual_seed(3)
    return training._varied(share, which, Options(**options), generator)


@pytest.mark.parametrize("name", NAMES)
def test_windows_are_left_as_they_are_by_default(name: Name) -> None:
    share = training._Share.of(name, DATA.training, DATA)
    windows, targets = varied(name, mirrored=False, begun=0.0)
    as_they_are, unchanged = share.windows(torch.arange(len(share.starts)))
    assert torch.equal(windows, as_they_are) and torch.equal(targets, unchanged)


@pytest.mark.parametrize("name", NAMES)
def test_half_of_the_windows_have_left_and_right_changed_over(name: Name) -> None:
    as_they_are, unchanged = varied(name, mirrored=False, begun=0.0)
    windows, targets = varied(name, mirrored=True, begun=0.0)
    turned = (windows == as_they_are.flip(2)).all(dim=(1, 2))
    kept = (windows == as_they_are).all(dim=(1, 2))
    assert (turned ^ kept).all()
    assert turned.double().mean().item() == pytest.approx(0.5, abs=0.1)
    assert torch.equal(targets[kept], unchanged[kept])
    if name == "type":
        assert torch.equal(targets[turned], unchanged[turned])
    else:
        before, after = (
            DATA.lateral.unscaled(each[turned].numpy()) for each in (unchanged, targets)
        )
        assert after == pytest.approx(-before, abs=1e-6)


def test_some_windows_seem_to_begin_within() -> None:
    as_they_are, unchanged = varied("type", mirrored=False, begun=0.0)
    windows, targets = varied("type", mirrored=False, begun=1.0)
    assert torch.equal(targets, unchanged)
    begins = []
    for window, before in zip(windows, as_they_are, strict=True):
        same = (window == before).all(dim=1)
        begin = int(torch.argmax(same.int()))
        assert torch.equal(window[begin:], before[begin:])
        assert torch.equal(window[:begin], before[begin].expand(begin, -1))
        begins.append(begin)
    assert set(begins) == set(range(WINDOW))
    # what is newest is never hidden
    assert torch.equal(windows[:, -1], as_they_are[:, -1])


def test_so_many_windows_seem_to_begin_within_as_configured() -> None:
    as_they_are, _ = varied("type", mirrored=False, begun=0.0)
    windows, _ = varied("type", mirrored=False, begun=0.4)
    changed = (windows != as_they_are).any(dim=(1, 2)).double().mean().item()
    # of 20 places to begin the first changes nothing; neither do those in rows that repeat it
    assert 0.3 < changed < 0.4


# Its layers


def test_fully_connected_layers_learn_too_and_their_file_says_so(tmp_path: Path) -> None:
    data = Dataset.of(toy_trials(30, 6))
    dense = Options(epochs=10, batch=64, rate=5e-3, stride=3, design="dense")
    trained = train("type", data, dense, tmp_path)
    assert {name: array.shape for name, array in trained.weights.items()} == dense_shapes(
        WINDOW * 12, 3
    )
    outputs = predict("type", trained.weights, data.validation, data.length)
    loss = trained.history[:, 1]
    assert loss.min() < 0.9 * loss[0]
    assert np.mean(outputs.argmax(axis=1) == data.validation.kind) > 0.6
    assert bits(train("type", data, dense, tmp_path)) == bits(trained)


@pytest.mark.parametrize("design", ["lstm", "dense"])
def test_first_weights_are_drawn_as_torch_draws_them(design: Design) -> None:
    generator = torch.Generator().manual_seed(1)
    network = drawn_network("type", 12, generator, design, keenness=1.0)
    for name, parameter in network.named_parameters():
        inputs = WINDOW * 12 if name.startswith("dense.0") else UNITS
        widest = parameter.abs().max().item()
        assert 0.7 * inputs**-0.5 < widest <= inputs**-0.5 or parameter.numel() < 9, name


def test_a_checkpoint_of_other_first_weights_is_told(tmp_path: Path) -> None:
    train("type", DATA, QUICK, tmp_path)
    other = QUICK.model_copy(update={"keenness": 1.0})
    with pytest.raises(ConfigurationError, match="other keenness: remove it"):
        train("type", DATA, other, tmp_path)


# It repeats itself


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_bits(tmp_path: Path, name: Name) -> None:
    first = train(name, DATA, QUICK, tmp_path / "one")
    torch.manual_seed(99)  # nothing is drawn from what others may have used
    second = train(name, DATA, QUICK, tmp_path / "other")
    assert bits(first) == bits(second)
    third = train(name, DATA, QUICK.model_copy(update={"seed": 6}), tmp_path / "third")
    assert bits(first) != bits(third)


def test_torch_is_left_as_it_was(tmp_path: Path) -> None:
    threads = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        with pytest.raises(StoppedError):
            train("type", DATA, QUICK, tmp_path, report=stop_after(1))
        assert torch.get_num_threads() == 3
        assert not torch.are_deterministic_algorithms_enabled()
    finally:
        torch.set_num_threads(threads)


# It goes on


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("epochs", [1, 3])
def test_a_training_that_was_stopped_ends_as_if_it_had_not_been(
    tmp_path: Path, name: Name, epochs: int
) -> None:
    whole = train(name, DATA, QUICK, tmp_path / "whole")
    with pytest.raises(StoppedError):
        train(name, DATA, QUICK, tmp_path / "parts", report=stop_after(epochs))
    received: list[int] = []
    parts = train(
        name, DATA, QUICK, tmp_path / "parts", report=lambda *what: received.append(what[0])
    )
    assert received == list(range(epochs + 1, QUICK.epochs + 1))
    assert bits(parts) == bits(whole)


def test_a_finished_training_is_not_made_again(tmp_path: Path) -> None:
    whole = train("type", DATA, QUICK, tmp_path)
    assert bits(train("type", DATA, QUICK, tmp_path, report=stop_after(1))) == bits(whole)


def test_a_training_begins_with_the_weights_of_another(tmp_path: Path) -> None:
    first = train("location", DATA, QUICK, tmp_path / "first")
    slow = QUICK.model_copy(update={"epochs": 1, "rate": 1e-9})
    warm = train("location", DATA, slow, tmp_path / "warm", warm=first.weights)
    assert warm.history[0, 1] == pytest.approx(first.history[:, 1].min(), rel=1e-3)
    for name, array in first.weights.items():
        assert warm.weights[name] == pytest.approx(array, abs=1e-5)


def test_progress_is_reported(tmp_path: Path) -> None:
    received: list[tuple[int, float, float, float]] = []
    trained = train("type", DATA, QUICK, tmp_path, report=lambda *what: received.append(what))
    assert [row[0] for row in received] == [1, 2, 3, 4]
    assert [row[1:3] for row in received] == [tuple(row) for row in trained.history]
    assert received[0][3] > received[2][3] > received[3][3] == 0.0


def test_every_window_is_seen_in_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[int]] = []

    def noting(rows: torch.Tensor, starts: torch.Tensor) -> torch.Tensor:
        if torch.is_grad_enabled():
            seen.append(starts.tolist())
        return gathered(rows, starts)

    monkeypatch.setattr("contactfusion_lab.learning.training.gathered", noting)
    train("type", DATA, Options(epochs=3, batch=1000, stride=3), tmp_path)
    assert [len(starts) for starts in seen] == [160, 160, 160]
    assert sorted(sum(seen, [])) == sorted(DATA.training.starts.tolist())
    assert seen[0] != sorted(seen[0])


def test_a_stride_beyond_the_windows_takes_one_at_a_time(tmp_path: Path) -> None:
    trained = train("type", DATA, Options(epochs=3, stride=10**6), tmp_path)
    assert np.isfinite(trained.history).all()


# What is wrong


def test_a_checkpoint_of_another_training_is_reported(tmp_path: Path) -> None:
    train("type", DATA, QUICK, tmp_path)
    other = QUICK.model_copy(update={"batch": 65, "rate": 0.5})
    with pytest.raises(ConfigurationError, match=r"type.npz .* other batch and rate: remove it"):
        train("type", DATA, other, tmp_path)
    with pytest.raises(ConfigurationError, match="other data: remove it"):
        train("type", Dataset.of(toy_trials(3, 2)), QUICK, tmp_path)
    weights: Weights = {
        name: np.zeros(shape, np.float32) for name, shape in tensor_shapes(12, 3).items()
    }
    with pytest.raises(ConfigurationError, match="other first weights: remove it"):
        train("type", DATA, QUICK, tmp_path, warm=weights)


def test_a_damaged_checkpoint_is_reported(tmp_path: Path) -> None:
    with pytest.raises(StoppedError):
        train("type", DATA, QUICK, tmp_path, report=stop_after(1))
    path = tmp_path / "type.npz"
    held: dict[str, Any] = read_arrays(path)
    content = path.read_bytes()
    damaged = {
        "generator": held["generator"][:-8],
        "history": np.array(1.0),
        "now.readout.bias": np.zeros(4, np.float32),
        "best.readout.bias": np.zeros(4, np.float32),
        "exp_avg.readout.bias": np.zeros(4, np.float32),
        "settings": "{",
    }
    for name, array in damaged.items():
        write_npz(path, **(held | {name: array}))
        with pytest.raises(ConfigurationError, match=r"type.npz is no checkpoint of a training"):
            train("type", DATA, QUICK, tmp_path)
    del held["step.readout.bias"]
    write_npz(path, **held)
    with pytest.raises(ConfigurationError, match="lacks step.readout.bias"):
        train("type", DATA, QUICK, tmp_path)
    middle = len(content) // 2
    flipped = bytes([content[middle] ^ 255])
    for wrong in (content[:-30], b"", content[:middle] + flipped + content[middle + 1 :]):
        path.write_bytes(wrong)
        with pytest.raises(ConfigurationError, match="is no npz file of numbers, or is cut off"):
            train("type", DATA, QUICK, tmp_path)


def test_weights_of_the_other_network_are_no_begin(tmp_path: Path) -> None:
    weights: Weights = {
        name: np.zeros(shape, np.float32)
        for name, shape in tensor_shapes(12, OUTPUTS["location"]).items()
    }
    with pytest.raises(ConfigurationError, match="type is to begin with are of another network"):
        train("type", DATA, QUICK, tmp_path, warm=weights)


def test_a_training_that_diverges_is_reported(tmp_path: Path) -> None:
    data = replace(DATA, length=DATA.length.model_copy(update={"maximum": float("nan")}))
    with pytest.raises(ContactFusionError, match="training of type diverged in epoch 1"):
        train("type", data, QUICK, tmp_path)


@pytest.mark.parametrize("field", ["epochs", "batch", "rate", "stride"])
def test_options_that_make_no_sense_are_reported(field: str) -> None:
    wrong: dict[str, Any] = {field: 0}
    with pytest.raises(ConfigurationError, match=f"{field}: .*greater"):
        Options(**wrong)


def test_a_missing_torch_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "contactfusion_lab.learning.backend")
    with pytest.raises(DependencyError, match=r"torch is not installed.*contactfusion\[learn\]"):
        importlib.import_module("contactfusion_lab.learning.backend")
