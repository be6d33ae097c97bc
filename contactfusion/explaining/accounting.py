"""Makes the account of a moment: for each contact why it is there, for each place why none is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import ContactFusionError
from contactfusion.explaining.account import (
    Account,
    ContactAccount,
    Place,
    PlaceAccount,
    Said,
    Without,
)
from contactfusion.explaining.combination import combined
from contactfusion.explaining.missing import missing_at, nearest_hypotheses, sources_of
from contactfusion.explaining.moment import Moment
from contactfusion.explaining.places import Expected, expected_places
from contactfusion.explaining.reason import Reason, Why
from contactfusion.explaining.remains import nearest, reach_of, without
from contactfusion.explaining.settings import Settings
from contactfusion.explaining.spots import Spot, said_at, shares_at, spot_at, spot_of
from contactfusion.explaining.verdicts import verdict
from contactfusion.explaining.view import NOBODY, View
from contactfusion.explaining.words import millimetres, place_words
from contactfusion.integrator.fusion import Fusion

MOST = 8
"""So many contacts are told of in full."""
FAR = 0.05
"""A place with nothing in so much of it cannot be told of [m]."""


def account_of(moment: Moment, settings: Settings, at: Sequence[float] | None = None) -> Account:
    """Give the account of a moment.

    Args:
        moment: the step and what was before.
        settings: of the pipeline that gave it.
        at: shape (3,) [m], the place that is asked for, in the frame of the space; None: those
            where one might expect a contact.

    Raises:
        ContactFusionError: `at` is no place, or nothing is or was near it.
    """
    view, config = View(moment, settings), settings.integrator
    contacts = view.fusion.contacts
    wanted = expected_places(view) if at is None else [_asked(view, at)]
    return Account(
        stamp=view.stamp,
        frame=config.frame,
        rule=config.rule,
        condensation=config.condensation,
        threshold=view.fusion.threshold,
        tolerance=settings.tolerance,
        contacts=tuple(_contact(view, number) for number in range(min(len(contacts), MOST))),
        untold=max(len(contacts) - MOST, 0),
        places=tuple(_place(view, one, at is not None) for one in wanted),
        sources=tuple(sources_of(view)),
    )


def _asked(view: View, at: Sequence[float]) -> Expected:
    """Give the place that was asked for, with the last contact there."""
    place = np.asarray(at, np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ContactFusionError(f"{at} is no place: give x, y and z in m")
    _require_near(view, place)
    reach = view.settings.tolerance
    dead = [one for one in view.past.dead(view.stamp) if _distance(one.contact, place) <= reach]
    return Expected(place, dead[0].stamp if dead else np.nan)


def _require_near(view: View, place: FloatArray) -> None:
    """Make sure that something is, or was lately, near a place."""
    fusion, far = view.fusion, max(FAR, view.settings.tolerance)
    sources = fusion.field.entries.sources
    around = nearest_hypotheses(fusion, place)
    here = nearest(place, fusion.contacts)
    if (around and around[0][0] <= far) or (here and here[1] <= far):
        return
    if any(view.past.last_told(one.name, place, far) for one in sources):
        return
    raise ContactFusionError(
        f"nothing was within {far * 100.0:.0f} cm of {place_words(place)} in "
        f"'{view.settings.integrator.frame}' at {view.stamp:.9g} s; "
        f"{_nearest_words(fusion, place)}"
    )


def _contact(view: View, number: int) -> ContactAccount:
    contact, spot = view.fusion.contacts[number], spot_of(view, number)
    shares = contact.shares
    if view.fusion.field.belief is not None and not view.settings.by_modes:
        shares = shares_at(view.fusion, spot)
    said = [replace(one, share=shares.get(one.source, np.nan)) for one in said_at(view, spot)]
    said.sort(key=lambda one: -np.nan_to_num(one.share))
    limit = reach_of(contact, view.settings.integrator.voxel_size)
    return ContactAccount(
        position=_plain(contact.position),
        likelihood=contact.likelihood,
        spread=float(np.sqrt(np.trace(contact.covariance) / 3.0)),
        dispersion=contact.dispersion,
        voxels=contact.voxels,
        force=_plain(contact.force),
        combination=combined(view, spot, contact.likelihood),
        said=tuple(said),
        missing=tuple(_missing(view, spot, said)),
        without=_withouts(view, said, spot, limit),
    )


def _place(view: View, wanted: Expected, asked: bool) -> PlaceAccount:
    fusion = view.fusion
    spot = spot_at(view, wanted.position, view.settings.tolerance)
    said = said_at(view, spot)
    missing = _missing(view, spot, said)
    reasons = verdict(view, spot) or [_nothing(fusion, spot, said, missing)]
    likelihood = np.nan if spot.best == NOBODY else float(fusion.field.likelihoods[spot.best])
    return PlaceAccount(
        position=_plain(wanted.position),
        reach=spot.reach,
        asked=asked,
        likelihood=likelihood,
        combination=combined(view, spot),
        reasons=tuple(reasons),
        said=tuple(said),
        missing=tuple(missing),
        without=_withouts(view, said, spot, spot.reach),
        last_contact=view.stamp - wanted.last_contact,
    )


def _nearest_words(fusion: Fusion, place: FloatArray) -> str:
    """Say what lies nearest to a place near which nobody says anything."""
    around = nearest_hypotheses(fusion, place)
    if not around:
        return "no hypothesis is alive anywhere"
    away, source = around[0]
    return f"the nearest hypothesis is {millimetres(away)} away, of {source}"


def _missing(view: View, spot: Spot, said: Sequence[Said]) -> list[Reason]:
    """Give why sources say nothing here, but for those whose belief reaches here from elsewhere."""
    reach_here = {one.source for one in said}
    return [one for one in missing_at(view, spot) if one.source not in reach_here]


def _nothing(fusion: Fusion, spot: Spot, said: Sequence[Said], missing: Sequence[Reason]) -> Reason:
    """Report that no hypothesis lies here, with the best reason of those that might have."""
    if missing and missing[0].why in (Why.EXPIRED, Why.WITHDRAWN):
        return missing[0]
    what = (
        f"no hypothesis lies within {millimetres(spot.reach)}"
        if said
        else "no source says anything here"
    )
    return Reason(Why.NOTHING, f"{what}; {_nearest_words(fusion, spot.position)}")


def _withouts(view: View, said: Sequence[Said], spot: Spot, reach: float) -> tuple[Without, ...]:
    return tuple(without(view.fusion, one.source, spot.position, reach) for one in said)


def _distance(contact: Contact, place: FloatArray) -> float:
    return float(np.linalg.norm(contact.position - place))


def _plain(values: FloatArray) -> Place:
    x, y, z = (float(value) for value in values)
    return x, y, z
