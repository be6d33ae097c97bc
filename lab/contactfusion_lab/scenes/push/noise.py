"""Errors of the sensors of a push, and how unkind its world is."""

from typing import Any

from pydantic import Field, model_validator

from contactfusion.model import Model
from contactfusion_lab.scenes.noise import composed
from contactfusion_lab.scenes.sensor_errors import Delays, RangeNoise, TaxelNoise

NOISES: dict[str, dict[str, Any]] = {"none": {"sensors": False}, "prototype": {}}
"""Named sets of errors, beside `hard`."""
PARTS: dict[str, dict[str, Any]] = {
    "taxels": {"taxels": {"gain": 0.2, "hysteresis": 0.1, "crosstalk": 0.05, "dead": 1}},
    "mounting": {"mounting": {"mm": 10.0, "degrees": 1.0}},
    "range": {"ranges": {"bias": 0.01, "mixed": 0.5}},
    "odometry": {
        "odometry": {"translation": 0.02, "yaw": 0.02, "slip": 0.02, "walk": 0.01, "turn": 0.5}
    },
    "clutter": {"clutter": True},
    "timing": {
        "delays": {"joints": (0.0, 0.06), "skins": (0.01, 0.10), "sights": (0.05, 0.20)},
    },
}
"""What `hard` adds to `prototype`, part by part; docs/push.md has the source of each value."""


class LidarNoise(Model):
    """Errors of LiDARs, as measured in recordings of real ones."""

    range: float = Field(default=0.0035, ge=0)
    """Standard deviation of a range [m]."""
    dropout: float = Field(default=0.014, ge=0, le=0.5)
    """Share of all measurements that have no return although a surface is there."""
    jumps: float = Field(default=0.008, ge=0, le=0.5)
    """Share of all measurements whose range jumps."""
    jump: float = Field(default=0.3, ge=0)
    """Greatest jump, nearer or farther [m]."""


class CameraNoise(Model):
    """Errors of depth cameras; the defaults are those of a RealSense D435i."""

    disparity: float = Field(default=0.08, ge=0)
    """Standard deviation of the disparity between left and right imager [pixels]."""
    baseline: float = Field(default=0.05, gt=0)
    """Distance between the imagers [m]."""
    focal: float = Field(default=615.0, gt=0)
    """Focal length of the imagers [pixels]; smaller images are subsampled from theirs. A depth z
    has the standard deviation z² disparity / (focal baseline)."""
    unit: float = Field(default=0.001, gt=0)
    """Resolution of depths [m]."""
    holes: float = Field(default=0.01, ge=0, le=0.5)
    """Share of all pixels that have no depth."""
    edges: float = Field(default=0.5, ge=0, le=1)
    """Share of the pixels beside a step in depth that have none."""
    colour: float = Field(default=6.0, ge=0)
    """Standard deviation of red, green and blue, of 255."""


class MisplacedConfig(Model):
    """Error of a sensor's extrinsic pose, in random directions."""

    mm: float = Field(default=0.0, ge=0, le=1000)
    """Translation [mm]."""
    degrees: float = Field(default=0.0, ge=0, le=90)
    """Rotation about an axis through the sensor [degrees]."""


EXACT_LIDAR = LidarNoise(range=0.0, dropout=0.0, jumps=0.0)
"""LiDARs that measure the truth."""
EXACT_CAMERA = CameraNoise(disparity=0.0, unit=1e-9, holes=0.0, edges=0.0, colour=0.0)
"""Cameras that do."""


class OdometryNoise(Model):
    """Standard deviations of errors of odometry; the first three are drawn once a push."""

    translation: float = Field(default=0.0, ge=0, le=0.5)
    """Of the scale of translations, as a share."""
    yaw: float = Field(default=0.0, ge=0, le=0.5)
    """Of the scale of rotations, as a share."""
    slip: float = Field(default=0.0, ge=0, le=0.5)
    """Of the lateral slip while the object presses, as a share of the path."""
    walk: float = Field(default=0.0, ge=0, le=1)
    """Of the position after a metre, by axis, a random walk [m/√m]."""
    turn: float = Field(default=0.0, ge=0, le=90)
    """Of the yaw after a metre, a random walk [degrees/√m]."""


class PushNoise(Model):
    """Errors beside the white noise of skin, LiDARs and cameras, and other bodies."""

    sensors: bool = True
    """Whether skin, LiDARs and cameras have their white noise, dropouts and holes: `noise` of
    `skin`, `lidar_noise` and `camera_noise`; else they measure the truth."""
    taxels: TaxelNoise = TaxelNoise()
    """Further errors of taxels; each strip of the skin has `dead` dead ones."""
    mounting: MisplacedConfig = MisplacedConfig()
    """Extrinsic error of every LiDAR and camera that is switched on, in addition to `misplaced`."""
    ranges: RangeNoise = RangeNoise()
    """Further errors of LiDARs and cameras."""
    odometry: OdometryNoise = OdometryNoise()
    """Errors of odometry and of the twist of the base."""
    clutter: bool = False
    """Whether LiDARs and cameras see a wall, boxes, and the legs of a person, too."""
    delays: Delays = Delays()
    """Delays of readings, drawn from ranges, no deviation; rounded to whole cycles."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        """Fields; a name stands for those of a known set."""
        return composed(value, NOISES, PARTS) if isinstance(value, str) else value


class _File(Model):
    noise: PushNoise


def named_noise(name: str) -> PushNoise:
    """The noise of a name.

    Raises:
        ConfigurationError: there is none of that name.
    """
    fields: dict[str, Any] = {"noise": name}
    return _File(**fields).noise
