"""What a generator or controller may know."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, State
from tests.clouds import HERE, NULL, SUPPORT, THERE, centres, cloud, fused


def test_before_the_first_step_there_are_no_contacts_and_no_evidence() -> None:
    state = State(now=0.0, grid=Grid("base", 0.005))
    assert state.contacts == ()
    assert state.evidence(without="skin").shape == (0, 3)


def test_the_contacts_are_those_of_the_last_step() -> None:
    fusion = fused(cloud("skin", 0.0, {HERE: 0.5}))
    assert State(now=0.0, grid=Grid("base", 0.005), fusion=fusion).contacts == fusion.contacts


def test_evidence_is_what_sensors_of_other_generators_gave() -> None:
    fusion = fused(
        cloud("skin", 0.0, {HERE: 0.5}),
        cloud("skin/back", 0.0, {(1, 0, 0): 0.5}),
        cloud("skin/free", 0.0, {(2, 0, 0): 1.0}, NULL),
        cloud("skinny", 0.0, {THERE: 0.02}),
        cloud("motion", 0.0, {(3, 0, 0): 0.9}, SUPPORT),
    )
    state = State(now=0.0, grid=Grid("base", 0.005), fusion=fusion)
    assert np.array_equal(state.evidence(without="skin"), centres([THERE]))
    assert np.array_equal(state.evidence(without="skinny"), centres([HERE, (1, 0, 0)]))


def test_evidence_that_was_nulled_is_evidence_still() -> None:
    fusion = fused(cloud("skin", 0.0, {HERE: 0.5}), cloud("free", 0.0, {HERE: 1.0}, NULL))
    state = State(now=0.0, grid=Grid("base", 0.005), fusion=fusion)
    assert np.array_equal(state.evidence(without="free"), centres([HERE]))


def test_a_state_cannot_be_changed() -> None:
    state: Any = State(now=0.0, grid=Grid("base", 0.005))
    with pytest.raises(dataclasses.FrozenInstanceError):
        state.now = 1.0
