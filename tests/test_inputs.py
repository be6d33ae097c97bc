import re
from collections.abc import Mapping
from typing import Any

import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.readings import (
    JointState,
    ObjectPose,
    Odometry,
    PointCloud,
    Reading,
    TactileImage,
    Twist,
    Wrench,
)
from contactfusion.run.inputs import Inputs, find_inputs

WRIST = {"type": "force_torque"}
SKIN = {"type": "tactile", "sensor": "skin"}
MOTION = {"type": "motion"}


def found(
    topics: Mapping[str, type[Reading]],
    told: Mapping[str, str] | None = None,
    **generators: dict[str, Any],
) -> Inputs:
    return find_inputs(topics, generators, told or {})


def test_the_only_topic_of_its_kind_feeds_a_generator() -> None:
    inputs = found({"ft/raw": Wrench, "joints": JointState}, wrist=WRIST)
    assert inputs.sensors == {"ft/raw": "ft/raw", "joints": "joints"}
    assert inputs.generators["wrist"]["sensor"] == "ft/raw"
    assert not inputs.missing


def test_a_sensor_gets_the_name_that_its_generator_listens_to() -> None:
    inputs = found({"array": TactileImage}, finger=SKIN)
    assert inputs.sensors == {"array": "skin"}


def test_a_topic_called_like_the_sensor_goes_before_others_of_its_kind() -> None:
    inputs = found({"other": TactileImage, "skin": TactileImage}, finger=SKIN)
    assert inputs.sensors == {"skin": "skin"}


def test_a_leading_slash_of_a_sensor_is_no_part_of_its_name() -> None:
    inputs = found({"raw": TactileImage, "skin": TactileImage}, finger={**SKIN, "sensor": "/skin"})
    assert inputs.sensors == {"skin": "/skin"}
    assert found({"skin": TactileImage}, finger={**SKIN, "sensor": "/skin"}).taken == ()


def test_a_name_that_ros_does_not_allow_is_found_as_ros_has_it() -> None:
    topics = {"left_skin": TactileImage, "right_skin": TactileImage}
    inputs = found(topics, **{"left-skin": {"type": "tactile"}, "right-skin": {"type": "tactile"}})
    assert inputs.sensors == {"left_skin": "left_skin", "right_skin": "right_skin"}


def test_a_misspelt_sensor_takes_no_name_for_which_steps_wait() -> None:
    sentence = (
        "generators.wrist.sensor: no topic is called 'schell', and the only Wrench is 'shell', "
        "for which steps wait (`cycle.on`): did you mean that?"
    )
    with pytest.raises(ConfigurationError, match=re.escape(sentence)):
        find_inputs({"shell": Wrench}, {"wrist": {**WRIST, "sensor": "schell"}}, {}, on="shell")


def test_several_topics_that_fit_are_listed_and_one_is_asked_for() -> None:
    topics = {"left": Wrench, "right": Wrench}
    with pytest.raises(ConfigurationError) as raised:
        found(topics, wrist=WRIST)
    assert str(raised.value) == (
        "'wrist' takes Wrench, and several topics hold it: /left, /right; "
        "choose one: --topic wrist=/left"
    )


def test_a_role_takes_the_topic_that_it_is_told() -> None:
    inputs = found({"left": Wrench, "right": Wrench}, {"wrist": "/right"}, wrist=WRIST)
    assert inputs.sensors == {"right": "right"}
    assert inputs.generators["wrist"]["sensor"] == "right"


def test_two_generators_may_read_one_topic() -> None:
    inputs = found({"ft": Wrench}, wrist={**WRIST, "sensor": "ft"}, other={**WRIST, "sensor": "ft"})
    assert inputs.sensors == {"ft": "ft"}
    assert {options["sensor"] for options in inputs.generators.values()} == {"ft"}


def test_one_topic_can_not_be_two_sensors() -> None:
    with pytest.raises(ConfigurationError, match="/ft feeds 'a' already, and can't be 'b', too"):
        found({"ft": Wrench}, one={**WRIST, "sensor": "a"}, two={**WRIST, "sensor": "b"})


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        ({"wirst": "/left"}, "unknown role 'wirst'; did you mean 'wrist'?"),
        ({"wrist": "/lef"}, "no readings come of '/lef'; did you mean '/left'?"),
        ({"wrist": "/cloud"}, "/cloud holds PointCloud, and 'wrist' takes Wrench"),
    ],
)
def test_what_is_told_wrongly_is_named(told: dict[str, str], sentence: str) -> None:
    with pytest.raises(ConfigurationError) as raised:
        found({"left": Wrench, "cloud": PointCloud}, told, wrist=WRIST)
    assert sentence in str(raised.value)


def test_what_the_recording_does_not_hold_is_told_in_a_sentence() -> None:
    inputs = found({"cloud": PointCloud}, wrist=WRIST)
    assert inputs.missing == ("generators.wrist: the recording holds no Wrench",)


def test_joints_and_objects_are_all_read() -> None:
    topics = {"arm": JointState, "hand": JointState, "mug": ObjectPose}
    assert set(found(topics).sensors) == {"arm", "hand", "mug"}


def test_of_odometry_one_topic_is_read() -> None:
    topics = {"wheel_odom": Odometry, "filtered": Odometry}
    with pytest.raises(ConfigurationError, match="--topic odometry=/wheel_odom"):
        found(topics)
    assert set(found(topics, {"odometry": "/filtered"}).sensors) == {"filtered"}


def test_twists_are_read_only_where_somebody_takes_them() -> None:
    assert not found({"cmd_vel": Twist}).sensors
    assert found({"wheels": Twist}, motion=MOTION).sensors == {"wheels": "wheels"}


def test_a_generator_of_context_alone_takes_all_there_is() -> None:
    inputs = found({"arm": JointState, "hand": JointState}, motion=MOTION)
    assert "sensor" not in inputs.generators["motion"]
    assert set(inputs.sensors) == {"arm", "hand"}


def test_what_nobody_listens_to_can_be_looked_at() -> None:
    topics = {"ft": Wrench, "left": PointCloud, "right": PointCloud, "cmd_vel": Twist}
    inputs = find_inputs(topics, {"wrist": {**WRIST, "sensor": "wrist"}}, {}, watched=True)
    assert inputs.sensors == {"ft": "wrist", "left": "left", "right": "right"}


def test_a_topic_that_is_a_generators_by_name_feeds_no_other_of_its_type() -> None:
    inputs = found({"left": Wrench}, left=WRIST, right=WRIST)
    assert inputs.missing == (
        "generators.right: no topic is called 'right', and /left is that of 'left'",
    )
    assert {name: each["sensor"] for name, each in inputs.generators.items()} == {
        "left": "left",
        "right": "right",
    }
    inputs = found({"raw": Wrench}, {"left": "/raw"}, left=WRIST, right=WRIST)
    assert inputs.missing and inputs.sensors == {"raw": "raw"}


def test_a_topic_that_is_a_generators_by_name_may_feed_one_of_another_type() -> None:
    inputs = found({"skin": TactileImage}, skin={"type": "tactile"}, foot={"type": "taxel_map"})
    assert [each["sensor"] for each in inputs.generators.values()] == ["skin", "skin"]


def test_a_generator_without_a_topic_takes_that_of_its_own_name_when_it_comes() -> None:
    inputs = found({}, left=WRIST, right=WRIST)
    assert len(inputs.missing) == 2
    assert [each["sensor"] for each in inputs.generators.values()] == ["left", "right"]
