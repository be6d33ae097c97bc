"""The bumper keeps the contract, and its clouds hold the right probabilities."""

import numpy as np
import pytest
from contactfusion_bumper import BumperConfig, BumperGenerator

from contactfusion import Grid, State, Switch, check_generator

STATE = State(now=0.0, grid=Grid("base", 0.005))


def test_it_keeps_the_contract() -> None:
    """The conformance kit finds no fault."""
    check_generator(BumperGenerator)
    check_generator(BumperGenerator, config=BumperConfig(probability=0.9, spacing=0.001))


def test_a_closed_switch_spreads_its_probability_over_the_face() -> None:
    """The sum is P(contact), the positions lie on the face."""
    bumper = BumperGenerator("front", BumperConfig(centre=(0.3, 0.0, 0.1), probability=0.8))
    (cloud,) = bumper.generate(Switch(stamp=0.0, frame="base", closed=True), STATE)
    assert cloud.single
    assert cloud.likelihoods.sum() == pytest.approx(0.8)
    assert np.ptp(cloud.likelihoods) == 0.0
    assert cloud.positions.mean(axis=0) == pytest.approx([0.3, 0.0, 0.1])
    assert (abs(cloud.positions - [0.3, 0.0, 0.1]) <= [0.0, 0.1, 0.05]).all()


def test_an_open_switch_has_looked_and_found_nothing() -> None:
    """The cloud is empty, not missing."""
    bumper = BumperGenerator("front", BumperConfig())
    (cloud,) = bumper.generate(Switch(stamp=0.0, frame="base", closed=False), STATE)
    assert len(cloud) == 0
