"""The identification of one `joint_torque` generator from a recording."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RecordingError
from contactfusion.frames import points_in
from contactfusion.generators.external_torque import ExternalTorque
from contactfusion.generators.joint_torque import JointTorqueConfig
from contactfusion.identify.joints import FAST, FIELDS, Choice, Fit, Mask, Regression
from contactfusion.identify.recorded import Motion, Recorded
from contactfusion.identify.report import Identification, plain, stated, table
from contactfusion.identify.windows import WIDTH, plateaus, windows_of
from contactfusion.robots.description import EffortConfig, LinkMassConfig, PayloadConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel

SETTLED = 5.0
"""The observer has settled after so many times its lag."""
FOLD = 1.0
"""Parts of a recording that are held out in turn last at least so long [s]."""
OUTLIER = 6.0
"""Residuals beyond so many robust standard deviations are not noise."""
RESTING = 0.1
"""A joint moves where friction is uncertain by less than this share of the most."""
LEAST_NOISE = 1e-6
"""[N·m, N]"""
ASTRAY = 0.3
"""Velocities may differ from those of positions by such a share."""
LAGS = tuple(range(-20, 21))
"""Delays of efforts that are tried, in rows of windows."""
LIGHTEST = 0.1
"""The least share of a link's mass that is believed."""
MASS, CENTRE = 0.1, 0.01
"""Standard deviation of the mass of a link, as a share of it, and of its centre of mass [m]: how
far the URDF is trusted."""
LATE = 2
"""A delay of fewer rows does no harm, ..."""
BETTER = 0.8
"""... and one counts where it leaves less than this share of the residuals."""
SEVERAL = 2
"""Number of joints that tell of a convention: a single one may be wired in reverse."""
WEIGHS, SIZED = 0.5, 2.0
"""Least share of an effort that weight and motion explain, and the greatest ratio of both, by which
it is their torque."""
Spans = Sequence[tuple[float, float]]


class Arm:
    """The joints of one generator."""

    def __init__(self, recorded: Recorded, name: str, config: JointTorqueConfig) -> None:
        assert recorded.model is not None
        self.name, self.config, self.recorded = name, config, recorded
        self.model: RobotModel = recorded.model
        self.motion: Motion = recorded.motions[name]
        self.joints = dict(config.joints)
        self.names = tuple(self.joints)
        self.numbers = np.array([self.model.joint_names.index(each) for each in self.names])
        self._side = -1.0 if config.sign == "by_robot" else 1.0
        self.efforts = self._side * self.motion.efforts(self.names)
        if dead := [self.names[row] for row in np.flatnonzero(~self.efforts.any(axis=0))]:
            raise RecordingError(
                f"generators.{name}: the efforts of {', '.join(dead)} are zero throughout; its "
                "driver does not report them"
            )

    def identify(self, found: Identification) -> None:
        """Add what is identified to the report and to the fields."""
        dynamics, effort = Dynamics(self.model), self.config.effort
        link = None if effort == "external" else self._last_link(dynamics)
        links = self._weighed(dynamics) if link else []
        windows = windows_of(
            self.motion, self.efforts, dynamics, self.numbers, link, links, LAGS if link else ()
        )
        weights = np.array([self.model.mass_of(name)[0] for name in links])
        believed = np.outer(weights, [MASS, *3 * (CENTRE,)]).ravel()
        joints = {
            name: each.model_copy(update={"offset": self._side * each.offset})
            for name, each in self.joints.items()
        }
        regression = Regression(windows, joints, effort, self._configured_payload(link), believed)
        saturated = list(self._saturated(found))
        used = outside(windows.stamps, saturated)
        if effort == "external":
            self._require_external(dynamics, used)
        else:
            self._require_sign(regression, used)
        choice, fit = regression.identified(used)
        touched = regression.contacts(fit)
        if touched:
            used &= outside(windows.stamps, [(begin, end) for begin, end, _ in touched])
            choice, fit = regression.identified(used)
        for begin, end, names in touched:
            found.warnings.append(
                f"{self.name}: from {begin:.1f} to {end:.1f} s the residual of {', '.join(names)} "
                "stays on one side: something may have touched; these seconds are left out"
            )
        if link and (late := self._late(regression, fit.payload, used)):
            found.warnings.append(
                f"{self.name}: its efforts come {abs(late) * 1e3:.0f} ms "
                f"{'after' if late > 0 else 'before'} its positions: are both stamped when they "
                "are measured?"
            )
        found.warnings += self._strange_velocities()
        spans = [*saturated, *((begin, end) for begin, end, _ in touched)]
        noise = self._noise(regression, choice, used, spans, link, links)
        self._report(found, choice, fit, noise, link)
        masses = self._masses(fit, links)
        if masses:
            changes = [
                each.mass / self.model.mass_of(name)[0] - 1.0 for name, each in masses.items()
            ]
            found.lines.append(
                f"masses of {len(masses)} links: the URDF's, changed by up to "
                f"{100.0 * max(map(abs, changes)):.1f} %; only what loads the joints "
                "is identifiable"
            )
        self._carry(found, choice, fit, masses, link)
        if masses:
            held = found.fields["robot"].setdefault("masses", {})
            held.update({name: plain(each) for name, each in masses.items()})

    def _carry(
        self,
        found: Identification,
        choice: Choice,
        fit: Fit,
        masses: dict[str, LinkMassConfig],
        link: str | None,
    ) -> None:
        """Put the payload into the fields; a second one is added to the mass of its link."""
        robot, payload = found.fields["robot"], self._values(choice, fit, link)[1]
        if choice.payload[0] and payload is not None:
            found.lines += self._of_payload(choice, fit, payload)
            if robot.get("payload", {}).get("mass", 0.0) == 0.0:
                robot["payload"] = plain(payload)
                return
            own = masses.get(payload.frame)
            mass, centre = self.model.mass_of(payload.frame)
            if own is not None:
                mass, centre = own.mass, np.array(own.centre_of_mass)
            heavier = mass + payload.mass
            x, y, z = (
                (mass * centre + payload.mass * np.array(payload.centre_of_mass)) / heavier
            ).tolist()
            masses[payload.frame] = LinkMassConfig(mass=heavier, centre_of_mass=(x, y, z))
        elif self._configured_payload(link)[0] > 0.0 and fit.payload[0] == 0.0:
            robot.setdefault("payload", {"frame": link, "mass": 0.0})

    def _masses(self, fit: Fit, links: Sequence[str]) -> dict[str, LinkMassConfig]:
        """The masses of links as a fit has them."""
        found = {}
        for name, (more, *moments) in zip(links, fit.masses.reshape(-1, 4).tolist(), strict=True):
            mass, centre = self.model.mass_of(name)
            heavier = max(mass + more, LIGHTEST * mass)
            x, y, z = ((mass * centre + moments) / heavier).tolist()
            found[name] = LinkMassConfig(mass=heavier, centre_of_mass=(x, y, z))
        return found

    def _weighed(self, dynamics: Dynamics) -> list[str]:
        """The links with a mass that the joints move."""
        moved = np.flatnonzero(dynamics.supports[:, self.numbers].any(axis=1)).tolist()
        names = [self.model.link_names[row] for row in moved]
        return [name for name in names if self.model.mass_of(name)[0] > 0.0]

    def _strange_velocities(self) -> Iterator[str]:
        """A sentence on joints whose velocities are not those of their positions."""
        readings = [each for each in self.motion.readings if each.velocities is not None]
        if len(readings) < len(self.motion.readings) or self.config.effort == "external":
            return
        rates = np.array(
            [
                each.velocities[[each.names.index(name) for name in self.names]]
                for each in readings
                if each.velocities is not None
            ]
        )
        if np.isnan(rates).any():
            return
        stamps, joints = self.motion.stamps, np.array(self.motion.positions)[:, self.numbers]
        moved = cumulative_trapezoid(rates, stamps, axis=0, initial=0)
        step = max(1, round(WIDTH / float(np.median(np.diff(stamps)))))
        truly, said = (np.diff(each[::step], axis=0) for each in (joints, moved))
        off, size = (np.sqrt(np.mean(each**2, axis=0)) for each in (truly - said, truly))
        strange = off > np.maximum(ASTRAY * size, WIDTH * FAST)
        if strange.any():
            wrong = ", ".join(self.names[row] for row in np.flatnonzero(strange))
            yield (
                f"{self.name}: the velocities of {wrong} are not those of the positions, and the "
                "generator believes them: its noise holds their error; leave them out, or mend them"
            )

    def _last_link(self, dynamics: Dynamics) -> str:
        """The link of a payload: as configured, or the one that the outermost joint carries."""
        robot = self.recorded.config.robot
        if robot is not None and robot.payload is not None:
            return self.model.link_of(robot.payload.frame)
        depth = {
            name: dynamics.supports[self.model.link_names.index(self.model.urdf.children[name])]
            for name in self.names
        }
        return self.model.urdf.children[max(depth, key=lambda name: int(depth[name].sum()))]

    def _configured_payload(self, link: str | None) -> FloatArray:
        """Mass [kg] and first moments in the link's frame [kg·m], shape (4,)."""
        robot = self.recorded.config.robot
        if link is None or robot is None or robot.payload is None:
            return np.zeros(4)
        payload = robot.payload
        pose = self.model.pose_on_link(payload.frame)
        centre = points_in(pose, np.array([payload.centre_of_mass]))[0]
        return np.array([payload.mass, *(payload.mass * centre)])

    def _saturated(self, found: Identification) -> Iterator[tuple[float, float]]:
        stamps = self.motion.stamps
        for name, efforts in zip(self.names, self.efforts.T, strict=True):
            for value, spans in plateaus(stamps, efforts).items():
                longest = max(end - begin for begin, end in spans)
                found.warnings.append(
                    f"{self.name}: the effort of {name} saturates at {value:g}, for up to "
                    f"{longest:.1f} s, first at {spans[0][0]:.1f} s; these seconds are left out"
                )
                yield from spans

    def _late(self, regression: Regression, payload: FloatArray, used: Mask) -> float:
        """By how much efforts lag positions [s]; 0 where they do not."""
        lagging = regression.windows.lagging
        left = {lag: regression.left_by(lagging[lag], payload, used) for lag in LAGS}
        best = min(LAGS, key=lambda lag: left[lag])
        is_late = abs(best) >= LATE and left[best] < left[0] + np.log(BETTER)
        return best * regression.windows.period if is_late else 0.0

    def _values(
        self, choice: Choice, fit: Fit, link: str | None
    ) -> tuple[dict[str, EffortConfig], PayloadConfig | None]:
        """Joints and payload as a fit has them, and as configured where it tells nothing."""
        joints = {}
        for row, (name, before) in enumerate(self.joints.items()):
            identified = {
                each: float(fit.joints[row, number])
                for number, each in enumerate(FIELDS)
                if choice.identifiable[row, number]
            }
            for each in identified.keys() & {"coulomb", "viscous"}:
                identified[each] = max(identified[each], 0.0)
            if "offset" in identified:
                identified["offset"] *= self._side
            joints[name] = before.model_copy(update=identified)
        mass = float(fit.payload[0])
        if link is None or mass <= 0.0:
            return joints, None
        x, y, z = (fit.payload[1:] / mass).tolist()
        return joints, PayloadConfig(frame=link, mass=mass, centre_of_mass=(x, y, z))

    def _noise(
        self,
        regression: Regression,
        choice: Choice,
        used: Mask,
        spans: Spans,
        link: str | None,
        links: Sequence[str],
    ) -> tuple[FloatArray, FloatArray]:
        """What the generator's own observer leaves on parts that the fit has not seen.

        Returns:
            Standard deviations by joint, shape (k,) [N·m, N], and their standard errors.
        """
        stamps, lag = self.motion.stamps, 1.0 / self.config.gain
        settling = 0.0 if self.config.effort == "external" else SETTLED * lag
        whole = float(stamps[-1] - stamps[0])
        if whole < 4.0 * settling:
            raise RecordingError(
                f"generators.{self.name}: {whole:.1f} s are too few for its gain of "
                f"{self.config.gain:g}: record {4.0 * settling:.0f} s or more"
            )
        # both halves hold a part, and the observer settles in half of one
        length = min(max(FOLD, 4.0 * settling), whole / 2.0)
        parts = ((stamps - stamps[0]) // length).astype(int)
        windows = ((regression.windows.stamps - stamps[0]) // length).astype(int)
        left, friction = np.full((2, *self.efforts.shape), np.nan)
        for fold in (0, 1):
            fit = regression.whole(choice, used & (windows % 2 != fold))
            joints, payload = self._values(choice, fit, link)
            silent = {name: each.model_copy(update={"noise": 0.0}) for name, each in joints.items()}
            update: dict[str, Any] = {"payload": payload}
            if masses := self._masses(fit, links):
                update["masses"] = {**self.model.config.masses, **masses}
            model = RobotModel(self.model.config.model_copy(update=update))
            observer = ExternalTorque(
                Dynamics(model), silent, self.config.effort, self.config.gain, 0.0, self.config.sign
            )
            part, begun = -1, 0.0
            for row in np.flatnonzero(parts % 2 == fold):
                if parts[row] != part:
                    part, begun = parts[row], stamps[row]
                    observer.reset()
                found = observer.update(
                    self.motion.readings[row],
                    self.motion.positions[row],
                    self.motion.gravities[row],
                )
                if found is None:  # it begins again
                    begun = stamps[row]
                elif stamps[row] >= begun + settling:
                    left[row], friction[row] = (values[self.numbers] for values in found)
        left[~outside(stamps, spans)] = np.nan
        period = float(np.median(np.diff(stamps)))
        correlated = period if self.config.effort == "external" else max(lag, period)
        noise = np.array(
            [_deviation(*pair, period) for pair in zip(left.T, friction.T, strict=True)]
        )
        alone = np.maximum(np.sum(~np.isnan(left), axis=0) * period / correlated, 2.0)
        return noise, noise / np.sqrt(2.0 * alone)

    def _report(
        self,
        found: Identification,
        choice: Choice,
        fit: Fit,
        noise: tuple[FloatArray, FloatArray],
        link: str | None,
    ) -> None:
        joints, _ = self._values(choice, fit, link)
        shown = {"external": ("offset",), "measured": ("offset", "coulomb", "viscous")}
        columns = shown.get(self.config.effort, FIELDS)
        rows: list[tuple[str, ...]] = [("joint", *columns, "noise")]
        effort = {}
        for row, (name, joint) in enumerate(joints.items()):
            cells = [name]
            for each in columns:
                number, unit = FIELDS.index(each), self._unit(row, each)
                error = fit.errors[row, number] if choice.identifiable[row, number] else None
                value = getattr(joint, each)
                cells.append("(unknown)" if value is None else stated(value, error, unit))
            cells.append(stated(noise[0][row], noise[1][row], self._unit(row, "noise")))
            rows.append(tuple(cells))
            effort[name] = joint.model_copy(update={"noise": float(noise[0][row])})
        found.lines += [f"{self.name} ({self.config.effort}), {self._length()}", *table(rows)]
        found.kept += [f"{self.name}: {sentence}" for sentence in choice.kept]
        self._keep(found, effort)

    def _require_sign(self, regression: Regression, used: Mask) -> None:
        """Refuse efforts of which all that bear a torque fall as it rises.

        Raises:
            ConfigurationError: the sign to set.
        """
        slopes = [slope for slope, _ in regression.slopes(used).values()]
        if len(slopes) >= SEVERAL and max(slopes) < 0.0:
            sign = "on_robot" if self.config.sign == "by_robot" else "by_robot"
            raise ConfigurationError(
                f"efforts fall as torques rise, in all {len(slopes)} joints that bear one: set "
                f"sign: {sign}",
                f"generators.{self.name}.sign",
            )

    def _require_external(self, dynamics: Dynamics, used: Mask) -> None:
        """Refuse torques of weight and motion in place of those of the outside world.

        Args:
            dynamics: of the robot.
            used: the windows that count, shape (w,).

        Raises:
            ConfigurationError: the joints that report them.
        """
        link = self._last_link(dynamics)
        windows = windows_of(self.motion, self.efforts, dynamics, self.numbers, link, [], ())
        payload = self._configured_payload(link)
        weighed = Regression(windows, self.joints, "measured", payload, np.zeros(0))
        names = [
            name
            for name, (slope, share) in weighed.slopes(used).items()
            if share > WEIGHS and 1.0 / SIZED < abs(slope) < SIZED
        ]
        if len(names) >= SEVERAL:
            raise ConfigurationError(
                f"the efforts of {', '.join(names)} are those of weight and motion, which external "
                "torques leave out: set effort: measured",
                f"generators.{self.name}.effort",
            )

    def _length(self) -> str:
        stamps = self.motion.stamps
        return f"{stamps[-1] - stamps[0]:.1f} s, {len(stamps)} readings"

    def _unit(self, row: int, name: str) -> str:
        """The unit of a value of a joint."""
        newton = "N" if self.model.units[self.numbers[row]] == "m" else "N·m"
        per_speed = "N·s/m" if newton == "N" else "N·m·s"
        own = "A" if self.config.effort == "current" else newton
        return {"offset": own, "constant": f"{newton}/A", "viscous": per_speed}.get(name, newton)

    def _keep(self, found: Identification, efforts: Mapping[str, EffortConfig]) -> None:
        """Put efforts where the configuration has them: on the robot, or in the generator."""
        values = {
            name: {field: value for field, value in plain(effort).items() if value is not None}
            for name, effort in efforts.items()
        }
        options = self.recorded.config.generators[self.name]
        if isinstance(options["joints"], Mapping):
            found.fields["generators"][self.name] = {"joints": values}
            return
        held = found.fields["robot"].setdefault("efforts", {})
        if both := values.keys() & held.keys():
            raise ConfigurationError(
                f"joint '{min(both)}' of the robot's `efforts` is another generator's, too, and "
                "would get two values: give one of them `joints` of its own, each with `noise`",
                f"generators.{self.name}.joints",
            )
        held.update(values)

    def _of_payload(self, choice: Choice, fit: Fit, payload: PayloadConfig) -> list[str]:
        errors = np.where(choice.payload, fit.payload_errors, np.nan)
        centre = ", ".join(
            stated(1e3 * value, 1e3 * error / payload.mass if error == error else None, "mm")
            for value, error in zip(payload.centre_of_mass, errors[1:], strict=True)
        )
        mass = stated(payload.mass, float(errors[0]), "kg")
        return [f"payload on '{payload.frame}': {mass}, centre {centre}"]


def outside(stamps: FloatArray, spans: Spans) -> Mask:
    """Which stamps, shape (n,), lie in none of the spans, nor within a window of one."""
    free = np.ones(len(stamps), np.bool_)
    for begin, end in spans:
        free &= (stamps < begin - WIDTH) | (stamps > end + WIDTH)
    return free


def _deviation(left: FloatArray, friction: FloatArray, period: float) -> float:
    """Root mean square without outliers, and without rests, whose friction is unknown."""
    known = ~np.isnan(left)
    moving = known & (friction <= RESTING * np.nanmax(friction, initial=0.0))
    if moving.sum() * period >= 1.0:
        known = moving
    left = left[known]
    off = np.abs(left - np.median(left))
    left = left[off <= OUTLIER * 1.4826 * np.median(off)]
    return max(float(np.sqrt(np.mean(left**2))), LEAST_NOISE)
