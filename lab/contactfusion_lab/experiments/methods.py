"""Methods: how an experiment fuses hypotheses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from contactfusion.assembly import built_integrator
from contactfusion.errors import ConfigurationError
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.integrator.integrator import Integrator
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.rule import Rule


@dataclass(frozen=True)
class Method:
    """A fusion method: a rule and a condensation.

    Attributes:
        rule: the name of the rule.
        condensation: the name of the condensation.
        spreads: every stated spread is multiplied by it before; 1: as it is stated.
        name: what it is called in place of these; "": by them.
        options: fields of the integrator that it sets, with their values.
        p_max: likelihoods are cut off there before; 1: as they are stated.
        near: what a range camera sees near the robot: evidence or Support; or as the row has it.
    """

    rule: str
    condensation: str
    spreads: float = 1.0
    name: str = ""
    options: tuple[tuple[str, Any], ...] = ()
    p_max: float = 1.0
    near: Literal["evidence", "support", "as the row"] = "as the row"

    @classmethod
    def named(cls, name: str) -> "Method":
        """Read RULE, RULE/CONDENSATION, or the name of a method that is tuned.

        Without a condensation that which a rule alone brings.

        Raises:
            PluginError: no such rule or condensation is installed.
            ConfigurationError: the two do not fit each other.
        """
        if name in TUNED:
            return TUNED[name]
        rule, _, condensation = name.partition("/")
        method = cls(rule, condensation or IntegratorConfig(rule=rule).condensation)
        method.integrator(IntegratorConfig()).step(0.0)  # some find out only then
        return method

    def applied(self, config: IntegratorConfig) -> IntegratorConfig:
        """A configuration with this rule and condensation; options of another are left out."""
        update = {field: dict(v) if isinstance(v, tuple) else v for field, v in self.options}
        return config.using(self.rule, self.condensation).model_copy(update=update)

    def integrator(self, config: IntegratorConfig) -> Integrator:
        """An integrator with this rule and condensation; sources are plugged in before they send.

        Args:
            config: as for `applied`.
        """
        return built_integrator(PipelineConfig(integrator=self.applied(config)))

    @property
    def looks_at_spreads(self) -> bool:
        """Whether its rule looks at spreads; others take voxels one by one."""
        rule: type[Rule] = installed_plugins().find("rules", self.rule)
        return rule.needs_places

    @property
    def stem(self) -> str:
        """Stem of the names of its files."""
        factor = "" if self.spreads == 1.0 else f"_spreads_{self.spreads:g}"
        return f"{self.name or f'{self.rule}_{self.condensation}'}{factor}"

    def __str__(self) -> str:
        factor = "" if self.spreads == 1.0 else f", σ × {self.spreads:g}"
        return f"{self.name or f'{self.rule}/{self.condensation}'}{factor}"


DEFAULT_METHOD = Method(IntegratorConfig().rule, IntegratorConfig().condensation)
"""What fuses with nothing set."""
DE_MORGAN, POSTERIOR = Method("de_morgan", "cluster_centroid"), Method("posterior", "modes")
"""The papers', and the baseline of a single contact over the surface."""
TUNING_SEEDS = (7, 8)
"""Of the touches on which settings were chosen, of `posterior` and of `DE_MORGAN_TUNED`."""
DE_MORGAN_TUNED = Method(
    "de_morgan",
    "cluster_centroid",
    name="de_morgan_tuned",
    options=(("voxel_size", 0.01), ("threshold", 0.5), ("tolerance", 0.02)),
    near="support",
)
"""De Morgan with the settings that the search of docs/tuning.md chose."""
TUNED = {DE_MORGAN_TUNED.name: DE_MORGAN_TUNED}
"""Methods whose settings a search has chosen, by name."""


def with_spreads(methods: Sequence[Method], factors: Sequence[float]) -> list[Method]:
    """Add those methods that look at spreads once more for each factor.

    Args:
        methods: how hypotheses are fused.
        factors: what stated spreads are multiplied by.

    Raises:
        ConfigurationError: a factor is none, or no method looks at spreads.
    """
    for factor in factors:
        if not 0.0 < factor < np.inf:
            raise ConfigurationError(f"spreads are multiplied by more than 0, not by {factor:g}")
    looking = [method for method in methods if method.looks_at_spreads]
    if factors and not looking:
        raise ConfigurationError(
            "none of these rules looks at spreads: add one that does, such as 'sets' or "
            "'posterior/modes'"
        )
    further = [replace(method, spreads=factor) for factor in factors for method in looking]
    return list(dict.fromkeys([*methods, *further]))
