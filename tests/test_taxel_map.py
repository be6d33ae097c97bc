"""Locations learned from presses: right, honest, and refused where they cannot be."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, Pipeline, PipelineConfig, State
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.files import write_npz
from contactfusion.generators.taxel_map import TaxelMap, TaxelMapConfig, TaxelMapGenerator
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import TactileImage

CENTRES = np.array([[x, y] for x in (0.0, 0.01, 0.02) for y in (0.0, 0.01, 0.02)])
WIDTH = 0.01
NOISE = 8.0
"""Of each channel; a press gives some hundreds."""


def signals(places: FloatArray, depths: FloatArray, noise: float = NOISE) -> FloatArray:
    """What nine channels with overlapping fields read; deeper presses read more."""
    squared = np.square(places[:, None, :2] - CENTRES).sum(axis=2)
    exact = 400.0 * depths[:, None] * np.exp(-0.5 * squared / WIDTH**2)
    read: FloatArray = exact + noise * np.random.default_rng(5).normal(size=exact.shape)
    return read


def presses(step: float = 0.001, noise: float = NOISE) -> tuple[FloatArray, FloatArray]:
    """Three depths at every point of a grid over 2 × 2 cm."""
    along = np.arange(0.0, 0.0205, step)
    x, y = (axis.ravel() for axis in np.meshgrid(along, along))
    places = np.repeat(np.stack([x, y, 0.0 * x], axis=1), 3, axis=0)
    return signals(places, np.tile([0.5, 1.0, 2.0], len(x)), noise), places


@pytest.fixture(scope="module")
def learned() -> TaxelMap:
    return TaxelMap.fit(*presses())


def elsewhere(count: int = 400) -> tuple[FloatArray, FloatArray]:
    """Presses between the points of the grid, at other depths."""
    rng = np.random.default_rng(6)
    places = np.concatenate([rng.uniform(0.0, 0.02, (count, 2)), np.zeros((count, 1))], axis=1)
    return signals(places, rng.uniform(0.5, 2.0, count)), places


def generator(folder: Path, learned: TaxelMap, **options: Any) -> TaxelMapGenerator:
    learned.save(folder / "map.npz")
    config = TaxelMapConfig(**{"map": folder / "map.npz", "min_signal": 60.0, **options})
    return TaxelMapGenerator("pad", config)


def image(values: FloatArray) -> TactileImage:
    return TactileImage(stamp=0.0, frame="pad", values=values)


def felt(pad: TaxelMapGenerator, values: FloatArray) -> HypothesisCloud:
    (cloud,) = pad.generate(image(values), State(now=0.0, grid=Grid("pad", 0.0005)))
    return cloud


def test_exact_presses_are_found_between_the_places_that_were_learned() -> None:
    learned = TaxelMap.fit(*presses(noise=0.0))
    rng = np.random.default_rng(7)
    places = np.concatenate([rng.uniform(0.001, 0.019, (100, 2)), np.zeros((100, 1))], axis=1)
    found = [learned.locate(s) for s in signals(places, np.ones(100), noise=0.0)]
    assert np.linalg.norm(np.array(found) - places, axis=1).max() < 2e-4


def test_the_depth_of_a_press_does_not_move_it(learned: TaxelMap) -> None:
    place = np.array([[0.0123, 0.0071, 0.0]])
    light, deep = (signals(place, np.array([depth]), noise=0.0)[0] for depth in (0.4, 3.0))
    np.testing.assert_allclose(learned.locate(light), learned.locate(deep), atol=1e-12)


def test_its_sigma_is_honest_on_places_that_it_never_saw(learned: TaxelMap) -> None:
    given, places = elsewhere()
    offsets = np.array([learned.locate(signal) for signal in given]) - places
    within = np.abs(offsets[:, :2]) / learned.sigma
    # Never too small; too large only by presses at the rim, which it must find from inside.
    assert 0.683 <= (within <= 1.0).mean() <= 0.9
    assert 0.954 <= (within <= 2.0).mean() <= 0.999
    assert not offsets[:, 2].any()


def test_its_sigma_is_that_of_every_place_left_out_with_all_its_presses(learned: TaxelMap) -> None:
    given, places = presses()
    squares = []
    for place in np.unique(places, axis=0):
        here = (places == place).all(axis=1)
        rest = TaxelMap(given[~here], places[~here])
        squares += [np.square(rest.locate(s) - place)[:2] for s in given[here]]
    assert learned.sigma == pytest.approx(np.sqrt(np.mean(squares)), rel=0.1)


def test_its_sigma_grows_with_the_noise_and_with_gaps_between_the_presses() -> None:
    sigma = {
        (step, noise): TaxelMap.fit(*presses(step, noise)).sigma
        for step, noise in ((0.001, 0.0), (0.002, 0.0), (0.002, 8.0))
    }
    assert sigma[0.001, 0.0] < sigma[0.002, 0.0] < sigma[0.002, 8.0]


def test_its_sigma_is_by_axis_of_those_that_the_places_span() -> None:
    x = np.linspace(0.0, 0.02, 21)
    line = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    given = signals(np.repeat(line, 3, axis=0), np.tile([0.5, 1.0, 2.0], 21))
    learned = TaxelMap.fit(given, np.repeat(line, 3, axis=0), neighbours=12)
    offsets = np.array([learned.locate(signal) for signal in given]) - np.repeat(line, 3, axis=0)
    assert 0.0 < learned.sigma
    assert np.abs(offsets[:, 0]).max() < 6.0 * learned.sigma


def test_a_location_never_leaves_the_bounds_of_its_neighbours(learned: TaxelMap) -> None:
    rng = np.random.default_rng(8)
    found = np.array([learned.locate(rng.normal(size=9)) for _ in range(100)])
    assert found.min() >= 0.0 and found.max() <= 0.02 + 1e-12


def test_the_generator_gives_one_place_with_its_sigma(tmp_path: Path, learned: TaxelMap) -> None:
    cloud = felt(generator(tmp_path, learned, p_max=0.8), elsewhere(1)[0][0])
    assert cloud.single and len(cloud) == 1
    assert cloud.likelihoods.tolist() == [0.8]
    assert cloud.spreads is not None and cloud.spreads.tolist() == [learned.sigma]
    assert cloud.frame == "pad"


@pytest.mark.parametrize("baseline", [7.0, tuple(range(9))])
def test_the_untouched_value_is_taken_off(tmp_path: Path, learned: TaxelMap, baseline: Any) -> None:
    pad = generator(tmp_path, learned, baseline=baseline)
    signal = elsewhere(1)[0][0]
    cloud = felt(pad, signal + np.asarray(baseline))
    np.testing.assert_allclose(cloud.positions[0], learned.locate(signal), atol=1e-9)
    assert not len(felt(pad, np.broadcast_to(np.asarray(baseline, np.float64), 9)))


def test_without_a_signal_it_looked_and_found_nothing(tmp_path: Path, learned: TaxelMap) -> None:
    pad, signal = generator(tmp_path, learned), elsewhere(1)[0][0]
    signal = signal / np.linalg.norm(signal)
    assert not len(felt(pad, np.zeros(9)))
    assert not len(felt(pad, 59.9 * signal))
    assert len(felt(pad, 60.1 * signal))


def test_another_number_of_channels_is_refused(tmp_path: Path, learned: TaxelMap) -> None:
    with pytest.raises(InvalidReadingError, match="8 channels, but the map of 'pad' has 9"):
        felt(generator(tmp_path, learned), np.ones(8))
    with pytest.raises(ConfigurationError, match="baseline: 2 numbers, but the map has 9 channels"):
        generator(tmp_path, learned, baseline=(1.0, 2.0))


def test_a_missing_map_is_named_with_its_generator_and_folder(tmp_path: Path) -> None:
    pad = {"type": "taxel_map", "map": "map.npz", "min_signal": 1.0}
    with pytest.raises(ConfigurationError, match=f"generators.pad: .*'map.npz' in {tmp_path}"):
        Pipeline(PipelineConfig(generators={"pad": pad}, folder=tmp_path))


@pytest.mark.parametrize("absolute", [False, True])
def test_a_relative_name_starts_at_the_folder_of_the_configuration(
    tmp_path: Path, learned: TaxelMap, absolute: bool
) -> None:
    learned.save(tmp_path / "maps" / "pad.npz")
    file = tmp_path / "maps" / "pad.npz" if absolute else "maps/pad.npz"
    config: dict[str, Any] = {
        "generators": {"pad": {"type": "taxel_map", "map": file, "min_signal": 60.0}},
        "integrator": {"frame": "pad", "voxel_size": 0.0005},
        "folder": tmp_path,
    }
    pipe = Pipeline(PipelineConfig(**config))
    given, places = elsewhere(5)
    for stamp, (signal, place) in enumerate(zip(given, places, strict=True)):
        pipe.receive(TactileImage(stamp=float(stamp), frame="pad", values=signal))
        (contact,) = pipe.step(float(stamp)).fusion.contacts
        assert contact.position[:2] == pytest.approx(place[:2], abs=0.0015)


def test_a_map_comes_back_bit_for_bit(tmp_path: Path, learned: TaxelMap) -> None:
    learned.save(tmp_path / "pad.map")
    again = TaxelMap.load(tmp_path / "pad.map")
    assert again.signals.tobytes() == learned.signals.tobytes()
    assert again.places.tobytes() == learned.places.tobytes()
    assert (again.neighbours, again.sigma) == (learned.neighbours, learned.sigma)
    signal = elsewhere(1)[0][0]
    assert again.locate(signal).tobytes() == learned.locate(signal).tobytes()


ONES = np.ones((4, 2))
PLACES = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize(
    ("signals", "places", "problem"),
    [
        (ONES, PLACES[:3], r"places of a map have shape \(3, 3\), not \(4, 3\)"),
        (ONES * [[1.0], [0.0], [1.0], [1.0]], PLACES, "a press of a taxel map has no signal"),
        (ONES * [[1.0], [np.nan], [1.0], [1.0]], PLACES, "row 1 of the signals of a map"),
        (ONES, np.zeros((4, 3)), "needs presses at two places or more"),
        (np.empty((0, 2)), np.empty((0, 3)), "needs presses"),
    ],
)
def test_presses_that_teach_nothing_are_refused(
    signals: FloatArray, places: FloatArray, problem: str
) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        TaxelMap.fit(signals, places)


def test_a_file_that_is_no_map_is_refused(tmp_path: Path) -> None:
    write_npz(tmp_path / "map.npz", signals=ONES, places=PLACES)
    with pytest.raises(ConfigurationError, match="lacks neighbours and sigma; it holds signals"):
        TaxelMap.load(tmp_path / "map.npz")
    write_npz(tmp_path / "map.npz", signals=ONES, places=PLACES, neighbours=3, sigma=-1.0)
    with pytest.raises(ConfigurationError, match="needs presses, neighbours and a sigma"):
        TaxelMap.load(tmp_path / "map.npz")


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"neighbours": [3, 4]}, "neighbours and sigma are not a number each"),
        ({"neighbours": np.nan}, "neighbours and sigma are not a number each"),
        ({"neighbours": np.inf}, "neighbours and sigma are not a number each"),
        ({"sigma": [0.1, 0.2]}, "neighbours and sigma are not a number each"),
        ({"sigma": "x"}, "sigma holds <U1, not real numbers"),
        ({"signals": ONES * (1.0 + 1.0j)}, "signals holds complex128, not real numbers"),
    ],
)
def test_a_map_of_other_than_numbers_is_refused(
    tmp_path: Path, changes: dict[str, Any], problem: str
) -> None:
    sound = {"signals": ONES, "places": PLACES, "neighbours": 3, "sigma": 0.001}
    write_npz(tmp_path / "map.npz", **{**sound, **changes})
    with pytest.raises(ConfigurationError, match=rf"map\.npz: {problem}"):
        TaxelMap.load(tmp_path / "map.npz")
