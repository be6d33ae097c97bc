"""ROBOT.yaml: a URDF, and the sensors on the robot."""

import os
import re
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError
from contactfusion.files import GIVE_CONFIG, file_in
from contactfusion.frames import FrameConfig
from contactfusion.hooks import GROUP
from contactfusion.model import Model, rooted
from contactfusion.patches import PatchConfig
from contactfusion.units import Degrees, Load, Metres, Offset, Spacing
from contactfusion.yaml_files import read_yaml

CameraRange = Annotated[Metres, Field(le=100)]
"""The range of time-of-flight and stereo cameras is some tens of metres."""
LidarRange = Annotated[Metres, Field(le=1000)]
"""The greatest range of LiDARs on vehicles is 600 m."""


class PatchOnLink(PatchConfig):
    """A patch of taxels that is fixed to a link."""

    frame: str
    """Its parent: a link, or one of `frames`."""


class WristConfig(Model):
    """A force-torque sensor in the arm's last joint."""

    frame: str
    """The frame of its wrenches: a link, or one of `frames`."""
    sign: Literal["on_robot", "by_robot"]
    """Whether it measures the force of the world on the robot, or of the robot on the world."""


class CameraConfig(Model):
    """A range camera; z is the optical axis, x points right, y down."""

    frame: str
    """The optical frame: a link, or one of `frames`."""
    width: int = Field(ge=1)
    """Image width [pixels]."""
    height: int = Field(ge=1)
    """Image height [pixels]."""
    fov: Degrees = Field(ge=3.2, lt=180)
    """The horizontal field of view [degrees]; above π, so that radians are found."""
    rate: float = Field(default=10.0, gt=0)
    """Image rate [Hz]; scenes of touches have a `camera_rate` of their own."""
    reach: tuple[CameraRange, CameraRange] = (0.2, 4.0)
    """The least and the greatest distance that it measures [m]."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        _require_ordered(self.reach)
        return self


class LidarConfig(Model):
    """A spinning LiDAR: it rotates about its z, from x to y; rings fan out along z."""

    frame: str
    """Its frame: a link, or one of `frames`."""
    rings: int = Field(default=32, ge=1)
    """The number of beams, one above the other."""
    fov: float = Field(default=90.0, gt=0, lt=180)
    """The vertical field of view, from the lowest to the highest ring [degrees]."""
    columns: int = Field(default=1024, ge=1)
    """Measurements in a full revolution."""
    window: tuple[float, float] = (-180.0, 180.0)
    """The azimuths between which it measures, from its x [degrees]."""
    rate: float = Field(default=10.0, gt=0)
    """Revolutions a second [Hz]."""
    reach: tuple[LidarRange, LidarRange] = (0.3, 50.0)
    """The least and the greatest distance that it measures [m]."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        _require_ordered(self.reach)
        first, last = self.window
        if not -360.0 <= first < last <= 360.0 or last - first > 360.0:
            raise ConfigurationError("give the first turn, then the last, at most a turn", "window")
        return self


class FingerConfig(Model):
    """A compliant finger: a contact force moves its joints."""

    joints: tuple[str, ...] = Field(min_length=1)
    """The joints of the finger."""
    links: tuple[str, ...] = Field(min_length=1)
    """The links of the finger."""


class EffortConfig(Model):
    """What is known of the effort that one joint reports; `identify` measures it in free motion."""

    noise: float = Field(gt=0)
    """Standard deviation of what is left of the torque in free motion [N·m, N]."""
    offset: float = 0.0
    """What it reports without any load, in its own unit."""
    constant: float | None = Field(default=None, gt=0)
    """Torque or force per unit of what it reports: of a motor's current [N·m/A, N/A], which must be
    known; else 1."""
    coulomb: float = Field(default=0.0, ge=0)
    """Friction against the motion that does not depend on speed [N·m, N]; 0 where torque is
    measured behind the gear."""
    viscous: float = Field(default=0.0, ge=0)
    """Friction against the motion per speed [N·m·s, N·s/m]."""

    @property
    def per_unit(self) -> float:
        """The constant, 1 where none is given."""
        return 1.0 if self.constant is None else self.constant


class LinkMassConfig(Model):
    """The mass of a link as it was identified, in place of that of the URDF."""

    mass: Load = Field(gt=0)
    """Its mass [kg]."""
    centre_of_mass: Offset
    """Its centre of mass, in the link's frame [m]."""


class PayloadConfig(Model):
    """What the robot carries beside the masses of its URDF, as a point mass."""

    frame: str
    """The frame of its centre of mass: a link, or one of `frames`."""
    mass: Load = Field(ge=0)
    """Its mass [kg]."""
    centre_of_mass: Offset = (0.0, 0.0, 0.0)
    """Its centre of mass [m]."""


class RobotConfig(Model):
    """A robot: its URDF, and the sensors on it."""

    urdf: str = Field(min_length=1)
    """The URDF file, or MODULE:FILE for one in an installed Python package, as in
    `pybullet_data:franka_panda/panda.urdf` or `contactfusion.robots:arm_hand.urdf`."""
    packages: tuple[Path, ...] = ()
    """Folders that are searched for `package://NAME/...`."""
    shapes: Literal["collision", "visual"] = "collision"
    """The kind of shapes that make up the surface."""
    links: tuple[str, ...] | None = None
    """The links that make up the surface; None: all that have shapes."""
    spacing: Spacing = Field(default=0.004, gt=0)
    """The distance between neighbouring samples of the surface [m]."""
    still: dict[str, float] = Field(default_factory=dict)
    """Positions of joints that no reading measures [rad, m]."""
    frames: dict[str, FrameConfig] = Field(default_factory=dict)
    """Further frames on links, by name."""
    patches: dict[str, PatchOnLink] = Field(default_factory=dict)
    """Patches of taxels, by the name of their sensor."""
    wrists: dict[str, WristConfig] = Field(default_factory=dict)
    """Force-torque sensors, by name."""
    cameras: dict[str, CameraConfig] = Field(default_factory=dict)
    """Range cameras, by name."""
    lidars: dict[str, LidarConfig] = Field(default_factory=dict)
    """Spinning LiDARs, by name."""
    fingers: dict[str, FingerConfig] = Field(default_factory=dict)
    """Compliant fingers, by name."""
    efforts: dict[str, EffortConfig] = Field(default_factory=dict)
    """What is known of the efforts that joints report, by joint."""
    masses: dict[str, LinkMassConfig] = Field(default_factory=dict)
    """Masses of links in place of those of the URDF, by link; `identify` measures them."""
    payload: PayloadConfig | None = None
    """What it carries beside the masses of its links, such as a tool."""
    folder: Path = Path()
    """The folder of relative file names; that of the file by default."""
    files_within: Path | None = None
    """The folder that all files have to lie in, but for those of packages; None: anywhere. It is
    set where a recording names the description."""

    def path(self) -> Path:
        """The URDF file.

        Raises:
            ConfigurationError: the Python package that should hold it is not installed.
        """
        try:
            return located(self.urdf, self.folder, self.files_within)
        except ConfigurationError as error:
            raise error.under("urdf") from None

    def package_folders(self) -> tuple[Path, ...]:
        """The folders of `packages`.

        Raises:
            ConfigurationError: a folder does not lie in `files_within`.
        """
        try:
            folders = (file_in(self.folder, path, self.files_within) for path in self.packages)
            return tuple(folders)
        except ConfigurationError as error:
            raise error.under("packages") from None


def _require_ordered(reach: tuple[float, float]) -> None:
    if not 0.0 <= reach[0] < reach[1]:
        raise ConfigurationError("give the least distance, then the greatest", "reach")


IN_PACKAGE = re.compile(r"([\w.]*):(.*)")
"""MODULE:FILE; a name with another colon, as of a time, is that of a file."""


def located(name: str, folder: Path = Path(), within: Path | None = None) -> Path:
    """The file of a name: in a folder, or MODULE:FILE in an installed Python package.

    The package is found without importing anything.

    Args:
        name: of the file.
        folder: that of a relative name.
        within: the folder that the file has to lie in, when a recording holds the name; then a
            package must be this one, or offer plug-ins for it. None: no limit.

    Raises:
        ConfigurationError: there is no such package, or the name leads elsewhere.
    """
    if not (found := IN_PACKAGE.fullmatch(name)):
        return file_in(folder, name, within)
    module, file = found.groups()
    top = module.partition(".")[0]
    if within is not None and top not in _offering_plugins():
        raise ConfigurationError(
            f"a configuration that comes from a recording may name files of contactfusion and of "
            f"packages with plug-ins for it, not of the Python package '{module}'; {GIVE_CONFIG}"
        )
    package = _package(module)
    return file_in(package, file, package if within is not None else None)


def _package(module: str) -> Path:
    """The folder of an installed Python package; not even its parent packages are imported."""
    top, *inner = module.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        spec = None
    for root in (spec and spec.submodule_search_locations) or ():
        folder = Path(root, *inner)
        if os.path.isdir(folder):  # also where the name is longer than any
            return folder
    raise ConfigurationError(f"the Python package '{module}' is not installed")


def _offering_plugins() -> set[str]:
    points = entry_points(group=GROUP)
    return {"contactfusion", *(point.module.partition(".")[0] for point in points)}


def read_robot(name: str | Path, folder: Path = Path(), within: Path | None = None) -> RobotConfig:
    """Read ROBOT.yaml; relative names in it start at its folder.

    Args:
        name: the file, or MODULE:FILE for one in an installed Python package.
        folder: that of a relative name.
        within: the folder that it and all files it names have to lie in, see `located`; None: no
            limit.

    Raises:
        ConfigurationError: the file is missing, or a field of it is wrong.
    """
    path = located(str(name), folder, within)
    inside = None if IN_PACKAGE.fullmatch(str(name)) else within  # a package's own may name any
    try:
        return rooted(RobotConfig(**read_yaml(path)), path.parent, inside)
    except ConfigurationError as error:
        faults = [ConfigurationError(f"{path}: {fault}") for fault in error.faults]
        raise ConfigurationError.of(faults) from None
