"""Which topic of a recording feeds which generator: by name, by kind, or as the user chooses."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, final

from contactfusion.assembly import generator_class
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.readings import Reading
from contactfusion.readings.codec import Codec, Role
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.messages import ros_name

Kinds = tuple[type[Reading], ...]
NOTHING: Mapping[str, type[Reading]] = MappingProxyType({})


@final
@dataclass(frozen=True)
class Inputs:
    """What is read of a recording, and by whom.

    Attributes:
        sensors: the name of the sensor of each topic that is read.
        generators: the options of all generators by name, with the `sensor` of each.
        missing: what generators need and the recording does not hold, or nothing reads, in
            sentences.
        taken: who takes a topic that is not called like its sensor, in sentences.
    """

    sensors: Mapping[str, str]
    generators: Mapping[str, dict[str, Any]]
    missing: tuple[str, ...]
    taken: tuple[str, ...]


def find_inputs(
    topics: Mapping[str, type[Reading]],
    generators: Mapping[str, Mapping[str, Any]],
    chosen: Mapping[str, str],
    watched: bool = False,
    ignored: Mapping[str, type[Reading]] = NOTHING,
    on: str | None = None,
    holder: str = "the recording",
) -> Inputs:
    """Find the topic for each generator.

    A generator's role is its `sensor`, or its own name when it has none. It takes the topic that
    is chosen for its role, or else the topic called like its sensor, or else the only one of its
    kinds that is not another's of its type by name. Of context, such as joints and poses of
    objects, all topics are read; of what one topic alone may report, one is: of odometry, and of
    twists where a generator takes them.

    Args:
        topics: the kind of reading of each topic.
        generators: the `type` and the options of each by name.
        chosen: topics by role.
        watched: whether to read what no generator takes, too, so that it can be looked at.
        ignored: the kind of reading of each topic that is not read at all.
        on: the sensor, or the kind of reading, whose topics are read as a step is due with each.
        holder: what holds the topics, in sentences.

    Raises:
        ConfigurationError: a role or a topic is unknown, does not fit, or several fit.
        PluginError: a type of generator is not installed.
    """
    chosen = {role: topic.removeprefix("/") for role, topic in chosen.items()}
    finding = _Finding(topics, chosen, ignored, holder, on)
    wanted = {name: _kinds(options) for name, options in generators.items()}
    for name, options in generators.items():
        finding.reserve(name, options)
    fed = {
        name: finding.feed(name, dict(options), wanted[name])
        for name, options in generators.items()
    }
    finding.context(tuple(kind for kinds in wanted.values() for kind in kinds))
    finding.refuse_strangers(roles_of(generators))
    if watched:
        finding.read_sensed()
    finding.clock(on)
    return Inputs(finding.sensors, fed, tuple(finding.missing), tuple(finding.taken))


def roles_of(generators: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The roles that a topic can be chosen for: those of generators by name, and of the robot."""
    return [*_alone(), *(_role(name, options) for name, options in generators.items())]


def _role(name: str, options: Mapping[str, Any]) -> str:
    sensor = options.get("sensor")
    if not (sensor is None or isinstance(sensor, str)):
        raise ConfigurationError(
            f"input should be a valid string, not {sensor!r}", f"generators.{name}.sensor"
        )
    return sensor or name


def _names(role: str) -> tuple[str, ...]:
    """What the topic of a role may be called: as it is, or as ROS allows it."""
    name = role.removeprefix("/")
    return role, name, ros_name(f"/{name}")[1:]


def _kinds(options: Mapping[str, Any]) -> Kinds:
    return generator_class(str(options["type"])).readings


class _Finding:
    def __init__(
        self,
        topics: Mapping[str, type[Reading]],
        chosen: Mapping[str, str],
        ignored: Mapping[str, type[Reading]],
        holder: str,
        on: str | None,
    ) -> None:
        self.topics, self.chosen, self.ignored, self.holder = topics, chosen, ignored, holder
        self.on = on
        self.sensors: dict[str, str] = {}
        """The name of the sensor of each topic that is read."""
        self.missing: list[str] = []
        self.taken: list[str] = []
        self._reserved: dict[tuple[str, str], str] = {}
        """Generators by type and by the topic that is theirs by name."""

    def reserve(self, name: str, options: Mapping[str, Any]) -> None:
        """Keep the topic that is a generator's by name, or chosen, from others of its type.

        Of two force-torque sensors one would count twice where the other is missing.
        """
        role = _role(name, options)
        for topic in (self.chosen[role],) if role in self.chosen else _names(role):
            self._reserved.setdefault((str(options["type"]), topic), name)

    def feed(self, name: str, options: dict[str, Any], kinds: Kinds) -> dict[str, Any]:
        """The options of a generator with its sensor."""
        sensor = options.get("sensor")
        role = _role(name, options)
        if sensor is None and not any(map(_is_of_one_sensor, kinds)) and role not in self.chosen:
            return options  # it takes all context there is
        topic = self._topic(role, kinds, str(options["type"]))
        if topic is None:
            self.missing.append(f"generators.{name}: {self._absence(role, kinds, options)}")
            return {**options, "sensor": role}  # it takes no other's
        if sensor and role not in self.chosen and topic not in _names(role):
            if self.on is not None and topic in _names(self.on):  # it would lose that name
                raise ConfigurationError(
                    f"no topic is called '{sensor}', and the only {_named(kinds)} is '{self.on}', "
                    f"for which steps wait (`cycle.on`): did you mean that?",
                    f"generators.{name}.sensor",
                )
            self.taken.append(
                f"generators.{name}: no topic is called '{sensor}', so /{topic} feeds it, the only "
                f"{_named(kinds)}"
            )
        # steps that wait for a sensor wait for its own name
        named = role if role == self.on and topic in _names(role) else topic
        sensor = sensor or self.sensors.get(topic, named)
        if self.sensors.setdefault(topic, sensor) != sensor:
            raise ConfigurationError(
                f"/{topic} feeds '{self.sensors[topic]}' already, and can't be '{sensor}', too: "
                f"give both generators the same sensor",
                f"generators.{name}.sensor",
            )
        return {**options, "sensor": sensor}

    def _absence(self, role: str, kinds: Kinds, options: Mapping[str, Any]) -> str:
        if others := [
            f"/{topic} is that of '{self._reserved[key]}'"
            for topic in self._of(kinds)
            if (key := (str(options["type"]), topic)) in self._reserved
        ]:
            return f"no topic is called '{role}', and {', '.join(others)}"
        left_out = ", ".join(
            f"/{topic}" for topic, kind in self.ignored.items() if issubclass(kind, kinds)
        )
        if left_out:
            return f"nothing feeds it, as {left_out} is ignored (--ignore)"
        return f"{self.holder} holds no {_named(kinds)}"

    def context(self, wanted: Kinds) -> None:
        """Read the state of robot and world."""
        for role, codec in _alone().items():
            if role in self.chosen or codec.kind in wanted or codec.role is Role.CONTEXT:
                topic = self._topic(role, (codec.kind,), "")
                if topic is not None:
                    self.sensors.setdefault(topic, topic)
        self._read(topic for topic, kind in self.topics.items() if _is_context(kind))

    def read_sensed(self) -> None:
        """Read all topics that one sensor measures."""
        self._read(topic for topic, kind in self.topics.items() if _is_of_one_sensor(kind))

    def _read(self, topics: Iterable[str]) -> None:
        """Read topics, under their own names where no generator takes them."""
        for topic in topics:
            self.sensors.setdefault(topic, topic)

    def clock(self, on: str | None) -> None:
        """Read what steps wait for, where no generator does: a sensor, or a kind of reading."""
        if on is None or on in self.sensors.values():
            return
        codec = installed_kinds().find(on)
        if named := [name for name in _names(on) if name in self.topics]:
            self.sensors.setdefault(named[0], on)
        elif codec and not set(self._of((codec.kind,))) & self.sensors.keys():
            self._read(self._of((codec.kind,)))

    def refuse_strangers(self, roles: Sequence[str]) -> None:
        """Refuse a topic that is chosen for a role that there is not."""
        for role in self.chosen:
            if role not in roles:
                hint = name_hint(role, roles, "roles")
                raise ConfigurationError(f"--topic: unknown role '{role}'; {hint}")

    def _topic(self, role: str, kinds: Kinds, taker: str) -> str | None:
        if role in self.chosen:
            return self._as_chosen(role, kinds)
        for name in _names(role):
            if issubclass(self.topics.get(name, Reading), kinds):
                return name
        fit = [topic for topic in self._of(kinds) if (taker, topic) not in self._reserved]
        if len(fit) > 1:
            listing = ", ".join(f"/{topic}" for topic in fit)
            raise ConfigurationError(
                f"'{role}' takes {_named(kinds)}, and several topics hold it: {listing}; "
                f"choose one: --topic {role}=/{fit[0]}"
            )
        return fit[0] if fit else None

    def _as_chosen(self, role: str, kinds: Kinds) -> str:
        topic = self.chosen[role]
        if topic not in self.topics:
            known = [f"/{name}" for name, kind in self.topics.items() if issubclass(kind, kinds)]
            hint = name_hint(f"/{topic}", known, "topics that fit")
            raise ConfigurationError(f"--topic {role}: no readings come of '/{topic}'; {hint}")
        if not issubclass(self.topics[topic], kinds):
            raise ConfigurationError(
                f"--topic {role}: /{topic} holds {self.topics[topic].__name__}, "
                f"and '{role}' takes {_named(kinds)}"
            )
        return topic

    def _of(self, kinds: Kinds) -> Iterator[str]:
        for topic, kind in self.topics.items():
            if issubclass(kind, kinds):
                yield topic


def _alone() -> dict[str, Codec[Any]]:
    """The kinds that one topic alone may report, by their names, which are their roles."""
    return {codec.name: codec for codec in installed_kinds().all() if codec.alone}


def is_sensed(kind: type[Reading]) -> bool:
    """Whether readings of a kind mean nothing without the pose of their frame."""
    codec = installed_kinds().of(kind)
    return codec is not None and codec.role is Role.SENSED


def _is_of_one_sensor(kind: type[Reading]) -> bool:
    """Whether a generator takes readings of a kind of one topic."""
    codec = installed_kinds().of(kind)
    return codec is not None and codec.role is Role.SENSED and not codec.alone


def _is_context(kind: type[Reading]) -> bool:
    """Whether several topics may report readings of a kind together."""
    codec = installed_kinds().of(kind)
    return codec is not None and codec.role is Role.CONTEXT and not codec.alone


def _named(kinds: Kinds) -> str:
    return " or ".join(kind.__name__ for kind in kinds)
