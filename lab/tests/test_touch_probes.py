"""A hand on whose skin probes press while it touches an object: touches at several places."""

from functools import cache

import numpy as np
import pytest

from contactfusion.frames import points_in
from contactfusion.readings import DepthImage, TactileImage
from contactfusion_lab.scenes.touch.probes import APART, COVERED, RADIUS
from lab.tests.test_touch_scene import Done, arm_and_hand, config, done

PLACES = 3


@cache
def touched(seed: int, short: float = 0.0, places: int = PLACES) -> Done:
    return done(config(places=places, noise="none", short=short), arm_and_hand(), seed)


@pytest.mark.slow
def test_a_hand_is_touched_at_several_places_apart_from_each_other() -> None:
    for seed in range(3):
        places = touched(seed).truth.contacts.places
        assert len(places) >= PLACES
        away = np.linalg.norm(places[:, None] - places, axis=2)
        assert ((away > APART - 0.01).sum(axis=1) >= PLACES - 1).all()


@pytest.mark.slow
def test_each_probe_presses_with_the_force_of_the_touch() -> None:
    press = touched(0).config.press
    forces = np.linalg.norm(touched(0).truth.contacts.forces, axis=1)
    assert (np.abs(forces - press) < 0.15 * press).sum() >= PLACES - 1


@pytest.mark.slow
def test_probes_press_on_skin_that_feels_them() -> None:
    trial = touched(0)
    last = [each for each in trial.of(TactileImage) if each.stamp == trial.readings[-1].stamp]
    assert sum(image.values.max() > 0.1 for image in last) >= 2
    patches = trial.robot.config.patches.values()
    centres = np.concatenate(
        [
            points_in(
                trial.poses[trial.robot.link_of(patch.frame)]
                @ trial.robot.pose_on_link(patch.frame),
                patch.centres(),
            )
            for patch in patches
        ]
    )
    away = np.linalg.norm(trial.truth.contacts.places[:, None] - centres, axis=2).min(axis=1)
    assert (away < COVERED + 0.003).sum() >= PLACES - 1


@pytest.mark.slow
def test_the_hand_comes_as_without_probes_and_cameras_see_them() -> None:
    with_probes, without = touched(0), touched(0, places=1)
    first, other = (trial.of(DepthImage) for trial in (with_probes, without))
    np.testing.assert_array_equal(first[0].depth, other[0].depth)
    nearer = [other[-1].depth - first[-1].depth]
    assert np.max(nearer) > RADIUS


@pytest.mark.slow
def test_a_hand_that_stops_short_meets_no_probe() -> None:
    assert not len(touched(0, short=0.02).truth.contacts.places)
