"""Kinds of reading of plug-ins: what fails is one sentence that names it, and harms no other."""

import importlib
import logging
import sys
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig, Wrench
from contactfusion.errors import ConfigurationError, PluginError
from contactfusion.faults import Faults
from contactfusion.frames import FrameConfig
from contactfusion.readings import BUILT_IN, Reading
from contactfusion.readings.registry import GROUP, Kinds, installed_kinds
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.testing import ConformanceError, check_codec, example_reading
from contactfusion.view.viewer import Viewer
from tests.kinds import Stranger, codec_of, installed
from tests.test_cli import Ask

pytest.importorskip("rosbags")
CODEC = '''
from dataclasses import dataclass
import numpy as np
import contactfusion as cf

@dataclass(frozen=True, kw_only=True, eq=False)
class KIND(cf.Reading):
    """Something warm."""
    celsius: np.ndarray
    def _check(self):
        self._freeze("celsius", None)

class Columns(cf.ColumnsConfig):
    """One column a thermometer."""
    def reading(self, at, row):
        return KIND(celsius=row, **at)

class TheCodec(cf.Codec[KIND]):
    """Temperatures."""
    name, kind, Columns = "NAME", KIND, Columns
    messages = ("MESSAGE",)
    definition = "std_msgs/Header header\\nfloat64[] celsius\\n"
    values = cf.ElementValues("celsius")
    def from_message(self, message, at):
        return KIND(celsius=message.celsius, **at)
    def to_message(self, reading, top):
        return self.message(header=top, celsius=reading.celsius)
    def draw(self, canvas, reading):
        canvas.arrow("up", np.array([0.0, 0.0, reading.celsius.max()]), "K", (255, 0, 0))
    def example(self, stamp, scale):
        return KIND(stamp=stamp, frame="sensor", celsius=scale * np.arange(1.0, 4.0))
'''
HOME = "of stranger 1.0"


def source(name: str, kind: str = "", message: str = "", *changes: tuple[str, str]) -> str:
    text = CODEC
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    kind, message = kind or name.title(), message or f"{name}_msgs/msg/{name.title()}"
    return text.replace("KIND", kind).replace("MESSAGE", message).replace("NAME", name)


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stranger]:
    with installed(tmp_path, monkeypatch) as found:
        yield found


def example(name: str) -> Any:
    return example_reading(codec_of(name).kind)


def faults(**fault: Any) -> Faults:
    fields: dict[str, Any] = {"faults": [fault]}
    return Faults(PipelineConfig(**fields).faults)


def push(stamp: float) -> Wrench:
    return Wrench(stamp=stamp, frame="base", force=np.ones(3), torque=np.ones(3))


def recorded(path: Path, *readings: Reading) -> RosRecording:
    with McapWriter(path, 10**18) as writer:
        for reading in readings:
            writer.reading(reading)
    return RosRecording(RosConfig(file=path))


def test_a_kind_of_a_stranger_is_found_by_name_class_and_message(stranger: Stranger) -> None:
    stranger.add("warmth", source("warmth"))
    kinds = installed_kinds()
    assert kinds.names[-1] == "warmth" and "cf_warmth" not in sys.modules
    codec = kinds.find("warmth")
    assert codec is not None and kinds.of(codec.kind) is codec is kinds.all()[-1]
    assert kinds.by_message()["warmth_msgs/msg/Warmth"] is codec
    check_codec(type(codec))


def test_built_in_kinds_import_no_stranger(stranger: Stranger) -> None:
    stranger.add("warmth", source("warmth"))
    faults(fault="bias", sensor="wrench", amount=[1.0] * 6).apply(push(0.0))
    assert "cf_warmth" not in sys.modules


INIT = "    def __init__(self):\n        1 / 0\n"
BROKEN = [
    ("1 / 0\n", "ZeroDivisionError: division by zero (cf_warmth.py, line 1)"),
    ("import sys; sys.exit('no')\n", "SystemExit: no (cf_warmth.py, line 1)"),
    ("import pyarow\n", "ModuleNotFoundError: No module named 'pyarow'"),
    ("", "AttributeError: module 'cf_warmth' has no attribute 'TheCodec'"),
    ("class TheCodec: pass\n", "TheCodec is no subclass of Codec"),
    (
        source("warmth", "", "", ("def example(", "def sample(")),
        "TheCodec does not implement `example` of Codec",
    ),
    (source("warmth", "", "", ('"NAME", ', '"heat", ')), "its entry point is 'warmth', and the"),
    (source("warmth", "", "", ("name, kind", "nam, kind")), "does not declare its `name`"),
    (source("warmth", "", "", ("name, kind,", "name, kin,")), "does not declare its `kind`, a"),
    (
        source("warmth", "Wrench"),
        "the class name Wrench is taken by the kind of reading 'wrench' of",
    ),
    (
        source("warmth", "", "sensor_msgs/msg/JointState"),
        "the ROS type sensor_msgs/msg/JointState is taken by the kind of reading 'joint_state' of",
    ),
    (
        source("warmth", "", "sensor_msgs/msg/Temperature"),
        "the definition of sensor_msgs/msg/Temperature can't be used: Type 'sensor_msgs/msg/Temp",
    ),
    (
        source("warmth", "", "", ("float64[] celsius\\n", "{{ no")),
        "the definition of warmth_msgs/msg/Warmth can't be used: ",
    ),
    (
        source("warmth", "", "bare_msgs/msg/Bare", ("std_msgs/Header header\\n", "")),
        "bare_msgs/msg/Bare has no std_msgs/Header `header`, which holds stamp and frame",
    ),
    (
        source("warmth", "", "nobody_msgs/msg/No", ("    definition", "    definitio")),
        "nothing defines the type nobody_msgs/msg/No: TheCodec needs its `definition`",
    ),
    (
        source("warmth", "", "", ('messages = ("MESSAGE",)', 'messages = "MESSAGE"')),
        "TheCodec has `messages` 'warmth_msgs/msg/Warmth' that are no tuple of types",
    ),
    (
        source("warmth", "", "", ("def to_message", "def to_mesage")),
        "TheCodec has `messages`, and does not implement `to_message`",
    ),
    (
        source("warmth", "", "", ('values = cf.ElementValues("celsius")', "values = None")),
        "TheCodec has `values` that are no Values",
    ),
    (
        source("warmth", "", "", ('Columns = "NAME", KIND, Columns', 'Columns = "NAME", KIND, 3')),
        "TheCodec has `Columns` that are no subclass of ColumnsConfig",
    ),
    (
        source("warmth", "", "", ("    def example", f"{INIT}    def example")),
        "ZeroDivisionError: division by zero (cf_warmth.py, line",
    ),
]


@pytest.mark.parametrize(("text", "sentence"), BROKEN, ids=[sentence for _, sentence in BROKEN])
def test_a_broken_kind_is_one_sentence_and_harms_no_other(
    text: str, sentence: str, stranger: Stranger, caplog: pytest.LogCaptureFixture
) -> None:
    stranger.add("warmth", text)
    stranger.add("sanity", source("sanity"))
    start = f"the kind of reading 'warmth' {HOME} cannot be used: "
    with pytest.raises(PluginError) as caught:
        faults(fault="silent", sensor="warmth")
    assert str(caught.value).startswith(start) and sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    back = list(recorded(Path("a.mcap"), push(0.0), example("sanity")).readings())
    assert [type(one).__name__ for one in back] == ["Wrench", "Sanity"]
    with caplog.at_level(logging.WARNING):
        installed_kinds().all()
    assert len([one for one in caplog.messages if one.startswith(start)]) == 1


def test_a_name_that_is_taken_is_refused_whoever_is_imported_first(stranger: Stranger) -> None:
    stranger.add("wrench", source("wrench", "Other"))
    stranger.add("zeal", source("zeal", "Warmth", "zeal_msgs/msg/Zeal"))
    stranger.add("early", source("early", "Warmth", "early_msgs/msg/Early"))
    assert type(example("wrench")) is Wrench
    with pytest.raises(PluginError, match="Warmth is taken by the kind of reading 'early' of stra"):
        installed_kinds().find("zeal")
    failures = [f"{title}: {why}" for title, why in installed_kinds().failures.items()]
    assert failures[0] == (
        f"the kind of reading 'wrench' {HOME}: the name 'wrench' is taken by contactfusion"
    )


def test_plugins_lists_what_is_broken_and_fails_when_it_is_strict(
    stranger: Stranger, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ask = Ask(monkeypatch, capsys)
    stranger.add("warmth", source("warmth"))
    stranger.add("draft", source("draft", "", "", ("scale * np.arange(1.0, 4.0)", "1 / 0")))
    stranger.add("crash", "1 / 0\n")
    answer = ask("plugins")
    out = " ".join(answer.out.split())
    assert answer.status == 0 and "warmth reading Temperatures. stranger 1.0" in out
    assert not [name for name in sys.modules if name.startswith("cf_")]
    answer = ask("plugins", "--strict")
    assert answer.status == 1
    assert f"the kind of reading 'crash' {HOME} cannot be used: ZeroDivision" in answer.out
    assert f"the kind of reading 'draft' {HOME} cannot be used: `example` raised Z" in answer.out
    answer = ask("plugins", "crash")
    assert answer.status == 1 and f"'crash' {HOME} cannot be used: ZeroDivision" in answer.err
    answer = ask("plugins", "warmth")
    assert answer.status == 0 and "float64[] celsius" in answer.out and "scale" in answer.out


RAISES = ("return KIND(celsius=message.celsius, **at)", "1 / 0")


def test_a_codec_that_raises_loses_its_messages_and_no_others(stranger: Stranger) -> None:
    stranger.add("warmth", source("warmth", "", "", RAISES))
    recording = recorded(Path("a.mcap"), push(0.0), example("warmth"))
    assert [type(one) for one in recording.readings()] == [Wrench]
    tally = recording.tally["/warmth"]
    assert (tally.unreadable, tally.readings) == (1, 0)
    assert tally.why_unreadable.startswith(
        f"the kind of reading 'warmth' {HOME} raised ZeroDivisionError: division by zero (cf_warmth"
    )


def test_a_codec_that_cannot_be_written_says_so(stranger: Stranger) -> None:
    stranger.add("warmth", source("warmth", "", "", ("celsius=reading.celsius", "kelvin=0")))
    with pytest.raises(PluginError, match=f"'warmth' {HOME} raised TypeError"):
        recorded(Path("a.mcap"), example("warmth"))


def test_columns_that_raise_are_one_sentence(stranger: Stranger) -> None:
    stranger.add("warmth", source("warmth", "", "", ("return KIND(celsius=row, **at)", "1 / 0")))
    Path("a.csv").write_text("1,2\n")
    columns = {"type": "warmth", "frame": "base", "columns": [1, 2]}
    log = {"type": "log", "file": "a.csv", "time": {"rate": 1}, "readings": {"a": columns}}
    with pytest.raises(PluginError, match=f"'warmth' {HOME} raised ZeroDivisionError"):
        list(open_recording(log).readings())


def test_values_that_raise_are_one_sentence(stranger: Stranger) -> None:
    wrong = 'cf.ElementValues("kelvin")'
    stranger.add("warmth", source("warmth", "", "", ('cf.ElementValues("celsius")', wrong)))
    broken = faults(fault="zeros", sensor="warmth")
    with pytest.raises(PluginError, match=f"'warmth' {HOME} raised AttributeError"):
        broken.apply(example("warmth"))


def test_a_kind_without_numbers_can_be_lost_and_late_and_nothing_else(stranger: Stranger) -> None:
    stranger.add("warmth", source("warmth", "", "", ("    values", "    _values")))
    reading = example("warmth")
    for broken in (faults(fault="stuck"), faults(fault="delay", seconds=0.0)):
        assert len(broken.apply(reading)) == 1
    with pytest.raises(ConfigurationError, match="does not know what to change in Warmth"):
        faults(fault="zeros").apply(reading)
    check_codec(type(codec_of("warmth")))


def test_what_cannot_be_drawn_is_reported_once_and_the_rest_is_drawn(stranger: Stranger) -> None:
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    stranger.add("warmth", source("warmth", "", "", ("canvas.arrow(", "1 / 0; (")))
    config = PipelineConfig(frames={"sensor": FrameConfig(parent="base")})
    pipeline = Pipeline(config)
    with Viewer(config, Path("a.rrd")) as viewer:
        for stamp in (0.0, 0.1):
            viewer.reading(example("warmth"))
            viewer.reading(push(stamp))
            viewer.step(pipeline.step(stamp), pipeline.state(stamp))
        (absence,) = viewer.absences()
    sentence = f"the kind of reading 'warmth' {HOME} raised ZeroDivisionError: division by zero"
    assert absence.startswith(f"Warmth is not drawn at 0.000 s: {sentence} (cf_warmth.py, line ")
    rows: Counter[str] = Counter()
    for chunk in RrdReader("a.rrd").stream():
        rows[chunk.entity_path] += chunk.to_record_batch().num_rows
    assert rows["/events/viewer"] == 1 and rows["/world/sensors/base/force"] >= 2


FAULTY = [
    (("scale * np.arange(1.0, 4.0)", "np.random.random(3)"), "gives another example each"),
    (("return KIND(stamp=stamp, ", "return KIND(stamp=9.0, "), "gives stamps [9.0, 9.0, 9.0]"),
    (("return KIND(stamp", "return dict(stamp"), "gives an example that is no Warmth: {'sta"),
    (("celsius=message.celsius", "celsius=-message.celsius"), "with other `celsius`"),
    (("celsius=row", "celsius=2 * row"), "comes from the columns of a log with other `celsiu"),
    (RAISES, "does not come back from a recording: the kind of reading 'warmth' of"),
    (("np.array([0.0, 0.0, reading", "np.array([0.0, reading"), "draws arrow 'up' of shape (2,)"),
    (('canvas.arrow("up"', '("up"'), "draws nothing of its examples, and has a `draw`"),
    (("canvas.arrow(", "1 / 0; ("), "fails: `draw` raised ZeroDivisionError"),
    (('cf.ElementValues("celsius")', 'cf.ElementValues("k")'), "fails: the fault 'zeros' raised"),
    (('    """Temperatures."""\n', ""), "has no docstring"),
]


@pytest.mark.parametrize(("change", "sentence"), FAULTY, ids=[one for _, one in FAULTY])
def test_the_kit_names_the_rule_that_is_broken(
    change: tuple[str, str], sentence: str, stranger: Stranger
) -> None:
    stranger.add("warmth", source("warmth", "", "", change))
    with pytest.raises(ConformanceError) as caught:
        check_codec(type(codec_of("warmth")))
    assert str(caught.value).startswith("TheCodec ") and sentence in str(caught.value)


def test_a_codec_that_is_not_registered_is_told_how(stranger: Stranger) -> None:
    (stranger.folder / "cf_lonely.py").write_text(source("lonely"))
    codec = importlib.import_module("cf_lonely").TheCodec
    with pytest.raises(ConformanceError) as caught:
        check_codec(codec)
    assert str(caught.value) == (
        "TheCodec is not registered: install an entry point of contactfusion_readings named "
        "lonely = cf_lonely:TheCodec"
    )


def test_entry_points_without_a_distribution_are_named_so() -> None:
    kinds = Kinds([EntryPoint("no", "no_such_module:Codec", GROUP)])
    with pytest.raises(PluginError, match="'no' of no distribution cannot be used: ModuleNotFound"):
        kinds.find("no")
    assert kinds.load() == BUILT_IN
