"""The robot on the network is compared with that of the configuration."""

import pytest

from contactfusion.live.description import differences

ARM = """<robot name="arm"><link name="base"/><link name="upper"/><link name="lower"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.3" rpy="0 0 1.5708"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/></joint></robot>"""


def test_the_same_robot_does_not_differ() -> None:
    assert list(differences(ARM, ARM)) == []
    assert list(differences(ARM.replace("0 0 0.3", "0 0 0.3005"), ARM)) == []


@pytest.mark.parametrize(
    ("old", "new", "clause"),
    [
        (
            "0 0 0.3",
            "0 0 0.312",
            "its joint shoulder stands 12.0 mm and 0.0 degrees beside that of the configuration",
        ),
        (
            "1.5708",
            "1.6",
            "its joint shoulder stands 0.0 mm and 1.7 degrees beside that of the configuration",
        ),
        ('"elbow"', '"knee"', "it lacks the joint elbow; it has the joint knee besides"),
        ("0 0 0.3", "0 zero", "it can't be read: could not convert string to float: 'zero'"),
        ("0 0 0.3", "0 nan 0", "it can't be read: '0 nan 0' is no origin of a joint"),
        ("</robot>", "", "it can't be read: no element found: line 4, column 87"),
    ],
)
def test_another_robot_is_told_apart(old: str, new: str, clause: str) -> None:
    assert "; ".join(differences(ARM.replace(old, new), ARM)) == clause


def test_joints_of_other_elements_are_none_of_the_robots() -> None:
    control = '<ros2_control name="c"><joint name="shoulder"/></ros2_control></robot>'
    assert list(differences(ARM.replace("</robot>", control), ARM)) == []


def test_of_many_joints_some_are_named() -> None:
    many = "".join(f'<joint name="j{i}" type="fixed"/>' for i in range(9))
    (clause,) = differences(f"<robot>{many}</robot>", "<robot/>")
    assert clause == "it has the joints j0, j1, j2, j3 and 5 more besides"
