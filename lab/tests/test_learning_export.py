"""What training leaves behind: networks that the run-time reads, and pictures of learning."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.generators.networks import ContactNetworks, NetworksCard, read_networks
from contactfusion.generators.proximity import BoxConfig, ProximityConfig
from contactfusion_lab.learning.cpm import draw_curves
from contactfusion_lab.learning.dataset import Dataset
from contactfusion_lab.learning.export import write_networks
from contactfusion_lab.learning.networks import predict
from contactfusion_lab.learning.training import Options, Trained, train
from lab.tests.learning_toys import toy_trials

DATA = Dataset.of(toy_trials(6, 4))


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trained, Trained]:
    folder, options = tmp_path_factory.mktemp("checkpoints"), Options(epochs=2, batch=64, seed=3)
    location = train("location", DATA, options, folder)
    return location, train("type", DATA, options.model_copy(update={"seed": 4}), folder)


def ship(path: Path, trained: tuple[Trained, Trained], data: Dataset = DATA) -> NetworksCard:
    return write_networks(path, *trained, data, ProximityConfig(), 10.0, "toys", {"other": 1.5})


def test_the_run_time_says_what_was_trained(
    tmp_path: Path, trained: tuple[Trained, Trained]
) -> None:
    path = tmp_path / "out" / "contact.safetensors"
    card = ship(path, trained)
    networks = ContactNetworks.load(path)
    assert networks.card == card
    location = predict("location", trained[0].weights, DATA.validation, DATA.length)[:, 0]
    logits = predict("type", trained[1].weights, DATA.validation, DATA.length)
    odds = np.exp(logits)
    for row in (0, 7, 100):
        found = networks.perceive(DATA.validation.gather(np.array([row]))[0])
        assert found.lateral == pytest.approx(DATA.lateral.unscaled(location[row]), abs=1e-6)
        assert found.probabilities == pytest.approx(odds[row] / odds[row].sum(), abs=1e-6)


def test_the_card_states_what_is_true(tmp_path: Path, trained: tuple[Trained, Trained]) -> None:
    card = ship(tmp_path / "contact.safetensors", trained)
    networks, windows = ContactNetworks.load(tmp_path / "contact.safetensors"), DATA.validation
    found = [networks.perceive(window) for window in windows.gather(np.arange(len(windows)))]
    errors = np.array([each.lateral for each in found]) - windows.lateral
    for row, kind in ((1, "point"), (2, "line")):
        here = errors[windows.kind == row]
        assert card.sigma[kind] == pytest.approx(np.sqrt(np.mean(here**2)), rel=1e-5)
    right = np.mean([each.probabilities.argmax() for each in found] == windows.kind)
    assert card.figures == {
        "validation_location_rmse_m": pytest.approx(np.sqrt(np.nanmean(errors**2)), rel=1e-5),
        "validation_type_accuracy": pytest.approx(right),
        "other": 1.5,
    }
    assert card.seeds == {"location": 3, "type": 4}
    assert (card.data, card.data_sha256) == ("toys", DATA.sha256)
    assert (card.length, card.lateral) == (DATA.length, DATA.lateral)


def test_the_card_is_text_for_people(tmp_path: Path, trained: tuple[Trained, Trained]) -> None:
    ship(tmp_path / "contact.safetensors", trained)
    text = (tmp_path / "contact.json").read_text()
    assert text.count("\n") > 20
    assert json.loads(text)["kinds"] == ["none", "point", "line"]


def test_the_same_networks_give_the_same_files(
    tmp_path: Path, trained: tuple[Trained, Trained]
) -> None:
    for folder in ("one", "other"):
        ship(tmp_path / folder / "contact.safetensors", trained)
    for name in ("contact.safetensors", "contact.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


def test_a_training_can_begin_with_what_was_shipped(
    tmp_path: Path, trained: tuple[Trained, Trained]
) -> None:
    ship(tmp_path / "contact.safetensors", trained)
    _, weights = read_networks(tmp_path / "contact.safetensors")
    assert all(np.array_equal(weights["type"][name], array)
               for name, array in trained[1].weights.items())  # fmt: skip
    again = train("type", DATA, Options(epochs=1), tmp_path, warm=weights["type"])
    assert again.history[0, 0] < trained[1].history[0, 0]


def test_what_cannot_be_shipped_is_reported(
    tmp_path: Path, trained: tuple[Trained, Trained]
) -> None:
    path = tmp_path / "contact.safetensors"
    kinds = np.minimum(DATA.validation.kind, 1)
    pointed = replace(DATA, validation=replace(DATA.validation, kind=kinds))
    with pytest.raises(ConfigurationError, match="no cycle of the validation trials has line"):
        ship(path, trained, pointed)
    wide = ProximityConfig(region=BoxConfig(x=(0.3, 0.62), y=(-0.4, 0.4), z=(-0.4, 0.5)))
    with pytest.raises(ConfigurationError, match="have 12 proximity lengths, the cells give 16"):
        write_networks(path, *trained, DATA, wide, 10.0, "toys")
    assert not list(tmp_path.iterdir())


def test_learning_curves_are_drawn(tmp_path: Path) -> None:
    falling = np.geomspace(1.0, 0.1, 30)[:, None] * [1.0, 1.2]
    path = draw_curves(
        {"location": [falling, falling / 2.0], "type": [falling]}, tmp_path / "c.png"
    )
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 10_000
