"""A step by the baselines of the laboratory."""

from typing import Any

from contactfusion import Fusion, HypothesisCloud, Integrator, IntegratorConfig
from contactfusion.plugins import installed_plugins
from contactfusion.surface import Surface
from tests.clouds import law

MODES = {"rule": "posterior", "condensation": "modes"}


def integrator(config: IntegratorConfig) -> Integrator:
    """An integrator whose rule and condensation are plug-ins."""
    rule = installed_plugins().find("rules", config.rule)
    condensation = installed_plugins().find("condensations", config.condensation)
    options = condensation.Config(**config.condensation_options)
    return Integrator(
        config,
        rule=rule(rule.Config(**config.rule_options)),
        condensation=condensation(options, config.linking_distance),
    )


def fused(
    *clouds: HypothesisCloud, now: float = 0.0, surface: Surface | None = None, **config: Any
) -> Fusion:
    """Fuse clouds in one step; by `posterior` and `modes` where nothing else is said."""
    step = integrator(law(**{**MODES, **config}))
    for cloud in clouds:
        step.receive(cloud)
    return step.step(now, surface)
