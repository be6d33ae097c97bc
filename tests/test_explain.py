"""Why a contact was reported, and what would be without each source."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from contactfusion import HypothesisCloud, Pipeline, PipelineConfig, Wrench
from contactfusion.errors import TimeError
from contactfusion.explain.text import explain_fusion, explain_moment
from tests.clouds import HERE, NULL, SUPPORT, THERE, cloud, fused


def lines(*clouds: HypothesisCloud, **config: Any) -> list[str]:
    return explain_fusion(fused(*clouds, **{"rule": "de_morgan", **config})).split("\n")


def test_nothing_is_explained_in_two_words() -> None:
    assert lines() == ["no contact"]
    assert lines(cloud("a", 0.0, {})) == ["no contact"]


def test_a_contact_of_one_source_is_gone_without_it_and_silent_sources_have_no_line() -> None:
    contact, without = lines(cloud("skin", 0.0, {HERE: 0.5}), cloud("wrist", 0.0, {}))
    assert contact.startswith("contact at (0.003, 0.003, 0.003) m in 'base', likelihood 0.50")
    assert without == "  without skin: no contact remains"


def test_what_remains_without_a_source_is_told_with_its_distance() -> None:
    told = lines(cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {HERE: 0.25, (1, 0, 0): 0.25}))
    assert told[1:] == [
        "  without a: likelihood 0.25, 1.1 mm from where it is now",
        "  without b: likelihood 0.50, 1.4 mm from where it is now",
    ]


def test_a_contact_elsewhere_does_not_count_as_the_one_that_remains() -> None:
    told = lines(cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {THERE: 0.25}))
    assert told[1] == "  without a: no contact remains here; the nearest is 20.0 cm away"


def test_support_has_its_line_and_null_has_none() -> None:
    told = lines(
        cloud("skin", 0.0, {HERE: 0.0625}),
        cloud("motion", 0.0, {HERE: 0.5}, SUPPORT),
        cloud("free", 0.0, {(9, 0, 0): 1.0}, NULL),
    )
    assert told[1:3] == [
        "  without motion: no contact remains",
        "  without skin: no contact remains",
    ]


def test_the_other_voxels_are_counted_by_reason() -> None:
    told = lines(
        cloud("a", 0.0, {HERE: 0.05, (1, 0, 0): 0.05}),
        cloud("b", 0.0, {THERE: 0.5}, SUPPORT),
        cloud("c", 0.0, {(90, 0, 0): 0.5}, NULL),
    )
    assert told == [
        "no contact",
        "other voxels: 2 too unlikely, 1 predicted, but no sensor felt them, 1 ruled out",
    ]


def test_remarks_of_sources_are_told() -> None:
    assert lines(cloud("skin", 0.0, {}, notes=("saturated",))) == [
        "no contact",
        "skin remarks: saturated",
    ]


def test_explaining_changes_nothing() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {HERE: 0.5, THERE: 0.25}))
    assert explain_fusion(fusion) == explain_fusion(fusion)


def wrenches() -> Iterator[Wrench]:
    """A second of readings of a wrist; it is pushed in the second half."""
    for stamp in np.arange(0.0, 1.0, 0.1):
        force = np.array([0.0, 0.0, -10.0 * (stamp >= 0.5)])
        yield Wrench(stamp=stamp, frame="wrist", sensor="wrist", force=force, torque=np.zeros(3))


def pushed() -> Pipeline:
    sphere = {"frame": "wrist", "shapes": [{"shape": "sphere", "radius": 0.05}]}
    wrist = {"type": "force_torque", "sensor": "wrist", "sign": "on_robot"}
    options: dict[str, Any] = {
        "generators": {"wrist": wrist},
        "surface": sphere,
        "integrator": {"frame": "wrist"},
        "cycle": {"on": "wrist"},
    }
    return Pipeline(PipelineConfig(**options))


def test_a_moment_of_readings_is_explained() -> None:
    before = explain_moment(pushed(), wrenches(), 0.45).split("\n")
    assert before[0].startswith("0.400 s: no contact in 'wrist' (sets, members")
    during = explain_moment(pushed(), wrenches(), 0.75).split("\n")
    assert during[0].startswith("0.700 s: 1 contact in 'wrist'")
    assert any(line.startswith("  wrist (evidence): ") for line in during)


def test_a_moment_after_the_readings_cannot_be_explained() -> None:
    with pytest.raises(TimeError, match=r"there is nothing at 2 s: .* from 0 s to 0\.9 s"):
        explain_moment(pushed(), wrenches(), 2.0)
