"""The picture of a robot: whole, and from near what carries patches."""

from pathlib import Path

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.doctor.picture import draw_robot
from contactfusion.doctor.robot import middle
from contactfusion.errors import ContactFusionError
from contactfusion.robots.description import read_robot
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from tests.urdfs import built, link

BOX = '<box size="0.1 0.1 0.1"/>'


def seen(path: Path) -> FloatArray:
    """Give the pixels of a picture, shape (h, w, 3), 0 to 1."""
    from matplotlib.image import imread

    pixels: FloatArray = imread(path)[:, :, :3]
    return pixels


def posed(model: RobotModel) -> PosedRobot:
    return PosedRobot(model, middle(model), model.root, np.eye(4))


def test_the_shipped_robot_is_drawn(tmp_path: Path) -> None:
    robot = posed(RobotModel(read_robot("contactfusion.robots:arm_hand.yaml")))
    path = draw_robot(robot, tmp_path / "pictures" / "arm.png")
    assert path == tmp_path / "pictures" / "arm.png"
    left, right = np.array_split(seen(path), 2, axis=1)
    for half in (left, right):
        assert 0.02 < np.mean(half.min(axis=2) < 0.7) < 0.5  # ink
        assert np.mean(np.ptp(half, axis=2) > 0.2) > 0.01  # and colour


def test_a_robot_without_sensors_is_drawn_alone(tmp_path: Path) -> None:
    path = draw_robot(posed(built(tmp_path, link("a", BOX))), tmp_path / "a.png")
    assert np.mean(np.ptp(seen(path), axis=2) > 0.2) > 0.02


def test_equal_robots_give_equal_pictures(tmp_path: Path) -> None:
    model = built(tmp_path, link("a", BOX))
    one, other = (draw_robot(posed(model), tmp_path / name) for name in ("a.png", "b.png"))
    assert one.read_bytes() == other.read_bytes()


def test_a_picture_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    model = built(tmp_path, link("a", BOX))
    with pytest.raises(ContactFusionError, match="can't be written: it is a folder"):
        draw_robot(posed(model), tmp_path)
    with pytest.raises(ContactFusionError, match="taken cannot be made: File exists"):
        draw_robot(posed(model), tmp_path / "taken" / "a.png")
