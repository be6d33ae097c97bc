"""The configuration of the integrator."""

from typing import Any, Literal

from pydantic import Field

from contactfusion.model import Model
from contactfusion.units import Memory, Spacing, Tolerance


class IntegratorConfig(Model):
    """How hypotheses are kept, fused and condensed (method §1-3)."""

    frame: str = Field(default="base", min_length=1)
    """The frame in which the voxels stand still; every cloud must come in it."""
    voxel_size: Spacing = Field(default=0.005, gt=0)
    """The side of a voxel [m]."""
    timeout: Memory = Field(default=0.5, gt=0)
    """How long an entry lives [s], where its source has no timeout of its own."""
    expiry: Literal["source", "voxel"] = "source"
    """`source`: an entry lives by its own stamp; `voxel`: all entries of a voxel live by the newest
    (F §III-B)."""
    rule: str = "de_morgan"
    """How the likelihoods of one voxel combine."""
    condensation: str = "cluster_centroid"
    """How voxels become contacts."""
    threshold: float = Field(default=0.1, gt=0, le=1)
    """The fused likelihood from which a voxel is a contact."""
    tolerance: Tolerance | None = Field(default=None, gt=0)
    """Voxels at most this far apart belong to one contact [m]; None: two sides of a voxel."""
    min_voxels: int = Field(default=1, ge=1)
    """Clusters of fewer voxels are no contacts."""
    mass_threshold: float = Field(default=0.5, gt=0)
    """`cluster_mass`: the sum of likelihoods from which a cluster is a contact."""
    floor: float = Field(default=0.01, ge=1e-6, lt=1)
    """`posterior`: what a source leaves to places that it does not believe in, of its highest."""
    friction: float = Field(default=0.5, gt=0)
    """`posterior`: the coefficient of friction of contacts whose force is known."""
    existence: float = Field(default=0.5, gt=0, le=1)
    """`modes`: there is a contact when it is at least so probable."""
    mode_share: float = Field(default=0.42, gt=0, le=1)
    """`modes`: a further contact is told when it takes at least this part of the belief."""
    prior: float = Field(default=0.05, gt=0, lt=1)
    """`log_odds`, `dempster_shafer`: the probability of a contact without any evidence."""
    stale_after: Memory = Field(default=1.0, gt=0)
    """A source silent for longer no longer holds up readiness [s]."""
    max_ahead: Memory = Field(default=0.1, ge=0)
    """A stamp further ahead of now is held back until its time [s]."""
    max_hypotheses: int = Field(default=2_000_000, ge=1)
    """A cloud of more hypotheses is refused."""
    strict_sources: bool = False
    """Whether a cloud of a source that was never plugged is an error."""
    options: dict[str, Any] = Field(default_factory=dict)
    """What a rule or condensation by plug-in needs."""
