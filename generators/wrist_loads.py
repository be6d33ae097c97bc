"""What joints bear of contacts whose sum another sensor measures, as one at a wrist does."""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import inverse
from contactfusion.hypotheses import Resultant
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.posed import PosedRobot

LONGEST = 0.25
"""Torques are kept for as long [s]; no resultant is older."""
ROUNDING = 1e-6
"""Stamps that are this near are the same [s]."""
SILENT = 16.8
"""A wrench of a smaller square, in its deviations, may be that of no contact: 99 of 100 are."""


class Left(NamedTuple):
    """The torques of contacts that no other sensor measures.

    Attributes:
        torques: shape (n,) [N·m, N].
        deviations: shape (n,), their standard deviations; infinite where a joint may bear anything.
        measured: the links that they do not speak of.
        is_shared: whether another sensor measures a contact, too.
    """

    torques: FloatArray
    deviations: FloatArray
    measured: frozenset[str]
    is_shared: bool


class WristLoads:
    """Takes them off the torques of all contacts, as late as these are known.

    Args:
        dynamics: of the robot.
        felt: which joints feel a force on each link, shape (links, n).
        scale: standard deviation of torques, as a part of them.
    """

    def __init__(self, dynamics: Dynamics, felt: NDArray[np.bool_], scale: float) -> None:
        self._dynamics, self._felt, self._scale = dynamics, felt, scale
        self.reset()

    def reset(self) -> None:
        """Begin again, as the observer does."""
        self._lagging: dict[str, tuple[FloatArray, FloatArray]] = {}
        self._torques: deque[tuple[float, FloatArray]] = deque()

    def left(
        self,
        robot: PosedRobot,
        stamp: float,
        resultants: Mapping[str, Resultant],
        ages: Mapping[str, float],
        torques: FloatArray,
        deviations: FloatArray,
        share: float,
    ) -> Left:
        """What is left of the torques of all contacts.

        Args:
            robot: with its joints where they were measured.
            stamp: when that was [s].
            resultants: by sensor; of several on the same links the steadiest counts, and one on a
                part of another's links is in that already.
            ages: how long before the torques they were measured [s].
            torques: shape (n,), of all contacts [N·m, N].
            deviations: shape (n,), their standard deviations.
            share: the part of a sudden change that they took up since the last call.
        """
        squares, measured, is_shared = deviations**2, set[str](), False
        if self._torques and stamp < self._torques[-1][0]:
            self._torques.clear()
        self._torques.append((stamp, torques))
        while stamp - self._torques[0][0] > LONGEST:
            self._torques.popleft()
        lagging: dict[str, tuple[FloatArray, FloatArray]] = {}
        linear, angular = self._dynamics.axes(robot.positions)
        for name, wrench in self._wholes(resultants).items():
            felt = self._felt_of(wrench)
            loads = felt.all(axis=0)
            measured.update(wrench.links)
            squares = np.where(felt.any(axis=0) & ~loads, np.inf, squares)  # between its contacts
            squared = wrench.force @ wrench.force / wrench.force_deviation**2
            squared += wrench.torque @ wrench.torque / wrench.torque_deviation**2
            is_shared = is_shared or bool(squared >= SILENT)
            at_root = wrench.moved(inverse(robot.base))
            by_force = linear + np.cross(angular, at_root.origin)
            load = loads * (by_force @ at_root.force + angular @ at_root.torque)
            # what the torques have taken up since the wrench was measured may be of its contacts
            risen = torques - self._torques_at(stamp - ages.get(name, 0.0))
            squares = squares + loads * (
                np.square(by_force).sum(axis=1) * at_root.force_deviation**2
                + np.square(angular).sum(axis=1) * at_root.torque_deviation**2
                + (self._scale * load) ** 2
                + np.square(risen)
            )
            # the torques may or may not hold yet what a sensor measures that is new itself
            before, doubt = self._lagging.get(name, (0.5 * load, 0.5 * load))
            lagging[name] = before + share * (load - before), doubt * (1.0 - share)
        self._lagging = lagging
        for load, doubt in lagging.values():
            torques, squares = torques - load, squares + doubt**2
        return Left(torques, np.sqrt(squares), frozenset(measured), is_shared)

    def _torques_at(self, stamp: float) -> FloatArray:
        """The torques of all contacts at a stamp [s], or just before it, shape (n,)."""
        older = (kept for at, kept in reversed(self._torques) if at <= stamp + ROUNDING)
        return next(older, self._torques[0][1])

    def _felt_of(self, wrench: Resultant) -> NDArray[np.bool_]:
        """Which joints feel a force on each link that a sensor carries, shape (l, n)."""
        names = self._dynamics.model.link_names
        return self._felt[[names.index(link) for link in wrench.links]]

    def _wholes(self, resultants: Mapping[str, Resultant]) -> Mapping[str, Resultant]:
        """Those that a joint feels whole, unlike one under the base; none is a part of another."""
        found: dict[frozenset[str], str] = {}
        for name in sorted(resultants, key=lambda name: (resultants[name].force_deviation, name)):
            wrench = resultants[name]
            if wrench.links and self._felt_of(wrench).all(axis=0).any():
                found.setdefault(frozenset(wrench.links), name)
        return {
            name: resultants[name]
            for links, name in found.items()
            if not any(links < others for others in found)
        }
