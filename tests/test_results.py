"""Contacts as rows of a table."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contactfusion.results import COLUMNS, contact_rows
from tests.clouds import HERE, cloud, fused


def row_of(*clouds: Any, **config: Any) -> dict[str, Any]:
    step: Any = SimpleNamespace(stamp=0.5, fusion=fused(*clouds, **config))
    (row,) = contact_rows(step)
    return dict(zip(COLUMNS, row, strict=True))


def test_a_row_holds_the_covariance_of_the_contact_after_all_else() -> None:
    diagonal = {HERE: 0.9, (1, 0, 1): 0.8}
    clouds = [cloud("skin", 0.0, diagonal, spreads=np.array([0.01, 0.02]))]
    row = row_of(*clouds)
    (contact,) = fused(*clouds).contacts
    assert list(row)[:11] == [
        *("stamp", "x", "y", "z", "likelihood", "dispersion", "voxels", "fx", "fy", "fz", "shares")
    ]
    told = [[float(row[f"cov_{min(a, b)}{max(a, b)}"]) for a in "xyz"] for b in "xyz"]
    assert told == pytest.approx(contact.covariance, rel=1e-5)
    assert told[0][2] > 0.0


def test_a_row_holds_the_ends_of_a_contact() -> None:
    clouds = [cloud("skin", 0.0, {HERE: 0.9, (0, 0, 1): 0.8})]
    row, (contact,) = row_of(*clouds), fused(*clouds).contacts
    ends = [[float(row[f"{axis}_{end}"]) for axis in "xyz"] for end in ("from", "to")]
    np.testing.assert_allclose(ends, contact.extent, atol=1e-6)
    assert np.ptp(ends, axis=0).max() > 0.0


def test_a_row_holds_the_number_of_a_contact_that_is_followed() -> None:
    row = row_of(cloud("skin", 0.0, {HERE: 0.9}))
    assert (row["track"], row["since"]) == (1, "0.000000")
    row = row_of(cloud("skin", 0.0, {HERE: 0.9}), rule="de_morgan")
    assert (row["track"], row["since"]) == ("", "")


def test_a_row_tells_place_likelihood_and_shares() -> None:
    row = row_of(cloud("skin", 0.0, {HERE: 0.5}), cloud("wrist", 0.0, {HERE: 0.5}))
    assert (row["stamp"], row["x"], row["likelihood"]) == ("0.500000", "0.0025", "0.75")
    assert row["shares"] == "skin:0.5000 wrist:0.5000" and row["fx"] == "nan"
