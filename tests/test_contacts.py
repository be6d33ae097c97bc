"""Contacts: data that nobody changes, and one line for people."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.clouds import HERE, NULL, cloud, fused


def test_a_contact_cannot_be_changed() -> None:
    contact: Any = fused(cloud("skin", 0.0, {HERE: 0.5}, forces=np.ones((1, 3)))).contacts[0]
    with pytest.raises(dataclasses.FrozenInstanceError):
        contact.likelihood = 1.0
    for array in (contact.position, contact.covariance, contact.extent, contact.force):
        assert not array.flags.writeable


def test_a_contact_tells_its_place_its_likelihood_and_who_gave_it_the_greatest_first() -> None:
    contact = fused(
        cloud("camera", 0.0, {HERE: 0.25}),
        cloud("skin", 0.0, {HERE: 0.75}),
        cloud("wrist", 0.0, {}),
        cloud("free", 0.0, {(90, 0, 0): 1.0}, NULL),
    ).contacts[0]
    assert str(contact) == (
        "contact at (0.003, 0.003, 0.003) m in 'base', likelihood 0.81, from skin 75%, camera 25%"
    )
