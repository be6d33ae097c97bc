"""Force plates under walking feet: the wrench gives a contact, the markers of the foot the truth.

A plate stands for a robot's sensor, its surface for the robot's. The contact lies inside the foot
when it is between the heel marker and 25 mm beyond the toe marker (which sits on the metatarsal
head), and within half the ankle's width of the line between them. The lateral error is the distance
to that line; it holds the anatomy too, as the load wanders across the sole.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.hypotheses import Note
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import CycleConfig, PipelineConfig
from contactfusion.readings import Markers, Wrench
from contactfusion.recordings.c3d import C3DConfig, C3DRecording
from contactfusion.shapes import BodyConfig, PartConfig
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import Measure, grouped, p50, p90, proportion

NAME = "force_plates"
MIN_FORCE = 60.0
"""Least force at which the position is certain enough to be rated [N]."""
VOXEL_SIZE = 0.002
HALF_WIDTH, BEYOND_TOE = 0.032, 0.025
"""Outline of a foot: half its width, and its length beyond the toe marker [m]."""
MOMENT = 0.05
"""Samples of so long a moment depend on each other [s]."""
PLATES = ("plate_1", "plate_3")
CROWDED = "plate_0"
"""The plate on which, for a while, two feet stand."""


@dataclass(frozen=True, eq=False)
class Walk:
    """The recording, with the feet at every stamp of the plates.

    Attributes:
        recording: the C3D.
        wrenches: the readings of each plate.
        stamps: shape (n,) [s], of the plates' samples.
        feet: by side, heel and toe, shape (n, 2, 3) [m], in the lab frame.
    """

    recording: C3DRecording
    wrenches: dict[str, list[Wrench]]
    stamps: FloatArray
    feet: dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Found:
    """The contacts found on one plate, over samples above the least force.

    Attributes:
        rows: shape (m,), the samples.
        places: shape (m, 2) [m], the contact on the floor, NaN where none was reported.
        flagged: shape (m,), whether more than one contact was suspected.
    """

    rows: NDArray[np.intp]
    places: FloatArray
    flagged: NDArray[np.bool_]


def measure(folder: Path, out: Path, method: Method) -> list[Measure]:
    """Measure places and flags on the loaded plates; draw the paths of the contacts."""
    walk = read(folder)
    friction = {plate: torsional_friction(walk.wrenches[plate]) for plate in PLATES}
    friction = {
        "plate_1": friction["plate_3"],  # learned on the other plate
        "plate_3": friction["plate_1"],
        CROWDED: float(np.sqrt(np.mean(np.square(list(friction.values()))))),
    }
    found = {plate: locate(walk, plate, friction[plate], method) for plate in (*PLATES, CROWDED)}
    measures, lateral, moments = [], [], []
    for plate in PLATES:
        along, across, length = foot_coordinates(walk, plate, found[plate])
        moments.append(_moments(walk, found[plate]))
        measures += _places(plate, found[plate], along, across, length, moments[-1])
        lateral.append(np.abs(across))
    measures += _lateral("both plates", np.concatenate(lateral), np.concatenate(moments), 0.004)
    for plate, errors, groups in zip(PLATES, lateral, moments, strict=True):
        measures += _lateral(plate, errors, groups, None)
    measures += _flags(walk, found)
    _draw(walk, found, out / "force_plates.png")
    return measures


def read(folder: Path) -> Walk:
    """Read the plates, and bring the feet to the plates' stamps."""
    recording = C3DRecording(C3DConfig(file=Path("walk.c3d.zip")), folder)
    wrenches: dict[str, list[Wrench]] = {}
    markers: list[Markers] = []
    for reading in recording.readings():
        if isinstance(reading, Wrench):
            wrenches.setdefault(reading.sensor, []).append(reading)
        elif isinstance(reading, Markers):
            markers.append(reading)
    stamps = np.array([wrench.stamp for wrench in wrenches[CROWDED]])
    seen = np.array([reading.stamp for reading in markers])
    tracks = np.array([reading.positions for reading in markers])
    feet = {}
    for side in "LR":
        columns = [markers[0].names.index(side + name) for name in ("HEE", "TOE")]
        track = tracks[:, columns].reshape(len(seen), -1)
        at_stamps = [np.interp(stamps, seen, column) for column in track.T]
        feet[side] = np.stack(at_stamps, axis=1).reshape(-1, 2, 3)
    return Walk(recording, wrenches, stamps, feet)


def torsional_friction(wrenches: list[Wrench]) -> float:
    """Learn how much moment along the force a single foot carries: its rms per force [m]."""
    loaded = [w for w in wrenches if np.linalg.norm(w.force) > MIN_FORCE]
    along = [float(w.torque @ w.force / (w.force @ w.force)) for w in loaded]
    return float(np.sqrt(np.mean(np.square(along))))


def locate(walk: Walk, plate: str, friction: float, method: Method) -> Found:
    """Run the pipeline on one plate."""
    corners = walk.recording.corners[plate]
    size = np.ptp(corners, axis=0)
    config = PipelineConfig(
        generators={
            plate: {
                "type": "force_torque",
                "sign": "on_robot",
                "min_force": MIN_FORCE,
                "patch": friction,
                "surface_tolerance": 2.0 * VOXEL_SIZE,
            }
        },
        integrator=method.applied(
            IntegratorConfig(frame="lab", voxel_size=VOXEL_SIZE, timeout=0.01)
        ),
        cycle=CycleConfig(on=plate),
        frames=walk.recording.frames(),
        surface=BodyConfig(
            frame=plate,
            spacing=2.0 * VOXEL_SIZE,
            shapes=(PartConfig(shape="rectangle", size=(float(size[0]), float(size[1]))),),
        ),
    )
    pipeline = Pipeline(config)
    loaded = [np.linalg.norm(w.force) > MIN_FORCE for w in walk.wrenches[plate]]
    rows = np.flatnonzero(loaded)
    steps = list(pipeline.run(walk.wrenches[plate][row] for row in rows))
    places = [
        step.fusion.contacts[0].position[:2] if step.fusion.contacts else (np.nan, np.nan)
        for step in steps
    ]
    flagged = [(plate, Note.MORE_THAN_ONE_CONTACT) in step.fusion.report.notes for step in steps]
    return Found(rows, np.array(places), np.array(flagged, np.bool_))


def foot_coordinates(
    walk: Walk, plate: str, found: Found
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The contacts along and across the foot that stands on the plate, and its length [m].

    The foot is the one whose markers are nearest the plate's centre; independent of the contacts.
    """
    centre = walk.recording.corners[plate].mean(axis=0)[:2]
    away = {
        side: np.linalg.norm(feet[found.rows].mean(axis=1)[:, :2] - centre, axis=1).mean()
        for side, feet in walk.feet.items()
    }
    foot = walk.feet[min(away, key=lambda side: away[side])][found.rows][:, :, :2]
    heel, toe = foot[:, 0], foot[:, 1]
    length = np.linalg.norm(toe - heel, axis=1)
    axis = (toe - heel) / length[:, None]
    offset = found.places - heel
    along = np.einsum("ij,ij->i", offset, axis)
    return along, axis[:, 0] * offset[:, 1] - axis[:, 1] * offset[:, 0], length


def both_feet(walk: Walk, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    """At which samples two feet stand on the crowded plate.

    Two feet stand from the strike of one to the next time that the other leaves the floor, by the
    events that were marked in the recording; a foot is over the plate when one of its markers is.
    """
    both = np.zeros(len(rows), np.bool_)
    stamps = walk.stamps[rows]
    events = walk.recording.events
    for strike in (event for event in events if event.label == "Foot Strike"):
        later = [
            event.stamp
            for event in events
            if event.label == "Foot Off"
            and event.context != strike.context
            and event.stamp > strike.stamp
        ]
        if later:
            both |= (stamps >= strike.stamp) & (stamps <= min(later))
    corners = walk.recording.corners[CROWDED][:, :2]
    for feet in walk.feet.values():
        markers = feet[rows][:, :, :2]
        over = (markers >= corners.min(axis=0)) & (markers <= corners.max(axis=0))
        both &= over.all(axis=2).any(axis=1)
    return both


def _places(
    plate: str,
    found: Found,
    along: FloatArray,
    across: FloatArray,
    length: FloatArray,
    moments: FloatArray,
) -> list[Measure]:
    inside = (along >= 0.0) & (along <= length + BEYOND_TOE) & (np.abs(across) <= HALF_WIDTH)
    detected = np.isfinite(found.places[:, 0])
    n = len(found.rows)
    note = "an unreported contact counts as outside"
    return [
        Measure(NAME, plate, "contact reported", *proportion(detected, moments), "", n),
        Measure(
            NAME,
            plate,
            "contact inside the foot",
            *proportion(inside, moments),
            "",
            n,
            0.99,
            note=note,
        ),
    ]


def _lateral(
    case: str, errors: FloatArray, groups: FloatArray, asked: float | None
) -> list[Measure]:
    rng = np.random.default_rng(0)
    known = np.isfinite(errors)
    errors, groups, n = errors[known], groups[known], int(known.sum())
    note = f"intervals over moments of {MOMENT} s"
    middle = grouped(errors, p50, groups, rng)
    tail = grouped(errors, p90, groups, rng)
    return [
        Measure(NAME, case, "lateral error p50", *middle, "m", n, asked, "less", note),
        Measure(NAME, case, "lateral error p90", *tail, "m", n, None, "less", note),
    ]


def _flags(walk: Walk, found: dict[str, Found]) -> list[Measure]:
    crowded = found[CROWDED]
    both, moments = both_feet(walk, crowded.rows), _moments(walk, crowded)
    measures = [
        Measure(
            NAME,
            CROWDED,
            "flagged while two feet stand on it",
            *proportion(crowded.flagged[both], moments[both]),
            "",
            int(both.sum()),
            note="by the events of the recording",
        ),
        Measure(
            NAME,
            CROWDED,
            "flagged while one foot stands on it",
            *proportion(crowded.flagged[~both], moments[~both]),
            "",
            int((~both).sum()),
            better="less",
        ),
    ]
    for plate in PLATES:
        flagged = found[plate].flagged
        measures.append(
            Measure(
                NAME,
                plate,
                "flagged although one foot stands on it",
                *proportion(flagged, _moments(walk, found[plate])),
                "",
                len(flagged),
                better="less",
            )
        )
    return measures


def _moments(walk: Walk, found: Found) -> FloatArray:
    """By sample, the moment that it depends on: an interval is over these."""
    moments: FloatArray = np.floor(walk.stamps[found.rows] / MOMENT)
    return moments


def _draw(walk: Walk, found: dict[str, Found], path: Path) -> None:
    figure = new_figure(8.0, 8.0)
    axes = figure.subplots()
    for number, (plate, found_on) in enumerate(found.items()):
        corners = walk.recording.corners[plate][[0, 1, 2, 3, 0], :2]
        axes.plot(*corners.T, color="#888888", linewidth=0.8)
        clear, flagged = found_on.places[~found_on.flagged], found_on.places[found_on.flagged]
        axes.plot(*clear.T, ".", markersize=2, color=COLOURS[number], label=f"contacts, {plate}")
        axes.plot(*flagged.T, "x", markersize=4, color="#cc0000")
        for feet in walk.feet.values():
            for foot in feet[found_on.rows[:: max(1, len(found_on.rows) // 6)]]:
                if foot[:, 2].max() < 0.07:  # standing, not swinging by
                    axes.plot(*foot[:, :2].T, color="#000000", alpha=0.25, linewidth=2)
    axes.plot([], [], "x", color="#cc0000", label="more than one contact suspected")
    axes.plot([], [], color="#000000", alpha=0.4, linewidth=2, label="foot, heel to toe marker")
    axes.set(xlabel="x [m] in 'lab'", ylabel="y [m]", aspect="equal", ylim=(-0.6, 1.1))
    axes.set_title("contacts on force plates")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize="small")
    save_figure(figure, path, dpi=120)
