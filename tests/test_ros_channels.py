"""Definitions of messages: every ROS means the same by the types that are read."""

from typing import Any

import pytest

from contactfusion.errors import RecordingError
from contactfusion.readings import BUILT_IN
from contactfusion.readings.depth_image import CAMERA_INFO, IMAGE
from contactfusion.recordings.messages import type_hash, typestore
from contactfusion.recordings.ros.channels import _cdr_of_ros1, is_standard, ros2_text, types_in

interfaces = pytest.importorskip("rosbags.interfaces")
typesys = pytest.importorskip("rosbags.typesys")

MSG, IDL = interfaces.MessageDefinitionFormat.MSG, interfaces.MessageDefinitionFormat.IDL
READ = [*(msgtype for codec in BUILT_IN for msgtype in codec.messages), CAMERA_INFO]
IDL_TEXT = """module my_msgs { module msg {
  struct Level { float height; sequence<uint8> data; };
}; };
"""


def defined(text: str, form: Any = MSG) -> Any:
    return interfaces.MessageDefinition(form, text)


@pytest.mark.parametrize("name", [name for name in typesys.Stores.__members__ if name != "EMPTY"])
def test_every_ros_means_the_same_by_the_types_that_are_read(name: str) -> None:
    store = typesys.get_typestore(typesys.Stores[name])
    version = 1 if name == "ROS1_NOETIC" else 2
    for msgtype in READ:
        if msgtype not in store.types:  # our own, and tf2 of ROS 1, where it is tf
            continue
        text, _ = store.generate_msgdef(msgtype, ros_version=version)
        assert is_standard(msgtype, types_in(defined(text), msgtype)), msgtype


def test_without_a_definition_a_type_is_what_ros_2_means() -> None:
    none = interfaces.MessageDefinition(interfaces.MessageDefinitionFormat.NONE, "")
    for nothing in (none, defined("")):
        assert is_standard(IMAGE, types_in(nothing, IMAGE))
        assert not is_standard("my_msgs/msg/Level", types_in(nothing, "my_msgs/msg/Level"))
        assert "uint32 height" in ros2_text(nothing, IMAGE, ros1=False)
        assert ros2_text(nothing, "my_msgs/msg/Level", ros1=False) == ""


def test_other_fields_are_another_type() -> None:
    text = "std_msgs/Header header\nWrench wrench\n"
    for wrench, same in (("Vector3 force\nVector3 torque", True), ("Vector3 force", False)):
        whole = f"{text}{80 * '='}\nMSG: std_msgs/Header\ntime stamp\nstring frame_id\n"
        whole += f"{80 * '='}\nMSG: geometry_msgs/Wrench\n{wrench}\n"
        whole += f"{80 * '='}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
        kind = "geometry_msgs/msg/WrenchStamped"
        assert is_standard(kind, types_in(defined(whole), kind)) is same


def test_idl_becomes_msg() -> None:
    rule = 80 * "=" + "\n"
    for text in (IDL_TEXT, f"{rule}IDL: my_msgs/msg/Level\n{IDL_TEXT}"):
        said = ros2_text(defined(text, IDL), "my_msgs/msg/Level", ros1=False)
        assert said.split("\n")[:2] == ["float32 height", "uint8[] data"]


def test_a_definition_that_is_none_is_one_sentence() -> None:
    with pytest.raises(RecordingError, match="definition of a/msg/B can't be parsed") as error:
        types_in(defined("{{ no"), "a/msg/B")
    assert "\n" not in str(error.value)
    assert ros2_text(defined("{{ no"), "a/msg/B", ros1=True) == ""


HOSTILE = {
    "brackets": (IDL, "const long N = ((((1))));", "computes constants"),
    "shift": (IDL, "const long N = 1 << 60000000000;", "computes constants"),
    "product": (IDL, "const long N = 999999 * 999999;", "computes constants"),
    "hidden": (IDL, 'const string S = "/*"; const long N = ((1)); /* " */', "computes constants"),
    "annotation": (IDL, "@default (value=1-1-1) octet v;", "computes constants"),
    "long_idl": (IDL, "octet v;\n" * 10_000, "90067 characters, more than 65536"),
    "long_msg": (MSG, "float64 x\n" * 30_000, "300000 characters, more than 262144"),
    "digits": (MSG, f"int32 A={'9' * 5000}\n", "a word of over 100 characters, '9999"),
    "array": (MSG, "std_msgs/Header[5000000] v\n", "have 5000000 elements, more than 16384"),
    "texts": (MSG, "string[9000] v\nstring[9000] w\n", "have 18000 elements"),
    "nothing": (IDL, "octet v", "can't be parsed"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_definition_that_would_take_hours_or_all_memory_is_refused(name: str) -> None:
    form, text, why = HOSTILE[name]
    if form is IDL:
        text = f"module a {{ module msg {{ {text} struct B {{ octet w; }}; }}; }}; // of a robot"
    with pytest.raises(RecordingError, match=why) as caught:
        types_in(defined(text, form), "a/msg/B")
    assert "\n" not in str(caught.value)
    assert ros2_text(defined(text, form), "a/msg/B", ros1=True) == ""
    with pytest.raises(RecordingError):
        type_hash("a/msg/B", text)


def test_constants_comments_and_annotations_are_no_expressions() -> None:
    text = """module a { module msg {
      /* a * b */ // (c)
      module B_Constants { const double N = -1.5e-3; const string S = "(a|b)*"; };
      typedef double double__36[36];
      @verbatim (language="comment", text="x << y")
      struct B { @default (value=1) octet w; double__36 covariance; sequence<octet, 5> v; };
    }; };"""
    constants, fields = types_in(defined(text, IDL), "a/msg/B")["a/msg/B"]
    assert [value for *_, value in constants] == [-0.0015, "(a|b)*"]
    assert [name for name, _ in fields] == ["w", "covariance", "v"]


def test_a_definition_that_holds_itself_is_not_whole() -> None:
    with pytest.raises(RecordingError, match="is not whole: maximum recursion"):
        type_hash("a/msg/B", "a/B again\n")


@pytest.mark.parametrize("poses", [0, 2])
def test_a_message_of_ros_1_is_as_long_as_it_says(poses: int) -> None:
    kind, header = "geometry_msgs/msg/PoseArray", bytes(16)
    text = typestore().generate_msgdef(kind, ros_version=1)[0]
    held = poses.to_bytes(4, "little") + bytes(56 * poses)
    _cdr_of_ros1(header + held, defined(text), kind, standard=True)
    lies = b"\xff\xff\xff\xff" + held[4:]  # four thousand million poses, counted one by one
    with pytest.raises(Exception, match="Invalid sequence length"):
        _cdr_of_ros1(header + lies, defined(text), kind, standard=True)
