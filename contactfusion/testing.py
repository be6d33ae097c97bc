"""The conformance kit: does a generator, or a kind of reading, keep its contract?

The tests of a plug-in call `check_generator` and `check_codec` on its classes; so do those of the
built-in ones.
"""

import pickle
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import (
    ConfigurationError,
    ContactFusionError,
    DefaultError,
    DependencyError,
    InvalidReadingError,
    cause_of,
)
from contactfusion.faults import FAULTS, Fault, Faults
from contactfusion.frames import FrameTree, Pose
from contactfusion.generator import (
    Generator,
    GeneratorConfig,
    checked_clouds,
    generator_fault,
    instance_fault,
)
from contactfusion.grid import Grid
from contactfusion.hypotheses import SUM_TOLERANCE, HypothesisCloud, HypothesisKind
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.plugins import class_fault
from contactfusion.readings import Reading
from contactfusion.readings.canvas import PLAIN, Canvas, Colour, Colours
from contactfusion.readings.codec import Codec
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.reading import R
from contactfusion.readings.registry import GROUP as KINDS
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.state import State
from contactfusion.time import LONGEST_SECONDS

EXAMPLES = 3
"""Number of example readings of each type."""
COMMON = len(fields(Reading))
"""The fields that readings of all kinds have come first."""
EPOCH = 1_700_000_000_000_000_000
"""When examples are recorded [ns]."""
LARGE = 1e6
"""A value that no sensor gives in earnest, in any unit."""

MOST = IntegratorConfig().max_hypotheses
"""A cloud of more hypotheses is refused, if no configuration allows more."""

Bits = tuple[str, ...]
"""What a reading or cloud holds, to be compared bit for bit."""


class ConformanceError(ContactFusionError, AssertionError):
    """A generator or a codec breaks the contract."""


def check_generator(
    cls: type[Generator[Any]],
    *,
    config: GeneratorConfig | None = None,
    readings: Sequence[Reading] | None = None,
    state: State | None = None,
    name: str = "under_test",
) -> None:
    """Check that a generator keeps the contract; its quality and speed are not rated.

    It must declare itself in full, give valid clouds of its declared outputs, give the same clouds
    for the same readings, leave readings as they are, share nothing with other instances, start
    again at `reset`, travel to another process, and stand zeros, large values and extreme stamps.

    Args:
        cls: the class of the generator.
        config: its options; the defaults of its `Config` when not given.
        readings: what its sensors give, in order; examples of its types when not given.
        state: the robot; only `now` is changed. When not given, all frames of readings coincide.
        name: of the instance.

    Raises:
        ConformanceError: the first rule that is broken.
    """
    _check_declarations(cls)
    options = _options(cls, config)
    samples = _samples(cls, readings)
    trial = _Trial(cls, options, name, samples, state or _plain_state(samples))
    answers = trial.answers(trial.built())
    same = trial.answers(trial.built()) == answers
    _require(same, cls, "is not deterministic: it gave other clouds")
    _check_independent(trial, answers)
    _check_reset(trial, answers)
    _check_picklable(trial, answers)
    generator = trial.built()
    for what, reading in _unexpected(samples):
        try:
            trial.answer(generator, reading)
        except ConformanceError as error:
            raise ConformanceError(f"{error} (a reading with {what})") from error


def example_reading(kind: type[R], index: int = 0) -> R:
    """A plausible reading of a type; a higher index makes a later one with other values.

    Raises:
        ConformanceError: there is no example of the type.
    """
    kinds = installed_kinds()
    codec = next((codec for codec in kinds.all() if issubclass(codec.kind, kind)), None)
    if codec is None:
        raise ConformanceError(f"there is no example of {kind.__name__}: pass `readings`")
    with kinds.guard(codec):
        reading: R = codec.example(0.1 * index, 1.0 + 0.25 * index)
    return reading


def check_codec(cls: type[Codec[Any]]) -> None:
    """Check that a kind of reading keeps the contract.

    It must be registered. Its examples must be equal each time, travel to another process, come
    back as they were from a recording of ROS and from the columns of a log, stay readings of the
    kind, frame and stamp under every fault, and be drawn if the codec has a `draw`.

    Args:
        cls: the codec of the kind; what it does not declare is not checked.

    Raises:
        ConformanceError: the first rule that is broken.
        DependencyError: rosbags is not installed, and the kind has messages.
    """
    codec = _registered(cls)
    with _sentences(cls, "`example`"):
        examples = [codec.example(0.1 * i, 1.0 + 0.25 * i) for i in range(EXAMPLES)]
        again = [codec.example(0.1 * i, 1.0 + 0.25 * i) for i in range(EXAMPLES)]
    for example, twin in zip(examples, again, strict=True):
        fits = isinstance(example, codec.kind) and isinstance(twin, codec.kind)
        _require(fits, cls, f"gives an example that is no {codec.kind.__name__}: {example!r}")
        _require(_bits(example) == _bits(twin), cls, "gives another example each time")
        with _sentences(cls, "pickling"):
            travelled = pickle.loads(pickle.dumps(example))
        _require(_bits(travelled) == _bits(example), cls, "is not the same after it was pickled")
    stamps = [example.stamp for example in examples]
    _require(stamps == [0.1 * i for i in range(EXAMPLES)], cls, f"gives stamps {stamps} of its own")
    if codec.messages:
        _check_messages(codec, examples)
    if codec.Columns is not None:
        for example in examples:
            _check_columns(codec, codec.Columns, example)
    for name, fault in FAULTS.items():
        _check_fault(codec, name, fault, examples)
    if codec.is_drawn:
        sketch = _Sketch(cls)
        with _sentences(cls, "`draw`"):
            for example in examples:
                codec.draw(sketch, example)
        _require(sketch.count > 0, cls, "draws nothing of its examples, and has a `draw`")


def _registered(cls: type[Codec[Any]]) -> Codec[Any]:
    """The codec of a class, as the framework finds it."""
    fault = class_fault(cls, Codec)
    _require(not fault, cls, fault)
    _require(bool(cls.__doc__), cls, "has no docstring")
    try:
        codec = installed_kinds().find(str(getattr(cls, "name", "")))
    except ContactFusionError as error:
        raise ConformanceError(str(error)) from error
    if codec is None or type(codec) is not cls:
        entry = f"{getattr(cls, 'name', 'NAME')} = {cls.__module__}:{cls.__name__}"
        raise _broken(cls, f"is not registered: install an entry point of {KINDS} named {entry}")
    return codec


def _check_messages(codec: Codec[Any], examples: Sequence[Reading]) -> None:
    """Record the examples, and compare with what is read of the recording."""
    cls = type(codec)
    with TemporaryDirectory() as folder, _sentences(cls, "recording"):
        path = Path(folder) / "examples.mcap"
        with McapWriter(path, EPOCH) as writer:
            for example in examples:
                writer.reading(example)
        recording = RosRecording(RosConfig(file=path))
        found = [back for back in recording.readings() if type(back) is type(examples[0])]
        tallies = recording.tally.values()
        why = "".join(tally.why_unreadable or tally.why_refused for tally in tallies)
    _require(len(found) == len(examples), cls, f"does not come back from a recording: {why}")
    for example, back in zip(examples, found, strict=True):
        wrong = ", ".join(_different(example, back))
        _require(not wrong, cls, f"comes back from a recording with other {wrong}")


def _check_columns(codec: Codec[Any], columns: type[ColumnsConfig], example: Reading) -> None:
    """Make the example of a row that holds its numbers in the order of its fields."""
    cls = type(codec)
    held = {field.name: getattr(example, field.name) for field in fields(example)[COMMON:]}
    given: dict[str, Any] = {
        name: np.asarray(value).tolist()
        for name, value in held.items()
        if name in columns.model_fields
    }
    rest = [np.ravel(value) for name, value in held.items() if name not in given]
    row = np.concatenate([array.astype(float) for array in rest if array.dtype.kind in "fb"])
    with _sentences(cls, "`Columns`"):
        config = columns(
            type=codec.name, frame=example.frame, columns=tuple(range(1, len(row) + 1)), **given
        )
        counts = config.counts()
        fits = not counts or len(row) in counts
        _require(fits, cls, f"has `Columns` for {counts} values, and an example of {len(row)}")
        made = config.reading({"stamp": example.stamp, "frame": config.frame, "sensor": ""}, row)
    wrong = ", ".join(_different(example, made))
    _require(not wrong, cls, f"comes from the columns of a log with other {wrong}")


def _check_fault(
    codec: Codec[Any], name: str, fault: type[Fault], examples: Sequence[Reading]
) -> None:
    """Apply a fault to the examples; a refusal in a sentence is an answer, too."""
    cls = type(codec)
    options: dict[str, Any] = {
        "dropout": {"probability": 0.5},
        "delay": {"seconds": 0.0},
        "calibration": {"mm": (1.0, 2.0, 3.0), "degrees": (4.0, 5.0, 6.0)},
        **dict.fromkeys(
            ("bias", "drift", "noise"), {"amount": [0.1] * (*codec.values.counts, 1)[0]}
        ),
    }
    faults = Faults([fault(**options.get(name, {}))])
    for example in examples:
        with suppress(ConfigurationError), _sentences(cls, f"the fault '{name}'"):
            for left in faults.apply(example):
                same = type(left) is type(example) and left.frame == example.frame
                _require(same, cls, f"gives {left!r} for the fault '{name}' of {example!r}")


@contextmanager
def _sentences(cls: type[Any], what: str) -> Iterator[None]:
    """Make what is raised a sentence that names the class; refusals of configurations pass."""
    try:
        yield
    except (ConformanceError, ConfigurationError, DependencyError):
        raise
    except (Exception, SystemExit) as error:
        raise _broken(cls, f"fails: {what} raised {cause_of(error, cls)}") from error


def _different(reading: Reading, other: Reading) -> Iterator[str]:
    """The fields in which two readings differ by more than float32 does; the sensor may."""
    for field in fields(reading):
        mine, theirs = getattr(reading, field.name), getattr(other, field.name)
        if isinstance(mine, np.ndarray) and isinstance(theirs, np.ndarray):
            same = mine.shape == theirs.shape and np.allclose(
                mine.astype(float), theirs.astype(float), rtol=1e-6, equal_nan=True
            )
        else:
            same = mine == theirs or field.name == "sensor"
        if not same:
            yield f"`{field.name}`"


class _Sketch(Canvas):
    """A canvas that draws nothing, and refuses what no canvas can draw."""

    def __init__(self, cls: type[Codec[Any]]) -> None:
        self._cls = cls
        self.count = 0
        """Number of drawings."""

    def points(
        self,
        points: FloatArray,
        colours: Colour | Colours = PLAIN,
        *,
        labels: Sequence[str] = (),
        large: bool = False,
    ) -> None:
        self._shaped("points", points, None, 3)
        self._coloured(colours, len(points))
        named = len(labels) in (0, len(points))
        _require(named, self._cls, f"draws {len(points)} points with {len(labels)} labels")

    def spheres(self, centres: FloatArray, radius: float, colour: Colour) -> None:
        self._shaped("centres of spheres", centres, None, 3)
        self._coloured(colour, 0)

    def arrow(self, name: str, vector: FloatArray, unit: str, colour: Colour) -> None:
        self._shaped(f"arrow '{name}'", vector, 3)
        self._coloured(colour, 0)

    def taxels(self, values: FloatArray) -> None:
        self._shaped("values of taxels", values, None)

    def depth_image(
        self, depth: FloatArray, intrinsics: FloatArray, colour: Colours | None
    ) -> None:
        self._shaped("depth", depth, None, None)
        self._shaped("intrinsics", intrinsics, 3, 3)
        if colour is not None:
            self._shaped("colour", colour, *depth.shape, 3)

    def axes(self, name: str, pose: Pose) -> None:
        self._shaped("pose of axes", pose, 4, 4)

    def _shaped(self, what: str, array: Any, *shape: int | None) -> None:
        self.count += 1
        have = np.shape(array)
        fits = len(have) == len(shape) and all(
            b in (None, a) for a, b in zip(have, shape, strict=True)
        )
        wanted = tuple("n" if size is None else size for size in shape)
        is_array = isinstance(array, np.ndarray)
        _require(fits and is_array, self._cls, f"draws {what} of shape {have}, not {wanted}")

    def _coloured(self, colours: Any, count: int) -> None:
        have = np.shape(colours)
        fits = have == (3,) or have in ((count, 3), (count, 4))
        _require(fits, self._cls, f"draws in colours of shape {have}: RGB, or one a point")


class _Trial:
    """A generator's class with the name, options, readings and state for its instances."""

    def __init__(
        self,
        cls: type[Generator[Any]],
        config: GeneratorConfig,
        name: str,
        samples: Sequence[Reading],
        state: State,
    ) -> None:
        self.cls, self.samples = cls, samples
        self._config, self._name, self._state = config, name, state

    def built(self) -> Generator[Any]:
        try:
            generator = self.cls(self._name, self._config)
            fault = instance_fault(generator, self._name)
            if self._state.robot is not None and not fault:
                generator.prepare(self._state.robot.model)
        except (Exception, SystemExit) as error:
            fault = f"cannot be built: {cause_of(error, self.cls)}"
            raise _broken(self.cls, fault) from error
        _require(not fault, self.cls, fault)
        return generator

    def answers(self, generator: Generator[Any]) -> list[tuple[Bits, ...]]:
        """The checked answers of a generator to all samples."""
        return [self.answer(generator, reading) for reading in self.samples]

    def answer(self, generator: Generator[Any], reading: Reading) -> tuple[Bits, ...]:
        """The checked answer of a generator to one reading."""
        state, before = replace(self._state, now=reading.stamp), _bits(reading)
        try:
            clouds = checked_clouds(generator.generate(reading, state))
        except (Exception, SystemExit) as error:
            fault = f"raised on a {reading.label}: {cause_of(error, self.cls)}"
            raise _broken(self.cls, fault) from error
        _require(_bits(reading) == before, self.cls, f"changed its {reading.label}")
        sources = [cloud.source for cloud in clouds]
        twice = len(set(sources)) < len(sources)
        _require(not twice, self.cls, f"gave two clouds of one output: {', '.join(sources)}")
        frames = {reading.frame, state.grid.frame, *state.frames.frames}
        for cloud in clouds:
            fault = _fault(cloud, generator.sources, reading, frames)
            _require(not fault, self.cls, f"gave a cloud of '{cloud.source}' {fault}")
        return tuple(_bits(cloud) for cloud in clouds)


def _check_declarations(cls: type[Generator[Any]]) -> None:
    fault = generator_fault(cls)
    _require(not fault, cls, fault)
    _require(bool(cls.__doc__), cls, "has no docstring")
    for field, info in cls.Config.model_fields.items():
        _require(bool(info.description), cls, f"does not document its option '{field}'")


def _options(cls: type[Generator[Any]], config: GeneratorConfig | None) -> GeneratorConfig:
    if config is None:
        try:
            return cls.Config()
        except DefaultError as error:
            raise _broken(cls, f"refuses a default of its own `Config`: {error}") from error
        except ContactFusionError as error:
            raise _broken(cls, f"needs options, so pass `config`: {error}") from error
        except (Exception, SystemExit) as error:
            raise _broken(cls, f"cannot be configured: {cause_of(error, cls.Config)}") from error
    wanted = cls.Config.__name__
    _require(isinstance(config, cls.Config), cls, f"takes a {wanted}, not {type(config).__name__}")
    return config


def _samples(cls: type[Generator[Any]], readings: Sequence[Reading] | None) -> list[Reading]:
    if readings is None:
        return [example_reading(kind, i) for i in range(EXAMPLES) for kind in cls.readings]
    fit = len(readings) > 0 and all(isinstance(reading, cls.readings) for reading in readings)
    kinds = ", ".join(kind.__name__ for kind in cls.readings)
    _require(fit, cls, f"takes {kinds}: pass `readings` of these types")
    return list(readings)


def _check_independent(trial: _Trial, answers: list[tuple[Bits, ...]]) -> None:
    """Compare with the answers beside a second instance, which gets the samples backwards."""
    generator, other = trial.built(), trial.built()
    between = []
    for reading, last in zip(trial.samples, reversed(trial.samples), strict=True):
        between.append(trial.answer(generator, reading))
        trial.answer(other, last)
    _require(between == answers, trial.cls, "is not independent of its other instances")


def _check_reset(trial: _Trial, answers: list[tuple[Bits, ...]]) -> None:
    generator = trial.built()
    trial.answers(generator)
    try:
        generator.reset()
    except (Exception, SystemExit) as error:
        raise _broken(trial.cls, f"raised at reset(): {cause_of(error, trial.cls)}") from error
    _require(trial.answers(generator) == answers, trial.cls, "is not as new after reset()")


def _check_picklable(trial: _Trial, answers: list[tuple[Bits, ...]]) -> None:
    generator = trial.built()
    try:
        travelled = pickle.loads(pickle.dumps(generator))
    except Exception as error:  # pickle raises anything
        fault = f"cannot be pickled, so it cannot be isolated: {cause_of(error, trial.cls)}"
        raise _broken(trial.cls, fault) from error
    same = trial.answers(travelled) == answers
    _require(same, trial.cls, "is not the same after it was pickled")


def _fault(
    cloud: HypothesisCloud,
    sources: Mapping[str, HypothesisKind],
    reading: Reading,
    frames: set[str],
) -> str:
    """The fault of a cloud, as the end of a sentence; empty: none."""
    likelihoods = cloud.likelihoods
    if cloud.source not in sources:
        return f"that it does not declare; its sources are: {', '.join(sources)}"
    if cloud.kind != sources[cloud.source]:
        return f"of kind {cloud.kind}; declared is {sources[cloud.source]}"
    if cloud.stamp != reading.stamp:
        return f"with stamp {cloud.stamp} s for a reading of {reading.stamp} s"
    if cloud.frame not in frames:
        return f"in frame '{cloud.frame}'; known are: {', '.join(sorted(frames))}"
    if len(cloud) > MOST:
        return f"of {len(cloud)} hypotheses; by default at most {MOST} are accepted"
    if not ((likelihoods >= 0.0) & (likelihoods <= 1.0)).all():
        return "with a likelihood outside [0, 1]"
    if cloud.single and likelihoods.sum() > 1.0 + SUM_TOLERANCE:
        return f"of a single contact whose likelihoods sum to {likelihoods.sum():.6g}"
    return ""


def _unexpected(samples: Sequence[Reading]) -> Iterator[tuple[str, Reading]]:
    """Valid readings that a generator may not expect, each with its description."""
    for kind in dict.fromkeys(type(reading) for reading in samples):
        reading = next(sample for sample in samples if type(sample) is kind)
        yield "zeros", _filled(reading, 0.0)
        yield "large values", _filled(reading, LARGE)
        yield "no returns", _filled(reading, np.nan)
        yield "the earliest stamp", replace(reading, stamp=-LONGEST_SECONDS)
        yield "the latest stamp", replace(reading, stamp=LONGEST_SECONDS)


def _filled(reading: R, value: float) -> R:
    """The reading with one value in all its arrays, as far as its type allows it."""
    codec = installed_kinds().of(type(reading))
    settings = codec.settings if codec else ()
    for field in fields(reading):
        held = getattr(reading, field.name)
        if isinstance(held, np.ndarray) and field.name not in settings and held.dtype.kind == "f":
            change: dict[str, Any] = {field.name: np.full_like(held, value)}
            try:
                reading = replace(reading, **change)
            except InvalidReadingError:
                continue  # e.g. no orientation is all zeros
    return reading


def _plain_state(samples: Sequence[Reading]) -> State:

    grid = Grid("base", 0.005)
    here = (grid.frame, np.eye(4))
    frames = {reading.frame: here for reading in samples if reading.frame != grid.frame}
    return State(now=0.0, grid=grid, frames=FrameTree(frames))


def _bits(record: Reading | HypothesisCloud) -> Bits:
    def bits(value: object) -> str:
        if isinstance(value, np.ndarray):
            return f"{value.dtype}{value.shape}{value.tobytes().hex()}"
        return repr(value)

    return tuple(bits(getattr(record, field.name)) for field in fields(record))


def _require(kept: bool, cls: object, fault: str) -> None:
    if not kept:
        raise _broken(cls, fault)


def _broken(cls: object, fault: str) -> ConformanceError:
    return ConformanceError(f"{getattr(cls, '__name__', repr(cls))} {fault}")
