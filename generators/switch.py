"""Contacts from foot switches, bumpers and limit switches (F Eq 2)."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import Reading, Switch
from contactfusion.robots.model import RobotModel
from contactfusion.state import State
from contactfusion.surface import Surface
from contactfusion.thinning import voxel_downsample
from contactfusion.units import Memory, Reach, Spread

STUCK = "pressed since the first reading: inverted?"
"""A note: it is wired the other way round, stuck, or really pressed, as under a standing foot."""
LONG = 1.0
"""Time after which it is remarked [s]."""


class SwitchConfig(GeneratorConfig):
    """The options of `switch`."""

    links: tuple[str, ...] = ()
    """The links on which a contact closes it; none: the link that carries the frame of its
    readings."""
    reach: Reach | None = Field(default=None, gt=0)
    """The greatest distance from the origin of its frame at which a contact closes it [m]; None:
    anywhere on its links."""
    p_closed: float = Field(default=0.95, gt=0, le=1)
    """Probability of a contact while it is closed."""
    inverted: bool = False
    """Whether it reports closed while nothing presses it: wired normally closed, or read at a pin
    with a pull-up."""
    debounce: Memory = Field(default=0.0, ge=0)
    """Time for which a change has to last before it counts [s]."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation, by axis, of the position of the robot's surface [m]."""


class SwitchGenerator(Generator[SwitchConfig]):
    """Regular, single contact: anywhere on the surface that closes the switch (F Eq 2)."""

    Config = SwitchConfig
    readings = (Switch,)
    needs_body = True

    def __init__(self, name: str, config: SwitchConfig) -> None:
        super().__init__(name, config)
        self.reset()

    def reset(self) -> None:
        """Forget whether it was pressed."""
        self._reported: bool | None = None
        self._pressed: bool | None = None
        self._since = 0.0
        self._has_opened = False

    def prepare(self, robot: RobotModel) -> None:
        """Look its links up in the robot.

        Raises:
            RobotError: the robot lacks one of them.
        """
        robot.known_links(self.config.links)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The surface that closes it while it is pressed; no cloud before it has settled.

        Raises:
            ConfigurationError: there is no surface, or none within its reach.
            RobotError: the robot lacks one of its links, or no link carries its frame.
        """
        assert isinstance(reading, Switch)
        if (pressed := self._settled(reading)) is None:
            return ()
        if not pressed:
            return (self.nothing(reading),)
        stuck = not self._has_opened and reading.stamp - self._since >= LONG
        surface, grid = self._surface(reading, state), state.grid
        points = self._within(surface.points, reading, state)
        points = points[voxel_downsample(points, grid)]
        cell = max(surface.spacing, grid.voxel_size) / np.sqrt(12.0)
        return (
            self.cloud(
                reading,
                points,
                self.config.p_closed / len(points),
                frame=grid.frame,
                spreads=np.full(len(points), np.hypot(self.config.noise, cell)),
                single=True,
                notes=(STUCK,) if stuck else (),
            ),
        )

    def _settled(self, reading: Switch) -> bool | None:
        """Whether it is pressed, once that has lasted; before, whether it was; None: unknown."""
        reported = bool(reading.closed) != self.config.inverted
        if reported is not self._reported:
            self._reported, self._since = reported, reading.stamp
        if reading.stamp - self._since >= self.config.debounce:
            self._pressed = reported
        self._has_opened |= self._pressed is False
        return self._pressed

    def _surface(self, reading: Switch, state: State) -> Surface:
        surface, links = state.placed_surface(self.name), self.config.links
        if links and state.robot is None:
            raise ConfigurationError(
                f"'{self.name}' names links, and there is no robot that has them: configure "
                "`robot`, or leave `links` out"
            )
        links = links or state.links_of(reading.frame)
        return surface.of_links(links) if links else surface

    def _within(self, points: FloatArray, reading: Switch, state: State) -> FloatArray:
        """The points, shape (n, 3) [m], at which a contact closes it.

        Raises:
            ConfigurationError: there is none.
        """
        reach = self.config.reach
        if not len(points):
            raise ConfigurationError(f"'{self.name}': no link that closes it has a surface")
        if reach is None:
            return points
        origin = state.frames.pose(state.grid.frame, of=reading.frame)[:3, 3]
        distances = np.linalg.norm(points - origin, axis=1)
        if distances.min() > reach:
            raise ConfigurationError(
                f"'{self.name}': no point of its links is within {reach:g} m of "
                f"'{reading.frame}', the nearest is {distances.min():.3g} m away"
            )
        within: FloatArray = points[distances <= reach]
        return within


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[SwitchConfig]]]:
    """The generator of switches."""
    return {"switch": SwitchGenerator}
