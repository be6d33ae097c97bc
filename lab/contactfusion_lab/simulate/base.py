"""The base of a simulated robot: velocities in, odometry and the truth out, in real time."""

import math
import time
from collections.abc import Callable, Iterator
from threading import Event
from typing import Final, final

import numpy as np

from contactfusion.live.transport import Quality, Transport
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Twist
from contactfusion.readings.messages import Message, message
from contactfusion.readings.poses import STATIC, transforms_message
from contactfusion.recordings.mcap import DESCRIPTION
from contactfusion.recordings.messages import typestore
from contactfusion.run.recorder import fixed_frames
from contactfusion.terminal import note
from contactfusion.time import NANOSECONDS_PER_SECOND
from contactfusion_lab.scenes.push.config import RATE
from contactfusion_lab.scenes.push.scene import PushScene
from contactfusion_lab.scenes.push.sensors import rng_of
from contactfusion_lab.scenes.push.world import Velocity
from contactfusion_lab.scenes.sensor_errors import Arrivals
from contactfusion_lab.simulate.topics import Publisher, state_messages

COMMANDS: Final = "/cmd_vel"
"""The topic of the velocity that the base is to have, as geometry_msgs/Twist in its frame."""
TWIST: Final = "geometry_msgs/msg/Twist"
TIMEOUT: Final = 0.25
"""Time after a command at which the base brakes, unless another one comes [s]."""
FASTEST: Final = np.array([1.0, 1.0, 2.0])
"""Greatest velocity to either side: forward, lateral [m/s], yaw rate [rad/s]."""
STILL: Final = (0.0, 0.0, 0.0)
LATEST_NS: Final = NANOSECONDS_PER_SECOND // 10
"""A step that is later by more is not made up for: the world stands still meanwhile [ns]."""
PER_SPEED: Final = 4
"""Number of steps of the physics from one true velocity that is sent to the next."""


@final
class RealTime:
    """Steps of the physics in time with the clock of this machine."""

    def __init__(self) -> None:
        self._start, self._count = time.monotonic_ns(), 0
        self._epoch = time.time_ns() - self._start
        self.behind = 0.0
        """Time that the world has stood still, as its steps came late [s]."""

    @property
    def stamp(self) -> int:
        """The time for which the newest step was due [ns since 1970]."""
        return self._epoch + self._due

    @property
    def _due(self) -> int:
        return self._start + self._count * NANOSECONDS_PER_SECOND // RATE

    def wait(self) -> None:
        """Sleep until the next step is due."""
        self._count += 1
        late = time.monotonic_ns() - self._due
        if late < 0:
            time.sleep(-late / NANOSECONDS_PER_SECOND)
        elif late > LATEST_NS:
            self._start += late
            self.behind += late / NANOSECONDS_PER_SECOND
            note(f"base: real time was missed by {late / NANOSECONDS_PER_SECOND:.2f} s")


@final
class Commanded:
    """The velocity that was commanded last; zero once it is older than `TIMEOUT`.

    Args:
        clock: gives seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self.count = clock, 0
        """Number of commands so far."""
        self._velocity, self._received = STILL, -math.inf
        self._moves = False

    def take(self, cdr: bytes, arrived: int) -> None:
        """Take a geometry_msgs/Twist; one that holds no numbers is none."""
        twist: Message = typestore().deserialize_cdr(cdr, TWIST)
        velocity = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        if np.isfinite(velocity).all():
            forward, lateral, yaw_rate = velocity.clip(-FASTEST, FASTEST).tolist()
            self._velocity, self._received = (forward, lateral, yaw_rate), self._clock()
            self.count += 1

    def velocity(self) -> Velocity:
        """The velocity that the base is to have now."""
        fresh = self._clock() - self._received <= TIMEOUT
        velocity = self._velocity if fresh else STILL
        if self._moves and not fresh:
            note(f"base: no command for {TIMEOUT:g} s, so it brakes")
        self._moves = velocity != STILL
        return velocity


def run_base(scene: PushScene, config: PipelineConfig, transport: Transport, ended: Event) -> None:
    """Be the base of a scene, and the world around it, until an event.

    Args:
        scene: at its start; LiDARs and cameras that are switched on are ignored.
        config: of the pipeline: its robot and frames, faults of sensors, and the seed.
        transport: takes the messages, and has the commands.
        ended: ends it.
    """
    commanded = Commanded()
    publisher = Publisher(transport, time.time_ns(), config.faults, config.seed)
    transport.listen(COMMANDS, TWIST, Quality(reliable=False, latched=False), commanded.take)
    _describe(config, publisher)
    arrivals = Arrivals(scene.config.noise.delays, rng_of(config.seed, "delays"))
    clock = RealTime()
    publisher.epoch_ns = clock.stamp
    note(f"base: takes {COMMANDS} ({TWIST}), and brakes {TIMEOUT:g} s after the last; Ctrl-C ends")
    while not ended.is_set():
        stamp, now = clock.stamp, publisher.seconds(clock.stamp)
        publisher.readings(
            arrivals.until(now + scene.config.period / 2.0, scene.motion_readings(now))
        )
        publisher.messages(state_messages(scene.world.state, stamp))
        scene.follow(_velocities(scene, clock, commanded, publisher, ended))
    lasted = publisher.seconds(clock.stamp)
    note(
        f"base: {lasted:.1f} s, {clock.behind:.1f} s of which behind real time; "
        f"{commanded.count} commands"
    )


def _velocities(
    scene: PushScene, clock: RealTime, commanded: Commanded, publisher: Publisher, ended: Event
) -> Iterator[Velocity]:
    """The velocity for each step of a cycle, when it is due; the true one is sent after some."""
    for step in range(scene.world.steps):
        clock.wait()
        if ended.is_set():
            return
        yield commanded.velocity()
        if step % PER_SPEED == PER_SPEED - 1:
            forward, lateral, yaw_rate = scene.world.base_twist
            now = publisher.seconds(clock.stamp)
            linear, angular = np.array([forward, lateral, 0.0]), np.array([0.0, 0.0, yaw_rate])
            true = Twist(stamp=now, frame="base", sensor="twist", linear=linear, angular=angular)
            publisher.truth(true)


def _describe(config: PipelineConfig, publisher: Publisher) -> None:
    """Send what holds from the start: the robot's URDF, and all frames that stand still."""
    assert config.robot is not None  # a scene needs one
    urdf = config.robot.path().read_text(encoding="utf-8")
    publisher.messages(
        [
            (f"/{DESCRIPTION}", message("std_msgs/String", data=urdf)),
            (f"/{STATIC}", transforms_message(fixed_frames(config), publisher.epoch_ns)),
        ]
    )
