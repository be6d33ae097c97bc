"""Switches: where the contact can be that closes one, and what an open one says."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import IntegratorConfig, Pipeline, PipelineConfig, State
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import FrameTree
from contactfusion.generators.switch import STUCK, SwitchConfig, SwitchGenerator
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.pipeline_config import CycleConfig
from contactfusion.readings import Switch
from contactfusion.robots.model import RobotModel
from contactfusion.shapes import BodyConfig
from tests import hands


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """A cube of 0.1 m, the hand, about the origin."""
    return hands.slide(tmp_path_factory.mktemp("slide"))


def switch(**options: Any) -> SwitchGenerator:
    return SwitchGenerator("foot", SwitchConfig(**options))


def reading(closed: bool, stamp: float = 0.0, frame: str = "hand") -> Switch:
    return Switch(stamp=stamp, frame=frame, closed=closed)


def only(
    generator: SwitchGenerator, of: Switch, robot: RobotModel | None, **state: float
) -> HypothesisCloud:
    (cloud,) = generator.generate(of, hands.state(robot, **state))
    return cloud


def ball() -> State:
    """A body that is no robot."""
    shapes = [{"shape": "sphere", "radius": 0.1}]
    body = BodyConfig.model_validate({"frame": "base", "shapes": shapes})
    return State(now=0.0, grid=hands.GRID, surface=body.sampled(Path()))


def pressed(generator: SwitchGenerator, *readings: tuple[float, bool]) -> list[bool | None]:
    """Whether each reading is taken for a contact; None: not said."""
    ball = BodyConfig.model_validate(
        {"frame": "base", "shapes": [{"shape": "sphere", "radius": 1}]}
    )
    state = State(now=0.0, grid=hands.GRID, surface=ball.sampled(Path()))
    clouds = [
        generator.generate(reading(closed, stamp, "base"), state) for stamp, closed in readings
    ]
    return [bool(len(cloud[0])) if cloud else None for cloud in clouds]


def test_a_closed_switch_is_one_contact_anywhere_on_its_link(robot: RobotModel) -> None:
    cloud = only(switch(p_closed=0.8), reading(True), robot, x=0.3)
    assert cloud.single and cloud.frame == "base"
    assert cloud.likelihoods.sum() == pytest.approx(0.8)
    assert np.ptp(cloud.likelihoods) == 0.0
    assert cloud.positions.mean(axis=0) == pytest.approx([0.3, 0.0, 0.0], abs=0.003)
    assert np.abs(cloud.positions - [0.3, 0.0, 0.0]).max(axis=1) == pytest.approx(0.05)


def test_an_open_switch_has_looked_and_found_nothing(robot: RobotModel) -> None:
    cloud = only(switch(), reading(False), robot)
    assert not len(cloud) and not cloud.notes


def test_within_a_reach_only_what_is_near_its_frame_closes_it(robot: RobotModel) -> None:
    cloud = only(switch(reach=0.06), reading(True), robot)
    assert (np.linalg.norm(cloud.positions, axis=1) <= 0.06).all()
    assert len(cloud) < len(only(switch(), reading(True), robot))


def test_a_link_by_name_needs_no_frame_on_the_robot(robot: RobotModel) -> None:
    named = only(switch(links=["hand"]), reading(True, frame="elsewhere"), robot)
    assert len(named) == len(only(switch(), reading(True), robot))


def test_normally_closed_wiring_is_turned_round() -> None:
    assert pressed(switch(inverted=True), (0.0, True), (0.1, False)) == [False, True]


def test_a_change_counts_once_it_has_lasted() -> None:
    bounces = [(0.0, False), (0.01, True), (0.02, False), (0.03, True), (0.04, True), (0.05, True)]
    assert pressed(switch(debounce=0.02), *bounces) == [None, None, None, None, None, True]
    assert pressed(switch(), *bounces) == [False, True, False, True, True, True]
    open_for_long = [(-0.1, False), *bounces]
    assert pressed(switch(debounce=0.02), *open_for_long)[1:] == [False] * 5 + [True]


def test_reset_forgets_that_it_was_pressed() -> None:
    generator = switch(debounce=0.1)
    assert pressed(generator, (0.0, True), (0.2, True)) == [None, True]
    generator.reset()
    assert pressed(generator, (0.3, True)) == [None]


def test_one_that_was_never_open_is_remarked_and_still_counts(robot: RobotModel) -> None:
    generator = switch()
    assert not only(generator, reading(True), robot).notes
    cloud = only(generator, reading(True, 1.5), robot)
    assert cloud.notes == (STUCK,) and len(cloud)
    only(generator, reading(False, 1.6), robot)
    only(generator, reading(True, 1.7), robot)
    assert not only(generator, reading(True, 9.0), robot).notes


@pytest.mark.parametrize(("sensitivity", "remains"), [(0.0, [0.9]), (0.5, [0.82]), (0.95, [])])
def test_its_silence_speaks_against_what_another_source_believes(
    sensitivity: float, remains: list[float], tmp_path: Path
) -> None:
    (tmp_path / "slide.urdf").write_text(hands.SLIDE)
    config = PipelineConfig.model_validate(
        {
            "robot": {"urdf": "slide.urdf", "still": {"slide": 0.0}},
            "folder": tmp_path,
            "generators": {
                "foot": {"type": "switch", "sensor": "foot", "sensitivity": sensitivity},
                "other": {"type": "switch", "sensor": "other", "p_closed": 0.9},
            },
            "integrator": IntegratorConfig(frame="base"),
            "cycle": CycleConfig(every=0.1),
        }
    )
    pipeline = Pipeline(config)
    for sensor, closed in (("foot", False), ("other", True)):
        pipeline.receive(Switch(stamp=0.1, frame="hand", sensor=sensor, closed=closed))
    contacts = pipeline.step(0.1).fusion.contacts
    assert [contact.likelihood for contact in contacts] == pytest.approx(remains, abs=0.02)


def test_on_a_divided_surface_its_own_link_closes_it() -> None:
    shapes = [
        {"shape": "sphere", "radius": 0.1, "xyz": [x, 0.0, 0.0], "link": link}
        for x, link in ((0.0, "left"), (1.0, "right"))
    ]
    body = BodyConfig.model_validate({"frame": "base", "shapes": shapes})
    frames = FrameTree({"right": ("base", np.eye(4))})
    state = State(now=0.0, grid=hands.GRID, frames=frames, surface=body.sampled(Path()))
    (cloud,) = switch().generate(reading(True, frame="right"), state)
    assert len(cloud.positions) and (cloud.positions[:, 0] > 0.8).all()


def test_what_it_cannot_do_is_said_in_a_sentence(robot: RobotModel) -> None:
    def said(of: SwitchGenerator, at: State, frame: str = "hand") -> str:
        with pytest.raises((ConfigurationError, RobotError)) as raised:
            of.generate(reading(True, frame=frame), at)
        return str(raised.value)

    there = hands.state(robot)
    with pytest.raises(RobotError, match=r"unknown link 'hnad': did you mean 'hand'"):
        switch(links=["hnad"]).prepare(robot)
    assert "no transform joins 'toe' to a link of the robot" in said(switch(), there, "toe")
    far = said(switch(reach=0.01), there)
    assert far == (
        "'foot': no point of its links is within 0.01 m of 'hand', the nearest is 0.05 m away"
    )
    assert "no link that closes it has a surface" in said(switch(links=["base"]), there)
    assert "'foot' needs the surface of the robot" in said(switch(), hands.state(None))
    ball = BodyConfig.model_validate(
        {"frame": "base", "shapes": [{"shape": "sphere", "radius": 1}]}
    )
    body = State(now=0.0, grid=hands.GRID, surface=ball.sampled(Path()))
    assert "names links, and there is no robot" in said(switch(links=["hand"]), body)
