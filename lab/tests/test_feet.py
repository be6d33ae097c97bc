"""The feet of a quadruped: what its joints tell of them, and how that is counted."""

import numpy as np
import pytest

from contactfusion import Pipeline
from contactfusion_lab.experiments import feet
from contactfusion_lab.experiments.feet import LEGS, counted, pipeline_config, recorded, watched


def test_delays_false_and_lost_contacts_are_counted() -> None:
    stamps = np.arange(0.0, 2.0, 0.02)
    truth = (stamps > 0.5) & (stamps < 1.5)
    found = (stamps > 0.55) & (stamps < 1.7)
    found[(stamps > 0.2) & (stamps < 0.25)] = True
    found[(stamps > 1.0) & (stamps < 1.05)] = False
    each = counted(stamps, found, truth)
    assert each.made == pytest.approx([0.04]) and each.broken == pytest.approx([0.2])
    assert (each.false, each.lost) == (1, 1)
    assert each.air + each.ground == pytest.approx(2.0)


def test_a_bounce_is_no_lift() -> None:
    stamps = np.arange(0.0, 1.0, 0.02)
    truth = stamps > 0.3
    truth[20:23] = False
    each = counted(stamps, truth, truth)
    assert len(each.made) == 1 and each.broken == []


def test_a_contact_that_is_never_found_has_no_delay() -> None:
    stamps = np.arange(0.0, 1.0, 0.02)
    each = counted(stamps, np.zeros(50, np.bool_), stamps > 0.3)
    assert each.made == [np.inf]


@pytest.mark.slow
def test_a_pinned_leg_tells_when_its_foot_is_pressed() -> None:
    (foot,), samples = recorded(7, is_pinned=True)
    frame = watched([foot], samples[: len(samples) // 2], rate=10.0)
    pressed = frame["force"] >= feet.BEARS
    assert 0.2 < pressed.mean() < 0.8
    assert ((frame["probability"] >= feet.SAYS) == pressed).mean() > 0.85


@pytest.mark.slow
def test_four_legs_that_stand_are_four_contacts() -> None:
    _, samples = recorded(7, is_pinned=False)
    pipeline = Pipeline(pipeline_config(rate=10.0))
    for trunk, joints, _ in samples[:100]:
        pipeline.receive(trunk)
        pipeline.receive(joints)
    contacts = pipeline.step(samples[99][1].stamp).fusion.contacts
    sources = [max(contact.shares, key=contact.shares.__getitem__) for contact in contacts]
    assert sorted(sources) == sorted(LEGS)
    assert min(contact.likelihood for contact in contacts) > 0.9
