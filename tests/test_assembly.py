"""Options of generators: which of them may be names from the robot's description."""

from typing import Annotated, Any

import numpy as np
import pytest

from contactfusion import Generator, GeneratorConfig, HypothesisCloud, OfRobot, State, Wrench
from contactfusion.assembly import built_generator
from contactfusion.errors import ConfigurationError
from contactfusion.patches import PatchConfig
from contactfusion.robots.description import RobotConfig

PAD: dict[str, Any] = {"places": [[0.0, 0.0, 0.0]], "size": [0.01, 0.01]}
ROBOT = RobotConfig.model_construct(patches={"palm": PatchConfig(**PAD)}, cameras={})


class StrangeConfig(GeneratorConfig):
    """Options with names that a robot's description has fields of."""

    camera: str = ""
    wrist: tuple[str, ...] = ()
    pad: Annotated[PatchConfig | None, OfRobot("patches")] = None


class Strange(Generator[StrangeConfig]):
    """A stranger's generator."""

    Config = StrangeConfig
    readings = (Wrench,)

    def generate(self, reading: Any, state: State) -> list[HypothesisCloud]:
        return [self.cloud(reading, np.zeros((1, 3)), 0.5)]


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactfusion.assembly.generator_class", lambda name: Strange)


def test_an_option_may_have_any_name() -> None:
    options = {"type": "strange", "camera": "front", "wrist": ["left", "right"]}
    config = built_generator("one", options, robot=ROBOT).config
    assert (config.camera, config.wrist) == ("front", ("left", "right"))


def test_a_marked_option_takes_a_name_from_the_robots_description() -> None:
    config = built_generator("one", {"type": "strange", "pad": "palm"}, robot=ROBOT).config
    assert config.pad == PatchConfig(**PAD)
    with pytest.raises(ConfigurationError, match=r"one\.pad: unknown name 'pam': did you mean 'pa"):
        built_generator("one", {"type": "strange", "pad": "pam"}, robot=ROBOT)
