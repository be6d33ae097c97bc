"""Who steers: a set of parameters of reactive pushing, or any installed controller."""

from typing import Any

from contactfusion.assembly import built_controller
from contactfusion.controllers.face import FaceConfig
from contactfusion.controllers.pushing_parameters import SETS
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion_lab.experiments.push.targets import Place


def controller_options(name: str, target: Place, face: FaceConfig) -> dict[str, Any]:
    """Give the configuration of a controller.

    Args:
        name: of a set of parameters of `reactive_pushing`, or of an installed controller.
        target: where to [m].
        face: what pushes.

    Raises:
        ConfigurationError: there is neither of that name.
    """
    told = {"target": target, "face": face.model_dump()}
    if name in SETS:
        return {"type": "reactive_pushing", "parameters": name, **told}
    installed = installed_plugins().offers("controllers")
    if name not in installed:
        hint = name_hint(name, [*SETS, *installed], "controllers")
        raise ConfigurationError(f"unknown controller '{name}'; {hint}")
    return {"type": name, **told}


def controller_settings(controller: str, face: FaceConfig) -> Any:
    """Give all options of a controller but `target` and `face`."""
    options = controller_options(controller, (0.0, 0.0), face)
    built = built_controller(PipelineConfig(controller=options))
    assert built is not None
    held = built.config.model_dump(mode="json", exclude={"target", "face"})
    return {"type": options["type"], **held}
