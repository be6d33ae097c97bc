"""The contract of segmenters: an image in, the mask of the pushed object out."""

from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, SerializeAsAny

from contactfusion.errors import ConfigurationError, Guard
from contactfusion.frames import Pose
from contactfusion.model import Model
from contactfusion.plugins import class_fault, configured, installed_plugins, refuse
from contactfusion.readings import DepthImage

Mask = NDArray[np.bool_]


class SegmenterConfig(Model):
    """Options of all segmenters; each adds its own fields."""

    type: str = Field(min_length=1)
    """The segmenter, by name."""


SegmenterConfigT = TypeVar("SegmenterConfigT", bound=SegmenterConfig)


class Segmenter(ABC, Generic[SegmenterConfigT]):
    """Finds one object in the images of one camera, and tracks it.

    A subclass declares its `Config` and implements `segment`. Its module ends with a hook that
    offers it:

        @hookimpl
        def contactfusion_segmenters():
            return {"clusters": ClustersSegmenter}

    It draws no random numbers: equal images give equal masks.

    Args:
        config: the options, an instance of `Config`.
    """

    Config: ClassVar[type[SegmenterConfig]] = SegmenterConfig
    """The type of the options."""

    def __init__(self, config: SegmenterConfigT) -> None:
        self.config = config

    @abstractmethod
    def segment(self, image: DepthImage, pose: Pose) -> Mask | None:
        """The mask of the object.

        Args:
            image: later than the one before.
            pose: of the camera in the robot's frame, whose x points forward and whose z points up.

        Returns:
            Shape (h, w); None when the object is lost. A mask without a pixel means that there is
            no object.
        """

    def reset(self) -> None:
        """Drop all state of earlier images."""
        return None


def built_segmenter(config: SegmenterConfig) -> Segmenter[Any]:
    """Build a segmenter.

    Raises:
        PluginError: no segmenter of that type is installed.
        DependencyError: it needs a package that is not installed.
    """
    cls = segmenter_class(config.type)
    with Guard(f"the plug-in '{config.type}'", cls):
        return cls(config)


def segmenter_class(name: str) -> type[Segmenter[Any]]:
    """The class of a type of segmenters.

    Raises:
        PluginError: no such type is installed, or its class breaks the contract.
    """
    cls: type[Segmenter[Any]] = installed_plugins().find("segmenters", name)
    refuse(name, cls, class_fault(cls, Segmenter, SegmenterConfig))
    return cls


def _configured(value: Any) -> Any:
    """The configuration of a segmenter by its options, or by its name alone."""
    options = {"type": value} if isinstance(value, str) else value
    if not isinstance(options, dict):
        return value
    name = options.get("type")
    if not isinstance(name, str):
        raise ConfigurationError("say which segmenter by its `type`")
    return configured(name, segmenter_class(name), options, "")


AnySegmenter = Annotated[SerializeAsAny[SegmenterConfig], BeforeValidator(_configured)]
"""The options of any segmenter, with its `type`; its name alone gives its defaults."""
