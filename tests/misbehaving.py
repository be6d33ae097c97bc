"""A distribution of plug-ins, each of which breaks its contract in another way."""

from pathlib import Path

HEAD = '''\
"""A plug-in that breaks its contract."""

import os
import sys
import time

import numpy as np
from pydantic import Field

from contactfusion import Controller, Generator, GeneratorConfig, hookimpl
from contactfusion.readings import Wrench


class OddConfig(GeneratorConfig):
    """The options."""

    gain: float = Field(default=1.0, gt=0)
    """The gain."""


class Odd(Generator[OddConfig]):
    """Is odd."""

    Config = OddConfig
    readings = (Wrench,)

    def generate(self, reading, state):
        """Give a place."""
        return [self.cloud(reading, [[0.0, 0.0, 0.05]], 0.5)]


@hookimpl
def contactfusion_generators():
    return {"NAME": Odd}
'''
ANSWER = "        return [self.cloud"
CLASS = "    readings = (Wrench,)\n"
GENERATORS: dict[str, tuple[str, str]] = {
    "sound": ("", ""),
    "init_raises": (
        CLASS,
        CLASS + "    def __init__(self, name, config):\n        raise ValueError('no taxels')\n",
    ),
    "init_exits": (
        CLASS,
        CLASS + "    def __init__(self, name, config):\n        sys.exit('bye')\n",
    ),
    "init_narrow": (
        CLASS,
        CLASS + "    def __init__(self, config):\n        self.config = config\n",
    ),
    "init_detached": (CLASS, CLASS + "    def __init__(self, name, config):\n        pass\n"),
    "reset_raises": (
        CLASS,
        CLASS + "    def reset(self):\n        raise ValueError('no way back')\n",
    ),
    "abstract": ("    def generate(", "    def gnerate("),
    "no_readings": (CLASS, ""),
    "wrong_config": ("    Config = OddConfig", "    Config = dict"),
    "wrong_default": ("default=1.0", "default=-1.0"),
    "wrong_outputs": (CLASS, CLASS + "    outputs = ['free']\n"),
    "no_hook": ("@hookimpl\n", ""),
    "no_generator": ("class Odd(Generator[OddConfig])", "class Odd"),
    "import_raises": ("class OddConfig", "1 / 0\n\n\nclass OddConfig"),
    "raises": (ANSWER, "        raise ValueError('no taxels\\nat all')\n" + ANSWER),
    "exits": (ANSWER, "        sys.exit(3)\n" + ANSWER),
    "dies": (ANSWER, "        os._exit(3)\n" + ANSWER),
    "hangs": (ANSWER, "        time.sleep(600)\n" + ANSWER),
    "late": (ANSWER, "        time.sleep(0.02)\n" + ANSWER),
    "huge": (
        ANSWER,
        "        return [self.cloud(reading, np.zeros((2_000_001, 3)), 0.5)]\n" + ANSWER,
    ),
    "leaks": (
        ANSWER,
        "        self.kept = getattr(self, 'kept', []) + [bytes(2**20)]\n        return []\n"
        + ANSWER,
    ),
    "forces": (ANSWER, "        reading.force.flags.writeable = True\n" + ANSWER),
}
"""By name, what is replaced in `HEAD` by what."""
OTHERS = {
    "rule_raises": '''\
"""A rule that raises at the third step."""

from contactfusion import hookimpl
from contactfusion.integrator.rules import DeMorgan


class Rule(DeMorgan):
    """Raises."""

    steps = 0

    def fuse(self, entries, sources, surface):
        """Raise at the third step."""
        self.steps += 1
        if self.steps == 3:
            raise ValueError("no rule")
        return super().fuse(entries, sources, surface)


@hookimpl
def contactfusion_rules():
    return {"rule_raises": Rule}
''',
    "rule_narrow": '''\
"""A rule that takes no configuration."""

from contactfusion import Rule, hookimpl


class Narrow(Rule):
    """Takes no configuration."""

    def __init__(self):
        pass

    def fuse(self, entries, sources, surface):
        """Fuse nothing."""


@hookimpl
def contactfusion_rules():
    return {"rule_narrow": Narrow}
''',
    "rule_stranger": '''\
"""A rule that is none."""

from contactfusion import hookimpl


class Rule:
    """Is no rule."""

    def __init__(self, config):
        pass

    def fuse(self, entries, sources, surface):
        """Fuse nothing."""


@hookimpl
def contactfusion_rules():
    return {"rule_stranger": Rule}
''',
    "rule_misspelt": '''\
"""A rule with a misspelt flag."""

from contactfusion import hookimpl
from contactfusion.integrator.rules import DeMorgan


class Misspelt(DeMorgan):
    """Has a misspelt flag."""

    needs_place = True


@hookimpl
def contactfusion_rules():
    return {"rule_misspelt": Misspelt}
''',
    "pilot_raises": '''\
"""A controller that raises."""

from contactfusion import Controller, hookimpl


class Pilot(Controller):
    """Raises."""

    def command(self, contacts, state):
        """Command nothing."""
        raise ValueError("no way")


@hookimpl
def contactfusion_controllers():
    return {"pilot_raises": Pilot}
''',
}
"""Modules of other kinds by name."""


def module(name: str) -> str:
    """The module of a plug-in."""
    return f"misbehaving_{name}"


def write_distribution(folder: Path) -> None:
    """Write what an installer leaves behind in a folder that Python imports from."""
    for name, (old, new) in GENERATORS.items():
        assert old in HEAD, name
        text = HEAD.replace(old, new, 1) if old else HEAD
        (folder / f"{module(name)}.py").write_text(text.replace("NAME", name))
    for name, text in OTHERS.items():
        (folder / f"{module(name)}.py").write_text(text)
    info = folder / "misbehaving-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: misbehaving\nVersion: 1.0\n")
    points = "".join(f"{name} = {module(name)}\n" for name in (*GENERATORS, *OTHERS))
    (info / "entry_points.txt").write_text(f"[contactfusion]\n{points}")
