"""What of a pipeline's configuration an explanation needs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from contactfusion.integrator.config import IntegratorConfig
from contactfusion.model import Model
from contactfusion.pipeline import Pipeline


@dataclass(frozen=True, slots=True)
class Settings:
    """How hypotheses live and fuse.

    Attributes:
        integrator: its configuration.
        rule: the options of its rule.
        condensation: the options of its condensation.
        own_timeouts: how long the hypotheses of a source live [s], by name, where it says so.
    """

    integrator: IntegratorConfig
    rule: Model
    condensation: Model
    own_timeouts: Mapping[str, float]

    @classmethod
    def of(cls, pipeline: Pipeline) -> Self:
        """Read them off a pipeline."""
        own = {
            source: generator.config.timeout
            for generator in pipeline.generators.values()
            for source in generator.sources
            if generator.config.timeout is not None
        }
        config, integrator = pipeline.config.integrator, pipeline.integrator
        timeouts = {} if config.expiry == "voxel" else own
        return cls(config, integrator.rule.config, integrator.condensation.config, timeouts)

    def timeout(self, source: str) -> float:
        """Give how long the hypotheses of a source live [s]."""
        return self.own_timeouts.get(source, self.integrator.timeout)

    @property
    def tolerance(self) -> float:
        """What lies so near together belongs together [m]."""
        return self.integrator.linking_distance

    @property
    def by_modes(self) -> bool:
        """Whether contacts come of a belief, not of voxels."""
        return self.integrator.condensation == "modes"
