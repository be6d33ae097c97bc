"""The condensation `cluster_mass`: clusters that are likely as a whole."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactfusion import Contact, Fusion, HypothesisCloud
from lab.tests import baseline_steps
from tests.clouds import HERE, NULL, SIDE, SUPPORT, Voxel, cloud, voxels_of
from tests.test_condensations import brute_force

TWELVE: dict[Voxel, float] = {(x, y, 0): 1 / 12 for x in range(4) for y in range(3)}


def fused(*clouds: HypothesisCloud, **options: Any) -> Fusion:
    return baseline_steps.fused(
        *clouds, **{"rule": "de_morgan", "condensation": "cluster_mass", **options}
    )


def contacts_of(likelihoods: dict[Voxel, float], **options: Any) -> tuple[Contact, ...]:
    return fused(cloud("a", 0.0, likelihoods), **options).contacts


def test_one_contact_spread_over_twelve_voxels_is_found_by_its_mass() -> None:
    (contact,) = fused(cloud("wrench", 0.0, TWELVE, single=True)).contacts
    assert contact.position == pytest.approx(np.array([2.0, 1.5, 0.5]) * SIDE)
    assert contact.voxels == 12 and contact.likelihood == pytest.approx(1 / 12)


@pytest.mark.parametrize(("mass_threshold", "count"), [(0.75, 1), (0.7500001, 0)])
def test_a_cluster_needs_its_mass(mass_threshold: float, count: int) -> None:
    voxels: dict[Voxel, float] = {HERE: 0.5, (1, 0, 0): 0.25}
    assert len(contacts_of(voxels, mass_threshold=mass_threshold)) == count


def test_the_faintest_voxels_have_no_mass_and_are_no_bridge() -> None:
    row: dict[Voxel, float] = {(x, 0, 0): 0.009 for x in range(1, 200)}
    assert contacts_of(row) == ()
    ends: dict[Voxel, float] = {HERE: 0.75, (200, 0, 0): 0.75}
    assert len(contacts_of({**row, **ends})) == 2
    assert len(contacts_of({**dict.fromkeys(row, 0.011), **ends})) == 1


def test_prediction_alone_gives_a_voxel_no_mass_but_adds_to_that_of_evidence() -> None:
    predicted = cloud("motion", 0.0, dict.fromkeys(TWELVE, 0.9), SUPPORT)
    faint = cloud("wrench", 0.0, {voxel: p / 4 for voxel, p in TWELVE.items()})
    for clouds, count in (([predicted], 0), ([faint], 0), ([predicted, faint], 1)):
        assert len(fused(*clouds).contacts) == count


def test_what_was_nulled_has_no_mass() -> None:
    assert fused(cloud("a", 0.0, {HERE: 0.9}), cloud("b", 0.0, {HERE: 0.1}, NULL)).contacts == ()


index = st.integers(-4, 4)
said = st.dictionaries(
    st.tuples(index, index, st.integers(-1, 1)), st.sampled_from([0.005, 0.05, 0.25]), max_size=25
)


@settings(max_examples=60)
@given(said=said)
def test_contacts_are_the_clusters_of_enough_mass(said: dict[Voxel, float]) -> None:
    fusion, voxels = fused(cloud("a", 0.0, said), mass_threshold=0.6), list(said)
    some = [voxel for voxel in voxels if said[voxel] >= 0.01]
    groups = [{some[member] for member in members} for members in brute_force(some, 4.0)]
    wanted = [group for group in groups if sum(map(said.__getitem__, group)) >= 0.6]
    found = [
        {voxels_of(fusion)[row] for row in fusion.rows_of(contact)} for contact in fusion.contacts
    ]
    assert sorted(map(sorted, found)) == sorted(map(sorted, wanted))
