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
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
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

    kind: Literal["patches", "wrists", "cameras", "fingers"]


class GeneratorConfig(Model):
    """What every generator can be told; each adds its own fields."""

    sensor: str | None = None
    """Take the readings of this sensor only; None: of every sensor of the right type."""
    timeout: Memory | None = Field(default=None, gt=0)
    """How long its hypotheses live [s]; None: the integrator's timeout."""
    stale_after: Memory | None = Field(default=None, gt=0)
    """The silence after which it counts as inactive [s]; None: the integrator's."""
    replace: bool = True
    """Whether each of its clouds replaces all that it said before, as for a moving contact."""
    sensitivity: float = Field(default=0.0, ge=0, lt=1)
    """How probably it tells of a contact when there is one; from 0 on, its silence speaks against
    contacts, where the rule listens to that (`posterior`)."""
    budget: Memory = Field(default=0.1, gt=0)
    """How long one reading may take [s] before it counts as an overrun."""
    isolate: bool = False
    """Whether it runs in a process of its own, so that no cycle waits for it."""
    patience: Memory = Field(default=60.0, gt=0)
    """Where there is no clock, as in a replay: how long a step waits for one answer of its process
    [s] before that is ended, and the generator stays out."""


ConfigT = TypeVar("ConfigT", bound=GeneratorConfig)


class Generator(ABC, Generic[ConfigT]):
    """Turns the readings of one sensor into contact hypotheses (F §IV).

    A subclass names its `Config`, the `readings` that it takes and the `outputs` that it gives, and
    implements `generate`. Its module ends with a hook that offers it:

        @hookimpl
        def contactfusion_generators():
            return {"bumper": BumperGenerator}

    Args:
        name: what this instance is called; its sources are named after it.
        config: the options, an instance of `Config`.
    """

    Config: ClassVar[type[GeneratorConfig]] = GeneratorConfig
    """The type of the options."""
    readings: ClassVar[tuple[type[Reading], ...]]
    """The types of reading that it takes."""
    outputs: Mapping[str, HypothesisKind] = {"": HypothesisKind.REGULAR}
    """The kind of each output; output "free" of the generator "skin" is the source "skin/free"."""
    needs_body: ClassVar[bool] = False
    """Whether it gives no clouds without the robot or its surface; `check` then looks for it."""

    def __init__(self, name: str, config: ConfigT) -> None:
        self.name = name
        self.config = config

    @abstractmethod
    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give at most one cloud an output.

        An empty cloud says "looked, found nothing"; no cloud says "did not look".

        Args:
            reading: one of the types in `readings`.
            state: the robot at the reading's stamp.
        """

    def prepare(self, robot: "RobotModel") -> None:
        """Do what takes long and hangs on the robot alone, before the first reading comes."""
        return None

    def most_hypotheses(self, grid: Grid) -> int | None:
        """The greatest number of hypotheses in a cloud; None: not known before readings come.

        Args:
            grid: the hypothesis space.
        """
        return None

    def reset(self) -> None:
        """Forget what was remembered of earlier readings."""
        return None

    @property
    def waits_for(self) -> str:
        """What keeps it from looking, in a sentence, as long as it gives no clouds."""
        return ""

    @property
    def sources(self) -> dict[str, HypothesisKind]:
        """The sources that its clouds come from, by name."""
        return {self.source(output): kind for output, kind in self.outputs.items()}

    def source(self, output: str = "") -> str:
        """Give the name of the source of one output."""
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
        """Make the cloud of one output, stamped as the reading.

        Args:
            reading: what it follows from.
            positions: shape (n, 3) [m].
            likelihoods: shape (n,), or one number for all.
            output: the output that gives it.
            frame: the frame of the positions; the reading's by default.
            **optional: `forces`, `spreads`, `single` and `notes` of the cloud.
        """
        if output not in self.outputs:
            hint = name_hint(output, self.outputs, "outputs")
            raise PluginError(f"'{self.name}' has no output '{output}'; {hint}")
        places = np.asarray(positions, np.float64).reshape(-1, 3)
        return HypothesisCloud(
            source=self.source(output),
            kind=self.outputs[output],
            stamp=reading.stamp,
            frame=frame or reading.frame,
            positions=places,
            likelihoods=np.broadcast_to(np.asarray(likelihoods, np.float64), len(places)),
            **optional,
        )

    def nothing(
        self, reading: Reading, *, output: str = "", notes: Sequence[str] = ()
    ) -> HypothesisCloud:
        """Make the empty cloud of one output: looked, found nothing."""
        return self.cloud(reading, np.empty((0, 3)), 0.0, output=output, notes=tuple(notes))


def generator_fault(cls: type[Generator[Any]]) -> str:
    """What keeps a class from the contract of generators, see `class_fault`."""
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
    """What keeps a generator that was built under a name from the contract; empty when nothing."""
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
    """Make sure that a generator gave clouds.

    Raises:
        TypeError: it gave anything else.
    """
    if not isinstance(clouds, Sequence):  # one that is read once would be spent by the check
        raise TypeError(f"it gave {type(clouds).__name__}, not a sequence of clouds")
    for cloud in clouds:
        if not isinstance(cloud, HypothesisCloud):
            raise TypeError(f"it gave {type(cloud).__name__}, not a HypothesisCloud")
    return clouds
