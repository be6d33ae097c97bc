"""What steps amounted to, and what kept a pipeline from its job."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig
from contactfusion.errors import ConfigurationError
from contactfusion.hypotheses import HypothesisKind, Note
from contactfusion.integrator.sources import Report, SourceReport
from contactfusion.loop import play
from contactfusion.pipeline_config import CycleConfig
from contactfusion.readings import DepthImage, ObjectPose, Reading
from contactfusion.run.summary import NO_EVIDENCE, Summary, refuse
from tests.toys import offer_toys, point, wrench

PLACE = (0.1, 0.0, 0.0)


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)


def ran(readings: Iterable[Reading], **fields: Any) -> tuple[Summary, list[str]]:
    """The summary of a pipeline that steps every 0.1 s, and its complaints."""
    pipeline = Pipeline(PipelineConfig(**{"cycle": {"every": 0.1}, **fields}))
    summary = Summary(pipeline)
    for _ in play(pipeline, readings, [summary.observer]):
        pass
    return summary, list(summary.complaints())


def points(frames: str) -> list[Reading]:
    """A reading each 0.1 s: in the space for "b", in an unknown frame for "u"."""
    names = {"b": "base", "u": "moon"}
    return [point(0.1 * row, *PLACE, frame=names[one]) for row, one in enumerate(frames)]


ECHO = {"eye": {"type": "echo"}}


@pytest.mark.parametrize(
    ("frames", "start"),
    [
        ("bbbb", None),
        ("bbuu", None),
        ("bubuu", "3 of 5 clouds of 'eye' were refused: unknown frame 'moon'"),
        ("uuu", "every cloud of 'eye' was refused: unknown frame 'moon'"),
    ],
)
def test_a_source_of_which_more_than_half_is_refused_is_told(
    frames: str, start: str | None
) -> None:
    _, complaints = ran(points(frames), generators=ECHO)
    assert len(complaints) == (start is not None)
    assert all(one.startswith(start or "") for one in complaints)


def test_the_newest_events_are_kept_and_the_others_are_counted() -> None:
    pipeline = Pipeline(PipelineConfig(cycle=CycleConfig(every=0.1), generators=ECHO))
    summary = Summary(pipeline, most_events=3)
    for _ in play(pipeline, points("uuuuuuub"), [summary.observer]):
        pass
    fields, every = summary.fields(), ran(points("uuuuuuub"), generators=ECHO)[0].fields()
    assert fields["events"] == every["events"][-3:]
    assert fields["events_left_out"] == len(every["events"]) - 3 > 0
    assert "events_left_out" not in every


def test_no_contact_alone_is_no_complaint() -> None:
    summary, complaints = ran(points("bbb"), generators=ECHO, integrator={"threshold": 0.99})
    assert summary.contacts == 0 and not complaints


def test_the_first_the_likeliest_and_the_last_contact_are_told() -> None:
    summary, _ = ran(points("bbb"), generators=ECHO)
    assert summary.first and summary.likeliest and summary.last
    first, then = (
        f"contact at (0.100, 0.000, 0.000) m in 'base', likelihood {likelihood}, from eye 100%"
        for likelihood in ("0.90", "0.98")
    )
    assert list(summary.lines())[:4] == [
        f"{summary.steps} steps, {summary.with_contact} with contact, {summary.contacts} contacts",
        f"  first at {summary.first[0]:.3f} s: {first}",
        f"  likeliest at {summary.likeliest[0]:.3f} s: {then}, force (0.0, 0.0, 1.0) N",
        f"  last at {summary.last[0]:.3f} s: {then}",
    ]
    assert (summary.first[0], summary.likeliest[0]) == (0.1, 0.2)
    assert summary.last_step and summary.last[0] == summary.last_step.stamp


def test_without_a_contact_none_is_told() -> None:
    summary, _ = ran(points("uuu"), generators=ECHO)
    assert summary.first is None and summary.likeliest is None and summary.last is None
    assert not any("likeliest" in line for line in summary.lines())


def test_where_no_force_was_felt_none_is_told() -> None:
    summary, _ = ran(points("bbb"), generators=ECHO)
    assert summary.likeliest
    stamp, contact = summary.likeliest
    summary.likeliest = stamp, replace(contact, force=np.full(3, np.nan))
    assert not any("force (" in line for line in summary.lines())


def image(stamp: float) -> DepthImage:
    return DepthImage(
        stamp=stamp, frame="base", sensor="eye", depth=np.ones((2, 3)), intrinsics=np.eye(3)
    )


def test_evidence_that_never_looked_is_told() -> None:
    _, complaints = ran([image(0.0), image(0.1)], generators={"look": {"type": "looker"}})
    assert complaints == ["generators.look: it gave no cloud for any of its 2 readings"]


def test_a_prediction_that_has_nothing_to_say_is_no_complaint() -> None:
    pose = ObjectPose(stamp=0.0, frame="base", name="cup", position=np.zeros(3),
                      orientation=np.array([0.0, 0.0, 0.0, 1.0]))  # fmt: skip
    assert ran([pose], generators={"seen": {"type": "follower"}})[1] == []


def test_a_run_without_any_evidence_says_so() -> None:
    support, _ = ran([image(0.0)], generators={"seen": {"type": "follower"}})
    evidence, _ = ran(points("b"), generators=ECHO)
    assert f"  {NO_EVIDENCE}" in support.lines()
    assert not any(NO_EVIDENCE in line for line in evidence.lines())


def test_a_sensor_that_is_silenced_by_a_fault_is_no_complaint() -> None:
    faults = [{"fault": "silent", "sensor": "point_cloud"}]
    summary, complaints = ran(points("bbb"), generators=ECHO, faults=faults)
    assert summary.steps and not complaints


def test_a_fault_of_a_sensor_that_never_came_names_the_nearest() -> None:
    readings = [wrench(0.0, *PLACE, sensor="wrist"), wrench(0.1, *PLACE, sensor="ankle")]
    faults = [{"fault": "zeros", "sensor": "wirst"}, {"fault": "zeros", "sensor": "wrench"}]
    _, complaints = ran(readings, generators={"hand": {"type": "feeler"}}, faults=faults)
    assert complaints == [
        "faults.0.sensor: no reading of 'wirst' came; did you mean 'wrist'? "
        "The sensors and types are: ankle, wrench, wrist"
    ]


def test_clouds_that_are_ahead_of_time_are_told() -> None:
    pipeline = Pipeline(PipelineConfig(generators=ECHO))
    pipeline.receive(point(1.5, *PLACE))
    summary = Summary(pipeline)
    summary.tally.add(point(1.5, *PLACE))
    summary.add(pipeline.step(0.0))
    (complaint,) = summary.complaints()
    assert complaint == "no cloud of 'eye' was accepted: a cloud of 'eye' is 1.5 s early: held back"


def test_sources_to_which_the_same_happens_share_a_line_and_a_list() -> None:
    eyes = {name: {"type": "echo", "sensor": name} for name in ("left", "right", "top")}
    frames = {"left": "moon", "right": "moon", "top": "sun"}
    readings = [
        point(0.1 * row, *PLACE, frame=frame, sensor=name)
        for row in range(3)
        for name, frame in frames.items()
    ]
    summary, complaints = ran(readings, generators=eyes, frames={"eye": {"parent": "base"}})
    lines = [line.strip() for line in summary.lines() if "refused at" in line]
    assert lines == [
        "refused at 0.100 s (6 times): unknown frame 'moon'; where no transform places it, "
        "`frames` or `robot.frames` can; likewise 'right'",
        "refused at 0.100 s (3 times): unknown frame 'sun'; where no transform places it, "
        "`frames` or `robot.frames` can",
    ]
    assert "the frames are: base" in complaints[0]


def test_remarks_stand_under_their_source() -> None:
    remote = {"far": {"type": "remote"}}
    summary, _ = ran(points("bb"), generators=remote)
    lines = list(summary.lines())[3:]
    assert lines[1].startswith("  far (regular): 2 clouds")
    assert lines[2:] == ["    2 × 0 contacts, 0 places"]
    assert summary.fields()["sources"]["far"]["remarks"] == {"0 contacts, 0 places": 2}


def test_the_first_complaint_is_raised_with_the_count_of_the_others() -> None:
    refuse(Path("a.yaml"), [])
    with pytest.raises(ConfigurationError, match=r"^a.yaml: one$"):
        refuse(Path("a.yaml"), ["one"])
    with pytest.raises(ConfigurationError, match=r"^a.yaml: one \(and 2 more\)$"):
        refuse(Path("a.yaml"), iter(["one", "two", "three"]))


def test_a_force_that_never_changes_is_not_blamed_on_the_tare() -> None:
    pipeline = Pipeline(PipelineConfig(generators=ECHO))
    summary, step = Summary(pipeline), pipeline.step(0.0)
    cases: list[tuple[dict[str, int], str]] = [
        ({Note.MORE_THAN_ONE_CONTACT: 4}, "4 × more than one contact: tare?"),
        ({Note.MORE_THAN_ONE_CONTACT: 4, Note.UNCHANGED: 2}, "4 × more than one contact"),
    ]
    for remarks, line in cases:
        source = SourceReport(HypothesisKind.REGULAR, 10.0, 0.0, True, 4, 0, 0, 0, (), remarks)
        fusion = replace(step.fusion, report=Report({"wrist": source}, ()))
        summary.add(replace(step, fusion=fusion))
        assert line in [one.strip() for one in summary.lines()]


def test_readings_that_no_generator_takes_are_noted() -> None:
    """Also of a kind that is not registered; joints and poses are of use without a generator."""

    class Smell(Reading):
        """A kind that no codec knows."""

    readings = [
        point(0.0, *PLACE, sensor="eye"),
        Smell(stamp=0.1, frame="base", sensor="nose"),
        ObjectPose(stamp=0.2, frame="base", name="box", position=np.zeros(3),
                   orientation=np.array([0.0, 0.0, 0.0, 1.0])),
        point(0.3, *PLACE, sensor="spare"),
    ]  # fmt: skip
    summary, _ = ran(readings, generators={"eye": {"type": "echo", "sensor": "eye"}})
    lines = [line.strip() for line in summary.lines() if "no generator takes" in line]
    assert lines == [
        "no generator takes the Smell of 'nose'",
        "no generator takes the PointCloud of 'spare'",
    ]
