"""The contract of generators: readings in, clouds of hypotheses out."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from contactfusion.errors import PluginError, name_hint
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Resultant
from contactfusion.model import Model
from contactfusion.plugins import class_fault
from contactfusion.readings import Reading
from contactfusion.state import State
from contactfusion.units import Memory

if TYPE_CHECKING:
    from contactfusion.robots.model import RobotModel


@dataclass(frozen=True)
class OfRobot:
    """Marks an option that may be a name, or a list of names, from the robot's description.

        patch: Annotated[PatchConfig, OfRobot("patches")]

    Attributes:
        kind: the field of `RobotConfig` that holds it by name.
    """

    kind: Literal["patches", "wrists", "cameras", "fingers", "efforts"]


class GeneratorConfig(Model):
    """Options of all generators; each adds its own fields."""

    sensor: str | None = None
    """The only sensor whose readings it takes; None: all sensors of the right type."""
    timeout: Memory | None = Field(default=None, gt=0)
    """Lifetime of its hypotheses [s]; None: the integrator's timeout."""
    stale_after: Memory | None = Field(default=None, gt=0)
    """Silence after which it is inactive [s]; None: the integrator's."""
    replace: bool = True
    """Whether each of its clouds replaces all earlier ones, as for a moving contact."""
    sensitivity: float = Field(default=0.0, ge=0, lt=1)
    """Probability of detection of a contact; above 0, an empty cloud is evidence against
    contacts, where the rule uses it (`sets`)."""
    budget: Memory = Field(default=0.1, gt=0)
    """Time for one reading [s] above which it is an overrun."""
    isolate: bool = False
    """Whether it runs in a process of its own, so that no cycle waits for it."""
    patience: Memory = Field(default=60.0, gt=0)
    """Without a clock, as in a replay: time for which a step waits for one answer of its process
    [s] before the process is ended, and the generator stays out."""


ConfigT = TypeVar("ConfigT", bound=GeneratorConfig)


class Generator(ABC, Generic[ConfigT]):
    """Turns the readings of one sensor into contact hypotheses (F §IV).

    A subclass declares its `Config`, the `readings` that it takes and its `outputs`, and implements
    `generate`. Its module ends with a hook that offers it:

        @hookimpl
        def contactfusion_generators():
            return {"bumper": BumperGenerator}

    Args:
        name: of this instance; its sources are named after it.
        config: the options, an instance of `Config`.
    """

    Config: ClassVar[type[GeneratorConfig]] = GeneratorConfig
    """The type of the options."""
    readings: ClassVar[tuple[type[Reading], ...]]
    """The types of the readings that it takes."""
    outputs: Mapping[str, HypothesisKind] = {"": HypothesisKind.REGULAR}
    """The kind of each output; output "free" of the generator "skin" is the source "skin/free"."""
    needs_body: ClassVar[bool] = False
    """Whether it needs the robot or its surface for any cloud; `check` then requires it."""

    resultant: Resultant | None = None
    """The sum of all contacts on a part of the robot by the last reading, in the grid's frame, for
    other generators; None: it is not measured."""

    def __init__(self, name: str, config: ConfigT) -> None:
        self.name = name
        self.config = config

    @abstractmethod
    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The clouds of a reading, at most one for each output.

        An empty cloud means "looked, found nothing"; no cloud means "did not look".

        Args:
            reading: one of the types in `readings`.
            state: the robot at the reading's stamp.
        """

    def absorb(self, reading: Reading, state: State) -> None:
        """Take note of a reading that a newer one of its sensor follows before the next step.

        On a running robot, and of a recording, a generator that implements it is asked for the
        clouds of the newest reading only, unless they add to earlier ones (`replace: false`); it
        must do here what later clouds depend on, such as filtering. Other generators are asked for
        the clouds of each reading.

        Args:
            reading: as for `generate`.
            state: the robot at the reading's stamp.
        """
        raise NotImplementedError  # only called where a class implements it

    @property
    def absorbs(self) -> bool:
        """Whether it need not make clouds of each reading."""
        return type(self).absorb is not Generator.absorb

    def prepare(self, robot: "RobotModel") -> None:
        """Do long computations that depend on the robot alone, before the first reading."""
        return None

    def most_hypotheses(self, grid: Grid) -> int | None:
        """The greatest number of hypotheses in a cloud; None: unknown before readings come.

        Args:
            grid: the hypothesis space.
        """
        return None

    def reset(self) -> None:
        """Drop all state of earlier readings."""
        return None

    @property
    def waits_for(self) -> str:
        """What it waits for, in a sentence, as long as it yields no clouds; else empty."""
        return ""

    @property
    def sources(self) -> dict[str, HypothesisKind]:
        """The sources of its clouds, by name."""
        return {self.source(output): kind for output, kind in self.outputs.items()}

    def source(self, output: str = "") -> str:
        """The name of the source of one output."""
        return f"{self.name}/{output}" if output else self.name

    def cloud(
        self,
        reading: Reading,
        positions: ArrayLike,
        likelihoods: ArrayLike,
        *,
        output: str = "",
        frame: str | None = None,
        **optional: Any,
    ) -> HypothesisCloud:
        """A cloud of one output, with the stamp of the reading.

        Args:
            reading: from which it follows.
            positions: shape (n, 3) [m].
            likelihoods: shape (n,), or one number for all.
            output: that it belongs to.
            frame: the frame of the positions; that of the reading by default.
            **optional: `forces`, `spreads`, `single`, `notes` and `resultant` of the cloud.
        """
        if output not in self.outputs:
            hint = name_hint(output, self.outputs, "outputs")
            raise PluginError(f"'{self.name}' has no output '{output}'; {hint}")
        points = np.asarray(positions, np.float64).reshape(-1, 3)
        return HypothesisCloud(
            source=self.source(output),
            kind=self.outputs[output],
            stamp=reading.stamp,
            frame=frame or reading.frame,
            positions=points,
            likelihoods=np.broadcast_to(np.asarray(likelihoods, np.float64), len(points)),
            **optional,
        )

    def nothing(
        self,
        reading: Reading,
        *,
        output: str = "",
        frame: str | None = None,
        notes: Sequence[str] = (),
    ) -> HypothesisCloud:
        """The empty cloud of one output: looked, found nothing.

        Args:
            reading: where it looked.
            output: its name.
            frame: of the cloud; None: that of the reading.
            notes: remarks; with one, its silence counts against no contact.
        """
        return self.cloud(
            reading, np.empty((0, 3)), 0.0, output=output, frame=frame, notes=tuple(notes)
        )


def generator_fault(cls: type[Generator[Any]]) -> str:
    """Why a class breaks the contract of generators, see `class_fault`; empty if it does not."""
    if fault := class_fault(cls, Generator, GeneratorConfig):
        return fault
    kinds: object = getattr(cls, "readings", ())
    declared = isinstance(kinds, tuple) and all(
        inspect.isclass(kind) and issubclass(kind, Reading) for kind in kinds
    )
    if not (declared and kinds):
        return "needs `readings`, a tuple of the types of reading that it takes"
    return ""


def instance_fault(generator: Generator[Any], name: str) -> str:
    """Why a generator that was built under a name breaks the contract; empty if it does not."""
    config = getattr(generator, "config", None)
    if getattr(generator, "name", None) != name or not isinstance(config, generator.Config):
        return "does not hand `name` and `config` to `super().__init__`"
    outputs: object = generator.outputs
    declared = isinstance(outputs, Mapping) and all(
        isinstance(output, str) and "/" not in output and isinstance(kind, HypothesisKind)
        for output, kind in outputs.items()
    )
    if not (declared and outputs):
        return "needs `outputs`, a mapping of names without a slash to HypothesisKind"
    return ""


def checked_clouds(clouds: object) -> Sequence[HypothesisCloud]:
    """The output of a generator, refused where it is no sequence of clouds.

    Raises:
        TypeError: it is anything else.
    """
    if not isinstance(clouds, Sequence):  # an iterator would be spent by the check
        raise TypeError(f"it gave {type(clouds).__name__}, not a sequence of clouds")
    for cloud in clouds:
        if not isinstance(cloud, HypothesisCloud):
            raise TypeError(f"it gave {type(cloud).__name__}, not a HypothesisCloud")
    return clouds
