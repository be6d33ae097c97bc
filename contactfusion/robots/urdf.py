"""What a URDF file says of links: their shapes and their inertia; checked before any library reads.

The kinematics are pinocchio's (`model.py`). It stops at the first fault with a word or none, so
what users get wrong most often is looked for here: files, meshes, limits, parents.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.files import require_file
from contactfusion.frames import Pose, pose_at
from contactfusion.shapes import ShapeConfig

Vector = tuple[float, float, float]
NEED_LIMITS = ("revolute", "prismatic")
PACKAGE = "package://"


@dataclass(frozen=True)
class Mesh:
    """A mesh as the shape of a link.

    Attributes:
        file: where it is.
        scale: along each axis.
        xyz: its origin in the link [m].
        rpy: roll, pitch and yaw in the link [rad].
    """

    file: Path
    scale: Vector
    xyz: Vector
    rpy: Vector

    def pose(self) -> Pose:
        """Give the pose of the mesh in the link."""
        return pose_at(self.xyz, self.rpy)


@dataclass(frozen=True)
class Link:
    """What a URDF says of one link, in the link's frame.

    Attributes:
        visual: the shapes to look at.
        collision: the shapes to touch.
        mass: [kg], 0 where the file names none.
        centre_of_mass: [m].
    """

    visual: tuple[ShapeConfig | Mesh, ...]
    collision: tuple[ShapeConfig | Mesh, ...]
    mass: float
    centre_of_mass: Vector


@dataclass(frozen=True)
class Urdf:
    """A URDF file.

    Attributes:
        path: where it is.
        links: by name, in the order of the file.
        parents: for each link but the root the link that it hangs on.
        children: the link that each joint carries.
    """

    path: Path
    links: Mapping[str, Link]
    parents: Mapping[str, str]
    children: Mapping[str, str]

    @property
    def root(self) -> str:
        """The link that hangs on no other."""
        return next(name for name in self.links if name not in self.parents)

    def hanging_on(self, link: str) -> tuple[str, ...]:
        """Give a link and all that hang on it, in the order of the file.

        Raises:
            RobotError: there is no such link.
        """
        self.require_link(link)
        return tuple(name for name in self.links if link in self._upwards(name))

    def require_link(self, name: str) -> None:
        """Make sure that there is a link of that name.

        Raises:
            RobotError: there is not.
        """
        if name not in self.links:
            raise RobotError(
                f"{self.path}: unknown link '{name}': {name_hint(name, self.links, 'links')}"
            )

    def _upwards(self, name: str) -> Iterator[str]:
        yield name
        while name in self.parents:
            name = self.parents[name]
            yield name


def read_urdf(path: Path, packages: Sequence[Path] = ()) -> Urdf:
    """Read the links of a URDF file.

    Args:
        path: the file.
        packages: folders in which `package://NAME/...` is looked for, before those above the file.

    Raises:
        RobotError: the file or a mesh is missing, it is no URDF, a joint has no limits, or the
            links do not form one tree.
    """
    require_file(path, RobotError)
    try:
        robot = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise RobotError(f"{path} is not XML: {error}") from None
    if robot.tag != "robot":
        raise RobotError(f"{path} is no URDF: its root is <{robot.tag}>, not <robot>")
    folders = (*packages, path.parent, *path.resolve().parents)
    links = {}
    for element in robot.findall("link"):
        name = element.get("name", "")
        if name in links:
            raise RobotError(f"{path}: two links are named '{name}'")
        try:
            links[name] = _link(element, path, folders)
        except (ConfigurationError, ValueError) as error:
            raise RobotError(f"{path}: link '{name}': {error}") from None
    parents = _parents(robot, path, links)
    children = {
        joint.get("name", ""): child.get("link", "")
        for joint in robot.findall("joint")
        if (child := joint.find("child")) is not None
    }
    return Urdf(path, links, parents, children)


def _link(element: Element, path: Path, folders: Sequence[Path]) -> Link:
    mass, centre = element.find("inertial/mass"), element.find("inertial/origin")
    return Link(
        visual=tuple(_shape(e, path, folders) for e in element.findall("visual")),
        collision=tuple(_shape(e, path, folders) for e in element.findall("collision")),
        mass=float(mass.get("value", 0.0)) if mass is not None else 0.0,
        centre_of_mass=_vector(centre, "xyz"),
    )


def _shape(element: Element, path: Path, folders: Sequence[Path]) -> ShapeConfig | Mesh:
    origin = element.find("origin")
    xyz, rpy = _vector(origin, "xyz"), _vector(origin, "rpy")
    shapes = list(element.find("geometry") or ())
    if not shapes:
        raise ConfigurationError(f"a <{element.tag}> has no geometry")
    shape = shapes[0]
    match shape.tag:
        case "box":
            return ShapeConfig(shape="box", size=_vector(shape, "size"), xyz=xyz, rpy=rpy)
        case "cylinder":
            radius, length = float(shape.attrib["radius"]), float(shape.attrib["length"])
            return ShapeConfig(shape="cylinder", radius=radius, length=length, xyz=xyz, rpy=rpy)
        case "sphere":
            return ShapeConfig(
                shape="sphere", radius=float(shape.attrib["radius"]), xyz=xyz, rpy=rpy
            )
        case "mesh":
            name = shape.get("filename", "")
            return Mesh(_found(name, path, folders), _vector(shape, "scale", 1.0), xyz, rpy)
        case _:
            kinds = "box, cylinder, sphere, mesh"
            raise ConfigurationError(f"unknown shape <{shape.tag}>; there are: {kinds}")


def _found(name: str, path: Path, folders: Sequence[Path]) -> Path:
    """Find a mesh by the name that the file gives it.

    ROS looks packages up in its own tables, which are not at hand: a package is a folder of that
    name, or the folder of the file when the package part is left out.
    """
    tails = [name.removeprefix("file://")]
    if name.startswith(PACKAGE):
        tail = name.removeprefix(PACKAGE)
        tails = [tail, tail.partition("/")[2]]
    candidates = [folder / tail for folder in folders for tail in tails if tail]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    hint = " (name the folder of the package in `packages`)" if name.startswith(PACKAGE) else ""
    raise ConfigurationError(f"the mesh '{name}' is not to be found{hint}")


def _parents(robot: Element, path: Path, links: Mapping[str, Link]) -> dict[str, str]:
    parents: dict[str, str] = {}
    for joint in robot.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        ends = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = element.get("link", "") if element is not None else ""
            if link not in links:
                hint = name_hint(link, links, "links")
                raise RobotError(f"{path}: joint '{name}' has an unknown {end} '{link}': {hint}")
            ends.append(link)
        limit = joint.find("limit")
        if kind in NEED_LIMITS and (limit is None or not {"lower", "upper"} <= set(limit.keys())):
            raise RobotError(f"{path}: joint '{name}' is {kind} but has no lower and upper limit")
        if ends[1] in parents:
            raise RobotError(f"{path}: link '{ends[1]}' hangs on two joints, '{name}' is one")
        parents[ends[1]] = ends[0]
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        names = ", ".join(roots) or "none"
        raise RobotError(f"{path}: one link must hang on no other, these do not: {names}")
    reached = {roots[0]}
    while new := {link for link, parent in parents.items() if parent in reached} - reached:
        reached |= new
    if lost := [link for link in links if link not in reached]:
        raise RobotError(f"{path}: no joints join link '{lost[0]}' to the root '{roots[0]}'")
    return parents


def _vector(element: Element | None, key: str, default: float = 0.0) -> Vector:
    text = element.get(key) if element is not None else None
    if text is None:
        return (default, default, default)
    numbers: FloatArray = np.array([float(word) for word in text.split()])
    if numbers.shape != (3,):
        raise ConfigurationError(f'{key}="{text}" is not three numbers')
    x, y, z = numbers.tolist()
    return (x, y, z)
