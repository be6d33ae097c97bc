"""The dynamics of a robot that carries something."""

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.frames import FrameConfig
from contactfusion.generators.external_torque import ExternalTorque
from contactfusion.identify.joints import point_mass, point_mass_slopes
from contactfusion.robots.description import PayloadConfig, RobotConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from tests.arms import ARM, BENT, STILL, known, reading, whole
from tests.free_motion import GRAVITY, TOOL, carrying

TILTED = np.array([1.0, 2.0, -9.0])
MOMENTS = np.array([TOOL.mass, *(TOOL.mass * np.array(TOOL.centre_of_mass))])


def test_momentum_and_drift_are_linear_in_the_inertia_of_a_payload() -> None:
    rng, bare, loaded = np.random.default_rng(0), Dynamics(carrying(None)), Dynamics(carrying(TOOL))
    for _ in range(5):
        positions, speeds = rng.normal(size=(2, len(bare.model.joint_names)))
        momentum, drift = bare.payload_columns("link_7", positions, speeds, TILTED)
        more = loaded.momentum(positions, speeds) - bare.momentum(positions, speeds)
        np.testing.assert_allclose(momentum @ point_mass(MOMENTS), more, atol=1e-12)
        more = loaded.drift(positions, speeds, TILTED) - bare.drift(positions, speeds, TILTED)
        np.testing.assert_allclose(drift @ point_mass(MOMENTS), more, atol=1e-12)


def test_the_slopes_of_a_point_mass_are_its_derivatives() -> None:
    steps = 1e-6 * np.eye(4)
    differences = [(point_mass(MOMENTS + h) - point_mass(MOMENTS - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(point_mass_slopes(MOMENTS), np.transpose(differences), atol=1e-8)


def test_the_observer_takes_the_payload_off() -> None:
    model = carrying(TOOL)
    held = model.gravity_torques(whole(BENT))[: len(ARM)]
    for robot, silent in ((model, True), (carrying(None), False)):
        torque = ExternalTorque(Dynamics(robot), known(), "measured", 30.0, 0.0)
        stamps = np.arange(0.0, 1.0, 0.01).tolist()
        given = [torque.update(reading(held, BENT, at), whole(BENT), GRAVITY) for at in stamps]
        assert given[-1] is not None
        assert (np.abs(given[-1][0][: len(ARM)]).max() < 1e-9) == silent


def test_a_payload_lies_in_a_frame_of_the_description() -> None:
    frames = {"tool": FrameConfig(parent="link_7", xyz=(0.02, -0.03, 0.0))}
    config = RobotConfig(
        urdf="contactfusion.robots:arm_hand.urdf",
        still=STILL,
        frames=frames,
        payload=PayloadConfig(frame="tool", mass=TOOL.mass, centre_of_mass=(0.0, 0.0, 0.12)),
    )
    torques = RobotModel(config).gravity_torques(whole(BENT))
    np.testing.assert_allclose(torques, carrying(TOOL).gravity_torques(whole(BENT)), atol=1e-12)


def test_a_payload_hangs_on_the_sensors_that_carry_it() -> None:
    bare, loaded = (
        PosedRobot(model, whole(BENT), model.root, np.eye(4))
        for model in (carrying(None), carrying(TOOL))
    )
    assert loaded.load_on("link_6")[0] == pytest.approx(bare.load_on("link_6")[0] + TOOL.mass)
    assert loaded.load_on("palm")[0] == bare.load_on("palm")[0]


def test_a_frame_of_a_payload_that_nothing_has_is_named() -> None:
    with pytest.raises(ConfigurationError, match=r"payload.frame: unknown frame 'link_8'"):
        carrying(PayloadConfig(frame="link_8", mass=1.0))
