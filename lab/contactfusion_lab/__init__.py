"""The laboratory of contactfusion: scenes in PyBullet, experiments, training, and the demo.

The scenes can be had from here; what is not listed may move.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contactfusion_lab.scenes.grasp.config import GraspConfig
    from contactfusion_lab.scenes.grasp.scene import GraspScene, grasped, result_of
    from contactfusion_lab.scenes.push.config import PushConfig
    from contactfusion_lab.scenes.push.env import PushEnv
    from contactfusion_lab.scenes.push.scene import PushScene, pushed
    from contactfusion_lab.scenes.touch.config import TouchConfig
    from contactfusion_lab.scenes.touch.scene import TouchScene

_HOMES = {
    "GraspConfig": "contactfusion_lab.scenes.grasp.config",
    "GraspScene": "contactfusion_lab.scenes.grasp.scene",
    "PushConfig": "contactfusion_lab.scenes.push.config",
    "PushEnv": "contactfusion_lab.scenes.push.env",
    "PushScene": "contactfusion_lab.scenes.push.scene",
    "TouchConfig": "contactfusion_lab.scenes.touch.config",
    "TouchScene": "contactfusion_lab.scenes.touch.scene",
    "grasped": "contactfusion_lab.scenes.grasp.scene",
    "pushed": "contactfusion_lab.scenes.push.scene",
    "result_of": "contactfusion_lab.scenes.grasp.scene",
}

__all__ = [
    "GraspConfig",
    "GraspScene",
    "PushConfig",
    "PushEnv",
    "PushScene",
    "TouchConfig",
    "TouchScene",
    "grasped",
    "pushed",
    "result_of",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'contactfusion_lab' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
