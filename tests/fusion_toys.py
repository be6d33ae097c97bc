"""A generator that is unsure, and recordings that it reads; this module is a plug-in."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import EntryPoint
from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import Field

from contactfusion import Pipeline, PipelineConfig
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import GROUP, hookimpl
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.plugins import Plugins
from contactfusion.readings import PointCloud, Reading
from contactfusion.state import State
from contactfusion.units import LengthScale
from contactfusion.yaml_files import with_overrides
from tests.toys import FUSION

PLACE = (0.1, 0.0, 0.0)
CONFIG: dict[str, Any] = {
    "generators": {"eye": {"type": "eye"}},
    "cycle": {"every": 0.1},
    "integrator": {"rule": "de_morgan", "timeout": 0.3},
}


class EyeConfig(GeneratorConfig):
    """How far it sees."""

    scale: Annotated[float, LengthScale()] = Field(default=0.01, gt=0)
    """λ: the likelihood is a half at this distance [m]."""


class Eye(Generator[EyeConfig]):
    """Takes x and y of a point for a place, and z for how far away something is [m]."""

    Config = EyeConfig
    readings = (PointCloud,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        assert isinstance(reading, PointCloud)
        places, square = reading.points.copy(), self.config.scale**2
        places[:, 2] = 0.0
        return (self.cloud(reading, places, square / (square + reading.points[:, 2] ** 2)),)


@hookimpl
def contactfusion_generators() -> Mapping[str, Any]:
    return {"eye": Eye}


def offer_eye(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pipelines find the eye, and no other generator."""
    toys = Plugins(points=[EntryPoint("toys", __name__, GROUP), *FUSION], strict=True)
    monkeypatch.setattr("contactfusion.assembly.installed_plugins", lambda: toys)


def makes(made: list[Sequence[str]], **changes: Any) -> Callable[[Sequence[str]], Pipeline]:
    """Give what makes pipelines, and notes the changes that were asked for."""

    def make(overrides: Sequence[str]) -> Pipeline:
        made.append(tuple(overrides))
        return Pipeline(PipelineConfig(**with_overrides({**CONFIG, **changes}, overrides)))

    return make


def seen(
    contacts: Sequence[tuple[float, float]], near: float = 0.005, far: float = 0.02
) -> Iterator[Reading]:
    """Give 20 s of readings: something is near in the times of contact, and else further away."""
    for stamp in np.arange(0.0, 20.0, 0.1):
        touching = any(start <= stamp < end for start, end in contacts)
        point = np.array([[PLACE[0], PLACE[1], near if touching else far]])
        yield PointCloud(stamp=float(stamp), frame="base", sensor="eye", points=point)
