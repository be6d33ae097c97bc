"""Pushing as a Gymnasium environment: twists in, readings out."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.readings import Odometry, TactileImage, Twist
from contactfusion.robots.description import RobotConfig, read_robot
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import BASE, PushScene
from contactfusion_lab.scenes.sensor_errors import Delays

FASTEST = np.array([0.5, 0.5, 1.0])
"""The greatest twist: forward, lateral [m/s], yaw rate [rad/s]."""
FURTHEST, STRONGEST = 1000.0, 1e4
"""Bounds of positions [m] and of values of taxels [N]."""
Observation = dict[str, NDArray[np.float64]]


class PushEnv(gymnasium.Env[Any, NDArray[np.float64]]):
    """A base that pushes an object to a target.

    An action is a twist of the base: forward, lateral (to the left) [m/s], yaw rate [rad/s].
    An observation holds `skin`, the value of each taxel [N]; `pose`, x, y [m] and yaw [rad] of the
    base in `odom`; `twist`, as an action; and `target`, x and y in `odom` [m]. The reward is by how
    much the true contact came nearer to the target [m]; it is 0 without contact. A push is
    terminated when the true contact is `within` the target, and truncated after `longest`, or when
    the object is `furthest` away. `info` holds the kind of the true contact; the readings are
    `readings`, and all of the truth is `truth`.

    Args:
        config: the push; `reset` may change fields of it.
        robot: the base; None: that of the package.

    Raises:
        DependencyError: pybullet is not installed.
    """

    metadata = {"render_modes": []}

    def __init__(self, config: PushConfig, robot: RobotConfig | None = None) -> None:
        self._config = config
        self._robot = robot or read_robot(BASE)
        taxels = len(self._robot.patches["skin"].centres())
        self.action_space = spaces.Box(-FASTEST, FASTEST, dtype=np.float64)
        reach = np.array([FURTHEST, FURTHEST, np.pi])
        self.observation_space = spaces.Dict(
            {
                "skin": spaces.Box(-STRONGEST, STRONGEST, (taxels,), np.float64),
                "pose": spaces.Box(-reach, reach, dtype=np.float64),
                "twist": spaces.Box(-STRONGEST, STRONGEST, (3,), np.float64),
                "target": spaces.Box(-FURTHEST, FURTHEST, (2,), np.float64),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a push.

        Args:
            seed: of all random draws; None: continue with those of the last seed.
            options: fields of `PushConfig` that are to differ, such as `target`.

        Returns:
            The first observation, and `info`.

        Raises:
            ConfigurationError: an option is wrong, or readings would be delayed.
            RobotError: the object cannot be loaded.
        """
        super().reset(seed=seed)
        fields = {**self._config.model_dump(), **(options or {})}
        config = PushConfig(**fields)
        if config.noise.delays != Delays():
            raise ConfigurationError("an environment observes at once", "noise.delays")
        drawn = int(self.np_random.integers(2**32))
        self._scene = PushScene(config, self._robot, drawn)
        self._distance = float("nan")
        return self._observed()

    def step(
        self, action: NDArray[np.float64]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one cycle.

        Args:
            action: shape (3,), the twist of the base.

        Returns:
            Observation, reward, terminated, truncated, `info`.

        Raises:
            InvalidReadingError: the twist is not finite.
        """
        if not np.isfinite(action).all():
            raise InvalidReadingError(f"an action is a finite twist, not {action!r}")
        scene, config = self._scene, self._scene.config
        forward, lateral, yaw_rate = np.clip(action, -FASTEST, FASTEST).tolist()
        scene.drive(forward, lateral, yaw_rate)
        observed, info = self._observed()
        truth = self.truth
        nearer = self._distance - truth.distance
        if np.isfinite(truth.distance):
            self._distance = truth.distance
        terminated = bool(truth.distance <= config.within)
        truncated = bool(
            scene.stamp >= config.longest or np.hypot(*truth.object[:2]) > config.furthest
        )
        reward = float(nearer) if np.isfinite(nearer) else 0.0
        return observed, reward, terminated, truncated, info

    def _observed(self) -> tuple[Observation, dict[str, Any]]:
        """The observation and `info`; readings and ground truth are kept."""
        self.readings, self.truth = self._scene.readings(), self._scene.truth()
        odometry, twist, image, *_ = self.readings
        assert isinstance(odometry, Odometry)
        assert isinstance(twist, Twist)
        assert isinstance(image, TactileImage)
        yaw = 2.0 * np.arctan2(*odometry.orientation[2:])
        observed = {
            "skin": image.values.copy(),
            "pose": np.array([*odometry.position[:2], np.arctan2(np.sin(yaw), np.cos(yaw))]),
            "twist": np.array([*twist.linear[:2], twist.angular[2]]),
            "target": np.array(self._scene.config.target),
        }
        return observed, {"touch": self.truth.kind}
