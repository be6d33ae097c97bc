"""Contacts: data that nobody changes, and one line for people."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactfusion import Contact, Fusion, HypothesisCloud, HypothesisKind
from tests.clouds import HERE, NULL, REGULAR, SUPPORT, THERE, Voxel, cloud, fused, voxels_of
from tests.explained import explanation
from tests.test_condensations import brute_force


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
        rule="de_morgan",
    ).contacts[0]
    assert str(contact) == (
        "contact at (0.003, 0.003, 0.003) m in 'base', likelihood 0.81, from skin 75%, camera 25%"
    )


# The voxels of contacts

LINK = 4.0
"""The squared offset of voxels that belong together, in voxels² [voxels²]."""
index = st.integers(-4, 4)
likelihood = st.sampled_from([0.02, 0.05, 0.08, 0.25, 0.5, 0.95])
said = st.dictionaries(st.tuples(index, index, st.integers(-1, 1)), likelihood, max_size=25)
SOURCES: dict[str, HypothesisKind] = {
    "free": NULL,
    "lidar": REGULAR,
    "motion": SUPPORT,
    "skin": REGULAR,
}
clouds = st.fixed_dictionaries(dict.fromkeys(SOURCES, said)).map(
    lambda given: [cloud(name, 0.0, given[name], kind) for name, kind in SOURCES.items()]
)
CONDENSATIONS: dict[str, dict[str, Any]] = {
    "threshold": {},
    "cluster_centroid": {"min_voxels": 2},
}


def groups(fusion: Fusion, condensation: str) -> Iterator[set[Voxel]]:
    """The voxels of each contact that there should be, by the verdicts and pairs of voxels."""
    space, voxels = fusion.space, voxels_of(fusion)
    rows = [row for row, verdict in enumerate(space.verdicts) if verdict == "contact"]
    reach = 0.0 if condensation == "threshold" else LINK
    for members in brute_force([voxels[row] for row in rows], reach):
        if condensation == "threshold" or len(members) >= 2:
            yield {voxels[rows[member]] for member in members}


@pytest.mark.parametrize("condensation", CONDENSATIONS)
@settings(max_examples=60)
@given(clouds=clouds)
def test_the_voxels_of_contacts_are_the_clusters_of_the_field(
    condensation: str, clouds: list[HypothesisCloud]
) -> None:
    fusion = fused(*clouds, condensation=condensation, **CONDENSATIONS[condensation])
    voxels = voxels_of(fusion)
    found = [{voxels[row] for row in fusion.rows_of(contact)} for contact in fusion.contacts]
    assert sorted(map(sorted, found)) == sorted(map(sorted, groups(fusion, condensation)))
    assert [len(rows) for rows in found] == [contact.voxels for contact in fusion.contacts]
    for number, contact in enumerate(fusion.contacts):
        rows = fusion.rows_of(contact)
        assert (fusion.owners[rows] == number).all()
        weights = fusion.space.likelihoods[rows]
        centroid = np.average(fusion.space.positions[rows], axis=0, weights=weights)
        assert contact.position == pytest.approx(centroid)
        assert contact.likelihood == weights.max()


@pytest.mark.parametrize("condensation", CONDENSATIONS)
@settings(max_examples=60)
@given(clouds=clouds)
def test_the_shares_of_a_contact_come_of_its_voxels_only(
    condensation: str, clouds: list[HypothesisCloud]
) -> None:
    fusion = fused(*clouds, condensation=condensation, **CONDENSATIONS[condensation])
    for contact in fusion.contacts:
        assert contact.shares == pytest.approx(shares(fusion, contact))


def shares(fusion: Fusion, contact: Contact) -> dict[str, float]:
    """The part of the likelihood in the voxels of a contact that each source gave."""
    columns = fusion.space.source_likelihoods[fusion.rows_of(contact)]
    given = np.nan_to_num(columns.astype(np.float64)).sum(axis=0).tolist()
    kept = {
        name: sum_
        for name, sum_ in zip(fusion.space.sources, given, strict=True)
        if SOURCES[name] != NULL
    }
    return {name: sum_ / sum(kept.values()) for name, sum_ in kept.items()}


@settings(max_examples=30)
@given(clouds=clouds)
def test_an_explanation_counts_the_voxels_of_the_contact(clouds: list[HypothesisCloud]) -> None:
    fusion = fused(*clouds, rule="de_morgan")
    explained = explanation((0.0, clouds)).contacts
    for contact, why in zip(fusion.contacts, explained, strict=False):
        columns = fusion.space.source_likelihoods[fusion.rows_of(contact)]
        spoken = np.isfinite(columns).sum(axis=0).tolist()
        counts = dict(zip(fusion.space.sources, spoken, strict=True))
        assert {part.source: part.voxels for part in why.said} == {
            name: count for name, count in counts.items() if count
        }


def test_the_voxels_of_contacts_cannot_be_changed_and_are_those_of_one_step() -> None:
    clouds = cloud("skin", 0.0, {HERE: 0.5, THERE: 0.25})
    first, second = (fused(clouds, rule="de_morgan") for _ in range(2))
    assert [first.rows_of(contact).tolist() for contact in first.contacts] == [[0], [1]]
    assert not first.owners.flags.writeable
    with pytest.raises(ValueError, match="no contact of this step: contact at "):
        first.rows_of(second.contacts[0])
