"""Links of a URDF file: shapes and inertia, checked before any library reads the file.

The kinematics are pinocchio's (`model.py`). It stops at the first fault with a word or none, so
the most frequent mistakes are found here: files, meshes, limits, parents.
"""

import math
import os.path
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.files import require_file
from contactfusion.frames import Pose, pose_at
from contactfusion.shapes import ShapeConfig

Vector = tuple[float, float, float]
SHAPES = ("box", "cylinder", "sphere", "mesh")
GREATEST = 1000.0
"""The greatest length, turn or scale [m, rad, 1]."""
HEAVIEST = 1e6
"""The greatest mass of a link [kg]."""
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed")
"""Types of joints with one position, or none."""
PACKAGE = "package://"
MANIFEST = "package.xml"
"""The file that marks a folder as a package of ROS."""
FOLDER = "urdf"
"""The usual folder of robots in a package; meshes stand beside it."""
XACRO = "ros.org/wiki/xacro"


@dataclass(frozen=True)
class Mesh:
    """A mesh as the shape of a link.

    Attributes:
        file: its path.
        scale: along each axis.
        xyz: its origin in the link [m].
        rpy: roll, pitch and yaw in the link [rad].
    """

    file: Path
    scale: Vector
    xyz: Vector
    rpy: Vector

    def pose(self) -> Pose:
        """The pose of the mesh in the link."""
        return pose_at(self.xyz, self.rpy)


@dataclass(frozen=True)
class Link:
    """A link of a URDF, in the link's frame.

    Its shapes are checked on first access: those that are not used may be wrong.

    Attributes:
        name: its name.
        mass: [kg], 0 where the file gives none.
        centre_of_mass: [m].
    """

    name: str
    mass: float
    centre_of_mass: Vector
    _element: Element
    _path: Path
    _places: "_Places"

    @property
    def is_shaped(self) -> bool:
        """Whether the file gives it any shape."""
        return any(self._element.find(kind) is not None for kind in ("visual", "collision"))

    @cached_property
    def visual(self) -> "Shapes":
        """The visual shapes.

        Raises:
            RobotError: a shape is wrong, or its mesh is missing.
        """
        return self._shapes("visual")

    @cached_property
    def collision(self) -> "Shapes":
        """The collision shapes.

        Raises:
            RobotError: a shape is wrong, or its mesh is missing.
        """
        return self._shapes("collision")

    def _shapes(self, kind: str) -> "Shapes":
        try:
            elements = self._element.findall(kind)
            return tuple(_shape(element, self._places) for element in elements)
        except ConfigurationError as error:
            raise RobotError(f"{self._path}: link '{self.name}': {error}") from None


Shapes = tuple[ShapeConfig | Mesh, ...]
"""The shapes of one kind of a link."""


class Mimic(NamedTuple):
    """A joint that follows another: at `multiplier` times its position, plus `offset`.

    Attributes:
        joint: the joint that is followed.
        multiplier: of its position.
        offset: [rad, m].
    """

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Urdf:
    """A URDF file.

    Attributes:
        path: of the file.
        links: by name, in the order of the file.
        parents: by link, but for the root, its parent link.
        children: the link that each joint carries.
        mimics: the joints that follow another, which follows none itself.
    """

    path: Path
    links: Mapping[str, Link]
    parents: Mapping[str, str]
    children: Mapping[str, str]
    mimics: Mapping[str, Mimic]

    @property
    def root(self) -> str:
        """The link that hangs on no other."""
        return next(name for name in self.links if name not in self.parents)

    def hanging_on(self, link: str) -> tuple[str, ...]:
        """A link and all that it carries, in the order of the file.

        Raises:
            RobotError: there is no such link.
        """
        self.require_link(link)
        return tuple(name for name in self.links if link in self._upwards(name))

    def require_link(self, name: str) -> None:
        """Refuse a name that no link has.

        Raises:
            RobotError: there is no such link.
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


class _Places(NamedTuple):
    """The folders that are searched for meshes, and those that meshes may lie in.

    Attributes:
        searched: folders, in this order.
        own: the package of the file, and the folders of packages that the user names.
        bounded: whether links may not lead out of them, either.
    """

    searched: tuple[Path, ...]
    own: tuple[Path, ...]
    bounded: bool

    def hold(self, file: Path, others: Sequence[Path]) -> bool:
        """Whether a file lies in a permitted folder, one of these or of others."""
        # a workspace that is installed by links has its files elsewhere
        forms = [file.resolve()] if self.bounded else [file.resolve(), Path(os.path.abspath(file))]
        return any(form.is_relative_to(folder) for form in forms for folder in (*self.own, *others))


def read_urdf(
    path: Path,
    packages: Sequence[Path] = (),
    within: Path | None = None,
    shapes: Sequence[Literal["collision", "visual"]] = ("collision",),
) -> Urdf:
    """Read the links of a URDF file.

    Meshes lie in the package of the file, in `packages`, or in another package of ROS in a folder
    above the file. The package of the file is the nearest folder above with a `package.xml`; else
    its own folder, or its parent when that is called `urdf`.

    Args:
        path: the file.
        packages: folders in which `package://NAME/...` is looked for, before those above the file.
        within: of a file in this folder, no mesh may lie outside of it; None: no limit.
        shapes: the kinds of shapes that are used, and checked at once.

    Raises:
        RobotError: the file or a mesh is missing, it is no URDF, a joint has no limits or mimics
            none that moves, or the links do not form one tree.
    """
    robot = _parsed(path)
    places = _places(path, packages, within)
    links = {}
    for name, element in _named(robot, "link", path).items():
        try:
            links[name] = _link(name, element, path, places)
        except ConfigurationError as error:
            raise RobotError(f"{path}: link '{name}': {error}") from None
        for kind in shapes:
            getattr(links[name], kind)
    joints = _named(robot, "joint", path)
    for name, element in joints.items():
        try:
            _check_joint(element, links)
        except ConfigurationError as error:
            raise RobotError(f"{path}: joint '{name}' {error}") from None
    children = {name: _end(joint, "child") for name, joint in joints.items()}
    return Urdf(path, links, _parents(joints, path, links), children, _mimics(joints, path))


def _places(path: Path, packages: Sequence[Path], within: Path | None) -> _Places:
    above = list(path.resolve().parents)
    bounded = within is not None and within.resolve() in above
    if within is not None and bounded:
        above = above[: above.index(within.resolve()) + 1]
    usual = above[1] if above[0].name == FOLDER and len(above) > 1 else above[0]
    package = next((folder for folder in above if (folder / MANIFEST).is_file()), usual)
    own = (package, *(folder.resolve() for folder in packages))
    return _Places((*packages, path.parent, *above), own, bounded)


def _parsed(path: Path) -> Element:
    require_file(path, RobotError)
    try:
        robot = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} is not XML: {error}") from None
    except OSError as error:
        raise RobotError(f"{path} can't be read: {error.strerror}") from None
    if robot.tag != "robot":
        raise RobotError(f"{path} is no URDF: its root is <{robot.tag}>, not <robot>")
    if any(XACRO in element.tag for element in robot.iter()):
        raise RobotError(f"{path} is no URDF yet: expand it with `xacro {path.name} > robot.urdf`")
    if not robot.get("name"):
        raise RobotError(f"{path}: the <robot> has no name")
    return robot


def _named(robot: Element, tag: str, path: Path) -> dict[str, Element]:
    """The links or the joints by name, in the order of the file."""
    named: dict[str, Element] = {}
    for element in robot.findall(tag):
        name = element.get("name", "")
        if not name:
            raise RobotError(f"{path}: a {tag} has no name")
        if name in named:
            raise RobotError(f"{path}: two {tag}s are named '{name}'")
        named[name] = element
    return named


def _link(name: str, element: Element, path: Path, places: _Places) -> Link:
    inertia, centre = element.find("inertial/mass"), element.find("inertial/origin")
    mass = _number(inertia, "value") if inertia is not None else 0.0
    if not 0.0 <= mass <= HEAVIEST:
        raise ConfigurationError(f"its mass is {mass:g} kg")
    return Link(name, mass, _vector(centre, "xyz"), element, path, places)


def _shape(element: Element, places: _Places) -> ShapeConfig | Mesh:
    origin = element.find("origin")
    xyz, rpy = _vector(origin, "xyz"), _vector(origin, "rpy")
    shape = element.find("geometry/*")
    if shape is None:
        raise ConfigurationError(f"a <{element.tag}> has no geometry")
    match shape.tag:
        case "box":
            return ShapeConfig(shape="box", size=_required(shape, "size"), xyz=xyz, rpy=rpy)
        case "cylinder":
            radius, length = _number(shape, "radius"), _number(shape, "length")
            return ShapeConfig(shape="cylinder", radius=radius, length=length, xyz=xyz, rpy=rpy)
        case "sphere":
            return ShapeConfig(shape="sphere", radius=_number(shape, "radius"), xyz=xyz, rpy=rpy)
        case "mesh":
            file = _found(_text(shape, "filename"), places)
            scale = _vector(shape, "scale", 1.0)
            if not all(scale):
                raise ConfigurationError(f"the mesh {file.name} is scaled by 0")
            return Mesh(file, scale, xyz, rpy)
        case _:
            hint = name_hint(shape.tag, SHAPES, "shapes")
            raise ConfigurationError(f"unknown shape <{shape.tag}>: {hint}")


def _found(name: str, places: _Places) -> Path:
    """The mesh of a name in the file.

    ROS looks packages up in its own tables, which are not at hand: a package is a folder of that
    name, or the folder of the file when the package part is left out.
    """
    tails, others = [name.removeprefix("file://")], list[Path]()
    if name.startswith(PACKAGE):
        tail = name.removeprefix(PACKAGE)
        package, _, rest = tail.partition("/")
        tails = [tail, rest]
        named = [folder.resolve() / package for folder in places.searched if package.strip(".")]
        others = [folder for folder in named if os.path.isfile(folder / MANIFEST)]
    candidates = [folder / tail for folder in places.searched for tail in tails if tail]
    files = [each for each in candidates if os.path.isfile(each)]  # a name may be too long
    for file in files:
        if places.hold(file, others):
            return file
    if files:
        raise ConfigurationError(
            f"the mesh '{name}' is {files[0].resolve()}, outside the package of the file, "
            f"{places.own[0]} (name the folder of the mesh, or of its package, in `packages`)"
        )
    hint = " (name the folder of the package in `packages`)" if name.startswith(PACKAGE) else ""
    raise ConfigurationError(f"the mesh '{name}' is not to be found{hint}")


def _check_joint(joint: Element, links: Mapping[str, Link]) -> None:
    """Refuse a joint that pinocchio can't read; the sentence continues after its name."""
    kind = joint.get("type", "")
    if kind not in JOINT_TYPES:
        hint = name_hint(kind, JOINT_TYPES, "types")
        raise ConfigurationError(f"may not have the type '{kind}': {hint}")
    for end in ("parent", "child"):
        if (link := _end(joint, end)) not in links:
            hint = name_hint(link, links, "links")
            raise ConfigurationError(f"has an unknown {end} '{link}': {hint}")
    origin, axis, limit = joint.find("origin"), joint.find("axis"), joint.find("limit")
    try:
        _vector(origin, "xyz")
        _vector(origin, "rpy")
        if axis is not None and kind != "fixed" and not any(_required(axis, "xyz")):
            raise ConfigurationError("its axis is zero")
        if kind in ("revolute", "prismatic"):
            if limit is None:
                raise ConfigurationError("has no <limit>")
            if _number(limit, "lower") > _number(limit, "upper"):
                raise ConfigurationError("its lower limit lies over its upper one")
        if limit is not None:
            _number(limit, "effort")
            _number(limit, "velocity")
    except ConfigurationError as error:
        raise ConfigurationError(f"is {kind}, but {error}") from None


def _end(joint: Element, end: str) -> str:
    """The link at one end of a joint."""
    element = joint.find(end)
    return element.get("link", "") if element is not None else ""


def _parents(
    joints: Mapping[str, Element], path: Path, links: Mapping[str, Link]
) -> dict[str, str]:
    parents: dict[str, str] = {}
    for name, joint in joints.items():
        parent, child = _end(joint, "parent"), _end(joint, "child")
        if child in parents:
            raise RobotError(f"{path}: link '{child}' hangs on two joints, '{name}' is one")
        parents[child] = parent
    roots = [link for link in links if link not in parents]
    if not roots:
        why = "its joints form a loop: every link hangs on another" if links else "it has no <link>"
        raise RobotError(f"{path} is no tree of links: {why}")
    if len(roots) > 1:
        names = ", ".join(f"'{root}'" for root in roots)
        raise RobotError(f"{path}: only one link may hang on no other, but these do: {names}")
    reached = {roots[0]}
    while new := {link for link, parent in parents.items() if parent in reached} - reached:
        reached |= new
    if lost := [link for link in links if link not in reached]:
        raise RobotError(f"{path}: no joints join link '{lost[0]}' to the root '{roots[0]}'")
    return parents


def _mimics(joints: Mapping[str, Element], path: Path) -> dict[str, Mimic]:
    """The joints that mimic another, each with the joint at the end of its chain."""
    moving = {name: joint for name, joint in joints.items() if joint.get("type") != "fixed"}
    followed = {}
    for name, joint in moving.items():
        element = joint.find("mimic")
        if element is None:
            continue
        try:
            followed[name] = _mimic(element, moving)
        except ConfigurationError as error:
            raise RobotError(f"{path}: joint '{name}': {error}") from None
    return {name: _unchained(name, followed, path) for name in followed}


def _mimic(element: Element, joints: Mapping[str, Element]) -> Mimic:
    joint = _text(element, "joint")
    if joint not in joints:
        hint = name_hint(joint, joints, "joints that move")
        raise ConfigurationError(f"it mimics an unknown joint '{joint}': {hint}")
    multiplier = _number(element, "multiplier") if element.get("multiplier") else 1.0
    return Mimic(joint, multiplier, _number(element, "offset") if element.get("offset") else 0.0)


def _unchained(name: str, followed: Mapping[str, Mimic], path: Path) -> Mimic:
    """The mimicry of a joint, through a chain of others, of a joint that follows none."""
    joint, multiplier, offset = followed[name]
    chain = [name, joint]
    while joint in followed:
        joint, times, plus = followed[joint]
        if joint in chain:
            raise RobotError(f"{path}: joints mimic in a circle: {' -> '.join([*chain, joint])}")
        chain.append(joint)
        offset, multiplier = offset + multiplier * plus, multiplier * times
    return Mimic(joint, multiplier, offset)


def _vector(element: Element | None, key: str, default: float = 0.0) -> Vector:
    if element is None or key not in element.keys():
        return (default, default, default)
    return _required(element, key)


def _required(element: Element, key: str) -> Vector:
    text = _text(element, key)
    try:
        x, y, z = map(float, text.split())
    except ValueError:
        raise ConfigurationError(f'{key}="{text}" is not three numbers{_xacro(text)}') from None
    if not all(map(math.isfinite, (x, y, z))):
        raise ConfigurationError(f'{key}="{text}" is not three finite numbers')
    if max(abs(x), abs(y), abs(z)) > GREATEST:
        raise ConfigurationError(f'{key}="{text}" is beyond {GREATEST:g}: lengths are in metres')
    return x, y, z


def _number(element: Element, key: str) -> float:
    text = _text(element, key)
    try:
        number = float(text)
    except ValueError:
        raise ConfigurationError(f'{key}="{text}" is not a number{_xacro(text)}') from None
    if not math.isfinite(number):
        raise ConfigurationError(f'{key}="{text}" is not finite')
    return number


def _xacro(text: str) -> str:
    """The clause on an expression that xacro has left in a value."""
    return ": it is an expression of xacro; put its value there" if "$" in text else ""


def _text(element: Element, key: str) -> str:
    text = element.get(key)
    if not text:
        raise ConfigurationError(f"the <{element.tag}> has no {key}")
    return text
