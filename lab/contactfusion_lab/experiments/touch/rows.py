"""The rows of the table: which sources are fused, and what comes of it."""

from dataclasses import dataclass, replace

import numpy as np

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

NEAR = 0.03
"""A contact this near a true one has detected it [m] (method §8)."""


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


PAPER = ("tactile", "force", "range")
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
    """Tell which modality a source belongs to."""
    options = config.generators[source.split("/")[0]]
    if options["type"] == "range":
        return "range" if options.get("evidence") == "proximity" else "moving"
    return TYPES.get(options["type"], str(options["type"]))


def everything(config: PipelineConfig) -> Row:
    """Give the row of all modalities that are configured.

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
    """Give the robot where its joints were read in the end, in the space's frame."""
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
    """Tell for each pair of modalities that both spoke whether they share a voxel."""
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
