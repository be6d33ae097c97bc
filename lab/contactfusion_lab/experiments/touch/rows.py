"""Rows of the table: what is fused in each, what comes of it, and rows against each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from scipy.stats import wilcoxon

from contactfusion.arrays import FloatArray
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.integrator import Integrator
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.model import shared_robot
from contactfusion.robots.posed import PosedRobot
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.experiments.touch.plan import Touch
from contactfusion_lab.experiments.touch.trial import Trial
from contactfusion_lab.trials.measures import CONFIDENCE, RESAMPLES, mcnemar

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


@dataclass(frozen=True)
class Outcome:
    """What one touch gave under one row and method.

    Attributes:
        touch: which.
        true_contacts: how many there were.
        row: the name of the row.
        method: how it was fused.
        contacts: how many were reported.
        detected: whether one of them is near a true one.
        false: how many are near none.
        error: from the most likely to the nearest true one [m]; NaN without either.
        sigma: the dispersion of the most likely [m]; NaN without any.
    """

    touch: Touch
    true_contacts: int
    row: str
    method: str
    contacts: int
    detected: bool
    false: int
    error: float
    sigma: float


def modality_of(config: PipelineConfig, source: str) -> str:
    """Which modality a source belongs to."""
    options = config.generators[source.split("/")[0]]
    if options["type"] == "range":
        return "range" if options.get("evidence") == "proximity" else "moving"
    return TYPES.get(options["type"], str(options["type"]))


def everything(config: PipelineConfig) -> Row:
    """The row of all modalities that are configured.

    `first touch` and `simulator` stand on the same belief: of the two, the first.
    """
    modalities = dict.fromkeys(modality_of(config, name) for name in config.generators)
    if "first touch" in modalities:
        modalities.pop("simulator", None)
    return Row("every generator", tuple(modalities))


def fused(
    trial: Trial, row: Row, method: Method, config: PipelineConfig, *, without: str = ""
) -> Fusion:
    """Fuse what some modalities said.

    Args:
        trial: what every source said.
        row: the modalities.
        method: the rule, the condensation, and what spreads are multiplied by.
        config: the pipeline that felt the touch.
        without: a modality to leave out.
    """
    integrator = Integrator(method.applied(config.integrator))
    for name, cloud in trial.clouds.items():
        modality = modality_of(config, name)
        if modality not in row.modalities or modality == without:
            continue
        if modality == "range" and row.ungated:
            cloud = replace(cloud, kind=HypothesisKind.REGULAR)
        if cloud.spreads is not None:
            cloud = replace(cloud, spreads=cloud.spreads * method.spreads)
        options = config.generators[name.split("/")[0]]
        integrator.plug(
            name,
            cloud.kind,
            timeout=options.get("timeout"),
            replace=options.get("replace", True),
            sensitivity=options.get("sensitivity", 0.0) * (cloud.kind == HypothesisKind.REGULAR),
        )
        integrator.receive(cloud)
    return integrator.step(trial.stamp, believed_robot(trial, config).surface)


def believed_robot(trial: Trial, config: PipelineConfig) -> PosedRobot:
    """The robot where its joints were read in the end, in the space's frame."""
    assert config.robot is not None
    model, frame = shared_robot(config.robot), config.integrator.frame
    base = config.frame_tree().pose(frame, of=model.root)
    return PosedRobot(model, trial.joints, frame, base)


def outcome(
    trial: Trial, row: Row, method: Method, config: PipelineConfig, *, without: str = ""
) -> Outcome:
    """Compare what is fused with the truth; see `fused`."""
    contacts = fused(trial, row, method, config, without=without).contacts
    places = np.reshape([contact.position for contact in contacts], (-1, 3))
    away = np.full(len(contacts), np.inf)
    if len(trial.places):
        away = np.linalg.norm(places[:, None] - trial.places, axis=2).min(axis=1)
    known = bool(len(contacts) and len(trial.places))
    return Outcome(
        touch=trial.touch,
        true_contacts=len(trial.places),
        row=row.name + (f" without {without}" if without else ""),
        method=str(method),
        contacts=len(contacts),
        detected=bool((away <= NEAR).any()),
        false=int((away > NEAR).sum()),
        error=float(away[0]) if known else np.nan,
        sigma=contacts[0].dispersion if contacts else np.nan,
    )


def shared(trial: Trial, config: PipelineConfig) -> dict[tuple[str, str], bool]:
    """Whether two modalities share a voxel, for each pair that both spoke."""
    grid = Grid(config.integrator.frame, config.integrator.voxel_size)
    voxels: dict[str, set[tuple[int, ...]]] = {}
    for name, cloud in trial.clouds.items():
        if len(cloud) and cloud.kind != HypothesisKind.NULL:
            cells = map(tuple, grid.voxels(cloud.positions).tolist())
            voxels.setdefault(modality_of(config, name), set()).update(cells)
    names = sorted(voxels)
    return {
        (one, other): bool(voxels[one] & voxels[other])
        for i, one in enumerate(names)
        for other in names[i + 1 :]
    }


@dataclass(frozen=True)
class Comparison:
    """One row and method against another.

    Attributes:
        row: the name of the row.
        method: how it was fused.
        against_row: the row that it is compared with.
        against_method: how that was fused.
        touches: how many both went through.
        detected_by_it_only: touches.
        detected_by_the_other_only: touches.
        p_of_detection: by McNemar's exact test, on the touches that only one of them detects.
        both_report: touches in which both report a contact: ε is compared on these.
        median_difference: the median over touches of the difference of ε [m]; None without any.
        p_of_error: by Wilcoxon's signed ranks.
        difference_of_medians: of ε [m], less than 0 where it is better; None without any.
        low: the lower end of its 95 % interval [m].
        high: the upper end [m].
    """

    row: str
    method: str
    against_row: str
    against_method: str
    touches: int
    detected_by_it_only: int
    detected_by_the_other_only: int
    p_of_detection: float
    both_report: int
    median_difference: float | None
    p_of_error: float
    difference_of_medians: float | None
    low: float | None
    high: float | None


def compare(found: Sequence[Outcome], other: Sequence[Outcome], seed: int) -> Comparison:
    """Compare outcomes touch by touch; those in free air have no say.

    Args:
        found: of one row and method.
        other: of another, of the same touches in the same order.
        seed: of the interval, a bootstrap over touches; each comparison has chance of its own.
    """
    pairs = [
        (one, another)
        for one, another in zip(found, other, strict=True)
        if not one.touch.short and one.true_contacts
    ]
    only_it = sum(one.detected and not another.detected for one, another in pairs)
    only_other = sum(another.detected and not one.detected for one, another in pairs)
    errors = np.array([(one.error, another.error) for one, another in pairs]).reshape(-1, 2)
    errors = errors[np.isfinite(errors).all(axis=1)]
    differences = errors[:, 0] - errors[:, 1]
    names = (found[0].row, found[0].method, other[0].row, other[0].method)
    rng = np.random.default_rng([seed, crc32(", ".join(names).encode())])
    return Comparison(
        *names,
        len(pairs),
        only_it,
        only_other,
        mcnemar(only_it, only_other),
        len(errors),
        float(np.median(differences)) if len(errors) else None,
        float(wilcoxon(differences).pvalue) if differences.any() else 1.0,
        *(_difference_of_medians(errors, rng) if len(errors) else (None, None, None)),
    )


def _difference_of_medians(
    errors: FloatArray, rng: np.random.Generator
) -> tuple[float, float, float]:
    """The difference of two medians with its interval; pairs of shape (n, 2) are drawn."""
    drawn = np.median(errors[rng.integers(len(errors), size=(RESAMPLES, len(errors)))], axis=1)
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(drawn[:, 0] - drawn[:, 1], [tail, 1.0 - tail])
    one, other = np.median(errors, axis=0)
    return float(one - other), float(low), float(high)


def best_single(outcomes: Mapping[str, Sequence[Outcome]]) -> str:
    """Name the one of `SINGLE` that detects the most touches; by row, of one method."""

    def detected(row: str) -> int:
        return sum(one.detected for one in outcomes[row] if not one.touch.short)

    return max((row for row in SINGLE if row in outcomes), key=detected)


def comparisons_text(comparisons: Sequence[Comparison]) -> str:
    """Comparisons of one method as Markdown; another method is named, if it is one."""
    lines = [
        "| row | against | detected by it only | by the other only | p | both report | "
        "ε median difference cm | p | difference of medians cm |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in comparisons:
        against = one.against_row if one.method == one.against_method else one.against_method
        lines.append(
            f"| {one.row} | {against} | {one.detected_by_it_only} | "
            f"{one.detected_by_the_other_only} | {one.p_of_detection:.2g} | {one.both_report} | "
            f"{_cm(one.median_difference)} | {one.p_of_error:.2g} | "
            f"{_cm(one.difference_of_medians)} [{_cm(one.low)}, {_cm(one.high)}] |"
        )
    return "\n".join(lines)


def _cm(metres: float | None) -> str:
    return "-" if metres is None else f"{metres * 100.0:.2f}"
