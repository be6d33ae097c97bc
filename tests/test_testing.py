"""The conformance kit: every rule has a generator that it catches."""

import sys
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, ClassVar, cast

import numpy as np
import pytest
from pydantic import Field

from contactfusion import Grid, State
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import BUILT_IN, PointCloud, Reading, Switch, Wrench
from contactfusion.testing import ConformanceError, check_generator, example_reading

READING_TYPES = {codec.name: codec.kind for codec in BUILT_IN}

REGULAR, NULL = HypothesisKind.REGULAR, HypothesisKind.NULL
Clouds = Sequence[HypothesisCloud]


class Sound(Generator[GeneratorConfig]):
    """Keeps every rule: the mean of all points so far, and where there is nothing."""

    readings: ClassVar[tuple[type[Reading], ...]] = (PointCloud, Wrench)
    outputs: Mapping[str, HypothesisKind] = {"": REGULAR, "free": NULL}

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        super().__init__(name, config)
        self.reset()

    def reset(self) -> None:
        self.seen = [np.zeros(3)]

    def generate(self, reading: Reading, state: State) -> Clouds:
        if isinstance(reading, PointCloud):
            self.seen.extend(np.nan_to_num(reading.points))
        place = np.mean(self.seen, axis=0)
        return [
            self.cloud(reading, [place, place], 0.5, single=True),
            self.cloud(reading, [[0.0, 0.0, 1.0]], 1.0, output="free", frame=state.grid.frame),
        ]


def test_a_sound_generator_passes() -> None:
    check_generator(Sound)
    check_generator(Sound, config=GeneratorConfig(sensor="left"), name="left")
    check_generator(Sound, readings=[example_reading(Wrench)])
    check_generator(Sound, state=State(now=0.0, grid=Grid("world", 0.01)))


def refused(cls: Any, fault: str, **given: Any) -> None:
    with pytest.raises(ConformanceError) as error:
        check_generator(cls, **given)
    assert fault in str(error.value)
    assert isinstance(error.value, AssertionError)


class NoGenerate(Generator[GeneratorConfig]):
    """Has no `generate`."""

    readings = (Wrench,)


class NoDocstring(Sound):
    pass


class PlainConfig(Sound):
    """Its options are no GeneratorConfig."""

    Config = cast(type[GeneratorConfig], dict)


class Unexplained(GeneratorConfig):
    """Holds an option that nobody explains."""

    gain: float = 1.0


class UnexplainedOption(Sound):
    """Has an option without a docstring."""

    Config = Unexplained


class NoReadings(Sound):
    """Takes nothing."""

    readings = ()


class OneType(Sound):
    """Its readings are a type, not a tuple."""

    readings = cast(tuple[type[Reading], ...], Wrench)


class NotAReading(Sound):
    """Its readings are no types of reading."""

    readings = cast(tuple[type[Reading], ...], (int,))


class NoOutputs(Sound):
    """Gives nothing."""

    outputs = {}


class SlashedOutput(Sound):
    """Has a slash in the name of an output."""

    outputs = {"a/b": REGULAR}


class UnknownKind(Sound):
    """Has an output of no kind."""

    outputs = {"": cast(HypothesisKind, "rumour")}


@pytest.mark.parametrize(
    ("cls", "fault"),
    [
        (int, "int is no subclass of Generator"),
        (NoGenerate, "NoGenerate does not implement `generate` of Generator"),
        (NoDocstring, "NoDocstring has no docstring"),
        (PlainConfig, "`Config` that is no subclass of GeneratorConfig"),
        (UnexplainedOption, "does not document its option 'gain'"),
        (NoReadings, "needs `readings`"),
        (OneType, "needs `readings`"),
        (NotAReading, "needs `readings`"),
        (NoOutputs, "needs `outputs`"),
        (SlashedOutput, "needs `outputs`"),
        (UnknownKind, "needs `outputs`"),
    ],
)
def test_it_must_declare_itself_in_full(cls: Any, fault: str) -> None:
    refused(cls, fault)


class Needy(GeneratorConfig):
    """Cannot be built without options."""

    gain: float
    """The gain."""


class NeedyGenerator(Sound):
    """Needs options."""

    Config = Needy


class Unbuildable(Sound):
    """Raises when it is built."""

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        raise OSError("no such file")


def test_options_that_are_needed_must_be_passed() -> None:
    refused(NeedyGenerator, "needs options, so pass `config`: gain: this field is required")
    check_generator(NeedyGenerator, config=Needy(gain=2.0))
    refused(NeedyGenerator, "takes a Needy, not GeneratorConfig", config=GeneratorConfig())


class Narrow(Sound):
    """Takes no configuration."""

    def __init__(self, name: str) -> None:
        super().__init__(name, GeneratorConfig())


class Detached(Sound):
    """Keeps neither name nor configuration."""

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        self.reset()


class Contradictory(GeneratorConfig):
    """Refuses its own default."""

    gain: float = Field(default=-1.0, gt=0)
    """The gain."""


class ContradictoryOption(Sound):
    """Has an option whose default is invalid."""

    Config = Contradictory


class Raising(GeneratorConfig):
    """Raises where a default is made."""

    gain: float = Field(default_factory=lambda: 1 / 0)
    """The gain."""


class RaisingOption(Sound):
    """Has an option whose default raises."""

    Config = Raising


@pytest.mark.parametrize(
    ("cls", "fault"),
    [
        (Unbuildable, "cannot be built: OSError: no such file (tests/test_testing.py, line "),
        (Narrow, "__init__() takes 2 positional arguments but 3 were given (tests/test_testing.py"),
        (Detached, "does not hand `name` and `config` to `super().__init__`"),
        (ContradictoryOption, "refuses a default of its own `Config`: gain: input should be great"),
        (RaisingOption, "cannot be configured: ZeroDivisionError: division by zero (tests/test_te"),
    ],
)
def test_it_must_be_buildable(cls: Any, fault: str) -> None:
    refused(cls, fault)


class Unpreparable(Sound):
    """Cannot be prepared for a robot."""

    def prepare(self, robot: object) -> None:
        raise RuntimeError("no such link")


def test_it_must_be_prepared_for_the_robot_that_is_given() -> None:
    robot: Any = SimpleNamespace(model=None)
    check_generator(Unpreparable)
    state = State(now=0.0, grid=Grid("base", 0.005), robot=robot)
    refused(Unpreparable, "cannot be built: RuntimeError: no such link", state=state)


def test_readings_that_are_passed_must_be_of_its_types() -> None:
    refused(Sound, "takes PointCloud, Wrench", readings=[])
    refused(Sound, "takes PointCloud, Wrench", readings=[example_reading(Switch)])


class Echo(Generator[GeneratorConfig]):
    """Passes its reading to a function, by default one that keeps every rule."""

    readings = (PointCloud,)
    act: ClassVar[Callable[["Echo", PointCloud], object]]

    def generate(self, reading: Reading, state: State) -> Clouds:
        assert isinstance(reading, PointCloud)
        return cast(Clouds, type(self).act(self, reading))

    def say(self, reading: PointCloud, **other: Any) -> HypothesisCloud:
        cloud = self.cloud(reading, np.nan_to_num(reading.points), 0.001)
        for field, value in other.items():
            object.__setattr__(cloud, field, value)  # behind the back of the cloud's own checks
        return cloud


def restamped(reading: PointCloud) -> list[HypothesisCloud]:
    object.__setattr__(reading, "stamp", reading.stamp + 0.1)
    return []


def overwritten(reading: PointCloud) -> list[HypothesisCloud]:
    reading.points.flags.writeable = True
    reading.points[0] = 0.25
    return []


FAULTS: dict[str, tuple[Callable[[Echo, PointCloud], object], str]] = {
    "raises": (lambda e, r: 1 / 0, "raised on a PointCloud: ZeroDivisionError"),
    "gives none": (lambda e, r: None, "gave NoneType, not a sequence of clouds"),
    "gives an iterator": (lambda e, r: iter([]), "gave list_iterator, not a sequence of clouds"),
    "gives numbers": (lambda e, r: [1], "gave int, not a HypothesisCloud"),
    "invalid cloud": (lambda e, r: [e.cloud(r, r.points, 2.0)], "outside [0, 1]"),
    "two of one output": (lambda e, r: [e.say(r), e.say(r)], "gave two clouds of one output"),
    "not declared": (lambda e, r: [e.say(r, source="skin")], "'skin' that it does not declare"),
    "other kind": (lambda e, r: [e.say(r, kind=NULL)], "of kind null; declared is regular"),
    "other stamp": (lambda e, r: [e.say(r, stamp=r.stamp + 1)], "with stamp 1.0 s for a reading"),
    "unknown frame": (lambda e, r: [e.say(r, frame="moon")], "in frame 'moon'; known are: base"),
    "above 1": (lambda e, r: [e.say(r, likelihoods=np.full(64, 1.1))], "outside [0, 1]"),
    "NaN": (lambda e, r: [e.say(r, likelihoods=np.full(64, np.nan))], "outside [0, 1]"),
    "sum above 1": (
        lambda e, r: [e.say(r, single=True, likelihoods=np.full(64, 0.5))],
        "of a single contact whose likelihoods sum to 32",
    ),
    "changes the stamp": (lambda e, r: restamped(r), "changed its PointCloud"),
    "changes the values": (
        lambda e, r: overwritten(r),
        "ValueError: cannot set WRITEABLE flag to True of this array (tests/test_testing.py, line ",
    ),
    "exits": (lambda e, r: sys.exit(3), "raised on a PointCloud: SystemExit: 3"),
    "gives too many": (
        lambda e, r: [e.cloud(r, np.zeros((2_000_001, 3)), 0.5)],
        "of 2000001 hypotheses; by default at most 2000000 are accepted",
    ),
    "random": (
        lambda e, r: [e.cloud(r, np.random.default_rng().random(3), 0.5)],
        "is not deterministic",
    ),
    "fears zeros": (
        lambda e, r: [e.say(r)] if r.points.any() else 1 / 0,
        "ZeroDivisionError: division by zero (tests/test_testing.py, ",
    ),
    "fears large values": (
        lambda e, r: [e.say(r)] if not r.points.max() > 1e3 else 1 / 0,
        "(a reading with large values)",
    ),
    "fears no returns": (
        lambda e, r: [e.cloud(r, r.points, 0.1)],
        "not finite: [nan nan nan] (a reading with no returns)",
    ),
    "fears the past": (
        lambda e, r: [e.say(r)] if r.stamp >= 0.0 else 1 / 0,
        "(a reading with the earliest stamp)",
    ),
    "fears the future": (
        lambda e, r: [e.say(r)] if r.stamp < 1e9 else 1 / 0,
        "(a reading with the latest stamp)",
    ),
}


def test_an_echo_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Echo, "act", lambda e, r: [e.say(r)], raising=False)
    check_generator(Echo)


@pytest.mark.parametrize(("act", "fault"), FAULTS.values(), ids=FAULTS)
def test_what_it_gives_must_keep_every_rule(
    act: Callable[[Echo, PointCloud], object], fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Echo, "act", act, raising=False)
    refused(Echo, fault)


class Clinging(Sound):
    """Does not start again."""

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        super().__init__(name, config)
        self.seen = [np.zeros(3)]

    def reset(self) -> None:
        return None


class Unresettable(Sound):
    """Raises at its second reset, the first being that of its making."""

    seen: Any = None

    def reset(self) -> None:
        if self.seen is not None:
            raise RuntimeError("worn out")
        super().reset()


class Sharing(Sound):
    """All instances remember in one place, that a new one empties."""

    common: ClassVar[list[Any]] = []

    def reset(self) -> None:
        self.common.clear()
        self.common.append(np.zeros(3))
        self.seen = self.common


class Remembering(Sound):
    """All instances remember in one place, for ever."""

    common: ClassVar[list[Any]] = [np.zeros(3)]

    def reset(self) -> None:
        self.seen = self.common


class Rooted(Sound):
    """Cannot travel."""

    def __init__(self, name: str, config: GeneratorConfig) -> None:
        super().__init__(name, config)
        self.gain = lambda: 1.0


class Changeling(Sound):
    """Arrives as another."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, seen=[np.ones(3)])


@pytest.mark.parametrize(
    ("cls", "fault"),
    [
        (Clinging, "is not as new after reset()"),
        (Unresettable, "raised at reset(): RuntimeError: worn out"),
        (Remembering, "is not deterministic"),
        (Sharing, "is not independent of its other instances"),
        (Rooted, "cannot be pickled, so it cannot be isolated"),
        (Changeling, "is not the same after it was pickled"),
    ],
)
def test_its_memory_is_its_own_and_ends_at_reset(cls: type[Sound], fault: str) -> None:
    refused(cls, fault)


@pytest.mark.parametrize("kind", READING_TYPES.values())
def test_there_is_an_example_of_every_type_of_reading(kind: type[Reading]) -> None:
    first, second = example_reading(kind), example_reading(kind, 1)
    assert type(first) is type(second) is kind
    assert first.stamp < second.stamp


class Smell(Reading):
    """A reading that the kit does not know."""


class Nose(Sound):
    """Takes an unknown reading."""

    readings = (Smell,)


def test_readings_of_a_new_type_must_be_passed() -> None:
    refused(Nose, "there is no example of Smell: pass `readings`")
    check_generator(Nose, readings=[Smell(stamp=0.0, frame="nose")])
