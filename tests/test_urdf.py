"""What a URDF says of links, and what is wrong with one, in one sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import RobotError
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.urdf import Mesh, Urdf, read_urdf
from contactfusion.shapes import ShapeConfig
from tests.urdfs import LIMIT, REAL, joint, link, written

MESH = '<mesh filename="{}"/>'


def said(path: Path) -> str:
    """The one sentence about a URDF that cannot be used."""
    with pytest.raises(RobotError) as caught:
        read_urdf(path, shapes=("visual", "collision"))
    sentence = str(caught.value)
    assert "\n" not in sentence
    return sentence


def tree(folder: Path) -> Urdf:
    """A trunk with an arm of two links, and a head."""
    return read_urdf(
        written(
            folder,
            link("trunk", mass=9.0),
            link("hand", mass=0.5, at="0 0 0.1"),
            link("arm", '<box size="1 2 3"/>', mass=2.0),
            link("head"),
            joint("wrist", "arm", "hand"),
            joint("shoulder", "trunk", "arm"),
            joint("neck", "trunk", "head", "fixed"),
        )
    )


# What it says


def test_links_come_in_the_order_of_the_file(tmp_path: Path) -> None:
    assert tuple(tree(tmp_path).links) == ("trunk", "hand", "arm", "head")


def test_the_root_hangs_on_no_other(tmp_path: Path) -> None:
    urdf = tree(tmp_path)
    assert urdf.root == "trunk"
    assert urdf.parents == {"hand": "arm", "arm": "trunk", "head": "trunk"}
    assert urdf.children == {"wrist": "hand", "shoulder": "arm", "neck": "head"}


def test_what_hangs_on_a_link_is_it_and_all_beyond_it(tmp_path: Path) -> None:
    urdf = tree(tmp_path)
    assert urdf.hanging_on("arm") == ("hand", "arm")
    assert urdf.hanging_on("head") == ("head",)
    assert urdf.hanging_on("trunk") == tuple(urdf.links)


def test_an_unknown_link_is_told_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="unknown link 'trnk': did you mean 'trunk'"):
        tree(tmp_path).hanging_on("trnk")


def test_a_link_has_its_mass_and_its_centre(tmp_path: Path) -> None:
    links = tree(tmp_path).links
    assert links["hand"].mass == 0.5 and links["hand"].centre_of_mass == (0.0, 0.0, 0.1)
    assert links["head"].mass == 0.0


def test_shapes_to_see_and_to_touch_are_kept_apart(tmp_path: Path) -> None:
    ball = '<{0}><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><geometry>{1}</geometry></{0}>'
    path = written(
        tmp_path,
        '<link name="a">',
        ball.format("visual", '<sphere radius="2"/>'),
        ball.format("collision", '<cylinder radius="0.5" length="4"/>'),
        ball.format("collision", '<box size="1 2 3"/>'),
        "</link>",
    )
    one = read_urdf(path).links["a"]
    there: dict[str, Any] = {"xyz": (1.0, 2.0, 3.0), "rpy": (0.1, 0.2, 0.3)}
    assert one.visual == (ShapeConfig(shape="sphere", radius=2.0, **there),)
    assert one.collision == (
        ShapeConfig(shape="cylinder", radius=0.5, length=4.0, **there),
        ShapeConfig(shape="box", size=(1.0, 2.0, 3.0), **there),
    )


def test_a_robot_may_be_one_link(tmp_path: Path) -> None:
    assert read_urdf(written(tmp_path, link("base"))).root == "base"


@pytest.mark.parametrize("name", REAL)
def test_real_robots_are_trees_with_masses(name: str) -> None:
    urdf = read_urdf(RobotConfig(urdf=name).path())
    assert urdf.hanging_on(urdf.root) == tuple(urdf.links)
    assert sum(one.mass for one in urdf.links.values()) > 10.0


# Joints that follow another


def gripper(folder: Path, *mimics: str) -> Path:
    """Fingers on a palm, the first of which follows none."""
    elements = [link("palm"), link("f0"), joint("j0", "palm", "f0")]
    for number, mimic in enumerate(mimics, start=1):
        elements.append(link(f"f{number}"))
        inside = f"{LIMIT}<mimic {mimic}/>"
        elements.append(joint(f"j{number}", "palm", f"f{number}", inside=inside))
    return written(folder, *elements)


def test_a_joint_follows_another_by_multiplier_and_offset(tmp_path: Path) -> None:
    path = gripper(tmp_path, 'joint="j0"', 'joint="j0" multiplier="-2" offset="0.5"')
    assert read_urdf(path).mimics == {"j1": ("j0", 1.0, 0.0), "j2": ("j0", -2.0, 0.5)}


def test_a_joint_that_follows_a_follower_follows_the_first(tmp_path: Path) -> None:
    mimics = 'joint="j2" multiplier="3" offset="1"', 'joint="j0" multiplier="2" offset="0.5"'
    assert read_urdf(gripper(tmp_path, *mimics)).mimics["j1"] == ("j0", 6.0, 2.5)


@pytest.mark.parametrize(
    ("mimics", "sentence"),
    [
        (['joint="j9"'], "joint 'j1': it mimics an unknown joint 'j9': the joints that move are"),
        (["multiplier='2'"], "joint 'j1': the <mimic> has no joint"),
        (['joint="j0" multiplier="x"'], "joint 'j1': multiplier=\"x\" is not a number"),
        (['joint="j1"'], "joints mimic in a circle: j1 -> j1"),
        (['joint="j2"', 'joint="j1"'], "joints mimic in a circle: j1 -> j2 -> j1"),
    ],
)
def test_a_joint_that_follows_none_that_moves_is_refused(
    mimics: list[str], sentence: str, tmp_path: Path
) -> None:
    assert sentence in said(gripper(tmp_path, *mimics))


def test_an_expression_of_xacro_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, *map(link, "ab"), joint("j", "a", "b", xyz="$(arg x) 0 0"))
    assert 'xyz="$(arg x) 0 0" is not three numbers: it is an expression of xacro' in said(path)


# Shapes that are not used


def test_a_shape_that_is_not_used_may_be_wrong(tmp_path: Path) -> None:
    visual = '<visual><geometry><sphere radius="0"/></geometry></visual>'
    gone = f"<visual><geometry>{MESH.format('gone.stl')}</geometry></visual>"
    shape = '<collision><geometry><sphere radius="1"/></geometry></collision>'
    path = written(tmp_path, f'<link name="a">{visual}{gone}{shape}</link>')
    one = read_urdf(path).links["a"]
    assert one.is_shaped and one.collision == (ShapeConfig(shape="sphere", radius=1.0),)
    assert RobotModel(RobotConfig(urdf=str(path))).parts.keys() == {"a"}
    for wrong in (
        lambda: one.visual,
        lambda: RobotModel(RobotConfig(urdf=str(path), shapes="visual")),
    ):
        with pytest.raises(RobotError, match="link 'a': .*radius"):
            wrong()


@pytest.mark.parametrize(
    ("element", "problem"),
    [
        ('<inertial><mass value="1e308"/></inertial>', "its mass is 1e.308 kg"),
        ('<collision><origin xyz="1e300 0 0"/>BALL</collision>', "is beyond 1000: lengths are in"),
        ("<collision><geometry>FLAT</geometry></collision>", "the mesh a.stl is scaled by 0"),
    ],
)
def test_what_no_robot_has_is_refused(element: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_text("")
    element = element.replace("BALL", '<geometry><sphere radius="1"/></geometry>')
    element = element.replace("FLAT", '<mesh filename="a.stl" scale="0 1 1"/>')
    with pytest.raises(RobotError, match=problem):
        _ = read_urdf(written(tmp_path, f'<link name="a">{element}</link>')).links["a"].collision


# Where meshes are


@pytest.mark.parametrize(
    ("named", "stands"),
    [
        ("arm.stl", "robot/arm.stl"),
        ("meshes/arm.stl", "robot/meshes/arm.stl"),
        ("../packages/arm.stl", "packages/arm.stl"),
        ("package://robot/arm.stl", "robot/arm.stl"),
        ("package://gone/meshes/arm.stl", "robot/meshes/arm.stl"),
        ("package://kit/arm.stl", "packages/kit/arm.stl"),
    ],
)
def test_a_mesh_is_found_beside_the_file_or_in_a_package(
    named: str, stands: str, tmp_path: Path
) -> None:
    mesh = tmp_path / stands
    mesh.parent.mkdir(parents=True, exist_ok=True)
    mesh.write_text("solid")
    (tmp_path / "robot").mkdir(exist_ok=True)
    path = written(tmp_path / "robot", link("a", MESH.format(named)))
    (shape,) = read_urdf(path, [tmp_path / "packages"]).links["a"].collision
    assert isinstance(shape, Mesh) and shape.file.samefile(mesh)


@pytest.mark.parametrize("prefix", ["", "file://"])
def test_a_mesh_may_have_an_absolute_name(prefix: str, tmp_path: Path) -> None:
    mesh = tmp_path / "arm.stl"
    mesh.write_text("solid")
    path = written(tmp_path, link("a", MESH.format(f"{prefix}{mesh}")))
    (shape,) = read_urdf(path).links["a"].collision
    assert isinstance(shape, Mesh) and shape.file == mesh


def refused(path: Path) -> bool:
    """Whether the mesh of a robot lies where it may not, and the sentence tells the cure."""
    with pytest.raises(RobotError, match=r"outside the package of the file, .*`packages`\)$"):
        read_urdf(path)
    return True


def robot_of(folder: Path, mesh: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return written(folder, link("a", MESH.format(mesh)))


@pytest.mark.parametrize(
    "name", ["../arm.stl", "{up}/arm.stl", "file://{up}/arm.stl", "package://robot/../arm.stl",
             "package://../arm.stl"]
)  # fmt: skip
def test_a_mesh_lies_in_the_package_of_the_file(name: str, tmp_path: Path) -> None:
    (tmp_path / "arm.stl").write_text("solid")
    path = robot_of(tmp_path / "robot", name.format(up=tmp_path))
    assert refused(path)
    (shape,) = read_urdf(path, [tmp_path]).links["a"].collision
    assert isinstance(shape, Mesh) and shape.file.samefile(tmp_path / "arm.stl")


def test_the_package_of_a_file_in_a_folder_urdf_is_the_one_above(tmp_path: Path) -> None:
    (tmp_path / "kit" / "meshes").mkdir(parents=True)
    for folder in (tmp_path, tmp_path / "kit" / "meshes"):
        (folder / "arm.stl").write_text("solid")
    assert read_urdf(robot_of(tmp_path / "kit" / "urdf", "../meshes/arm.stl"))
    assert read_urdf(robot_of(tmp_path / "kit" / "urdf", "package://kit/meshes/arm.stl"))
    assert refused(robot_of(tmp_path / "kit" / "urdf", "../../arm.stl"))


def test_the_package_of_a_file_is_the_nearest_with_a_manifest(tmp_path: Path) -> None:
    deep = tmp_path / "kit" / "robots" / "seven"
    for folder in (tmp_path, tmp_path / "kit" / "meshes", tmp_path / "other"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "arm.stl").write_text("solid")
    assert refused(robot_of(deep, "package://kit/meshes/arm.stl"))
    (tmp_path / "kit" / "package.xml").write_text("<package/>")
    for name in ("package://kit/meshes/arm.stl", "../../meshes/arm.stl"):
        assert read_urdf(robot_of(deep, name))
    assert refused(robot_of(deep, "../../../arm.stl"))
    assert refused(robot_of(deep, "package://other/arm.stl"))
    (tmp_path / "other" / "package.xml").write_text("<package/>")
    assert read_urdf(robot_of(deep, "package://other/arm.stl"))


def test_a_workspace_may_be_installed_by_links(tmp_path: Path) -> None:
    source, share = tmp_path / "src" / "kit", tmp_path / "share" / "kit"
    (source / "meshes").mkdir(parents=True)
    (source / "meshes" / "arm.stl").write_text("solid")
    path = robot_of(share / "urdf", "package://kit/meshes/arm.stl")
    (share / "package.xml").write_text("<package/>")
    (share / "meshes").symlink_to(source / "meshes")
    assert read_urdf(path)
    linked = tmp_path / "linked" / "kit"
    linked.parent.mkdir()
    linked.symlink_to(share)
    assert read_urdf(linked / "urdf" / "robot.urdf")


def test_packages_that_are_named_come_before_what_stands_above_the_file(tmp_path: Path) -> None:
    for folder in ("kit", "packages/kit"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "package.xml").write_text("<package/>")
        (tmp_path / folder / "arm.stl").write_text("solid")
    path = written(tmp_path, link("a", MESH.format("package://kit/arm.stl")))
    (shape,) = read_urdf(path, [tmp_path / "packages"]).links["a"].collision
    assert isinstance(shape, Mesh) and shape.file == tmp_path / "packages/kit/arm.stl"


def test_a_mesh_stands_and_is_scaled_as_it_says(tmp_path: Path) -> None:
    (tmp_path / "arm.stl").write_text("solid")
    geometry = '<mesh filename="arm.stl" scale="1 2 -3"/>'
    (shape,) = read_urdf(written(tmp_path, link("a", geometry, at="1 2 3"))).links["a"].collision
    assert isinstance(shape, Mesh) and shape.scale == (1.0, 2.0, -3.0)
    assert np.array_equal(shape.pose()[:3, 3], [1.0, 2.0, 3.0])


# What is wrong


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["is not XML"]),
        ("hello", ["is not XML"]),
        ("\x00\x01", ["is not XML"]),
        ('<robot name="a"><link name="b"></robot>', ["is not XML", "line 1"]),
        ('<?xml version="1.0" encoding="no-such"?><robot/>', ["is not XML", "no-such"]),
        ('<sdf version="1.6"/>', ["is no URDF", "<sdf>", "<robot>"]),
        ('<robot name="a"/>', ["has no <link>"]),
        ('<robot><link name="a"/></robot>', ["the <robot> has no name"]),
        ('<robot name="a"><link/></robot>', ["a link has no name"]),
        (
            '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include/></robot>',
            ["`xacro robot.urdf > robot.urdf`"],
        ),
    ],
)
def test_a_file_that_is_no_urdf_is_told_by_name(
    text: str, words: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    sentence = said(path)
    assert str(path) in sentence and all(word in sentence for word in words), sentence


def test_a_missing_file_is_told_with_the_nearest(tmp_path: Path) -> None:
    written(tmp_path, link("a"))
    assert "did you mean 'robot.urdf'?" in said(tmp_path / "robto.urdf")
    assert "is a folder" in said(tmp_path)
    assert "nor its folder" in said(tmp_path / "no" / "robot.urdf")


@pytest.mark.parametrize(
    ("geometry", "words"),
    [
        ('<capsule radius="1" length="1"/>', ["unknown shape <capsule>", "box, cylinder, mesh"]),
        ('<spere radius="1"/>', ["unknown shape <spere>", "did you mean 'sphere'"]),
        ('<box size="1 1"/>', ['size="1 1" is not three numbers']),
        ('<box size="1 1 x"/>', ['size="1 1 x" is not three numbers']),
        ('<box size="1, 1, 1"/>', ['size="1, 1, 1" is not three numbers']),
        ('<box size="1 1 nan"/>', ["is not three finite numbers"]),
        ('<box size="1 1 0"/>', ["a box has 3 positive edges"]),
        ("<box/>", ["the <box> has no size"]),
        ('<sphere radius="-1"/>', ["radius", "greater than 0", "-1"]),
        ('<sphere radius="one"/>', ['radius="one" is not a number']),
        ('<cylinder length="1"/>', ["the <cylinder> has no radius"]),
        ('<cylinder radius="1" length="inf"/>', ['length="inf" is not finite']),
        ("<mesh/>", ["the <mesh> has no filename"]),
        ('<mesh filename="arm.stl"/>', ["the mesh 'arm.stl' is not to be found"]),
        (
            '<mesh filename="package://kit/arm.stl"/>',
            ["the mesh 'package://kit/arm.stl' is not to be found", "in `packages`"],
        ),
        (" ", ["a <collision> has no geometry"]),
    ],
)
def test_a_shape_that_cannot_be_is_told_with_its_link(
    geometry: str, words: list[str], tmp_path: Path
) -> None:
    sentence = said(written(tmp_path, link("arm", geometry)))
    assert all(word in sentence for word in ["link 'arm'", *words]), sentence


def test_a_mesh_of_which_the_scale_is_no_scale_is_told(tmp_path: Path) -> None:
    (tmp_path / "arm.stl").write_text("solid")
    path = written(tmp_path, link("a", '<mesh filename="arm.stl" scale="0.001"/>'))
    assert 'scale="0.001" is not three numbers' in said(path)


@pytest.mark.parametrize(
    ("mass", "words"),
    [
        ('<mass value="heavy"/>', 'value="heavy" is not a number'),
        ('<mass value="nan"/>', 'value="nan" is not finite'),
        ('<mass value="-2"/>', "its mass is -2 kg"),
        ("<mass/>", "the <mass> has no value"),
    ],
)
def test_a_mass_that_cannot_be_is_told_with_its_link(mass: str, words: str, tmp_path: Path) -> None:
    path = written(tmp_path, f'<link name="arm"><inertial>{mass}</inertial></link>')
    assert f"link 'arm': {words}" in said(path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parent": "bas"}, "has an unknown parent 'bas': did you mean 'base'?"),
        ({"child": "am"}, "has an unknown child 'am': did you mean 'arm'?"),
        ({"child": ""}, "has an unknown child ''"),
        ({"inside": ""}, "is revolute, but has no <limit>"),
        ({"kind": "prismatic", "inside": ""}, "is prismatic, but has no <limit>"),
        (
            {"inside": '<limit effort="1" velocity="1"/>'},
            "is revolute, but the <limit> has no lower",
        ),
        ({"inside": '<limit lower="0" upper="1"/>'}, "is revolute, but the <limit> has no effort"),
        ({"inside": LIMIT.replace("-1", "x")}, 'is revolute, but lower="x" is not a number'),
        ({"inside": LIMIT.replace("-1", "nan")}, 'is revolute, but lower="nan" is not finite'),
        (
            {"inside": LIMIT.replace("-1", "3")},
            "is revolute, but its lower limit lies over its upper one",
        ),
        ({"kind": "revolut"}, "may not have the type 'revolut': did you mean 'revolute'?"),
        ({"kind": ""}, "may not have the type ''"),
        ({"kind": "floating"}, "may not have the type 'floating': the types are: continuous,"),
        ({"kind": "planar"}, "may not have the type 'planar': the types are: continuous,"),
        ({"axis": "0 0 0"}, "is revolute, but its axis is zero"),
        ({"axis": "0 1"}, 'is revolute, but xyz="0 1" is not three numbers'),
        ({"xyz": "0 up 1"}, 'is revolute, but xyz="0 up 1" is not three numbers'),
    ],
)
def test_a_joint_that_cannot_be_is_told_by_name(
    changes: dict[str, str], words: str, tmp_path: Path
) -> None:
    fields = {"name": "hinge", "parent": "base", "child": "arm", **changes}
    sentence = said(written(tmp_path, link("base"), link("arm"), joint(**fields)))
    assert f"joint 'hinge' {words}" in sentence, sentence


@pytest.mark.parametrize(
    ("names", "joints", "words"),
    [
        ("abc", (), "only one link may hang on no other, but these do: 'a', 'b', 'c'"),
        ("ab", (("1", "a", "b"), ("2", "b", "a")), "its joints form a loop"),
        ("abc", (("1", "b", "c"), ("2", "c", "b")), "no joints join link 'b' to the root 'a'"),
        ("abc", (("1", "b", "b"), ("2", "a", "c")), "no joints join link 'b' to the root 'a'"),
        ("abc", (("1", "a", "c"), ("2", "b", "c")), "link 'c' hangs on two joints, '2' is one"),
        ("abc", (("1", "a", "b"), ("1", "b", "c")), "two joints are named '1'"),
        ("abc", (("", "a", "b"), ("2", "b", "c")), "a joint has no name"),
    ],
)
def test_links_that_form_no_tree_are_told(
    names: str, joints: tuple[tuple[str, str, str], ...], words: str, tmp_path: Path
) -> None:
    links = [link(name) for name in names]
    sentence = said(written(tmp_path, *links, *(joint(*ends, "fixed") for ends in joints)))
    assert words in sentence, sentence


def test_two_links_of_one_name_are_told(tmp_path: Path) -> None:
    assert "two links are named 'a'" in said(written(tmp_path, link("a"), link("a")))
