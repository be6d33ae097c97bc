"""What is published of a step: contacts, voxels and events, also while nothing is fresh."""

from contactfusion import Pipeline, PipelineConfig
from contactfusion.live.config import LiveConfig
from contactfusion.live.results import CLOUD, EVENTS, MARKERS, VOXELS, Results
from contactfusion.pipeline import Step
from tests.test_changes import push
from tests.wire import PROBE, START, Clock, Wire

CONFIG = LiveConfig(pictures=1e-9)


def steps(threshold: float, forces: list[float]) -> list[Step]:
    """A step for each force on the probe, 0.1 s apart [N]."""
    integrator = {**PROBE["integrator"], "threshold": threshold, "timeout": 0.05}
    pipeline = Pipeline(PipelineConfig(**{**PROBE, "integrator": integrator}))
    made = []
    for row, force in enumerate(forces):
        pipeline.take(push(0.1 * row, force))
        made.append(pipeline.step(0.1 * row))
    return made


def results(wire: Wire) -> Results:
    made = Results(wire, CONFIG, START, "probe", Clock())
    made.none()  # what an earlier process drew is deleted
    wire.sent.clear()
    return made


def test_voxels_with_evidence_are_shown_below_the_threshold_and_gone_when_it_ends() -> None:
    wire = Wire()
    made = results(wire)
    for step in steps(1.0, [-5.0, -5.0, 0.0, 0.0]):
        assert not step.fusion.contacts
        made.step(step)
    assert [sent.width > 0 for sent in wire.sent[VOXELS]] == [True, True, False]
    assert not wire.sent[MARKERS] and not wire.sent[CLOUD]


def test_what_is_not_fresh_is_cleared_once_and_events_are_published_all_the_same() -> None:
    wire = Wire()
    made = results(wire)
    first, second, *_ = steps(0.5, [-5.0, -5.0])
    made.step(first, is_fresh=False)
    assert not wire.sent[CLOUD] and not wire.sent[VOXELS]
    assert any("contact 1 made" in sent.data for sent in wire.sent[EVENTS])
    made.step(second)
    assert wire.sent[CLOUD][-1].width == 1 and wire.sent[VOXELS][-1].width
    made.none()
    made.none()
    assert [sent.width for sent in wire.sent[CLOUD]] == [1, 0]
    assert wire.sent[VOXELS][-1].width == 0
