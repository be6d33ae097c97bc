"""What of a pipeline's configuration an explanation needs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline


@dataclass(frozen=True, slots=True)
class Settings:
    """How hypotheses live and fuse.

    Attributes:
        integrator: its configuration.
        own_timeouts: how long the hypotheses of a source live [s], by name, where it says so.
    """

    integrator: IntegratorConfig
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
        by_voxel = pipeline.config.integrator.expiry == "voxel"
        return cls(pipeline.config.integrator, {} if by_voxel else own)

    def timeout(self, source: str) -> float:
        """Give how long the hypotheses of a source live [s]."""
        return self.own_timeouts.get(source, self.integrator.timeout)

    @property
    def tolerance(self) -> float:
        """What lies so near together belongs together [m]."""
        if self.integrator.tolerance is None:
            return 2.0 * self.integrator.voxel_size
        return self.integrator.tolerance

    @property
    def by_modes(self) -> bool:
        """Whether contacts come of a belief, not of voxels."""
        return self.integrator.condensation == "modes"
