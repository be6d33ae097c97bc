"""Rows of the table: what is fused in each, what comes of it, and rows against each other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.integrator import Integrator
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.model import shared_robot
from contactfusion.robots.posed import PosedRobot
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.experiments.touch.record import Instant, thinned
from contactfusion_lab.experiments.touch.trial import Trial
from contactfusion_lab.trials.calibration import level, radius
from contactfusion_lab.trials.localisation import localisation
from contactfusion_lab.trials.measures import TRIAL, Comparison, compared

NEAR = 0.03
"""A contact this near a true one has detected it [m] (method §8)."""
PAPER = ("tactile", "force", "range")
SINGLE = ("tactile", "force", "range", "fingers")
TYPES = {
    "tactile": "tactile",
    "force_torque": "force",
    "finger_pose": "fingers",
    "first_touch": "first touch",
    "motion": "motion",
    "simulator": "simulator",
    "free_space": "free space",
}


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        name: what it is called.
        modalities: what is fused.
        ungated: whether what the range camera sees near the hand counts as evidence.
    """

    name: str
    modalities: tuple[str, ...]
    ungated: bool = False


ROWS = (
    Row("tactile", ("tactile",)),
    Row("force", ("force",)),
    Row("range", ("range",), ungated=True),
    Row("all", PAPER, ungated=True),
    Row("all + simulator", (*PAPER, "simulator"), ungated=True),
    Row("fingers", ("fingers",)),
    Row("range, moving objects", ("moving",)),
    Row("all, range as support", PAPER),
    Row("all + simulator, range as support", (*PAPER, "simulator")),
    Row("all + first touch", (*PAPER, "first touch"), ungated=True),
)
"""The papers' five rows first; their range counts what is near as evidence."""

PAPERS = ROWS[:5]

ALL, ALL_AND_SIMULATOR = ROWS[3:5]

EVERY = "every generator"

TIMED = (ALL.name, ALL_AND_SIMULATOR.name, EVERY)
"""Of these rows the time until a report is evaluated."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a touch under a row and method.

    Attributes:
        touch: its name.
        object: by name.
        direction: counted from 0.
        repeat: counted from 0.
        short: whether it was stopped before the touch.
        true_contacts: how many there were.
        row: the name of the row.
        method: how it was fused.
        contacts: how many were reported.
        detected: whether one of them is near a true one.
        false: how many are near none.
        error: from the most likely to the nearest true one [m]; NaN without either.
        sigma: the dispersion of the most likely [m]; NaN without any.
        gospa: of true and reported contacts, with a cut-off of 3 cm [m].
        gospa_distance: root of the sum of the squared distances of the pairs in it [m].
        gospa_missed: true contacts without a partner in it.
        gospa_false: reported contacts without a partner in it.
        recall: share of the true contacts with a partner in it; NaN without any.
        probability: likelihood of the most likely contact, 0 without any.
        level: probability of the ellipsoid of the most likely contact's covariance that reaches the
            nearest true one; NaN without either.
        radius: of its 95 % ellipsoid, as of a sphere of that volume [m]; NaN without any.
        force: magnitude of the sum of the true contact forces [N].
        latency: time from the first contact to the first report near a true one [s]; NaN where none
            came, and where it is not evaluated.
        lost: how often no report was near a true contact any more, though there still was one.
    """

    touch: str
    object: str
    direction: int
    repeat: int
    short: bool
    true_contacts: int
    row: str
    method: str
    contacts: int
    detected: bool
    false: int
    error: float
    sigma: float
    gospa: float
    gospa_distance: float
    gospa_missed: int
    gospa_false: int
    recall: float
    probability: float
    level: float
    radius: float
    force: float
    latency: float
    lost: int


def modality_of(config: PipelineConfig, source: str) -> str:
    """Which modality a source belongs to; under a preset, what moves is the papers' range."""
    options = config.generators[source.split("/")[0]]
    if options["type"] == "range":
        near = options.get("evidence") == "proximity" or config.preset is not None
        return "range" if near else "moving"
    return TYPES.get(options["type"], str(options["type"]))


def everything(config: PipelineConfig) -> Row:
    """The row of all modalities that are configured.

    `first touch` and `simulator` stand on the same belief: of the two, the first.
    """
    modalities = dict.fromkeys(modality_of(config, name) for name in config.generators)
    if "first touch" in modalities:
        modalities.pop("simulator", None)
    return Row(EVERY, tuple(modalities))


def fused(
    instant: Instant, row: Row, method: Method, config: PipelineConfig, *, without: str = ""
) -> Fusion:
    """Fuse the hypotheses of some modalities.

    Args:
        instant: the newest cloud of every source.
        row: the modalities.
        method: the rule, the condensation, and how clouds count.
        config: the pipeline that received the readings.
        without: a modality to leave out.
    """
    integrator = method.integrator(config.integrator)
    grid = Grid(integrator.config.frame, integrator.config.voxel_size)
    for cloud in counted(instant, row, method, config, without=without):
        if cloud.kind == HypothesisKind.NULL:
            cloud = thinned(cloud, instant.occupied, grid)
        receive(integrator, cloud, config)
    return integrator.step(instant.stamp, believed_robot(instant, config).surface)


def reported(instant: Instant, row: Row, method: Method, config: PipelineConfig) -> FloatArray:
    """Positions of the contacts that are reported, shape (n, 3) [m]; see `fused`."""
    clouds = counted(instant, row, method, config)
    contacts: Sequence[Contact] = ()
    if any(cloud.kind == HypothesisKind.REGULAR and cloud.likelihoods.any() for cloud in clouds):
        contacts = fused(instant, row, method, config).contacts  # never any without evidence
    return np.reshape([contact.position for contact in contacts], (-1, 3))


def receive(integrator: Integrator, cloud: HypothesisCloud, config: PipelineConfig) -> None:
    """Receive a cloud as the pipeline does that is configured."""
    options = config.generators[cloud.source.split("/")[0]]
    integrator.plug(
        cloud.source,
        cloud.kind,
        timeout=options.get("timeout"),
        replace=options.get("replace", True),
        sensitivity=options.get("sensitivity", 0.0) * (cloud.kind == HypothesisKind.REGULAR),
    )
    integrator.receive(cloud)


def counted(
    instant: Instant, row: Row, method: Method, config: PipelineConfig, *, without: str = ""
) -> list[HypothesisCloud]:
    """The newest clouds of a row, as the method has them count; see `fused`."""
    ungated = row.ungated if method.near == "as the row" else method.near == "evidence"
    clouds = []
    for name, cloud in instant.clouds.items():
        modality = modality_of(config, name)
        if modality not in row.modalities or modality == without:
            continue
        if modality == "range" and ungated:
            cloud = replace(cloud, kind=HypothesisKind.REGULAR)
        if cloud.spreads is not None and method.spreads != 1.0:
            cloud = replace(cloud, spreads=cloud.spreads * method.spreads)
        if method.p_max < 1.0:
            cloud = replace(cloud, likelihoods=np.minimum(cloud.likelihoods, method.p_max))
        clouds.append(cloud)
    return clouds


def believed_robot(instant: Instant, config: PipelineConfig) -> PosedRobot:
    """The robot where its joints were read last, in the space's frame."""
    assert config.robot is not None
    model, frame = shared_robot(config.robot), config.integrator.frame
    base = config.frame_tree().pose(frame, of=model.root)
    return PosedRobot(model, instant.joints, frame, base)


def outcome(
    trial: Trial, row: Row, method: Method, config: PipelineConfig, *, without: str = ""
) -> Outcome:
    """Compare what is fused with the truth; see `fused`."""
    contacts = fused(trial.last, row, method, config, without=without).contacts
    places = np.reshape([contact.position for contact in contacts], (-1, 3))
    away = np.full(len(contacts), np.inf)
    if len(trial.places):
        away = np.linalg.norm(places[:, None] - trial.places, axis=2).min(axis=1)
    known = bool(len(contacts) and len(trial.places))
    touch, sets = trial.touch, localisation(trial.places, places, NEAR)
    return Outcome(
        touch=touch.name,
        object=touch.target,
        direction=touch.direction,
        repeat=touch.repeat,
        short=touch.short,
        true_contacts=len(trial.places),
        row=row.name + (f" without {without}" if without else ""),
        method=str(method),
        contacts=len(contacts),
        detected=bool((away <= NEAR).any()),
        false=int((away > NEAR).sum()),
        error=float(away[0]) if known else np.nan,
        sigma=contacts[0].dispersion if contacts else np.nan,
        gospa=sets.gospa,
        gospa_distance=sets.distance,
        gospa_missed=sets.missed,
        gospa_false=sets.false,
        recall=1.0 - sets.missed / len(trial.places) if len(trial.places) else np.nan,
        probability=contacts[0].likelihood if contacts else 0.0,
        level=_level(contacts[0], trial.places) if known else np.nan,
        radius=radius(contacts[0].covariance) if contacts else np.nan,
        force=trial.force,
        latency=np.nan,
        lost=0,
    )


def _level(contact: Contact, places: FloatArray) -> float:
    """The level of the nearest true contact in the covariance of a reported one."""
    nearest = places[np.linalg.norm(places - contact.position, axis=1).argmin()]
    return level(nearest - contact.position, contact.covariance)


def shared(trial: Trial, config: PipelineConfig) -> dict[tuple[str, str], bool]:
    """Whether two modalities share a voxel, for each pair with hypotheses of both."""
    grid = Grid(config.integrator.frame, config.integrator.voxel_size)
    voxels: dict[str, set[tuple[int, ...]]] = {}
    for name, cloud in trial.clouds.items():
        if len(cloud) and cloud.kind != HypothesisKind.NULL:
            cells = map(tuple, grid.voxels(cloud.positions).tolist())
            voxels.setdefault(modality_of(config, name), set()).update(cells)
    names = sorted(voxels)
    return {
        (first, second): bool(voxels[first] & voxels[second])
        for i, first in enumerate(names)
        for second in names[i + 1 :]
    }


def felt(outcomes: pd.DataFrame) -> pd.DataFrame:
    """The outcomes with a true contact, without those in free air."""
    return outcomes[~outcomes["short"] & (outcomes["true_contacts"] > 0)]


def compare_all(
    outcomes: pd.DataFrame, methods: Sequence[Method], config: PipelineConfig, seed: int
) -> list[Comparison]:
    """Compare rows with the best single modality, and with the same rows by the first method.

    Detection and GOSPA are compared over all touches, ε where both report.

    Args:
        outcomes: of all touches.
        methods: how hypotheses are fused.
        config: the pipeline that felt the touches.
        seed: of the intervals.
    """
    wide = [row.name for row in (*ROWS, everything(config)) if len(row.modalities) > 1]
    first, pairs = methods[0], list[tuple[str, str]]()
    for method in methods:
        best = best_single(outcomes[outcomes["method"] == str(method)])
        pairs += [(f"{row}, {method}", f"{best}, {method}") for row in wide]
        pairs.append((f"{ALL_AND_SIMULATOR.name}, {method}", f"{ALL.name}, {method}"))
        if method != first:
            pairs += [(f"{row}, {method}", f"{row}, {first}") for row in wide]
    frame = felt(outcomes).rename(columns={"touch": TRIAL})
    return compared(frame, pairs, "detected", ["gospa", "error"], seed)


def best_single(outcomes: pd.DataFrame) -> str:
    """The one of `SINGLE` that detects the most touches."""
    touches = outcomes[~outcomes["short"]]
    detected = touches.groupby("row")["detected"].sum()
    found = detected.reindex(SINGLE).dropna()
    return str(found.idxmax()) if len(found) else SINGLE[0]
