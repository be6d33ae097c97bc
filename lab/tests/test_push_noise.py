"""Errors of the sensors of a push: by name, part by part, and none of them in the truth."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import PlanarPose, Pose, apart, planar_rotation, planar_turned
from contactfusion.readings import DepthImage, Odometry, PointCloud, Reading, TactileImage, Twist
from contactfusion_lab.scenes.push import sensors
from contactfusion_lab.scenes.push.clutter import KEPT, Clutter, gap
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.env import PushEnv
from contactfusion_lab.scenes.push.noise import NOISES, PARTS, OdometryNoise, PushNoise
from contactfusion_lab.scenes.push.objects import outlines, rectangle, triangles_of
from contactfusion_lab.scenes.push.odometry import PushOdometry
from contactfusion_lab.scenes.push.scene import PushScene, PushTruth, mobile_base
from contactfusion_lab.scenes.push.view import PushView
from contactfusion_lab.scenes.sensor_errors import RangeErrors
from lab.tests.test_push_world import base

EYES = ("lidar", "camera")
AHEAD = (0.25, 0.02, 0.05)
"""How the base moves: ahead, to the left [m/s], turn [rad/s]."""
AFTER = {"taxels": "skin", "mounting": "lidar", "range": "lidar", "odometry": "odometry"}
"""A sensor whose readings each part changes."""


def config(**fields: Any) -> PushConfig:
    return PushConfig(**{"target": (2.0, 0.0), **fields})


def noise(given: Any) -> PushNoise:
    return config(noise=given).noise


def scene(given: Any, seed: int = 0, **fields: Any) -> PushScene:
    return PushScene(config(noise=given, **fields), base(), seed)


def driven(made: PushScene, cycles: int = 8) -> tuple[list[list[Reading]], list[PushTruth]]:
    """What is read and what is true in some cycles of driving ahead."""
    read, true = [made.readings()], [made.truth()]
    for _ in range(cycles):
        made.drive(*AHEAD)
        read.append(made.readings())
        true.append(made.truth())
    return read, true


def of(readings: list[list[Reading]], sensor: str) -> list[FloatArray]:
    """The values that one sensor reads."""
    values: dict[type, Callable[[Any], FloatArray]] = {
        Odometry: lambda one: np.concatenate([one.position, one.orientation, one.linear]),
        TactileImage: lambda one: one.values,
        PointCloud: lambda one: one.points,
        DepthImage: lambda one: one.depth,
    }
    return [
        values[type(one)](one)
        for each in readings
        for one in each
        if one.sensor == sensor and type(one) in values
    ]


def same(first: list[FloatArray], second: list[FloatArray]) -> bool:
    return all(map(np.array_equal, first, second))


class TestNames:
    def test_a_push_has_the_noise_of_the_prototype_unless_told(self) -> None:
        assert noise("prototype") == noise({}) == config().noise

    def test_hard_is_the_prototype_with_every_part_and_parts_go_alone(self) -> None:
        assert noise("hard") == noise("+".join(["prototype", *PARTS]))
        alone = noise("prototype+odometry")
        assert alone.odometry == noise("hard").odometry != OdometryNoise()
        assert alone.model_copy(update={"odometry": OdometryNoise()}) == noise("prototype")

    def test_every_part_and_set_differs(self) -> None:
        found = [
            noise(name) for name in (*NOISES, "hard", *(f"prototype+{part}" for part in PARTS))
        ]
        assert all(found.count(one) == 1 for one in found)

    def test_noise_may_be_given_by_fields_and_is_read_from_what_it_dumps(self) -> None:
        assert noise({"ranges": {"bias": 0.03}}).ranges.bias == 0.03
        assert noise(noise("hard").model_dump(mode="json")) == noise("hard")

    @pytest.mark.parametrize(
        ("given", "sentence"),
        [
            ("hrad", "noise: unknown noise 'hrad'.*did you mean 'hard'"),
            ("full", "the noises are: hard, none, prototype"),
            ("prototype+odometer", "unknown part of the noise hard.*did you mean 'odometry'"),
            ({"odometry": {"slip": 2.0}}, "noise.odometry.slip"),
        ],
    )
    def test_what_is_no_noise_is_told(self, given: Any, sentence: str) -> None:
        with pytest.raises(ConfigurationError, match=sentence):
            noise(given)


class TestParts:
    @pytest.mark.parametrize("part", PARTS)
    def test_no_part_changes_the_truth_and_each_is_the_same_again(self, part: str) -> None:
        given = f"prototype+{part}"
        read, true = driven(scene(given, 3, sees=EYES), 4)
        again, truth = driven(scene(given, 3, sees=EYES), 4)
        assert true == truth or str(true) == str(truth)  # NaN without contact
        assert str(true) == str(driven(scene("prototype", 3, sees=EYES), 4)[1])
        assert all(same(of(read, name), of(again, name)) for name in ("skin", "odometry", *EYES))

    @pytest.mark.parametrize(("part", "sensor"), AFTER.items())
    def test_a_part_changes_its_own_sensors_and_no_other(self, part: str, sensor: str) -> None:
        plain = driven(scene("prototype", sees=EYES))[0]
        with_part = driven(scene(f"prototype+{part}", sees=EYES))[0]
        assert not same(of(plain, sensor), of(with_part, sensor))
        others = {"skin", "odometry", "lidar"} - {sensor}
        assert all(same(of(plain, other), of(with_part, other)) for other in others)

    def test_without_noise_all_measure_the_truth(self) -> None:
        made = scene("none", sees=EYES)
        read, true = driven(made)
        skin = of(read, "skin")[-1]
        assert skin.sum() == pytest.approx(true[-1].force)
        again = driven(scene("none", 99, sees=EYES))[0]
        assert all(same(of(read, name), of(again, name)) for name in ("skin", "lidar", "camera"))
        depth = of(read, "camera")[0]
        assert np.unique(depth[depth > 1.5].round(6)) == pytest.approx([1.55])  # floor

    def test_each_strip_of_the_skin_has_a_dead_taxel(self) -> None:
        taxels = noise({"taxels": {"dead": 1}}).taxels
        skin = sensors.PushSkin(base().patches["skin"], config().skin)
        dead = sensors.PushSkin(base().patches["skin"], config().skin, taxels, 5)
        assert len(skin._errors) == 3
        for errors in dead._errors:
            count = len(errors._response)
            assert np.count_nonzero(errors.read(0.0, np.ones(count)) == 0.0) == 1

    def test_every_eye_stands_a_centimetre_and_a_degree_off_another_each_push(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        drawn = list[Pose]()

        def kept(*args: Any) -> Pose:
            drawn.append(found := misplacement(*args))
            return found

        misplacement = sensors.misplacement
        monkeypatch.setattr(sensors, "misplacement", kept)
        for seed in (1, 2):
            scene("prototype+mounting", seed, sees=EYES)
        assert len(drawn) == 4
        for pose in drawn:
            length, angle = apart(np.eye(4), pose)
            assert (length, math.degrees(angle)) == pytest.approx((0.01, 1.0))
        assert all(apart(*pair)[0] > 1e-3 for pair in itertools.combinations(drawn, 2))

    def test_each_eye_has_a_scale_of_its_own(self) -> None:
        given = {"sensors": False, "ranges": {"bias": 0.01}}
        exact, biased = (driven(scene(which, 3, sees=EYES), 0)[0] for which in ("none", given))
        near, far = (np.linalg.norm(of(read, "lidar")[0], axis=1) for read in (exact, biased))
        lidar = far / near
        flat, deep = of(exact, "camera")[0], of(biased, "camera")[0]
        camera = deep[flat > 0] / flat[flat > 0]
        assert np.ptp(lidar) < 1e-6 and np.ptp(camera) < 1e-6
        assert 1e-4 < abs(lidar[0] - camera[0]) < 0.1


class TestOdometry:
    @staticmethod
    def measured(
        pressed: bool = False, seed: int = 0, **fields: float
    ) -> tuple[PushOdometry, list[PlanarPose]]:
        """Odometry of 2 m on an arc, and its poses."""
        made = PushOdometry(
            OdometryNoise(**fields), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), np.random.default_rng(seed)
        )
        x, y, yaw, poses = 0.0, 0.0, 0.0, []
        for _ in range(100):
            ahead = planar_turned((0.02, 0.0), yaw + 0.005)
            x, y, yaw = x + ahead[0], y + ahead[1], yaw + 0.01
            made.follow((x, y, yaw), (0.2, 0.0, 0.1), pressed, 0.1)
            poses.append((x, y, yaw))
        return made, poses

    def test_without_noise_it_is_the_truth_to_the_bit(self) -> None:
        made, poses = self.measured()
        assert made.pose == poses[-1] and made.twist == (0.2, 0.0, 0.1)

    def test_a_scale_error_grows_with_the_path(self) -> None:
        made, poses = self.measured(translation=0.02)
        share = math.hypot(*made.pose[:2]) / math.hypot(*poses[-1][:2]) - 1.0
        assert 1e-4 < abs(share) < 0.1
        assert made.twist[0] == pytest.approx(0.2 * (1.0 + share))
        assert made.pose[2] == pytest.approx(poses[-1][2])

    def test_yaw_has_a_scale_of_its_own(self) -> None:
        made, poses = self.measured(yaw=0.02)
        assert made.twist[2] == pytest.approx(0.1 * made.pose[2] / poses[-1][2])
        assert made.pose[2] != poses[-1][2] and made.twist[0] == pytest.approx(0.2)

    def test_it_slips_sideways_only_while_the_object_presses(self) -> None:
        free, poses = self.measured(slip=0.02)
        assert free.pose == pytest.approx(poses[-1])
        pushing, _ = self.measured(pressed=True, slip=0.02)
        assert abs(pushing.twist[1]) > 1e-4 and pushing.twist[0] == pytest.approx(0.2)

    def test_a_random_walk_grows_with_the_root_of_the_path(self) -> None:
        ends = [self.measured(seed=seed, walk=0.01)[0].pose for seed in range(200)]
        truth = self.measured()[1][-1]
        off = np.array(ends)[:, :2] - truth[:2]
        assert off.std(axis=0) == pytest.approx(0.01 * math.sqrt(2.0), rel=0.15)

    def test_the_twist_leads_to_the_pose(self) -> None:
        read, _ = driven(scene("hard"), 20)
        x, y, yaw = -mobile_base().front, 0.0, 0.0
        for each in read[1:]:
            (twist,) = (one for one in each if isinstance(one, Twist))
            turn = 0.1 * twist.angular[2]
            dx, dy = planar_turned(tuple(0.1 * twist.linear[:2]), yaw + turn / 2.0)
            x, y, yaw = x + dx, y + dy, yaw + turn
        (odometry,) = (one for one in read[-1] if isinstance(one, Odometry))
        assert odometry.position[:2] == pytest.approx((x, y))
        assert 2.0 * math.atan2(odometry.orientation[2], odometry.orientation[3]) == pytest.approx(
            yaw
        )

    def test_success_is_judged_by_the_truth(self) -> None:
        made = scene({"odometry": {"translation": 0.3}}, 2)
        read, true = driven(made, 20)
        off = of(read, "odometry")[-1][0] - true[-1].base[0]
        assert abs(off) > 0.02
        there = np.hypot(*(np.array(true[-1].contact) + true[-1].base[:2] - (2.0, 0.0)))
        assert true[-1].distance == pytest.approx(there, abs=0.05)


class TestClutter:
    @staticmethod
    def clutter(seed: int = 0, thing: Any = "box") -> Clutter:
        pushed = outlines(config(object=thing).object)
        rng = np.random.default_rng(seed)
        return Clutter(mobile_base().corners, pushed, (0.3, 0.0, 0.0), rng)

    def test_the_gap_of_squares_is_that_between_their_faces(self) -> None:
        square = rectangle(1.0, 1.0)
        assert gap(square, square + (1.3, 0.2)) == pytest.approx(0.3)
        assert gap(square, square + (0.4, 0.9)) == pytest.approx(-0.1)
        assert 0.0 < gap(square, square + (2.0, 2.0)) <= math.sqrt(2.0)

    @pytest.mark.parametrize("thing", ["box", "lshape"])
    def test_legs_keep_away_from_the_object_and_walk_along(self, thing: str) -> None:
        parts = outlines(config(object=thing).object)
        nearest = []
        for seed in range(20):
            one, places = self.clutter(seed, thing), []
            for stamp in np.arange(0.0, 20.0, 0.2).tolist():
                x, y, yaw = 0.3 + 0.1 * stamp, 0.0, 0.05 * stamp
                legs = one.legs(stamp, (0.1 * stamp - 0.3, 0.0, 0.0), (x, y, yaw))
                placed = [part @ planar_rotation(yaw).T + (x, y) for part in parts]
                nearest.append(min(gap(leg.outline, part) for leg in legs for part in placed))
                places.append(legs[0].middle)
            assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.4
            assert np.ptp(places, axis=0).max() > 1.5
        assert KEPT < min(nearest) < KEPT + 0.1 and max(nearest) < 2.0

    def test_who_would_be_run_into_steps_aside_for_a_while(self) -> None:
        one = self.clutter()
        away = (20.0, 20.0, 0.0)
        everything = one.seen(0.0, away, (23.0, 20.0, 0.0))
        assert len(everything) == 1 + 5 + 1 + 2
        box = one._still[-1].middle
        assert len(one.seen(0.0, (*box, 0.0), (23.0, 20.0, 0.0))) <= len(everything) - 1
        assert len(one.seen(1.0, away, (23.0, 20.0, 0.0))) == len(everything)

    def test_eyes_see_it_and_nothing_touches_it(self) -> None:
        plain, true = driven(scene("none", 4, sees=EYES, object="cylinder"), 30)
        with_it, truth = driven(scene("none+clutter", 4, sees=EYES, object="cylinder"), 30)
        assert str(true) == str(truth) and same(of(plain, "skin"), of(with_it, "skin"))
        assert not same(of(plain, "camera"), of(with_it, "camera"))
        clouds = zip(of(plain, "lidar"), of(with_it, "lidar"), strict=True)
        nearer = [
            np.linalg.norm(seen, axis=1).min() <= np.linalg.norm(alone, axis=1).min() + 1e-9
            for alone, seen in clouds
        ]
        assert all(nearer)

    def test_a_body_before_the_object_hides_it_in_the_image(self) -> None:
        thing = config().object
        corners = np.concatenate([vertices for vertices, _ in triangles_of(thing)])
        exact = config(noise="none")
        view = PushView(thing, base())
        pose = np.eye(4)
        pose[:3, :3] = [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
        pose[:3, 3] = 0.4, 0.0, 1.1
        errors = RangeErrors(exact.noise.ranges, np.random.default_rng(0))
        camera = sensors.PushCamera(
            base().cameras["camera"],
            pose,
            view,
            corners,
            exact.white[2],
            errors,
            np.array([200.0, 20.0, 20.0]),
        )
        slab = triangles_of(
            config(object={"shape": "box", "size": (0.2, 0.2, 1.0), "mass": 1.0}).object
        )
        moved = [(vertices + (0.2, 0.0, 0.0), triangles) for vertices, triangles in slab]
        here, there, rng = (-0.3, 0.0, 0.0), (0.2, 0.0, 0.0), np.random.default_rng(0)
        alone = camera.picture(here, there, rng)
        hidden = camera.picture(here, there, rng, moved)
        changed = hidden.depth < alone.depth - 0.1
        assert changed.any() and not hidden.mask[changed].any()
        assert (hidden.mask <= alone.mask).all() and hidden.mask.any()
        assert hidden.depth[changed] == pytest.approx(0.55)


class TestTiming:
    def test_readings_arrive_in_their_own_cycle_without_delay(self) -> None:
        made = scene("prototype", sees=EYES)
        for _ in range(3):
            assert {one.stamp for one in made.arriving()} == {made.stamp}
            made.drive(*AHEAD)

    def test_readings_arrive_late_in_order_and_none_is_lost(self) -> None:
        made, late, newest = scene("prototype+timing", sees=EYES), [], dict[str, float]()
        for _ in range(40):
            for one in made.arriving():
                late.append((one.sensor, made.stamp - one.stamp))
                assert one.stamp > newest.get(f"{one.sensor}", -1.0)
                newest[one.sensor] = one.stamp
            made.drive(*AHEAD)
        of_lidar = {round(age, 3) for sensor, age in late if sensor == "lidar"}
        assert of_lidar == {0.1, 0.2} or of_lidar == {0.0, 0.1, 0.2}
        assert {round(age, 3) for sensor, age in late if sensor == "skin"} == {0.0, 0.1}
        assert sum(sensor == "skin" for sensor, _ in late) >= 39

    def test_an_environment_refuses_delays(self) -> None:
        env = PushEnv(config(noise="hard"))
        with pytest.raises(ConfigurationError, match="noise.delays"):
            env.reset(seed=1)
