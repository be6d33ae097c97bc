"""The foot of an iCub that is tipped on a plate: skin and wrench under it, each the other's truth.

No sensor is the truth. Maps, offsets and noise are learned on other runs: of the same foot, or of
the other one, mirrored. With one sensor dead from half-time on, the living one is judged by what
the dead one would have measured; with both alive, the wrench and every second taxel are judged by
the centre of the other taxels. The skin travels 0.6 of the wrench's way, as its taxels saturate and
the edges of the sole are bare: an affine map takes the wrench's centre of pressure to the skin's.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import RecordingError
from contactfusion.figures import COLOURS, new_figure
from contactfusion.frames import FrameConfig
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import CycleConfig, PipelineConfig
from contactfusion.readings import Reading, TactileImage, Wrench
from contactfusion.recordings.tables import read_columns
from contactfusion.robots.description import RobotConfig
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import Measure, grouped, p50, p90, proportion

NAME = "icub_tipping"
SOLE = "sole"
OFFSETS = {
    "left": (-52.03, -5.642, -18.09, -0.5161, 9.913, 0.7176),
    "right": (-17.50, -0.9107, 18.06, -0.8248, 3.327, -0.2529),
}
"""What the six-axis sensors read unloaded, by the robot's own calibration [N, N·m]."""
TAXELS = 384
"""Numbers in a frame of the skin; those of places without a taxel are at the origin."""
EDGE = 0.0066
"""Edge of a taxel: the distance of the nearest two [m]."""
FALLS = 5.0
"""A taxel that has fallen by less is not pressed."""
LEAST_NOISE = 0.5
"""Values are whole numbers: no taxel is believed to be quieter than half of one."""
MAD = 0.6745
"""The median of the absolute values of a Gaussian, in its standard deviations."""
BEGINS, PERIOD, BLOCK = 0.1, 0.02, 0.5
"""When the first contact is asked for, how often, and for how long errors depend on each other [s].
"""
UNLOADED = 10.0
"""The greatest force on a foot in the air [N]."""
ASKED = 0.005
"""The median error that is asked of the living sensor [m]."""
Sensor = Literal["skin", "wrench"]
Taxels = slice
EVEN, ODD, ALL = slice(0, None, 2), slice(1, None, 2), slice(None)


@dataclass(frozen=True, eq=False)
class Run:
    """One tipping of a foot.

    Attributes:
        name: that of its folder.
        side: of the foot.
        taxels: shape (t, 3), their positions [m].
        skin_stamps: shape (n,) [s].
        skin: shape (n, t), their values, falling under pressure.
        wrench_stamps: shape (m,) [s].
        wrenches: shape (m, 6), less the offsets [N, N·m].
    """

    name: str
    side: str
    taxels: FloatArray
    skin_stamps: FloatArray
    skin: FloatArray
    wrench_stamps: FloatArray
    wrenches: FloatArray

    @cached_property
    def wrench_centres(self) -> FloatArray:
        """The wrench's centres of pressure in its own frame, shape (m, 2) [m]."""
        force, torque = self.wrenches[:, :3], self.wrenches[:, 3:]
        return np.stack([-torque[:, 1], torque[:, 0]], axis=1) / force[:, 2:]

    def at_skin(self, columns: FloatArray) -> FloatArray:
        """Columns (m, k) of the wrench's samples at the stamps of the skin, shape (n, k)."""
        return np.stack(
            [np.interp(self.skin_stamps, self.wrench_stamps, each) for each in columns.T], axis=1
        )

    def mirrored(self) -> "Run":
        """As of the other foot: places change the sign of y."""
        wrenches = self.wrenches * (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)
        return replace(self, taxels=self.taxels * (1.0, -1.0, 1.0), wrenches=wrenches)


@dataclass(frozen=True, eq=False)
class Learned:
    """What other runs tell of a foot's sensors.

    Attributes:
        baseline: shape (t,), the untouched value of each taxel.
        noise: shape (t,), its standard deviation.
        gain: force on a taxel per unit of its value [N].
        spread: standard deviation of the skin's centre by axis, as halves of its taxels tell [m].
        map: shape (3, 2), from the wrench's centre of pressure, and 1, to the skin's.
        residual: standard deviation of what the map leaves, by axis [m].
        middle: shape (2,), the mean of the skin's centre [m].
    """

    baseline: FloatArray
    noise: FloatArray
    gain: float
    spread: float
    map: FloatArray
    residual: float
    middle: FloatArray

    def mapped(self, centres: FloatArray) -> FloatArray:
        """Centres of pressure of the wrench, shape (m, 2), where the skin would have them [m]."""
        return np.column_stack([centres, np.ones(len(centres))]) @ self.map


def measure(folder: Path, out: Path, method: Method) -> list[Measure]:
    """Measure where the foot is pressed, by each sensor, by both, and with one dead."""
    runs = list(read(folder))
    whole = [run for run in runs if len(run.wrenches)]
    measures = []
    figure = new_figure(11.0, 3.2 * len(whole))
    panels = figure.subplots(len(whole), 1, squeeze=False)[:, 0]
    for run, axes in zip(whole, panels, strict=True):
        tracks = dict(Trial(run, runs, method).tracks())
        case = f"{run.side} foot, {run.name}"
        for name, track in tracks.items():
            measures += track_measures(f"{case}: {name}", track)
        measures += [_compared(case, tracks), _unloaded(case, run)]
        shown = ("skin", "wrench", "wrench dead from half-time", "skin dead from half-time")
        for colour, name in zip(COLOURS, shown, strict=False):
            track = tracks[name]
            axes.plot(track.stamps, 1e3 * track.places[:, 0], color=colour, label=name)
        judge = tracks["wrench"]
        axes.plot(judge.stamps, 1e3 * judge.judge[:, 0], "k:", label="centre of all taxels")
        axes.set(title=case, xlabel="time [s]", ylabel="along the foot [mm]")
        axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    save_figure(figure, out / f"{NAME}.png")
    return measures


def read(folder: Path) -> Iterator[Run]:
    """All runs with the skin of a foot; without wrenches where those of that foot are missing.

    Raises:
        RecordingError: there is none, or a file is not what it should be.
    """
    found = False
    for side, offsets in OFFSETS.items():
        positions = _positions(folder / f"{side}_foot_taxels.txt")
        real = np.abs(positions).sum(axis=1) > 0.0
        for log in sorted(folder.glob(f"*/*/icub/skin/{side}_foot/data.log")):
            icub = log.parents[2]
            stamps, skin = _log(log, TAXELS)
            wrench = icub / f"{side}_foot" / "analog:o" / "data.log"
            heard = _log(wrench, 6) if wrench.is_file() else (np.empty(0), np.empty((0, 6)))
            start, found = stamps[0], found or wrench.is_file()
            yield Run(
                icub.parent.name, side, positions[real], stamps - start, skin[:, real],
                heard[0] - start, heard[1] - offsets,
            )  # fmt: skip
    if not found:
        raise RecordingError(f"no run under '{folder}' has skin and wrench of the same foot")


def _positions(path: Path) -> FloatArray:
    """The positions of all taxels of a file of iCub's skin, shape (384, 3) [m]."""
    if not path.is_file():
        raise RecordingError(f"there is no '{path}' with the positions of the taxels")
    _, mark, lines = path.read_text().partition("[calibration]")
    rows = [line.split() for line in lines.splitlines()]
    positions = [row[:3] for row in rows if len(row) == 6]
    if not mark or len(positions) != TAXELS:
        raise RecordingError(f"{path}: {len(positions)} positions of taxels instead of {TAXELS}")
    return np.array(positions, np.float64)


def _log(path: Path, count: int) -> tuple[FloatArray, FloatArray]:
    """Stamps, shape (n,) [s], and values, shape (n, count), of a log of YARP's data dumper."""
    columns = read_columns(path, range(2, 3 + count))
    values = np.concatenate([columns[number] for number in range(2, 3 + count)], axis=1)
    return values[:, 0], values[:, 1:]


def learned(run: Run, runs: Sequence[Run]) -> Learned:
    """What other runs tell: wrenches of the same foot, or of the other one mirrored.

    Untouched values are of the same foot in any other run: each taxel's highest.

    Raises:
        RecordingError: there is no other run.
    """
    others = [other for other in runs if other is not run]
    images = [other.skin for other in others if other.side == run.side]
    whole = [other for other in others if len(other.wrenches)]
    feet = [other for other in whole if other.side == run.side]
    feet = feet or [other.mirrored() for other in whole]
    if not images or not feet:
        raise RecordingError(f"there are no other runs to learn from what '{run.name}' needs")
    steps = np.concatenate([np.diff(image, axis=0) for image in images])
    noise = np.maximum(np.median(np.abs(steps), axis=0) / MAD / np.sqrt(2.0), LEAST_NOISE)
    pressed = [(foot, fallen(foot.skin, foot.skin.max(axis=0))) for foot in feet]
    skin = np.concatenate([centre(each, foot.taxels) for foot, each in pressed])
    halves = np.concatenate(
        [
            centre(each[:, ::2], foot.taxels[::2]) - centre(each[:, 1::2], foot.taxels[1::2])
            for foot, each in pressed
        ]
    )
    wrench = np.concatenate([foot.at_skin(foot.wrench_centres) for foot in feet])
    given = np.column_stack([wrench, np.ones(len(wrench))])
    fitted: FloatArray = np.asarray(np.linalg.lstsq(given, skin, rcond=None)[0], np.float64)
    force = sum(np.abs(foot.at_skin(foot.wrenches)[:, 2]).sum() for foot in feet)
    return Learned(
        baseline=np.max([image.max(axis=0) for image in images], axis=0),
        noise=noise,
        gain=float(force / sum(each.sum() for _, each in pressed)),
        spread=float(halves.std() / 2.0),
        map=fitted,
        residual=float((given @ fitted - skin).std()),
        middle=skin.mean(axis=0),
    )


def fallen(skin: FloatArray, baseline: FloatArray) -> FloatArray:
    """How far taxels have fallen from their untouched values, 0 where hardly, shape (n, t)."""
    depth = baseline - skin
    return np.where(depth >= FALLS, depth, 0.0)


def centre(pressures: FloatArray, taxels: FloatArray) -> FloatArray:
    """The centre of pressures (n, t) on taxels (t, 3), shape (n, 2) [m]; NaN of none."""
    total = pressures.sum(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        return np.asarray(pressures @ taxels[:, :2] / total, np.float64)


@dataclass(frozen=True, eq=False)
class Track:
    """Where a foot is pressed, and where another sensor says so.

    Attributes:
        stamps: shape (n,) [s].
        places: shape (n, 2) [m]; NaN where no contact was reported.
        covariances: shape (n, 2, 2) [m²].
        judge: shape (n, 2) [m].
        deviation: standard deviation of the judge by axis [m].
    """

    stamps: FloatArray
    places: FloatArray
    covariances: FloatArray
    judge: FloatArray
    deviation: float

    @cached_property
    def errors(self) -> FloatArray:
        """Distances of contacts from the judge, shape (n,) [m]; NaN where none was reported."""
        return np.asarray(np.linalg.norm(self.places - self.judge, axis=1))

    def within(self, share: float) -> NDArray[np.bool_]:
        """Whether the judge lies in the ellipse that should hold it that often, shape (r,)."""
        kept = np.isfinite(self.errors)
        offsets = (self.places - self.judge)[kept, :, None]
        both = self.covariances[kept] + self.deviation**2 * np.eye(2)
        squares = (offsets * np.linalg.solve(both, offsets)).sum(axis=(1, 2))
        return np.asarray(squares <= chi2.ppf(share, 2), np.bool_)

    def after(self, stamp: float) -> "Track":
        """The part after a stamp [s]."""
        late = self.stamps > stamp
        return Track(
            self.stamps[late],
            self.places[late],
            self.covariances[late],
            self.judge[late],
            self.deviation,
        )

    def joined(self, other: "Track") -> "Track":
        """This one, then another."""
        return Track(
            np.concatenate([self.stamps, other.stamps]),
            np.concatenate([self.places, other.places]),
            np.concatenate([self.covariances, other.covariances]),
            np.concatenate([self.judge, other.judge]),
            self.deviation,
        )


class Trial:
    """One run, fused in several settings.

    Args:
        run: of which the foot is located.
        runs: all; what is known of the sensors is learned on the others.
        method: how hypotheses are fused.
    """

    def __init__(self, run: Run, runs: Sequence[Run], method: Method) -> None:
        self.run, self.known, self._method = run, learned(run, runs), method
        self._pressures = fallen(run.skin, self.known.baseline)
        self._mapped = self.known.mapped(run.wrench_centres)
        self._half = run.skin_stamps[-1] / 2.0

    def tracks(self) -> Iterator[tuple[str, Track]]:
        """By the name of a setting where the foot is pressed.

        Those that begin with `every second taxel` are judged by the centre of the other taxels, and
        hold both halves, one after the other.
        """
        wrench = self._track(("wrench",))
        middle = np.broadcast_to(self.known.middle, wrench.places.shape)
        constant = replace(wrench, places=middle)
        yield "constant place", constant
        yield "constant place, aligned in the first half", self._aligned(constant)
        yield "affine map", replace(wrench, places=self._wrench_at(wrench.stamps))
        yield "wrench", wrench
        skin = self._by_wrench(self._track(("skin",)))
        yield "skin", skin
        yield "wrench, aligned in the first half", self._aligned(wrench)
        yield "skin, aligned in the first half", self._aligned(skin)
        both: tuple[Sensor, ...] = ("skin", "wrench")
        yield "wrench dead from half-time", self._by_wrench(self._dead(both, "wrench"))
        yield "skin dead from half-time", self._dead(both, "skin")
        chosen: dict[str, tuple[Sensor, ...]] = {
            "skin": ("skin",),
            "wrench": ("wrench",),
            "both": both,
        }
        for name, sensors in chosen.items():
            halves = [self._track(sensors, *pair) for pair in ((EVEN, ODD), (ODD, EVEN))]
            yield f"every second taxel, {name}", halves[0].joined(halves[1])

    def _dead(self, sensors: Sequence[Sensor], dead: Sensor) -> Track:
        return self._track(sensors, dead=dead).after(self._half)

    def _by_wrench(self, track: Track) -> Track:
        """Judged by the wrench where the map puts it."""
        return replace(track, judge=self._wrench_at(track.stamps), deviation=self.known.residual)

    def _aligned(self, track: Track) -> Track:
        """The second half, less the median of what the sensors differ by in the first."""
        first = track.stamps <= self._half
        shift = np.nanmedian((track.places - track.judge)[first], axis=0)
        return replace(track, places=track.places - shift).after(self._half)

    def _wrench_at(self, stamps: FloatArray) -> FloatArray:
        return interpolated(stamps, self.run.wrench_stamps, self._mapped)

    def _track(
        self,
        sensors: Sequence[Sensor],
        taxels: Taxels = ALL,
        judges: Taxels = ALL,
        dead: Sensor | None = None,
    ) -> Track:
        """Where the pipeline finds the foot pressed, judged by the centre of some taxels.

        Args:
            sensors: that the pipeline has.
            taxels: those that it has of the skin.
            judges: those that judge.
            dead: the sensor that falls silent at half-time.
        """
        pipeline, known = Pipeline(self._config(sensors, taxels)), self.known
        stamps, places, covariances = [], [], []
        for step in pipeline.run(self._readings(sensors, taxels, dead)):
            contacts = step.fusion.contacts
            stamps.append(step.stamp)
            places.append(centre_of(contacts))
            covariances.append(contacts[0].covariance[:2, :2] if contacts else np.eye(2))
        found = np.arange(BEGINS, self.run.skin_stamps[-1], PERIOD)
        latest = np.maximum(np.searchsorted(stamps, found, side="right") - 1, 0)
        centres = centre(self._pressures[:, judges], self.run.taxels[judges])
        judge = interpolated(found, self.run.skin_stamps, centres)
        deviation = known.spread if judges == ALL else known.spread * np.sqrt(2.0)
        located, unsure = np.array(places)[latest], np.array(covariances)[latest]
        return Track(found, located, unsure, judge, deviation)

    def _readings(
        self, sensors: Sequence[Sensor], taxels: Taxels, dead: Sensor | None
    ) -> Iterator[Reading]:
        """The readings of sensors in the order of their stamps."""
        run, readings = self.run, list[Reading]()
        if "skin" in sensors:
            for stamp, values in zip(run.skin_stamps.tolist(), run.skin, strict=True):
                taken = values[taxels]
                readings.append(TactileImage(stamp=stamp, frame=SOLE, sensor="skin", values=taken))
        if "wrench" in sensors:
            height = run.taxels[0, 2]
            levers = np.column_stack([self._mapped, np.full(len(self._mapped), height)])
            torques = np.cross(levers, run.wrenches[:, :3])
            for stamp, force, torque in zip(
                run.wrench_stamps.tolist(), run.wrenches[:, :3], torques, strict=True
            ):
                readings.append(
                    Wrench(stamp=stamp, frame=SOLE, sensor="wrench", force=force, torque=torque)
                )
        readings.sort(key=lambda reading: reading.stamp)
        for reading in readings:
            if reading.stamp >= 0.0 and not (reading.sensor == dead and reading.stamp > self._half):
                yield reading

    def _config(self, sensors: Sequence[Sensor], taxels: Taxels) -> PipelineConfig:
        """The pipeline: what is stated of its sensors was learned on other runs."""
        known, run = self.known, self.run
        weight = float(np.median(np.abs(run.wrenches[:, 2])))
        generators = {
            "skin": {
                "type": "tactile",
                "patch": {"places": run.taxels[taxels].tolist(), "size": (EDGE, EDGE)},
                "baseline": {
                    "values": known.baseline[taxels].tolist(),
                    "noise": known.noise[taxels].tolist(),
                    "touch": "falls",
                },
                "gain": known.gain * len(run.taxels) / len(run.taxels[taxels]),
                "noise": known.spread,
            },
            "wrench": {
                "type": "force_torque",
                "sign": "on_robot",
                "torque_noise": known.residual * weight,
            },
        }
        return PipelineConfig(
            robot=RobotConfig(urdf=f"{__package__}:icub_foot.urdf"),
            frames={SOLE: FrameConfig(parent="world")},
            generators={name: generators[name] for name in sensors},
            integrator=self._method.applied(IntegratorConfig(frame=SOLE)),
            cycle=CycleConfig(every=PERIOD),
        )


def centre_of(contacts: Sequence[Contact]) -> FloatArray:
    """The centre of pressure of contacts on the sole, shape (2,) [m]; NaN of none."""
    if not contacts:
        return np.full(2, np.nan)
    forces = np.array([np.linalg.norm(contact.force) for contact in contacts])
    if len(contacts) == 1 or not np.isfinite(forces).all():
        return contacts[0].position[:2]
    places = np.array([contact.position[:2] for contact in contacts])
    return np.asarray(forces @ places / forces.sum(), np.float64)


def interpolated(stamps: FloatArray, given: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns (m, k) at other stamps (n,), shape (n, k)."""
    return np.stack([np.interp(stamps, given, each) for each in columns.T], axis=1)


def track_measures(case: str, track: Track) -> list[Measure]:
    """How far contacts lie from the judge, how often they are reported, and what they state."""
    rng, errors = np.random.default_rng(0), track.errors
    known = np.isfinite(errors)
    n, asked = int(known.sum()), ASKED if "dead" in case else None
    blocks, note = np.floor(track.stamps / BLOCK), f"intervals over blocks of {BLOCK} s"
    reported = proportion(known, blocks)
    measures = [Measure(NAME, case, "contact reported", *reported, "", len(errors), note=note)]
    if not n:
        return measures
    groups = blocks[known]
    for metric, statistic, least in (("p50", p50, asked), ("p90", p90, None)):
        figures = grouped(errors[known], statistic, groups, rng)
        measures.append(
            Measure(NAME, case, f"error {metric}", *figures, "m", n, least, "less", note)
        )
    for share in (0.68, 0.95):
        figures = proportion(track.within(share), groups)
        metric = f"judge within {share:.0%} ellipse"
        measures.append(Measure(NAME, case, metric, *figures, "", n, note=note))
    return measures


def _compared(case: str, tracks: Mapping[str, Track]) -> Measure:
    """The median error of both sensors less that of the better one, by the other taxels."""
    named = {name: tracks[f"every second taxel, {name}"] for name in ("skin", "wrench", "both")}
    errors = np.stack([track.errors for track in named.values()], axis=1)
    known = np.isfinite(errors).all(axis=1)
    best = int(np.median(errors[known, :2], axis=0).argmin())
    groups = np.floor(named["both"].stamps[known] / BLOCK)
    figures = grouped(
        errors[known],
        lambda drawn: float(np.median(drawn[:, 2]) - np.median(drawn[:, best])),
        groups,
        np.random.default_rng(0),
    )
    note = "worse if the interval lies above 0"
    metric = f"both, median error beyond that of the {[*named][best]} alone"
    return Measure(NAME, case, metric, *figures, "m", int(known.sum()), None, "less", note)


def _unloaded(case: str, run: Run) -> Measure:
    """For how long the foot was in the air, where a contact would be an alarm [s]."""
    light = np.linalg.norm(run.wrenches[:, :3], axis=1) < UNLOADED
    seconds = float(np.diff(run.wrench_stamps)[light[1:]].sum())
    note = f"force under {UNLOADED:g} N; alarms can be counted only there"
    return Measure(NAME, case, "in the air", seconds, seconds, seconds, "s", len(light), note=note)
