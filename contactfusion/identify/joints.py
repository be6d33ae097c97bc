"""Identification of what joints report: offset, current constant, friction, payload, by regression.

In each window c (e − o) = τ + Y π + Z μ + f tanh(q'/SLOW) + v q': c is the constant of a joint, e
what it reports, o its offset, τ the torque of motion and gravity by the URDF, π the payload, μ what
the links weigh beside their masses in the URDF, which are believed to be about right, f and v its
Coulomb and viscous friction. Residuals are those of e, whose noise is what windows leave; Huber's
weights spare a few outliers, and standard errors allow for residuals that hang together for a
second (a sandwich over clusters, Liang & Zeger 1986).
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.generators.external_torque import SLOW, Effort
from contactfusion.identify.windows import WIDTH, Windows, spans
from contactfusion.robots.description import EffortConfig

FIELDS = ("offset", "constant", "coulomb", "viscous")
FAST = 5.0 * SLOW
"""A joint above this speed moves [rad/s, m/s]."""
MOVED = 0.5
"""A joint moves in a direction if it does so for this time [s]."""
SHARE = 0.1
"""A parameter is separable from the others by at least this share of what it explains."""
WRONG = 0.1
"""The greatest standard error of a constant and of a payload's mass, as a share of it."""
CENTRED = 0.02
"""The greatest standard error of a payload's centre of mass [m]."""
HEAVY = 0.05
"""What weighs less is no payload [kg]."""
SURE = 3.0
"""Standard errors by which a payload differs from none."""
CLUSTER = round(1.0 / WIDTH)
"""Windows whose residuals hang together."""
HUBER = 1.345
"""Residuals above so many standard deviations weigh less (Huber 1964)."""
ROUNDS = 10
"""Steps of Gauss and Newton; weights follow with each."""
FLOOR = 1e-3
"""Residuals are never taken to be smaller than this share of an effort's spread."""
RIDGE = 1e-10
"""Keeps what nothing excites at its start, with a standard error beyond all bounds."""
PRESSED = 6.0
"""A residual that exceeds its noise so many times, ..."""
LASTING = 0.3
"""... for so long and to one side, is that of a contact [s]."""
APART = 0.5
"""Contacts that are nearer than this are one [s]."""
Mask = NDArray[np.bool_]


@dataclass
class Choice:
    """What is identifiable of joints and payload, and why the rest is not.

    Attributes:
        identifiable: which of `FIELDS` of each joint, shape (k, 4); the others stay as configured.
        payload: which of mass and first moments, shape (4,).
        kept: a sentence on each that stays as configured.
    """

    identifiable: Mask
    payload: Mask
    kept: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters with standard errors.

    Attributes:
        joints: `FIELDS` of each joint, shape (k, 4).
        errors: their standard errors, shape (k, 4); 0 where the configured value stays.
        payload: mass [kg] and first moments [kg·m], shape (4,).
        payload_errors: their standard errors, shape (4,); 0 where configured values stay.
        masses: mass [kg] and first moments [kg·m] of links beside those of the URDF, shape (4 l,).
        deviations: robust standard deviation of residuals by joint, shape (k,), in its own unit.
        residuals: by window and joint, in such deviations, shape (w, k).
    """

    joints: FloatArray
    errors: FloatArray
    payload: FloatArray
    payload_errors: FloatArray
    masses: FloatArray
    deviations: FloatArray
    residuals: FloatArray


class _Line(NamedTuple):
    """The regression, linear about some values.

    Attributes:
        residuals: in deviations, shape (w, k).
        deviations: robust, by joint, shape (k,).
        scores: weighted residuals times their slopes, of each window that counts, shape (u, p).
        inverse: of the curvature, shape (p, p).
    """

    residuals: FloatArray
    deviations: FloatArray
    scores: FloatArray
    inverse: FloatArray


class Regression:
    """The equation of motion of the joints of one generator.

    Args:
        windows: the motion.
        configured: what is known of the efforts of the joints, by name.
        effort: what they report.
        payload: mass [kg] and first moments [kg·m] that are configured, shape (4,).
        believed: standard deviations of what links weigh beside the URDF, shape (4 l,).
    """

    def __init__(
        self,
        windows: Windows,
        configured: dict[str, EffortConfig],
        effort: Effort,
        payload: FloatArray,
        believed: FloatArray,
    ) -> None:
        self.windows, self.names, self.effort = windows, tuple(configured), effort
        self.configured = np.array(
            [
                [each.offset, each.per_unit, each.coulomb, each.viscous]
                for each in configured.values()
            ]
        )
        self.payload, self._believed = payload, believed
        self._floor = FLOOR * np.maximum(windows.efforts.std(axis=0), 1e-9)

    def choice(self, used: Mask) -> Choice:
        """What directions, speeds and loads of the motion can tell.

        Args:
            used: the windows that count, shape (w,).
        """
        identifiable = np.zeros(self.configured.shape, np.bool_)
        identifiable[:, 0] = True
        if self.effort == "external":
            return Choice(identifiable, np.zeros(4, np.bool_))
        identifiable[:, 1], identifiable[:, 2:] = self.effort == "current", True
        choice = Choice(identifiable, np.ones(4, np.bool_))
        for joint in range(len(self.names)):
            choice.kept += self._unidentifiable(joint, used, identifiable[joint])
        return choice

    def _unidentifiable(self, joint: int, used: Mask, identifiable: Mask) -> list[str]:
        """Mark what is not identifiable of a joint, in place; a sentence on each reason."""
        windows, name, kept = self.windows, self.names[joint], list[str]()
        speeds, sliding = windows.velocities[used, joint], windows.sliding[used, joint]
        forward, back = (self.windows.width * np.sum(side > FAST) for side in (speeds, -speeds))
        if forward + back < 2.0 * MOVED:
            identifiable[:] = False
            return [f"{name} hardly moved: all that it bears may be friction at rest"]
        if min(forward, back) < MOVED:
            identifiable[[0, 2]] = False
            kept.append(f"{name} moved in one direction: offset and Coulomb friction look alike")
        if _share(speeds, sliding) < SHARE:
            identifiable[3] = False
            kept.append(f"{name} kept one speed: viscous and Coulomb friction look alike")
        slope, share = self._slope(joint, used)
        if slope < 0.0 and share > SHARE:
            identifiable[:] = False
            kept.append(f"{name} reports less as its torque rises: is its sign reversed?")
        elif identifiable[1] and share < SHARE:
            identifiable[1] = False
            kept.append(
                f"{name} bore too little of gravity and inertia: they are {100 * share:.0f} % of "
                "its current, which tell no constant"
            )
        return kept

    def slopes(self, used: Mask) -> dict[str, tuple[float, float]]:
        """Of each joint that bears a torque: effort per torque, and the share that torque explains.

        Args:
            used: the windows that count, shape (w,).
        """
        found = {name: self._slope(joint, used) for joint, name in enumerate(self.names)}
        return {name: slope for name, slope in found.items() if slope[1] > SHARE}

    def _slope(self, joint: int, used: Mask) -> tuple[float, float]:
        """Effort per torque, and the share of the effort that torque alone explains."""
        windows = self.windows
        efforts, ones = windows.efforts[used, joint], np.ones(used.sum())
        others = np.column_stack(
            [ones, windows.sliding[used, joint], windows.velocities[used, joint]]
        )
        torques = self._torques(self.payload)[used, joint]
        slope = np.linalg.lstsq(np.column_stack([others, torques]), efforts, rcond=None)[0][-1]
        alone = torques - others @ np.linalg.lstsq(others, torques, rcond=None)[0]
        return float(slope), float(abs(slope) * alone.std() / max(efforts.std(), 1e-12))

    def _torques(self, payload: FloatArray, masses: FloatArray | None = None) -> FloatArray:
        """The torques of motion and gravity with a payload, and other masses, shape (w, k)."""
        torques = self.windows.torques + self.windows.payload @ point_mass(payload)
        return np.asarray(torques if masses is None else torques + self.windows.masses @ masses)

    def whole(self, choice: Choice, used: Mask) -> Fit:
        """The fit of joints and payload, then of joints and links that carry it.

        A payload and the links look alike: what a payload explains is no other mass of a link.
        """
        first = self.fit(choice, used)
        second = self.fit(choice, used, first.payload) if len(self._believed) else first
        return replace(second, payload_errors=first.payload_errors)

    def fit(self, choice: Choice, used: Mask, held: FloatArray | None = None) -> Fit:
        """Estimate what is identifiable; other offsets are estimated only so as not to disturb.

        Args:
            choice: what is identifiable.
            used: the windows that count, shape (w,).
            held: a payload that stays while the links' masses are estimated, shape (4,); None: it
                is estimated, and the links weigh what they do in the URDF.
        """
        free = choice.identifiable.copy()
        free[:, 0] = True
        masses, weighs = np.zeros(len(self._believed)), held is not None
        columns = np.r_[free.ravel(), choice.payload & (not weighs), np.full(len(masses), weighs)]
        prior = np.r_[np.zeros(free.size + 4), self._believed**-2.0]
        joints = self.configured.copy()
        payload = (self.payload if held is None else held).copy()
        joints[:, 1] = 1.0 / joints[:, 1]  # effort per torque: residuals are linear in it
        for joint in np.flatnonzero(free[:, 1]).tolist():
            joints[joint, 1] = self._slope(joint, used)[0]
        for _ in range(ROUNDS):
            line = self._linearised(joints, payload, masses, columns, used, prior)
            pulled = prior * np.r_[np.zeros(free.size + 4), masses]
            step = np.zeros(len(columns))
            step[columns] = line.inverse @ (line.scores.sum(axis=0) - pulled[columns])
            joints = joints + step[: joints.size].reshape(joints.shape)
            payload = payload + step[joints.size : joints.size + 4]
            masses = masses + step[joints.size + 4 :]
        line = self._linearised(joints, payload, masses, columns, used, prior)
        clusters = np.add.reduceat(line.scores, np.arange(0, used.sum(), CLUSTER))
        spare = len(clusters) / max(len(clusters) - 1, 1)
        sandwich = line.inverse @ (clusters.T @ clusters) @ line.inverse * spare
        errors = np.zeros(len(columns))
        errors[columns] = np.sqrt(np.maximum(np.diag(sandwich), np.diag(line.inverse)))
        by_joint, of_payload = errors[: joints.size], errors[joints.size : joints.size + 4]
        slope, by_joint = joints[:, 1].copy(), by_joint.reshape(joints.shape)
        joints[:, 1], by_joint[:, 1] = 1.0 / slope, by_joint[:, 1] / slope**2
        return Fit(joints, by_joint, payload, of_payload, masses, line.deviations, line.residuals)

    def _linearised(
        self,
        joints: FloatArray,
        payload: FloatArray,
        masses: FloatArray,
        columns: Mask,
        used: Mask,
        prior: FloatArray,
    ) -> "_Line":
        """Residuals at some values, weighted, and how they change with the free parameters.

        Args:
            joints: offset, effort per torque, Coulomb and viscous friction, shape (k, 4).
            payload: mass and first moments, shape (4,).
            masses: those of links beside the URDF, shape (4 l,).
            columns: which of all these are free, shape (4 k + 4 + 4 l,).
            used: the windows that count, shape (w,).
            prior: one over the variance that each of these is believed to have, shape as columns.
        """
        windows, count = self.windows, len(self.names)
        offset, slope, coulomb, viscous = joints.T
        torques = self._torques(payload, masses)
        torques += coulomb * windows.sliding + viscous * windows.velocities
        residuals = windows.efforts - offset - slope * torques
        robust = 1.4826 * np.median(np.abs(residuals[used]), axis=0)
        deviations = np.maximum(robust, self._floor)
        resting = slope * coulomb * windows.sticking
        scales = np.sqrt(deviations**2 + resting**2 / 3.0)
        residuals = residuals / scales
        weights = np.minimum(1.0, HUBER / np.maximum(np.abs(residuals[used]), 1e-9))
        slopes = np.zeros((used.sum(), count, len(columns)))
        first = 4 * np.arange(count)
        slopes[:, np.arange(count), first] = 1.0
        slopes[:, np.arange(count), first + 1] = torques[used]
        slopes[:, np.arange(count), first + 2] = slope * windows.sliding[used]
        slopes[:, np.arange(count), first + 3] = slope * windows.velocities[used]
        loads = windows.payload[used] @ point_mass_slopes(payload)
        weighed = np.concatenate([loads, windows.masses[used]], axis=2)
        slopes[:, :, 4 * count :] = slope[:, None] * weighed
        slopes = slopes[:, :, columns] / scales[used][:, :, None]
        scores = np.sum(slopes * (weights * residuals[used])[:, :, None], axis=1)
        weighted = np.reshape(slopes * weights[:, :, None], (-1, slopes.shape[2]))
        curvature = weighted.T @ slopes.reshape(weighted.shape)
        curvature += np.diag(prior[columns])
        size = np.sqrt(np.maximum(np.diag(curvature), 1e-30))
        inverse = np.linalg.inv(curvature / np.outer(size, size) + RIDGE * np.eye(len(size)))
        return _Line(residuals, deviations, scores, inverse / np.outer(size, size))

    def identified(self, used: Mask) -> tuple[Choice, Fit]:
        """The fit of all that is identifiable, by the kind of motion and by standard errors."""
        choice = self.choice(used)
        while True:
            fit = self.fit(choice, used)
            before = len(choice.kept)
            self._drop(choice, fit, used)
            if len(choice.kept) == before:
                return choice, self.whole(choice, used)

    def _drop(self, choice: Choice, fit: Fit, used: Mask) -> None:
        """Keep as configured what has too large a standard error."""
        noise = fit.deviations * fit.joints[:, 1]
        fastest = np.abs(self.windows.velocities[used]).max(axis=0)
        _, constant, coulomb, viscous = np.abs(fit.joints.T)
        most = np.stack(
            [
                fit.deviations,
                WRONG * constant,
                np.maximum(noise, WRONG * coulomb),
                np.maximum(noise / np.maximum(fastest, FAST), WRONG * viscous),
            ],
            axis=1,
        )
        for joint, number in zip(
            *np.nonzero(choice.identifiable & (fit.errors > most)), strict=True
        ):
            choice.identifiable[joint, number] = False
            choice.kept.append(
                f"{self.names[joint]} leaves its {FIELDS[number]} open: "
                f"{fit.joints[joint, number]:.3g} ± {fit.errors[joint, number]:.2g}"
            )
        self._drop_payload(choice, fit)

    def _drop_payload(self, choice: Choice, fit: Fit) -> None:
        mass, error = fit.payload[0], fit.payload_errors[0]
        if not choice.payload[0]:
            return
        if error > max(HEAVY / 2.0, WRONG * abs(mass)):
            choice.payload[:] = False
            choice.kept.append(f"the payload stays open: {mass:.2f} ± {error:.2g} kg")
        elif mass < max(HEAVY, SURE * error):
            choice.payload[:] = False
            self.payload = np.zeros(4)
            lighter = mass < -max(HEAVY, SURE * error)
            choice.kept.append(
                f"there is no payload: {mass:.3f} ± {error:.2g} kg"
                + (", the last link is lighter than in the URDF" if lighter else "")
            )
        for axis, name in enumerate("xyz", 1):
            if choice.payload[axis] and fit.payload_errors[axis] > CENTRED * max(mass, HEAVY):
                choice.payload[axis] = False
                choice.kept.append(
                    f"the payload's centre along {name} stays open: the wrist never tilted enough"
                )

    def left_by(self, efforts: FloatArray, payload: FloatArray, used: Mask) -> float:
        """What other efforts, shape (w, k), would leave unexplained: mean logarithm by joint."""
        windows, logs = self.windows, []
        torques = self._torques(payload)
        for joint in range(len(self.names)):
            held = (windows.sliding[:, joint], windows.velocities[:, joint], torques[:, joint])
            columns = np.column_stack([np.ones(used.sum()), *(column[used] for column in held)])
            wanted = efforts[used, joint]
            left = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
            logs.append(np.log(max(float(left.std()), float(self._floor[joint]))))
        return float(np.mean(logs))

    def contacts(self, fit: Fit) -> list[tuple[float, float, tuple[str, ...]]]:
        """When residuals are not those of free motion: begin and end [s], and the joints."""
        found, width = [], self.windows.width
        for joint, name in enumerate(self.names):
            for side in (fit.residuals[:, joint], -fit.residuals[:, joint]):
                for begin, end in spans(self.windows.stamps, side > PRESSED, LASTING - width):
                    found.append((begin - width / 2.0, end + width / 2.0, (name,)))
        joined: list[tuple[float, float, tuple[str, ...]]] = []
        for begin, end, names in sorted(found):
            if joined and begin < joined[-1][1] + APART:
                first, last, before = joined[-1]
                joined[-1] = first, max(last, end), tuple(dict.fromkeys((*before, *names)))
            else:
                joined.append((begin, end, names))
        return joined


def point_mass(payload: FloatArray) -> FloatArray:
    """Inertial parameters of a point mass, shape (10,), by mass and first moments, (4,).

    What is lighter than a payload has no inertia about the link's origin.
    """
    mass, moments = payload[0], payload[1:]
    return np.array([mass, *moments, *_inertia(moments, moments) / (2.0 * max(mass, HEAVY))])


def point_mass_slopes(payload: FloatArray) -> FloatArray:
    """The derivatives of `point_mass` by mass and first moments, shape (10, 4)."""
    mass, moments = payload[0], payload[1:]
    slopes = np.zeros((10, 4))
    slopes[:4] = np.eye(4)
    if mass > HEAVY:
        slopes[4:, 0] = -_inertia(moments, moments) / (2.0 * mass**2)
    for axis, unit in enumerate(np.eye(3)):
        slopes[4:, 1 + axis] = _inertia(moments, unit) / max(mass, HEAVY)
    return slopes


def _inertia(first: FloatArray, second: FloatArray) -> FloatArray:
    """The symmetric form 2 a·b I − a bᵀ − b aᵀ, its xx, xy, yy, xz, yz and zz, shape (6,)."""
    crossed = np.outer(first, second)
    whole = 2.0 * np.trace(crossed) * np.eye(3) - crossed - crossed.T
    return np.asarray(whole[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])


def _share(column: FloatArray, other: FloatArray) -> float:
    """The share of a column that another one and a constant do not explain."""
    others = np.column_stack([np.ones(len(other)), other])
    left = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
    return float(np.linalg.norm(left)) / max(float(np.linalg.norm(column)), 1e-12)
