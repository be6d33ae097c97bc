"""The account of one moment: why contacts are where they are, and why there is none elsewhere."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from contactfusion.explaining.reason import Reason
from contactfusion.hypotheses import HypothesisKind

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Said:
    """What one source says at a place.

    Attributes:
        source: its name.
        kind: what it stands on.
        likelihood: of its likeliest hypothesis within reach, or of its nearest if none is.
        age: of that hypothesis [s].
        timeout: how long it lives [s].
        voxels: in how many voxels within reach it says something; 0: only by its spread.
        spread: the standard deviation of that hypothesis's place [m], 0 if the source gave none.
        away: how far from the place that hypothesis lies [m].
        share: of the contact's likelihood; NaN where there is no contact.
        fit: with a rule that has a belief, how well the place fits what the source says: as a part
            of what its best place has, and for null what it leaves of the others' belief; else NaN.
    """

    source: str
    kind: HypothesisKind
    likelihood: float
    age: float
    timeout: float
    voxels: int
    spread: float
    away: float
    share: float = math.nan
    fit: float = math.nan


@dataclass(frozen=True, slots=True)
class Without:
    """What would be here without one source.

    Attributes:
        source: its name.
        contact: whether there would be a contact here.
        likelihood: of that contact; NaN: there would be none.
        moved: how far it would lie from here [m]; of the nearest elsewhere if none were here, and
            NaN if there were none at all.
    """

    source: str
    contact: bool
    likelihood: float
    moved: float


@dataclass(frozen=True, slots=True)
class ContactAccount:
    """One contact, and why it was told.

    Attributes:
        position: in the account's frame [m].
        likelihood: of the contact.
        spread: standard deviation of its position along an axis, √(trace covariance / 3) [m].
        dispersion: its standard distance [m].
        voxels: how many it is made of.
        force: on the robot [N]; NaN where none was felt.
        combination: how its likelihood comes of those of the sources.
        said: what each source says here, larger shares first.
        missing: why other sources of evidence and support say nothing here.
        without: what would remain without each source in `said`.
    """

    position: Place
    likelihood: float
    spread: float
    dispersion: float
    voxels: int
    force: Place
    combination: str
    said: tuple[Said, ...]
    missing: tuple[Reason, ...]
    without: tuple[Without, ...]


@dataclass(frozen=True, slots=True)
class PlaceAccount:
    """A place where a contact might be expected, and why none was told.

    Attributes:
        position: in the account's frame [m].
        reach: what lies within so much of it is told of [m].
        asked: whether somebody asked for this place.
        likelihood: the highest fused likelihood here; NaN: no source says anything.
        combination: how that comes of the likelihoods of the sources, or "".
        reasons: why there is no contact, the main one first; `Why.CONTACT`: there is one.
        said: what each source says here, likelier ones first.
        missing: why other sources of evidence and support say nothing here.
        without: what would be here without each source in `said`.
        last_contact: how long ago a contact was told here [s]; NaN: not lately.
    """

    position: Place
    reach: float
    asked: bool
    likelihood: float
    combination: str
    reasons: tuple[Reason, ...]
    said: tuple[Said, ...]
    missing: tuple[Reason, ...]
    without: tuple[Without, ...]
    last_contact: float


@dataclass(frozen=True, slots=True)
class SourceAccount:
    """How a source does.

    Attributes:
        source: its name.
        kind: what it stands on.
        age: since its newest cloud [s]; NaN: none ever came.
        timeout: how long its hypotheses live [s].
        rate: clouds a second; NaN before the second.
        active: whether it has spoken within `stale_after`.
        hypotheses: how many voxels hold a live one.
        accepted: clouds that were taken, so far.
        late: clouds that were dropped because a newer one had come.
        early: clouds that were held back.
        refused: clouds that could not be used.
        notes: remarks on its newest cloud.
        events: what happened to it lately, with how long ago.
    """

    source: str
    kind: HypothesisKind
    age: float
    timeout: float
    rate: float
    active: bool
    hypotheses: int
    accepted: int
    late: int
    early: int
    refused: int
    notes: tuple[str, ...]
    events: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Account:
    """Why contacts were told at one moment, and why not elsewhere.

    Attributes:
        stamp: of the step [s].
        frame: of all places and forces.
        rule: that fused.
        condensation: that made contacts.
        threshold: from which likelihood on a voxel is a contact.
        tolerance: what lies so near together belongs together [m].
        contacts: the likeliest first.
        untold: how many further contacts there are.
        places: without a contact; the one asked for, or the most conspicuous ones.
        sources: by name.
    """

    stamp: float
    frame: str
    rule: str
    condensation: str
    threshold: float
    tolerance: float
    contacts: tuple[ContactAccount, ...]
    untold: int
    places: tuple[PlaceAccount, ...]
    sources: tuple[SourceAccount, ...]


def as_json(account: Account) -> str:
    """Give an account as JSON: names as in the classes, m, s and N, null for NaN."""
    return json.dumps(_plain(asdict(account)), indent=1, ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value
