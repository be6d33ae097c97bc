"""The picture of an account: it can be drawn of whatever there is, and is the same each time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from contactfusion.explain.explanation import explanation_of
from contactfusion.explain.picture import picture
from tests.clouds import HERE, NULL, SUPPORT, THERE, cloud
from tests.explained import Round, moment, settings

ROW = {(x, y, 0): 0.9 for x in range(6) for y in range(2)}
CASES: dict[str, tuple[list[Round], Sequence[float] | None, dict[str, Any]]] = {
    "contact": ([(0.0, [cloud("skin", 0.0, ROW)])], None, {}),
    "one voxel": ([(0.0, [cloud("skin", 0.0, {HERE: 0.5})])], None, {}),
    "null": (
        [(0.0, [cloud("skin", 0.0, ROW), cloud("free", 0.0, dict.fromkeys(ROW, 1.0), NULL)])],
        None,
        {},
    ),
    "dead": ([(0.0, [cloud("skin", 0.0, {HERE: 0.5})]), (0.7, [])], None, {}),
    "asked": (
        [(0.0, [cloud("skin", 0.0, ROW), cloud("motion", 0.0, {THERE: 0.5}, SUPPORT)])],
        (0.2, 0.0, 0.0),
        {},
    ),
    "set": (
        [(0.0, [cloud("skin", 0.0, ROW), cloud("lidar", 0.0, {HERE: 0.5})])],
        None,
        {"rule": "sets"},
    ),
    "dollar": ([(0.0, [cloud("a$\\frac$", 0.0, ROW), cloud("b$_", 0.0, {THERE: 0.5})])], None, {}),
    "nothing": ([(0.0, [])], None, {}),
}


def drawn(case: str) -> bytes:
    rounds, at, config = CASES[case]
    then = moment(*rounds, **config)
    return picture(explanation_of(then, settings(**config), at), then.step.fusion)


@pytest.mark.parametrize("case", CASES)
def test_every_account_can_be_drawn(case: str) -> None:
    assert drawn(case).startswith(b"\x89PNG")


def test_the_same_picture_is_drawn_twice() -> None:
    assert drawn("contact") == drawn("contact")


def test_pictures_differ_with_what_they_show() -> None:
    pictures = [np.frombuffer(drawn(case), np.uint8).tobytes() for case in CASES]
    assert len(set(pictures)) == len(CASES)
