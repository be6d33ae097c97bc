"""`experiment skin`: one to six presses at once on a flat skin; how many are found, and where.

A skin of 20 x 20 taxels 5 mm apart is pressed at places that nothing but their distance limits, by
forces of which the greatest may be ten times the least; each press spreads over several taxels,
whose gains differ and which feel their neighbours. Every touch is a single reading.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist, pdist

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import make_folder
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import TactileImage
from contactfusion.terminal import note
from contactfusion_lab.experiments.methods import DE_MORGAN, DEFAULT_METHOD, POSTERIOR, Method
from contactfusion_lab.scenes.sensor_errors import TaxelErrors, TaxelNoise
from contactfusion_lab.trials.choices import require_once
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.localisation import localisation
from contactfusion_lab.trials.measures import CASE, TRIAL, compared, parts_of
from contactfusion_lab.trials.tables import (
    Units,
    cell,
    comparisons_text,
    frame_of,
    markdown,
    summary_of,
    write_results,
)

SIDE, PITCH = 20, 0.005
"""Taxels of a side of the skin, and the distance between them [m]."""
MARGIN = 0.01
"""Presses are no nearer to an edge of the skin [m]."""
FORCES = (1.0, 10.0)
"""Of the presses [N], drawn evenly in their logarithm."""
SPREAD = 0.004
"""Standard deviation of the pressure of a press in the skin [m]."""
NOISE, ERRORS = 0.02, TaxelNoise(gain=0.1, crosstalk=0.05)
"""White noise of a taxel [N], and its other errors."""
CUTOFF = 0.01
"""A contact belongs to a press that is nearer [m]."""
MOST = 6
"""Presses at once."""
TUNED = replace(
    DE_MORGAN,
    name="de_morgan_tuned",
    options=(("voxel_size", 0.002), ("threshold", 0.3), ("tolerance", 0.0051)),
)
"""De Morgan with the settings that have the least GOSPA on seeds 7 and 8, presses 2 cm apart."""
METHODS = (DEFAULT_METHOD, DE_MORGAN, TUNED, POSTERIOR)
UNITS: Units = {
    "recall": ("recall %", 100.0, ".1f"),
    "false": ("false a touch", 1.0, ".3f"),
    "gospa": ("GOSPA mm", 1e3, ".2f"),
    "error": ("ε mm", 1e3, ".2f"),
}


@dataclass(frozen=True)
class Touch:
    """Presses at once, and what the skin reads of them.

    Attributes:
        places: shape (n, 3) [m], of the presses, on the skin.
        values: shape (400,) [N], of the taxels.
    """

    places: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class Row:
    """How well the contacts of a method match the presses of a touch.

    Attributes:
        case: the method.
        trial: name of the touch.
        presses: their number, as text.
        exact: whether each press is found and nothing else.
        recall: share of the presses that is found.
        false: number of contacts that are none.
        gospa: the metric [m].
        error: root mean square distance of the found presses [m]; NaN without any.
    """

    case: str
    trial: str
    presses: str
    exact: bool
    recall: float
    false: int
    gospa: float
    error: float


def centres() -> FloatArray:
    """The centres of the taxels, shape (400, 3) [m], row by row as `tactile` has them."""
    rows, columns = np.divmod(np.arange(SIDE**2, dtype=np.float64), SIDE)
    grid = np.stack([rows, columns, np.zeros(SIDE**2)], axis=1)
    return (grid - [0.5 * (SIDE - 1), 0.5 * (SIDE - 1), 0.0]) * PITCH


def pressed(count: int, apart: float, rng: np.random.Generator) -> Touch:
    """A touch with a number of presses that are no nearer to each other than `apart` [m]."""
    taxels, reach = centres(), SIDE * PITCH / 2.0 - MARGIN
    places = np.zeros((count, 3))
    while True:
        places[:, :2] = rng.uniform(-reach, reach, (count, 2))
        if count == 1 or pdist(places).min() >= apart:
            break
    forces = np.exp(rng.uniform(np.log(FORCES[0]), np.log(FORCES[1]), count))
    density = np.exp(-0.5 * cdist(taxels, places, "sqeuclidean") / SPREAD**2)
    pressures = density @ (forces * PITCH**2 / (2.0 * np.pi * SPREAD**2))
    values = TaxelErrors(taxels, ERRORS, rng).read(0.0, pressures)
    return Touch(places, values + NOISE * rng.standard_normal(len(values)))


def touches(seed: int, count: int, apart: float) -> Iterator[tuple[str, Touch]]:
    """A number of touches of each number of presses, by name; each has chance of its own."""
    for presses in range(1, MOST + 1):
        for number in range(count):
            rng = np.random.default_rng([seed, presses, number])
            yield f"{presses}-{number:03d}", pressed(presses, apart, rng)


def pipeline_of(method: Method) -> Pipeline:
    """The skin's generator, and a method that fuses it."""
    patch = {"grid": {"rows": SIDE, "columns": SIDE, "pitch": [PITCH, PITCH]}}
    skin = {"type": "tactile", "sensor": "skin", "patch": patch, "baseline": {"noise": NOISE}}
    integrator = method.applied(IntegratorConfig(frame="skin"))
    return Pipeline(PipelineConfig(generators={"skin": skin}, integrator=integrator))


def located(values: FloatArray, method: Method) -> FloatArray:
    """Where the contacts of a method lie by one reading, shape (m, 3) [m]."""
    pipeline = pipeline_of(method)
    pipeline.receive(TactileImage(stamp=0.0, frame="skin", sensor="skin", values=values))
    contacts = pipeline.step(0.0).fusion.contacts
    return np.reshape([contact.position for contact in contacts], (-1, 3))


def matched(name: str, touch: Touch, method: Method) -> Row:
    """How well a method finds the presses of a touch."""
    presses = len(touch.places)
    match = localisation(touch.places, located(touch.values, method), CUTOFF)
    found = presses - match.missed
    return Row(
        case=str(method),
        trial=name,
        presses=str(presses),
        exact=match.missed == match.false == 0,
        recall=found / presses,
        false=match.false,
        gospa=match.gospa,
        error=match.distance / np.sqrt(found) if found else np.nan,
    )


def run_skin(count: int, apart: float, seed: int, methods: Sequence[Method], out: Path) -> None:
    """Press the skin; write results.csv, summary.json, table.md, and draw a touch of six presses.

    Args:
        count: touches of each number of presses.
        apart: the least distance between presses [m].
        seed: of all chance.
        methods: how hypotheses are fused, the first compared with the others.
        out: the folder that takes the results.

    Raises:
        ConfigurationError: a method stands twice among them.
    """
    require_once([str(method) for method in methods], "rules")
    make_folder(out)
    rows = list[Row]()
    for name, touch in touches(seed, count, apart):
        rows += [matched(name, touch, method) for method in methods]
        if name.endswith(f"{count - 1:03d}"):
            note(f"  {len(rows) // len(methods)} of {MOST * count} touches")
    frame = frame_of(rows, Row).rename(columns={"case": CASE, "trial": TRIAL})
    summaries = {
        case: summary_of(part, ["presses"], ["exact"], UNITS, "mean", seed)
        for case, part in parts_of(frame).items()
    }
    first, *others = map(str, methods)
    comparisons = compared(frame, [(first, each) for each in others], "exact", ["gospa"], seed)
    texts = {
        "Presses at once": _table(summaries),
        "All touches, compared": comparisons_text(comparisons, UNITS),
    }
    write_results(out, frame, {"cases": summaries, "tests": [*map(asdict, comparisons)]}, texts)
    drawn = pressed(MOST, apart, np.random.default_rng([seed, MOST, 0]))
    _draw(drawn, methods, out / "skin.png")


def _table(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """The means by number of presses, with their intervals over touches."""
    lines = []
    for presses in [*map(str, range(1, MOST + 1)), "all"]:
        for case, summary in summaries.items():
            part = summary[presses]
            exact = part["exact"]
            cells = [cell(exact["share"], exact["low"], exact["high"], 100.0, ".0f")]
            for measure, (_, scale, form) in UNITS.items():
                given = part[measure]
                cells.append(cell(given["mean"], given["low"], given["high"], scale, form))
            lines.append([presses, case, *cells])
    return markdown(["presses", "rule", "exact %", *(unit[0] for unit in UNITS.values())], lines)


def _draw(touch: Touch, methods: Sequence[Method], path: Path) -> None:
    """What the taxels read, and where each method has contacts [mm]."""
    figure = new_figure(3.0 * len(methods), 3.6)
    image, half = touch.values.reshape(SIDE, SIDE).T, 500.0 * SIDE * PITCH
    axes = figure.subplots(1, len(methods), sharey=True, squeeze=False)[0]
    for axis, method in zip(axes, methods, strict=True):
        axis.imshow(image, origin="lower", cmap="Greys", extent=(-half, half, -half, half))
        for places, colour, marker, label in (
            (touch.places, COLOURS[1], "*", "press"),
            (located(touch.values, method), COLOURS[0], "x", "contact"),
        ):
            axis.scatter(*1e3 * places[:, :2].T, color=colour, marker=marker, label=label)
        axis.set_title(str(method), fontsize=9)
        axis.set_xlabel("x [mm]")
    axes[0].legend(fontsize=7)
    axes[0].set_ylabel("y [mm]")
    save_figure(figure, path)
