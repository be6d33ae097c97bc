"""What each source is worth: steps fused again without it, counted in bounded memory."""

import csv
import gc
import io
import json
import math
import weakref
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from contactfusion.errors import ContactFusionError
from contactfusion.explain.ablation import (
    CAUTION,
    Quantiles,
    Worth,
    ablated,
    as_csv,
    as_json,
    picture,
    table,
    write_ablation,
    write_picture,
)
from contactfusion.explain.counterfactual import paired
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline import Step
from tests.clouds import HERE, NULL, REGULAR, SUPPORT, THERE, cloud, fused
from tests.explained import stepped

PLUGS = {"lidar": REGULAR, "skin": REGULAR, "skin/free": NULL}


def worth(name: str, whole: bool = True, rounds: int = 1) -> Worth:
    """The worth of a source where the skin and its free space rule the LiDAR out elsewhere."""
    clouds = [
        (
            0.1 * n,
            [
                cloud("lidar", 0.1 * n, {(1, 0, 0): 0.5, THERE: 0.5}),
                cloud("skin", 0.1 * n, {HERE: 0.5}),
                cloud("skin/free", 0.1 * n, {THERE: 1.0}, NULL),
            ],
        )
        for n in range(rounds)
    ]
    found = {(one.name, one.whole): one for one in ablated(stepped(*clouds, plugs=PLUGS))}
    return found[name, whole]


def test_a_contact_that_one_source_gives_moves_without_the_other() -> None:
    lidar = worth("lidar")
    assert (lidar.contacts, lidar.lost, lidar.gained) == (1, 0, 0)
    assert lidar.moved_median == lidar.moved_p95 == pytest.approx(0.0025, abs=5e-5)
    assert lidar.share == pytest.approx(0.5)


def test_a_null_source_that_is_left_out_gains_a_contact() -> None:
    free = worth("skin/free", whole=False)
    assert (free.lost, free.gained) == (0, 1)
    assert free.share == 0.0 and free.likelihood_change == 0.0


def test_a_generator_is_left_out_with_all_its_sources() -> None:
    skin, alone = worth("skin"), worth("skin", whole=False)
    assert (skin.lost, skin.gained) == (0, 1)
    assert (alone.lost, alone.gained) == (0, 0)


def test_what_is_gone_without_a_source_is_lost_with_its_steps() -> None:
    rounds = [(0.1 * n, [cloud("skin", 0.1 * n, {HERE: 0.5} if n % 2 else {})]) for n in range(10)]
    (skin,) = ablated(stepped(*rounds, plugs={"skin": REGULAR}))
    assert (skin.steps, skin.steps_with, skin.steps_without) == (10, 5, 0)
    assert (skin.contacts, skin.lost) == (5, 5)
    assert math.isnan(skin.moved_median) and math.isnan(skin.likelihood_change)


def test_the_likelihood_falls_by_what_a_source_adds() -> None:
    clouds = [cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {HERE: 0.5})]
    for one in ablated(stepped((0.0, clouds), plugs={"a": REGULAR, "b": REGULAR})):
        assert one.likelihood_change == pytest.approx(-0.25)


def test_a_source_without_a_word_is_worth_nothing() -> None:
    rounds = (0.0, [cloud("skin", 0.0, {HERE: 0.5})])
    motion, _ = ablated(stepped(rounds, plugs={"motion": SUPPORT, "skin": REGULAR}))
    assert (motion.name, motion.lost, motion.gained, motion.moved_p95) == ("motion", 0, 0, 0.0)


def test_steps_are_not_kept() -> None:
    kept: list[weakref.ref[Fusion]] = []

    def steps() -> Iterator[Step]:
        for step in stepped(*((0.01 * n, []) for n in range(8)), plugs=PLUGS):
            gc.collect()
            assert sum(one() is not None for one in kept) <= 2
            kept.append(weakref.ref(step.fusion))
            yield step

    ablated(steps())
    assert len(kept) == 8


# Pairs and quantiles


def test_contacts_are_paired_with_the_nearest_once_each() -> None:
    before = fused(cloud("a", 0.0, {(0, 0, 0): 0.5, (10, 0, 0): 0.5})).contacts
    after = fused(cloud("a", 0.0, {(1, 0, 0): 0.5, (40, 0, 0): 0.5})).contacts
    ((one, other, away),) = paired(before, after, 0.005)
    assert (one, other) == (0, 0) and away == pytest.approx(0.005)
    assert paired(before, (), 0.005) == paired((), after, 0.005) == []


@pytest.mark.parametrize("share", [0.5, 0.95, 1.0])
def test_quantiles_are_those_of_the_values_to_half_a_step(share: float) -> None:
    values, counted = np.random.default_rng(1).uniform(0.0, 1.0, 999), Quantiles(0.001, 2.0)
    for value in values:
        counted.add(value)
    expected = np.quantile(values, share, method="inverted_cdf")
    assert counted.at(share) == pytest.approx(expected, abs=0.0005001)


def test_quantiles_know_no_value_and_no_end() -> None:
    counted = Quantiles(0.001, 2.0)
    assert math.isnan(counted.at(0.5))
    counted.add(7.0)
    assert counted.at(0.5) == pytest.approx(2.0)


# What is written


def worths() -> list[Worth]:
    clouds = [
        cloud("lidar", 0.0, {HERE: 0.5}),
        cloud("skin", 0.0, {HERE: 0.5}),
        cloud("skin/free", 0.0, {THERE: 0.5}, NULL),
    ]
    return ablated(stepped((0.0, clouds), plugs=PLUGS))


def test_the_table_indents_the_sources_of_a_generator_and_says_what_it_is_not() -> None:
    head, *rows, _, caution = table(worths()).split("\n")
    assert head.split()[:3] == ["without", "lost", "gained"]
    assert [row.split("  ")[0] or row.split()[0] for row in rows] == [
        "lidar",
        "skin (all)",
        "skin",
        "skin/free",
    ]
    assert caution == CAUTION


def test_the_name_of_a_source_ends_no_row_of_the_table() -> None:
    clouds = [cloud("skin\n0", 0.0, {HERE: 0.5})]
    told = table(ablated(stepped((0.0, clouds), plugs={"skin\n0": REGULAR})))
    assert told.count("\n") == 3, told


def test_the_csv_has_a_row_each_and_the_json_the_same() -> None:
    rows = list(csv.DictReader(io.StringIO(as_csv(worths()))))
    assert [(row["name"], row["whole"]) for row in rows] == [
        ("lidar", "True"),
        ("skin", "True"),
        ("skin", "False"),
        ("skin/free", "False"),
    ]
    held = json.loads(as_json(worths()))
    assert [one["lost"] for one in held["without"]] == [int(row["lost"]) for row in rows]


def test_what_is_no_number_is_left_empty() -> None:
    rounds = (0.0, [cloud("skin", 0.0, {HERE: 0.5})])
    alone = ablated(stepped(rounds, plugs={"skin": REGULAR}))
    (row,) = csv.DictReader(io.StringIO(as_csv(alone)))
    assert row["moved_median"] == row["likelihood_change"] == ""
    assert json.loads(as_json(alone))["without"][0]["moved_p95"] is None


def test_files_are_written_and_the_same_each_time(tmp_path: Path) -> None:
    written = write_ablation(worths(), tmp_path / "out")
    assert [path.name for path in written] == ["ablation.csv", "ablation.json"]
    first = [path.read_bytes() for path in written]
    assert first == [path.read_bytes() for path in write_ablation(worths(), tmp_path / "out")]
    drawn = write_picture(worths(), tmp_path / "out")
    assert drawn.name == "ablation.png" and drawn.read_bytes() == picture(worths())
    assert picture(worths()).startswith(b"\x89PNG")


def test_nothing_to_tell_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ContactFusionError, match="no step with a source"):
        write_ablation(ablated([]), tmp_path)
