"""The contact networks at run-time: what torch would say, and what is wrong with a file."""

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from safetensors.numpy import save

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.generators.lstm import dense_shapes, lstm_layer, tensor_shapes
from contactfusion.generators.networks import (
    OUTPUTS,
    SHIPPED,
    ContactNetworks,
    NetworksCard,
    Scale,
    read_networks,
    weights_file,
)
from contactfusion.generators.proximity import ProximityConfig

Tensors = dict[str, NDArray[Any]]


def some_weights(seed: int = 0) -> Tensors:
    rng = np.random.default_rng(seed)
    return {
        f"{network}.{name}": rng.uniform(-0.6, 0.6, shape).astype(np.float32)
        for network, outputs in OUTPUTS.items()
        for name, shape in tensor_shapes(12, outputs).items()
    }


def some_card(content: bytes) -> NetworksCard:
    return NetworksCard(
        proximity=ProximityConfig(),
        window=20,
        rate=10.0,
        length=Scale(minimum=0.001, maximum=0.31),
        lateral=Scale(minimum=-0.25, maximum=0.35),
        sigma={"point": 0.02, "line": 0.03},
        figures={"validation_location_rmse_m": 0.025},
        seeds={"location": 0, "type": 1},
        data="none",
        data_sha256="",
        weights_sha256=hashlib.sha256(content).hexdigest(),
    )


def write(folder: Path, tensors: Tensors) -> Path:
    """Write networks whose card fits; give the path of the weights."""
    content, path = save(tensors), folder / "contact.safetensors"
    path.write_bytes(content)
    path.with_suffix(".json").write_text(some_card(content).model_dump_json())
    return path


def some_window(seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).uniform(0.0, 0.31, (20, 12))


def by_torch(tensors: Tensors, network: str, window: FloatArray) -> FloatArray:
    """Let torch run a network on a scaled window."""
    mine = {
        name.removeprefix(f"{network}."): torch.tensor(tensor)
        for name, tensor in tensors.items() if name.startswith(network)
    }  # fmt: skip
    lstm = torch.nn.LSTM(12, 32, num_layers=2, batch_first=True)
    readout = torch.nn.Linear(32, OUTPUTS[network])
    torch.nn.ModuleDict({"lstm": lstm, "readout": readout}).load_state_dict(mine)
    scaled = torch.tensor((window - 0.001) / (0.31 - 0.001), dtype=torch.float32)
    with torch.no_grad():
        result: FloatArray = readout(lstm(scaled[None])[0][0, -1]).double().numpy()
    return result


# What they say


@pytest.mark.parametrize("seed", range(5))
def test_they_say_what_torch_says(tmp_path: Path, seed: int) -> None:
    tensors, window = some_weights(seed), some_window(seed + 100)
    found = ContactNetworks.load(write(tmp_path, tensors)).perceive(window)
    location = by_torch(tensors, "location", window)[0]
    odds = np.exp(by_torch(tensors, "type", window))
    assert found.lateral == pytest.approx(-0.25 + 0.6 * location, abs=1e-6)
    assert found.probabilities == pytest.approx(odds / odds.sum(), abs=1e-6)


def dense_type(seed: int = 0) -> Tensors:
    """Networks of which the type network has fully connected layers."""
    rng = np.random.default_rng([seed, 1])
    kept = {name: one for name, one in some_weights(seed).items() if not name.startswith("type")}
    return kept | {
        f"type.{name}": rng.uniform(-0.3, 0.3, shape).astype(np.float32)
        for name, shape in dense_shapes(240, 3).items()
    }


@pytest.mark.parametrize("seed", range(3))
def test_fully_connected_layers_say_what_torch_says(tmp_path: Path, seed: int) -> None:
    tensors, window = dense_type(seed), some_window(seed + 100)
    layers = torch.nn.Sequential(
        torch.nn.Flatten(), torch.nn.Linear(240, 32), torch.nn.ReLU(),
        torch.nn.Linear(32, 32), torch.nn.ReLU(), torch.nn.Linear(32, 3),
    )  # fmt: skip
    named = [tensor for name, tensor in tensors.items() if name.startswith("type")]
    layers.load_state_dict(dict(zip(layers.state_dict(), map(torch.tensor, named), strict=True)))
    scaled = torch.tensor((window - 0.001) / (0.31 - 0.001), dtype=torch.float32)
    with torch.no_grad():
        odds = torch.softmax(layers(scaled[None])[0], 0).double().numpy()
    found = ContactNetworks.load(write(tmp_path, tensors)).perceive(window)
    assert found.probabilities == pytest.approx(odds, abs=1e-6)
    assert found.lateral == pytest.approx(
        -0.25 + 0.6 * by_torch(tensors, "location", window)[0], abs=1e-6
    )


def test_a_file_says_which_layers_it_holds_and_lacks_none(tmp_path: Path) -> None:
    tensors = dense_type()
    del tensors["type.dense.1.bias"]
    with pytest.raises(ConfigurationError, match="lacks the tensor type.dense.1.bias"):
        read_networks(write(tmp_path, tensors))


@pytest.mark.parametrize("name", SHIPPED)
def test_networks_of_the_package_are_sound(name: str) -> None:
    card, weights = read_networks(weights_file(name))
    assert card.window == 20
    assert ("dense.0.weight" in weights["type"]) == (name == "paper")


def sigmoid(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x))


def test_a_layer_of_one_unit_is_as_by_hand() -> None:
    inputs, recurrent = np.array([[0.5, -1.0, 2.0, 0.25]]), np.array([[1.0, 0.5, -1.5, 2.0]])
    bias = np.array([0.1, 0.2, -0.3, 0.4])
    first_cell = sigmoid(0.5 * 0.8 + 0.1) * math.tanh(2.0 * 0.8 - 0.3)
    first = sigmoid(0.25 * 0.8 + 0.4) * math.tanh(first_cell)
    keep = sigmoid(-1.0 * -0.6 + 0.5 * first + 0.2)
    let_in = sigmoid(0.5 * -0.6 + 1.0 * first + 0.1)
    cell = keep * first_cell + let_in * math.tanh(2.0 * -0.6 - 1.5 * first - 0.3)
    second = sigmoid(0.25 * -0.6 + 2.0 * first + 0.4) * math.tanh(cell)
    hidden = lstm_layer(np.array([[0.8], [-0.6]]), inputs, recurrent, bias)
    assert hidden[:, 0] == pytest.approx([first, second], abs=1e-15)


def test_extreme_lengths_saturate_and_nothing_else(tmp_path: Path) -> None:
    networks = ContactNetworks.load(write(tmp_path, some_weights()))
    for size in (-1e6, 1e6):
        found = networks.perceive(np.full((20, 12), size))
        assert math.isfinite(found.lateral)
        assert found.probabilities.sum() == pytest.approx(1.0)


def test_far_logits_are_probabilities(tmp_path: Path) -> None:
    tensors = some_weights()
    tensors["type.readout.bias"] = np.array([0.0, 2000.0, -2000.0], np.float32)
    found = ContactNetworks.load(write(tmp_path, tensors)).perceive(some_window())
    assert found.probabilities.tolist() == [0.0, 1.0, 0.0]


def test_the_same_window_gives_the_same_bits(tmp_path: Path) -> None:
    networks = ContactNetworks.load(write(tmp_path, some_weights()))
    one, other = networks.perceive(some_window()), networks.perceive(some_window())
    assert one.lateral == other.lateral
    assert one.probabilities.tobytes() == other.probabilities.tobytes()


def test_the_weights_of_a_file_are_those_that_were_written(tmp_path: Path) -> None:
    tensors = some_weights()
    card, weights = read_networks(write(tmp_path, tensors))
    assert card.proximity == ProximityConfig()
    assert weights["type"]["readout.bias"].tolist() == tensors["type.readout.bias"].tolist()
    assert sum(map(len, weights.values())) == len(tensors)


@pytest.mark.parametrize("shape", [(19, 12), (20, 11), (12, 20), (240,)])
def test_windows_of_another_shape_are_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    networks = ContactNetworks.load(write(tmp_path, some_weights()))
    with pytest.raises(InvalidReadingError, match=r"not \(20, 12\)"):
        networks.perceive(np.zeros(shape))


def test_windows_with_nan_are_refused(tmp_path: Path) -> None:
    window = some_window()
    window[7, 3] = np.nan
    networks = ContactNetworks.load(write(tmp_path, some_weights()))
    with pytest.raises(InvalidReadingError, match="row 7 of the proximity lengths"):
        networks.perceive(window)


# What is wrong with a file


def refused(path: Path, what: str) -> None:
    with pytest.raises(ConfigurationError, match=what) as error:
        ContactNetworks.load(path)
    assert path.stem in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_files_are_told(tmp_path: Path) -> None:
    path = write(tmp_path, some_weights())
    refused(tmp_path / "contcat.safetensors", "did you mean 'contact.safetensors'")
    path.with_suffix(".json").unlink()
    refused(path, "there is no file 'contact.json'")


@pytest.mark.parametrize("length", [0, 5, 100, -40])
def test_weights_that_are_cut_off_are_told(tmp_path: Path, length: int) -> None:
    path = write(tmp_path, some_weights())
    path.write_bytes(path.read_bytes()[:length])
    refused(path, "is no safetensors file, or is cut off")


def test_other_weights_than_the_card_tells_of_are_told(tmp_path: Path) -> None:
    path = write(tmp_path, some_weights(0))
    path.write_bytes(save(some_weights(1)))
    refused(path, "holds other weights than its card names")


def changed(name: str, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Tensors:
    tensors = some_weights()
    return tensors | {name: change(tensors[name])}


def test_tensors_of_another_shape_are_told(tmp_path: Path) -> None:
    name = "location.lstm.weight_ih_l0"
    path = write(tmp_path, changed(name, lambda tensor: np.ascontiguousarray(tensor[:, :11])))
    refused(path, rf"tensor {name} has shape \(128, 11\), not \(128, 12\)")


def test_missing_tensors_are_told(tmp_path: Path) -> None:
    tensors = some_weights()
    del tensors["type.readout.bias"]
    refused(write(tmp_path, tensors), "lacks the tensor type.readout.bias; did you mean")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_no_numbers_are_told(tmp_path: Path, value: float) -> None:
    name = "type.lstm.bias_hh_l1"
    path = write(tmp_path, changed(name, lambda tensor: np.full_like(tensor, value)))
    refused(path, f"tensor {name} holds weights that are not finite")


@pytest.mark.parametrize("text", ["", "{", "[1]", "3", "\x00\xff", "["])
@pytest.mark.parametrize("times", [1, 100_000])
def test_a_card_that_is_none_is_told(tmp_path: Path, text: str, times: int) -> None:
    path = write(tmp_path, some_weights())
    path.with_suffix(".json").write_text(text * times, encoding="latin-1")
    refused(path, "is no JSON text, or is cut off|holds no card")


@pytest.mark.parametrize(
    ("field", "value", "what"),
    [
        ("sigma", {"point": 0.02}, "contact.json: sigma: needs a value for point and for line"),
        ("sigma", {"point": -1.0, "line": 0.1}, "contact.json: sigma.point"),
        ("length", {"minimum": 1.0, "maximum": 1.0}, "length.maximum: is not above the minimum"),
        ("kinds", ["none", "line", "point"], "contact.json: kinds"),
        ("windw", 20, "did you mean 'window'"),
        ("window", 0, "contact.json: window"),
    ],
)
def test_a_card_that_holds_nonsense_is_told(
    tmp_path: Path, field: str, value: object, what: str
) -> None:
    path = write(tmp_path, some_weights())
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps({**card, field: value}))
    refused(path, what)


def test_a_card_that_lacks_a_field_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, some_weights())
    card = json.loads(path.with_suffix(".json").read_text())
    del card["lateral"]
    path.with_suffix(".json").write_text(json.dumps(card))
    refused(path, "contact.json: lateral: this field is required")


def test_strips_that_the_weights_do_not_know_are_told(tmp_path: Path) -> None:
    path = write(tmp_path, some_weights())
    card = json.loads(path.with_suffix(".json").read_text())
    card["proximity"]["cell"] = [0.02, 0.1]
    path.with_suffix(".json").write_text(json.dumps(card))
    refused(path, r"weight_ih_l0 has shape \(128, 12\), not \(128, 6\)")


def test_an_unknown_name_is_told_with_those_of_the_package() -> None:
    with pytest.raises(
        ConfigurationError, match="unknown networks 'papre'; did you mean 'paper'.*safetensors"
    ):
        weights_file("papre")
