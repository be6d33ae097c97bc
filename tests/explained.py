"""Rounds of clouds, and the account of what they lead to."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from contactfusion import HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.explain.explanation import Explanation, explanation_of
from contactfusion.explain.moment import Moment, Settings, moment_at
from contactfusion.pipeline import Step
from contactfusion.surface import Surface
from tests.clouds import NULL, REGULAR, SUPPORT, law

Round = tuple[float, Sequence[HypothesisCloud]]
PLUGS: Mapping[str, HypothesisKind] = {
    "free": NULL,
    "lidar": REGULAR,
    "motion": SUPPORT,
    "skin": REGULAR,
}


def _law(config: Mapping[str, Any]) -> IntegratorConfig:
    """A configuration; De Morgan where nothing says how to fuse."""
    says = {"rule", "condensation"} & config.keys()
    return law(**(config if says else {"rule": "de_morgan", **config}))


def stepped(
    *rounds: Round,
    plugs: Mapping[str, HypothesisKind] = PLUGS,
    timeouts: Mapping[str, float] | None = None,
    surface: Surface | None = None,
    **config: Any,
) -> Iterator[Step]:
    """Step after each round of clouds; sources replace what they said, as generators do."""
    integrator = Integrator(_law(config))
    for source, kind in plugs.items():
        timeout = (timeouts or {}).get(source)
        integrator.plug(source, kind, timeout=timeout, replace=True)
    for now, clouds in rounds:
        for cloud in clouds:
            integrator.receive(cloud)
        yield Step(now, integrator.step(now, surface), None)


def moment(*rounds: Round, **options: Any) -> Moment:
    """Give the last step, and what was before."""
    return moment_at(stepped(*rounds, **options), rounds[-1][0], reach=0.01)


def settings(timeouts: Mapping[str, float] | None = None, **config: Any) -> Settings:
    return Settings(_law(config), timeouts or {})


def explanation(
    *rounds: Round,
    at: Sequence[float] | None = None,
    plugs: Mapping[str, HypothesisKind] = PLUGS,
    timeouts: Mapping[str, float] | None = None,
    surface: Surface | None = None,
    **config: Any,
) -> Explanation:
    """Give the account of the last step."""
    then = moment(*rounds, plugs=plugs, timeouts=timeouts, surface=surface, **config)
    return explanation_of(then, settings(timeouts, **config), at)
