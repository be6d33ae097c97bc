"""What is common to generators whose eyes are read by the contact networks."""

from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.generator import ConfigT
from contactfusion.generators.networks import ContactNetworks, shipped
from contactfusion.generators.perceived import FaceGenerator, Kind, Memory, PerceivedConfig, Percept
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import Reading
from contactfusion.state import State

GAP = 0.5
"""A silence up to this is bridged; after a longer one the past is forgotten [s]."""


class LearnedConfig(PerceivedConfig):
    """What all who use the contact networks can be told."""

    weights: Path | None = Field(default=None)
    """The networks, as `contactfusion train cpm` writes them; None: those of the package."""


class LearnedFace(FaceGenerator[ConfigT]):
    """Regular, multi contact: P = 1 - softmax(none), l̂ by the location network (method §6)."""

    def __init__(self, name: str, config: ConfigT) -> None:
        super().__init__(name, config)
        assert isinstance(config, LearnedConfig)
        self._networks = ContactNetworks.load(config.weights or shipped())
        card = self._networks.card
        self.proximity = card.proximity
        """The region before the face, and its cells, as the networks learned them."""
        self._memory = Memory(card.window, 1.0 / card.rate, GAP)

    def reset(self) -> None:
        """Forget what was seen."""
        self._memory.clear()

    def perceived(
        self, reading: Reading, state: State, lengths: FloatArray
    ) -> Sequence[HypothesisCloud]:
        """Give the contact on the face; none for a reading that is not newer than the last.

        Args:
            reading: what was seen.
            state: of the robot.
            lengths: shape (S,), the proximity of each strip [m].
        """
        window = self._memory.window(reading.stamp, lengths)
        if window is None:
            return ()
        found = self._networks.perceive(window)
        none, point, line = found.probabilities.tolist()
        likelihood = 1.0 - none
        kind = Kind.POINT if point >= line else Kind.LINE
        sigma = self._networks.card.sigma[kind]
        percept = Percept(kind, found.lateral, likelihood, sigma)
        return (self.face_cloud(reading, state, percept, lengths, self.proximity),)
