"""The path of a reading: generators, the space's frame, fusion, command.

The same object runs in simulation, in replay and live. It is synchronous and pure: no threads, no
clock of its own; time comes in with readings and steps.
"""

import functools
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from contactfusion.assembly import AnyGenerator, built_controller, built_generator, built_integrator
from contactfusion.controller import FAULT, Command, Controller
from contactfusion.errors import (
    ConfigurationError,
    ContactFusionError,
    FrameError,
    Guard,
    PluginError,
    SourceError,
    cause_of,
    name_hint,
)
from contactfusion.estimate import HYPOTHESIS, counted, size
from contactfusion.frames import points_in, vectors_in
from contactfusion.generator import checked_clouds
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Resultant
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.inbox import OTHER_CLOCK
from contactfusion.integrator.sources import Event, EventKind
from contactfusion.isolation import RESTARTS, Isolated
from contactfusion.loop import play
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, Odometry, Reading, Wrench
from contactfusion.robot_state import Robot
from contactfusion.state import State
from contactfusion.stream import Stream
from contactfusion.time import LEAP

LOG = logging.getLogger(__name__)
FRESH = 0.1
"""A resultant that is older is not passed on [s]."""
CONTROLLER = "the controller"
"""Name of the controller in messages, beside the quoted names of generators."""
Ask = Callable[[AnyGenerator, Reading, State], Sequence[HypothesisCloud]]
"""How a generator is called; a stream with a clock measures the time here."""
Tell = Callable[[HypothesisCloud], None]
"""Receiver of every cloud that the integrator accepted, in the space's frame."""


def asked(generator: AnyGenerator, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
    """The clouds of a generator for a reading."""
    return generator.generate(reading, state)


def unobserved(cloud: HypothesisCloud) -> None:
    """No-op receiver of accepted clouds."""


@dataclass(frozen=True, eq=False)
class Step:
    """Result of one step of the pipeline.

    Attributes:
        stamp: the time of the step [s].
        fusion: contacts, space and report.
        command: what the controller commands, or None without a controller.
    """

    stamp: float
    fusion: Fusion
    command: Command | None

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened to the sources since the last step."""
        return self.fusion.report.events


class Pipeline:
    """Generators, integrator and controller as one configuration puts them together.

    Args:
        config: the configuration.
        ask: how a generator is called for its clouds.
        tell: receiver of each cloud that the integrator accepted.
        live: whether no step waits for generators in processes of their own.

    Raises:
        ContactFusionError: a plug-in is not installed, or an option of one is wrong.
    """

    def __init__(
        self,
        config: PipelineConfig,
        ask: Ask = asked,
        tell: Tell = unobserved,
        live: bool = False,
    ) -> None:
        self.config = config
        self._live = live
        self._ask = ask
        self._tell = tell
        self.integrator = built_integrator(config)
        self.grid = Grid(config.integrator.frame, config.integrator.voxel_size)
        """The voxels of the hypothesis space."""
        self._robot = Robot(config, self.grid)
        self.generators: dict[str, AnyGenerator] = {}
        """The plugged generators by name."""
        self._sources: dict[str, dict[str, HypothesisKind]] = {}
        """The sources of each, as when it was plugged."""
        self.bounds: dict[str, Path | None] = {}
        """The folder in which the files of each have to lie, or None."""
        self.options: dict[str, dict[str, Any]] = {}
        """The `type` and the options of each."""
        self._unready: dict[str, str] = {}
        """Why a generator or the controller is not called: its `reset` raised."""
        self._raised: set[str] = set()
        """Plug-ins that have raised before."""
        self.unplaced: Counter[str] = Counter()
        """How often clouds of each generator were refused as no transform placed them."""
        self.lost = set[str]()
        """Generators whose last clouds were refused as no transform placed them."""
        self.given: Counter[str] = Counter()
        """How many readings each generator was asked for clouds of."""
        self.scripted = False
        """Whether isolated generators process only what `answer` names, as it was recorded."""
        self._failed_commands, self._first_failure = 0, ""
        try:
            for name, options in config.generators.items():
                self.plug(name, options)
            self._controller = built_controller(config)
        except BaseException:
            self.close()
            raise
        self._fusion: Fusion | None = None
        self._collected = False
        self.conflates = False
        """Whether generators that `absorb` make clouds of the newest reading before a step only,
        unless their clouds add to earlier ones."""
        self._newest: dict[tuple[str, str], Reading] = {}
        """The newest reading since the last step, by generator that absorbs and sensor."""
        self.transform_lag = 0.0
        """So long before a step the newest transforms may be, as on a running robot [s]."""
        self._wrenches = list[Wrench]()
        """Since the last step, for the controller."""
        self._resultants: dict[str, tuple[float, Resultant]] = {}
        """The newest of each generator, with its stamp."""

    def plug(self, name: str, options: dict[str, Any], within: Path | None = None) -> None:
        """Plug a generator in, also while running.

        Args:
            name: what it is called.
            options: its `type` and the fields of its `Config`.
            within: the folder in which all files that they name have to lie, unless the
                configuration has one; None: no limit.

        Raises:
            SourceError: a generator of that name is plugged.
            PluginError: it is not installed, breaks the contract, or raises.
            ConfigurationError: an option of it is wrong.
        """
        if name in self.generators:
            raise SourceError(f"the generator '{name}' is plugged already; unplug it first")
        within = self.config.files_within or within
        generator = built_generator(name, options, self.config.folder, self.config.robot, within)
        with Guard(f"generators.{name}: the plug-in '{options['type']}'", type(generator)):
            self._require_affordable(generator)
            sources = dict(generator.sources)
        evidence = [*sources.values()].count(HypothesisKind.REGULAR)
        if generator.config.sensitivity and evidence != 1:
            raise ConfigurationError(
                "is for a generator with one output of evidence, whose silence then says that it "
                f"found nothing; '{name}' has {evidence}",
                f"generators.{name}.sensitivity",
            )
        if generator.config.isolate:
            generator = Isolated(generator, self._live, self._robot.model)
            generator.scripted = self.scripted
        elif self._robot.model is not None:
            prepared = f"generators.{name}: `prepare` of the plug-in '{options['type']}'"
            try:
                with Guard(prepared, type(generator)):
                    generator.prepare(self._robot.model)
            except ConfigurationError as error:
                raise error.under(f"generators.{name}") from None
        for source, kind in sources.items():
            self.integrator.plug(
                source,
                kind,
                timeout=generator.config.timeout,
                stale_after=generator.config.stale_after,
                replace=generator.config.replace,
                sensitivity=generator.config.sensitivity * (kind == HypothesisKind.REGULAR),
            )
        self.generators[name], self.options[name] = generator, options
        self._sources[name], self.bounds[name] = sources, within

    def plugged(self, name: str) -> AnyGenerator:
        """The generator of a name.

        Raises:
            SourceError: no such generator is plugged.
        """
        if name not in self.generators:
            hint = name_hint(name, self.generators, "plugged generators")
            raise SourceError(f"unknown generator '{name}'; {hint}")
        return self.generators[name]

    def waits_for(self, name: str) -> str:
        """What a generator waits for, in a sentence; empty where it does not wait."""
        generator = self.generators[name]
        try:
            return str(generator.waits_for)
        except Exception as error:  # a plug-in may raise anything
            return self._reason(f"`waits_for` of '{name}'", generator, error)

    def restart(self, name: str) -> None:
        """Let a generator drop its state, such as its tare; a process that ended starts again.

        Raises:
            SourceError: no such generator is plugged.
        """
        self._unready.pop(f"'{name}'", None)
        self._reset(f"'{name}'", self.plugged(name))

    def _require_affordable(self, generator: AnyGenerator) -> None:
        """Make sure that a generator's clouds are no larger than memory and time allow."""
        count, most = generator.most_hypotheses(self.grid), self.config.integrator.max_hypotheses
        if count is not None and count > most:
            raise ConfigurationError(
                f"a cloud would hold {counted(count)} hypotheses, {size(count * HYPOTHESIS)}, more "
                f"than {counted(most)}, at a voxel_size of {self.grid.voxel_size:g} m; "
                "lengths are in metres",
                f"generators.{generator.name}",
            )

    def unplug(self, name: str) -> None:
        """Unplug a generator and all that it contributed.

        Raises:
            SourceError: no such generator is plugged.
        """
        generator = self.plugged(name)
        del self.generators[name], self.options[name], self.given[name]
        self.lost.discard(name)
        self._unready.pop(f"'{name}'", None)
        for source in self._sources.pop(name):
            self.integrator.unplug(source)
        if isinstance(generator, Isolated):
            generator.close()

    def listens(self, sensor: str, kind: type[Reading]) -> bool:
        """Whether readings of a sensor reach a generator, or the robot's joints or base.

        Transforms do not count: a consumer that misses one reports it.
        """
        is_robot = issubclass(kind, Odometry) or (
            issubclass(kind, JointState) and self._robot.model is not None
        )
        return is_robot or any(
            takes(generator, sensor, kind) for generator in self.generators.values()
        )

    def receive(self, reading: Reading) -> None:
        """Receive a reading for every generator that takes it; one that fails harms no other.

        Raises:
            ConfigurationError: the configuration has faults, which act on what is played.
        """
        if self.config.faults:
            raise ConfigurationError("faults act on what `run` plays, not on `receive`", "faults")
        self.take(reading)

    def take(self, reading: Reading) -> None:
        """Receive what faults have left of a reading, for every generator that takes it."""
        self._robot.add(reading)
        if self._controller and isinstance(reading, Wrench):
            self._wrenches.append(reading)
        kind = type(reading)
        takers = [
            generator
            for generator in self.generators.values()
            if takes(generator, reading.sensor, kind)
        ]
        for generator in takers:
            if not (self.conflates and generator.absorbs and generator.config.replace):
                self._generate(generator, reading)
                continue
            key = generator.name, reading.sensor
            if before := self._newest.get(key):
                self._deliver(generator, functools.partial(self._absorbed, generator, before))
            self._newest[key] = reading

    def _generate(self, generator: AnyGenerator, reading: Reading) -> None:
        """Receive the clouds of a reading."""
        self.given[generator.name] += 1
        state = self.state(reading.stamp)
        self._deliver(generator, functools.partial(self._ask, generator, reading, state))
        self._keep_resultant(generator, reading.stamp)

    def _keep_resultant(self, generator: AnyGenerator, stamp: float) -> None:
        """Keep what a generator measured of a reading of this stamp for the others."""
        if isinstance(generator, Isolated):  # it has answered an earlier one
            stamp = generator.measured
            if generator.trouble:
                for source in self._sources[generator.name]:
                    self.integrator.refuse(source, generator.trouble)
                generator.trouble = ""
        self._resultants.pop(generator.name, None)
        try:
            resultant = generator.resultant
        except Exception as error:  # a plug-in may compute it
            reason = self._reason(f"`resultant` of '{generator.name}'", generator, error)
            for source in self._sources[generator.name]:
                self.integrator.refuse(source, reason)
            return
        if resultant is not None:
            self._resultants[generator.name] = stamp, resultant

    def _absorbed(self, generator: AnyGenerator, reading: Reading) -> Sequence[HypothesisCloud]:
        """No clouds: a generator takes note of a reading that a newer one follows."""
        generator.absorb(reading, self.state(reading.stamp))
        self._keep_resultant(generator, reading.stamp)
        return ()

    def collect(self) -> None:
        """Receive the clouds of isolated generators that are done; the next step asks no more."""
        self._collected = True
        for generator in list(self.generators.values()):
            if isinstance(generator, Isolated):
                self._deliver(generator, functools.partial(generator.collect, wait=False))
                while generator.owes:
                    self._deliver(generator, functools.partial(generator.collect, wait=True))
                self._keep_resultant(generator, generator.measured)

    def answer(self, name: str, number: int) -> None:
        """Receive the clouds of an isolated generator for one of its readings, as was recorded.

        Args:
            name: of the generator.
            number: of the reading; those before it that wait are dropped.

        Raises:
            SourceError: no such generator is plugged, or it is not isolated.
        """
        generator = self.plugged(name)
        if not isinstance(generator, Isolated):
            raise SourceError(f"'{name}' does not run in a process of its own")
        self._deliver(generator, functools.partial(generator.answer, number))
        self._keep_resultant(generator, generator.measured)

    def step(self, now: float) -> Step:
        """Fuse all that is alive at `now` [s], and let the controller act on the contacts."""
        for source, stamp in self._robot.leave_out(now + LEAP):
            self.integrator.note(
                EventKind.EARLY,
                source,
                f"{source} is {stamp - now:,.3f} s ahead of the step: left out, {OTHER_CLOCK}",
            )
        newest, self._newest = self._newest, {}
        # what measures resultants goes first: others, such as joint_torque, take these off
        newest = dict(sorted(newest.items(), key=lambda each: each[0][0] not in self._resultants))
        for (name, _), reading in newest.items():
            if name in self.generators:
                self._generate(self.generators[name], reading)
        if not self._collected:
            self.collect()
        self._collected = False
        state = self._with_resultants(self._robot.state(now, self._fusion, self.transform_lag))
        if state.unplaced:
            self.integrator.refuse("surface", state.unplaced)
        self._fusion = self.integrator.step(now, state.surface)
        command = None
        if self._controller:
            state = replace(state, fusion=self._fusion, wrenches=tuple(self._wrenches))
            self._wrenches.clear()
            command = self._command(self._controller, self._fusion, state)
        return Step(now, self._fusion, command)

    def run(self, stream: Stream | Iterable[Reading]) -> Iterator[Step]:
        """Play a stream or readings, stepping by the cycle policy or the stream.

        Transforms may come before the readings that need them: they move no clock.
        """
        return play(self, stream)

    def state(self, stamp: float) -> State:
        """Robot state at a stamp [s]: joints, base pose, frames, surface."""
        return self._with_resultants(self._robot.state(stamp, self._fusion))

    def placed(self, reading: Reading) -> bool:
        """Whether the frame of a reading, and the robot, are placed in the space at its stamp."""
        frames, space = self._robot.frames(reading.stamp), self.grid.frame
        try:
            for frame in (reading.frame, *self._robot.roots):
                frames.pose(space, of=frame)
        except FrameError:
            return False
        return True

    def _with_resultants(self, state: State) -> State:
        ages = {
            name: state.now - measured
            for name, (measured, _) in self._resultants.items()
            if abs(state.now - measured) <= FRESH and name in self.generators
        }
        if not ages:
            return state
        fresh = {name: self._resultants[name][1] for name in ages}
        return replace(state, resultants=fresh, resultant_ages=ages)

    def reset(self) -> None:
        """Start again, as when a recording is played a second time; plugs stay."""
        self.integrator.reset()
        self._robot.clear()
        self._fusion = None
        self._newest.clear()
        self._wrenches.clear()
        self._resultants.clear()
        self.unplaced.clear()
        self.lost.clear()
        self.given.clear()
        self._failed_commands, self._first_failure = 0, ""
        self._unready.clear()
        for name, generator in self.generators.items():
            self._reset(f"'{name}'", generator)
        if self._controller:
            self._reset(CONTROLLER, self._controller)

    def restore(self) -> None:
        """Undo what was changed since the start: generators and the threshold are as configured."""
        for name in [*self.generators]:
            if self.options[name] != self.config.generators.get(name):
                self.unplug(name)
        for name, options in self.config.generators.items():
            if name not in self.generators:
                self.plug(name, options)
        self.integrator.set_threshold(self.config.integrator.threshold)

    @property
    def misplaced(self) -> str:
        """A sentence on the links that /tf_static places elsewhere than the URDF, or nothing."""
        return self._robot.misplaced

    @property
    def ended(self) -> Mapping[str, str]:
        """Why plug-ins did not take part all the time, by their field of the configuration."""
        out = {
            f"generators.{name}": generator.out
            or f"its process was started again, {generator.ends} of {RESTARTS} times: readings "
            "are lost"
            for name, generator in self.generators.items()
            if isinstance(generator, Isolated) and (generator.out or generator.ends)
        }
        if self._failed_commands:
            failed = f"it commanded nothing in {self._failed_commands} steps"
            out["controller"] = f"{failed}: {self._first_failure}"
        return out

    def close(self) -> None:
        """End the processes of isolated generators."""
        for generator in self.generators.values():
            if isinstance(generator, Isolated):
                generator.close()

    def _deliver(
        self, generator: AnyGenerator, ask: Callable[[], Sequence[HypothesisCloud]]
    ) -> None:
        """Pass a generator's clouds on; whatever goes wrong is counted against it alone."""
        sources = self._sources[generator.name]
        try:
            if unready := self._unready.get(f"'{generator.name}'"):
                raise PluginError(unready)
            clouds = checked_clouds(ask())
        except (Exception, SystemExit) as error:  # a plug-in may raise anything; no other suffers
            self._misses(generator, error)
            reason = self._reason(f"'{generator.name}'", generator, error)
            for source in sources:
                self.integrator.refuse(source, reason)
            return
        self.lost.discard(generator.name)
        for cloud in clouds:
            try:
                if cloud.source not in sources:
                    self.integrator.refuse(
                        next(iter(sources), generator.name),
                        f"'{generator.name}' gave a cloud of '{cloud.source}', not of its own: "
                        f"{', '.join(sources)}",
                    )
                    continue
                cloud = self._in_space(cloud)
            except ContactFusionError as error:
                self._misses(generator, error)
                self.integrator.refuse(cloud.source, str(error))
                continue
            try:
                self.integrator.receive(cloud)
            except ContactFusionError:
                continue  # the integrator has counted it
            self._tell(cloud)

    def _misses(self, generator: AnyGenerator, error: BaseException) -> None:
        """Count a cloud that no transform places."""
        if isinstance(error, FrameError):
            self.unplaced[generator.name] += 1
            self.lost.add(generator.name)

    def _command(self, controller: Controller, fusion: Fusion, state: State) -> Command:
        """The controller's command; where it raises, one without motion, with the reason."""
        try:
            if unready := self._unready.get(CONTROLLER):
                raise PluginError(unready)
            command = controller.command(fusion.contacts, state)
            if not isinstance(command, Command):
                raise TypeError(f"it gave {type(command).__name__}, not a Command")
            return command
        except (Exception, SystemExit) as error:  # the robot must not run on
            reason = self._reason(CONTROLLER, controller, error)
            self._failed_commands += 1
            self._first_failure = self._first_failure or reason
            return Command(mode=FAULT, reason=reason)

    def _reset(self, who: str, plugged: AnyGenerator | Controller) -> None:
        """Reset a generator or the controller; one that raises is not called until it can be."""
        try:
            plugged.reset()
        except (Exception, SystemExit) as error:
            self._unready[who] = self._reason(f"`reset` of {who}", plugged, error)

    def _reason(self, who: str, plugged: AnyGenerator | Controller, error: BaseException) -> str:
        """What a plug-in raised; the first time its traceback goes to the log, too."""
        is_reported = isinstance(error, PluginError)
        reason = str(error) if is_reported else f"{who} raised {cause_of(error, type(plugged))}"
        if who not in self._raised:
            self._raised.add(who)
            LOG.debug("%s", reason, exc_info=error)
        return reason

    def _in_space(self, cloud: HypothesisCloud) -> HypothesisCloud:
        """Bring a cloud into the frame of the hypothesis space."""
        if cloud.frame == self.grid.frame:
            return cloud
        pose = self._robot.frames(cloud.stamp).pose(self.grid.frame, of=cloud.frame)
        return replace(
            cloud,
            frame=self.grid.frame,
            positions=points_in(pose, cloud.positions),
            forces=None if cloud.forces is None else vectors_in(pose, cloud.forces),
            resultant=cloud.resultant and cloud.resultant.moved(pose),
        )


def takes(generator: AnyGenerator, sensor: str, kind: type[Reading]) -> bool:
    """Whether a generator takes readings of a sensor and a type."""
    wanted = generator.config.sensor
    return issubclass(kind, generator.readings) and wanted in (None, sensor)
