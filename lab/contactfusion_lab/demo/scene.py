"""The push that the demo shows, as fields of a file for `contactfusion run`."""

from collections.abc import Mapping
from typing import Any

import yaml

from contactfusion.errors import ConfigurationError
from contactfusion.generators.networks import shipped
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.experiments.push.suites import SENSINGS

LEARNED = "lidar_cpm"
"""The generator that reads the LiDAR, unless another is asked for."""
SKIN = "skin"
"""The sensor that dies."""
DIES = 10.0
"""When: about half-way [s]."""
TARGET = (-2.4, -1.2)
"""Behind the robot, to its right [m]."""
YAW = 20.0
"""How the box is turned: its corner touches first [degrees]."""
LONGEST = 60.0
"""Nobody waits longer than this for the box to arrive [s]."""
HEAD = """\
# The push of the demo. Run it again, change it, break something else:
#   contactfusion run scene.yaml
#   contactfusion run scene.yaml --set faults.0.start=5 --set faults.0.sensor=lidar
"""


def scene_fields(lidar: str = LEARNED) -> dict[str, Any]:
    """Give the scene: the fused sensing of the push experiment, with a skin that falls silent.

    Args:
        lidar: the type of the generator that reads the LiDAR.

    Raises:
        ConfigurationError: the networks of that generator are missing.
    """
    if lidar == LEARNED and not shipped().is_file():
        raise ConfigurationError(
            f"the demo reads its LiDAR with networks that come with contactfusion, but {shipped()} "
            "is missing; install contactfusion again"
        )
    fused = read_yaml(SENSINGS["fused"])
    fused["generators"]["lidar"]["type"] = lidar
    return {
        **fused,
        "controller": {"type": "reactive_pushing", "target": list(TARGET)},
        "faults": [{"fault": "silent", "sensor": SKIN, "start": DIES}],
        "seed": 1,
        "scene": {
            "type": "push",
            "object": "box",
            "yaw": YAW,
            "target": list(TARGET),
            "sees": ["lidar"],
            "longest": LONGEST,
        },
    }


def by_skin_alone(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Give the same push, dying skin and all, with nothing but the skin to feel by."""
    return {
        **fields,
        "generators": {SKIN: fields["generators"][SKIN]},
        "scene": {**fields["scene"], "sees": []},
    }


def as_yaml(fields: Mapping[str, Any]) -> str:
    """Give the scene as the text of a file."""
    return HEAD + yaml.safe_dump(dict(fields), sort_keys=False)
