"""Sensor suites of a push, by name, and its controllers."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from contactfusion.assembly import AnyGenerator, built_controller, built_generator
from contactfusion.controllers.face import NARROW, FaceConfig
from contactfusion.controllers.pushing_parameters import SETS
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.generators.networks import read_networks, weights_file
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.pipeline import Ask, asked
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.preset import preset_named
from contactfusion.readings import Reading
from contactfusion.robots.description import RobotConfig
from contactfusion.state import State
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.scenes.push.sensors import with_taxels
from contactfusion_lab.trials.choices import require_known
from contactfusion_lab.trials.executor import ShippedFile

SENSINGS = {
    name: Path(__file__).with_name(f"{name}.yaml")
    for name in (
        "skin",
        "lidar",
        "rgbd",
        "rule",
        "rule_tuned",
        "fused",
        "fused_rule",
        "fused_camera",
    )
}
"""The pipeline of each."""
RULE_TUNED = "rule_tuned"
THRESHOLDS = {
    "lidar": {"touch": 0.007, "near": 0.03},
    "lidar_side": {"touch": 0.007, "near": 0.005},
    "lidar_tilted": {"touch": 0.007, "near": 0.03},
}
"""Of `rule_tuned` [m], by the place of its LiDAR: chosen by
`contactfusion_lab.tune_push.lidar_rule` on pushes of the seeds 3100 and 3101, of which no table is
made."""
BLUR = 2.5
"""Width of a point contact as a skin measures it [taxels]."""
REST = ("folder", "faults", "controller", "seed", "preset")
"""Fields of a pipeline that do not change a trial, or are settings of their own."""


@dataclass(frozen=True)
class Change:
    """Differences from the file of a sensor suite.

    Attributes:
        rule: fusion rule, RULE or RULE/CONDENSATION; empty: that of the file.
        without: sources that are ignored.
        lidar: the LiDAR that replaces any other; empty: that of the file.
        camera: the camera likewise.
        weights: of contact networks, a file or the name of some of the package; None: as the file
            says.
        preset: the preset that replaces options of the file; empty: none.
    """

    rule: str = ""
    without: tuple[str, ...] = ()
    lidar: str = ""
    camera: str = ""
    weights: Path | str | None = None
    preset: str = ""


@dataclass(frozen=True)
class Sensing:
    """A sensor suite.

    Attributes:
        label: its name, and that of the folder of its pushes.
        pipeline: the generators and how they are fused, without a controller.
        sees: the LiDARs and cameras that are switched on for it.
        without: sources of its generators that are ignored.
        networks: digest of the file of networks, by generator.
        learned: on what these were trained, by generator.
    """

    label: str
    pipeline: PipelineConfig
    sees: tuple[str, ...]
    without: frozenset[str]
    networks: Mapping[str, str]
    learned: Mapping[str, str]

    @property
    def robot(self) -> RobotConfig:
        """The base."""
        assert self.pipeline.robot is not None  # read_sensing made sure of it
        return self.pipeline.robot

    @property
    def ask(self) -> Ask:
        """The function by which its pipeline calls generators."""
        if not self.without:
            return asked

        def ask(
            generator: AnyGenerator, reading: Reading, state: State
        ) -> Sequence[HypothesisCloud]:
            clouds = asked(generator, reading, state)
            return [cloud for cloud in clouds if cloud.source not in self.without]

        return ask

    @property
    def has_skin(self) -> bool:
        """Whether a generator reads the skin."""
        return any("patch" in options for options in self.pipeline.generators.values())

    @cached_property
    def face(self) -> FaceConfig:
        """The face that pushes: a skin blurs points, LiDARs and cameras do not."""
        blur = NARROW
        if self.has_skin:
            blur = BLUR * self.robot.patches["skin"].grids[0].pitch[1]
        return FaceConfig(blur=blur)

    def settings(self) -> dict[str, Any]:
        """Its settings; for a file of networks the digest of its content."""
        exclude: Any = dict.fromkeys(REST, True) | {
            "robot": {"folder"},
            "generators": {name: {"weights"} for name in self.networks},
        }
        return {
            "pipeline": self.pipeline.model_dump(mode="json", exclude=exclude),
            "without": sorted(self.without),
            "networks": dict(self.networks),
            "face": self.face.model_dump(mode="json"),
        }


def read_sensing(name: str, taxels: int, change: Change) -> Sensing:
    """The sensor suite of a name.

    Args:
        name: of the suite.
        taxels: of the skin's front.
        change: differences from its file.

    Raises:
        ContactFusionError: a name is unknown, a plug-in is not installed, networks are missing, or
            no source of contacts is left.
    """
    require_known([name], SENSINGS, "sensing", "sensings")
    path = SENSINGS[name]
    fields = read_yaml(path)
    if change.preset:
        fields = preset_named(change.preset).over(fields)
    pipeline = PipelineConfig(**{"folder": path.parent, **fields})
    robot = pipeline.robot
    assert robot is not None
    exteroceptive = {
        **dict.fromkeys(robot.lidars, _chosen(change.lidar, robot.lidars, "LiDARs")),
        **dict.fromkeys(robot.cameras, _chosen(change.camera, robot.cameras, "cameras")),
    }
    generators, networks, learned = {}, dict[str, str](), dict[str, str]()
    for generator, options in pipeline.generators.items():
        changed = dict(options)
        if chosen := exteroceptive.get(str(options.get("sensor"))):
            changed["sensor"] = chosen
        if name == RULE_TUNED:
            changed |= THRESHOLDS.get(changed["sensor"], {})
        if "weights" in installed_plugins().find("generators", options["type"]).Config.model_fields:
            weights = weights_file(change.weights or options.get("weights"))
            learned[generator] = read_networks(weights)[0].data
            changed["weights"] = ShippedFile(weights.absolute())
            networks[generator] = hashlib.sha256(weights.read_bytes()).hexdigest()
        generators[generator] = changed
    patches = {**robot.patches, "skin": with_taxels(robot.patches["skin"], taxels)}
    update: dict[str, Any] = {
        "generators": generators,
        "robot": robot.model_copy(update={"patches": patches}),
    }
    if change.rule:
        update["integrator"] = Method.named(change.rule).applied(pipeline.integrator)
    pipeline = pipeline.model_copy(update=update)
    if change.without:
        pipeline = _without(pipeline, change.without, name)
    kept = pipeline.generators
    sensors = dict.fromkeys(str(options.get("sensor")) for options in kept.values())
    parts = [name, change.preset, change.rule, *(f"without_{source}" for source in change.without)]
    return Sensing(
        label="-".join(filter(None, parts)).replace("/", "_"),
        pipeline=pipeline,
        sees=tuple(sensor for sensor in sensors if sensor in exteroceptive),
        without=frozenset(change.without),
        networks={name: digest for name, digest in networks.items() if name in kept},
        learned={name: data for name, data in learned.items() if name in kept},
    )


def _chosen(name: str, known: Mapping[str, Any], kind: str) -> str:
    """A name that is known, or nothing."""
    if name and name not in known:
        hint = name_hint(name, known, f"{kind} of the robot")
        raise ConfigurationError(f"the robot has no '{name}'; {hint}")
    return name


def _without(pipeline: PipelineConfig, without: Sequence[str], name: str) -> PipelineConfig:
    """Take out the generators of which no source is left."""
    robot, folder = pipeline.robot, pipeline.folder
    sources = {
        generator: built_generator(generator, options, folder, robot).sources
        for generator, options in pipeline.generators.items()
    }
    known = {source: kind for each in sources.values() for source, kind in each.items()}
    require_known(without, known, "source", f"sources of '{name}'")
    if not any(
        kind == HypothesisKind.REGULAR and source not in without for source, kind in known.items()
    ):
        raise ConfigurationError(f"'{name}' without {' and '.join(without)} feels nothing")
    kept = {
        generator: options
        for generator, options in pipeline.generators.items()
        if not sources[generator].keys() <= set(without)
    }
    return pipeline.model_copy(update={"generators": kept})


def controller_options(name: str, target: tuple[float, float], face: FaceConfig) -> dict[str, Any]:
    """The configuration of a controller.

    Args:
        name: of a set of parameters of `reactive_pushing`, or of an installed controller.
        target: where to [m].
        face: what pushes.

    Raises:
        ConfigurationError: there is neither of that name.
    """
    fields = {"target": target, "face": face.model_dump()}
    if name in SETS:
        return {"type": "reactive_pushing", "parameters": name, **fields}
    installed = installed_plugins().offers("controllers")
    if name not in installed:
        hint = name_hint(name, [*SETS, *installed], "controllers")
        raise ConfigurationError(f"unknown controller '{name}'; {hint}")
    return {"type": name, **fields}


def controller_settings(controller: str, face: FaceConfig) -> Any:
    """All options of a controller but `target` and `face`."""
    options = controller_options(controller, (0.0, 0.0), face)
    built = built_controller(PipelineConfig(controller=options))
    assert built is not None
    held = built.config.model_dump(mode="json", exclude={"target", "face"})
    return {"type": options["type"], **held}
