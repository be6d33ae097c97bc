"""The integrator: hypotheses in, contacts out, and why (F §III). This page tells the story."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

from contactfusion.errors import (
    ConfigurationError,
    ContactFusionError,
    SourceError,
    TimeError,
    missing_plugin,
    name_hint,
)
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, kind_of
from contactfusion.integrator.condensations import contactfusion_condensations
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.integrator.disagreement import Disagreement
from contactfusion.integrator.fusion import Fusion, fuse
from contactfusion.integrator.inbox import Inbox
from contactfusion.integrator.members import Members
from contactfusion.integrator.rules import contactfusion_rules
from contactfusion.integrator.sources import Event, EventKind, Report, SourceRecord
from contactfusion.integrator.space import Space
from contactfusion.integrator.tracks import Tracks
from contactfusion.rule import Condensation, Rule
from contactfusion.surface import Surface
from contactfusion.time import to_nanoseconds

P = TypeVar("P", Rule, Condensation)


class Integrator:
    """Keeps the newest hypotheses of every source and fuses them into contacts.

    It is synchronous and pure: time comes in as an argument, and equal input gives equal output.

    Args:
        config: how hypotheses are kept, fused and condensed.
        rule: that of a plug-in; None: the built-in one that the configuration names.
        condensation: likewise. A `Pipeline` finds those of plug-ins by name.

    Raises:
        PluginError: no such rule or condensation is built in.
        ConfigurationError: an option is wrong, or the condensation does not fit the rule.
    """

    def __init__(
        self,
        config: IntegratorConfig | None = None,
        *,
        rule: Rule | None = None,
        condensation: Condensation | None = None,
    ) -> None:
        self.config = config or IntegratorConfig()
        alone = rule is not None and condensation is None and not rule.finds_members
        if alone and self.config.condensation == "members":
            self.config = self.config.using("de_morgan", "cluster_centroid")
        self.rule = rule or _built_in_rule(self.config)
        """How likelihoods combine."""
        self.condensation = condensation or _built_in_condensation(self.config)
        """How a field of likelihoods becomes contacts."""
        if self.condensation.needs_members and not self.rule.finds_members:
            raise ConfigurationError(
                f"'{self.config.condensation}' needs a rule that finds the contacts of a set, such "
                f"as 'sets', not '{self.config.rule}'",
                "condensation",
            )
        self._tracks: Tracks | None = None
        if isinstance(self.condensation, Members):
            self._tracks = Tracks(self.condensation.rate, self.condensation.existence)
        self._disagreement = Disagreement()
        self._grid = Grid(self.config.frame, self.config.voxel_size)
        self._space = Space(self._grid, self.config, places=self.rule.needs_places)
        lead = to_nanoseconds(self.config.max_ahead)
        self._inbox = Inbox(self._grid, lead, self.config.max_hypotheses)
        self._sources: dict[str, SourceRecord] = {}
        self._unplugged: set[str] = set()
        self._events: list[Event] = []
        self._last: int | None = None

    def plug(
        self,
        source: str,
        kind: HypothesisKind = HypothesisKind.REGULAR,
        timeout: float | None = None,
        stale_after: float | None = None,
        replace: bool = False,
        sensitivity: float = 0.0,
    ) -> None:
        """Plug a source in, or change how it is plugged.

        Args:
            source: its name.
            kind: evidence, support or null.
            timeout: lifetime of its entries [s]; None: as configured.
            stale_after: the silence after which readiness no longer waits [s]; None: as configured.
            replace: whether each of its clouds replaces all that it had, as for a moving contact.
            sensitivity: probability of detection; an empty cloud without notes then counts against
                a contact, by rules that use it.

        Raises:
            SourceError: it is plugged already, with another kind, a time is not positive, or the
                sensitivity is none.
        """
        kind = kind_of(kind)
        lifetime = _lifetime("timeout", self.config.timeout if timeout is None else timeout)
        silence = _lifetime(
            "stale_after", self.config.stale_after if stale_after is None else stale_after
        )
        if not 0.0 <= sensitivity < 1.0 or (sensitivity and kind != HypothesisKind.REGULAR):
            raise SourceError(
                f"the sensitivity of '{source}' is a probability under 1 of evidence, not "
                f"{sensitivity} of {kind}"
            )
        known = self._sources.get(source)
        if known and known.kind != kind:
            raise SourceError(
                f"'{source}' is plugged as {known.kind}; unplug it before you plug it as {kind}"
            )
        if not known:
            self.note(EventKind.PLUGGED, source, f"'{source}' was plugged in as {kind}")
        record = known or SourceRecord(source, kind)
        record.timeout, record.stale_after, record.replace = lifetime, silence, replace
        record.sensitivity = sensitivity
        self._sources[source] = record
        self._unplugged.discard(source)

    def unplug(self, source: str) -> None:
        """Remove a source with all that it contributed; its clouds are refused until `plug`.

        Raises:
            SourceError: no such source is plugged.
        """
        if source not in self._sources:
            raise SourceError(f"unknown source '{source}'; {self._source_hint(source)}")
        del self._sources[source]
        self._inbox.drop(source)
        self._space.drop(source)
        self._disagreement.forget(source)
        self._unplugged.add(source)
        self.note(EventKind.UNPLUGGED, source, f"'{source}' was unplugged")

    def receive(self, cloud: HypothesisCloud) -> None:
        """Take in a cloud; it counts from the next step on.

        Raises:
            ContactFusionError: the source is unplugged, unknown (with strict sources) or of another
                kind, the frame is not the grid's, or a place is out of reach. The cloud is refused
                as a whole, and counted against its source.
        """
        try:
            self._check_source(cloud)
            self._inbox.put(cloud)
        except ContactFusionError as error:
            self.refuse(cloud.source, str(error))
            raise

    def refuse(self, source: str, reason: str) -> None:
        """Count an unusable cloud against its source, with an event in the report."""
        if source in self._sources:
            self._sources[source].invalid += 1
        self.note(EventKind.REFUSED, source, reason)

    def note(self, kind: EventKind, source: str, message: str) -> None:
        """Note something that happened to a source, for the next step's report."""
        self._events.append(Event(kind, source, message))

    def ready(self, now: float) -> bool:
        """Whether every active source has reported since the last step.

        Args:
            now: the time at which to ask [s].
        """
        at = to_nanoseconds(now)
        waiting = self._inbox.reported(at, self._sources)
        return all(
            name in waiting for name, source in self._sources.items() if source.is_active(at)
        )

    def step(self, now: float, surface: Surface | None = None) -> Fusion:
        """Fuse all that is alive now into contacts, whether or not every source has reported.

        Args:
            now: the time of the step [s]; never before the last step's.
            surface: the robot's surface now, in the grid's frame, for rules that use it.

        Raises:
            TimeError: time ran backwards; `reset` starts again.
            PluginError: the rule or the condensation raised.
        """
        at = self._advance(now)
        accepted = self._inbox.take(at, self._sources, self._events)
        self._watch_silence(at)
        records = [self._sources[name] for name in sorted(self._sources)]
        entries = self._space.absorb(accepted, records, at)
        report = Report({record.name: record.report(at) for record in records}, self._drain())
        fusion = fuse(entries, self.rule, self.condensation, self.config.threshold, surface, report)
        if self._tracks is None or fusion.field.members is None:
            return fusion
        for source, message in self._disagreement.watch(at, fusion.field.members):
            self.note(EventKind.DISAGREES, source, message)
        contacts, changes = self._tracks.follow(entries, fusion.field.members, surface)
        return replace(fusion, contacts=contacts, changes=changes)

    def set_threshold(self, threshold: float) -> None:
        """Report contacts from another likelihood on; of a set, from another probability.

        Raises:
            ConfigurationError: it does not lie between 0 and 1.
        """
        if not 0.0 < threshold <= 1.0:
            raise ConfigurationError(f"{threshold} does not lie between 0 and 1", "threshold")
        self.config = self.config.model_copy(update={"threshold": threshold})
        if isinstance(self.condensation, Members) and self._tracks:
            self.condensation.existence = self._tracks.existence = threshold

    def reset(self) -> None:
        """Forget all hypotheses and stamps, as when a recording starts again; plugs stay."""
        self._inbox.clear()
        self._space.clear()
        if self._tracks:
            self._tracks.clear()
        self._disagreement.clear()
        for record in self._sources.values():
            record.forget()
        self._last = None

    def _check_source(self, cloud: HypothesisCloud) -> None:
        known = self._sources.get(cloud.source)
        if cloud.source in self._unplugged:
            raise SourceError(f"'{cloud.source}' is unplugged; plug it before it sends clouds")
        if known is None:
            if self.config.strict_sources:
                raise SourceError(
                    f"unknown source '{cloud.source}'; {self._source_hint(cloud.source)}"
                )
            self.plug(cloud.source, cloud.kind)
        elif known.kind != cloud.kind:
            raise SourceError(
                f"'{cloud.source}' is plugged as {known.kind} but sent a cloud of {cloud.kind}"
            )

    def _advance(self, now: float) -> int:
        at = to_nanoseconds(now)
        if self._last is not None and at < self._last:
            raise TimeError(
                f"the step at {now:.9g} s comes after one at {self._last / 1e9:.9g} s; "
                "reset() starts again when a clock jumps back"
            )
        self._last = at
        return at

    def _watch_silence(self, at: int) -> None:
        for source in self._sources.values():
            if source.first_step is None:
                source.first_step = at
            active = source.is_active(at)
            if active != source.active:
                kind = EventKind.BACK if active else EventKind.STALE
                state = "is back" if active else "has been silent for too long"
                self.note(kind, source.name, f"'{source.name}' {state}")
                source.active = active

    def _drain(self) -> tuple[Event, ...]:
        events = tuple(self._events)
        self._events.clear()
        return events

    def _source_hint(self, name: str) -> str:
        return name_hint(name, self._sources, "plugged sources")


def _built_in_rule(config: IntegratorConfig) -> Rule:
    cls = _built_in("rule", config.rule, contactfusion_rules())
    try:
        return cls(cls.Config(**config.rule_options))
    except ConfigurationError as error:
        raise error.under("rule") from None


def _built_in_condensation(config: IntegratorConfig) -> Condensation:
    cls = _built_in("condensation", config.condensation, contactfusion_condensations())
    try:
        return cls(cls.Config(**config.condensed_by), config.linking_distance)
    except ConfigurationError as error:
        raise error.under("condensation") from None


def _built_in(part: str, name: str, known: Mapping[str, type[P]]) -> type[P]:
    if name not in known:
        raise missing_plugin(part, name, known, f" (that of a plug-in is passed as `{part}=`)")
    return known[name]


def _lifetime(name: str, seconds: float) -> int:
    """A time that must be positive, in ns."""
    if not seconds > 0.0:
        raise SourceError(f"{name} must be greater than 0 s, not {seconds}")
    return to_nanoseconds(seconds)
