"""The sensors of a simulated robot: the truth in, readings out."""

from threading import Event
from typing import Final

from contactfusion.live.transport import Transport
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.terminal import note
from contactfusion_lab.scenes.push.scene import PushScene
from contactfusion_lab.scenes.push.sensors import rng_of
from contactfusion_lab.scenes.sensor_errors import Arrivals
from contactfusion_lab.simulate.topics import Publisher, StateListener

PATIENCE: Final = 0.2
"""The longest wait for the truth, before it looks whether it shall end [s]."""


def run_sensors(
    scene: PushScene, config: PipelineConfig, transport: Transport, ended: Event
) -> None:
    """Be the skin, LiDARs and cameras of a scene, until an event.

    Each reading has the stamp of the truth that it is made of. States that come while readings are
    made are not sensed, but for the newest.

    Args:
        scene: a copy of the base's, at its start.
        config: of the pipeline: faults of sensors, and the seed.
        transport: has the truth, and takes the messages.
        ended: ends it.
    """
    listener = StateListener(transport)
    publisher = Publisher(transport, 0, config.faults, config.seed)
    arrivals = Arrivals(scene.config.noise.delays, rng_of(config.seed, "delays of the sensors"))
    count = missed = 0
    note("sensors: wait for the base; Ctrl-C ends")
    while not ended.is_set():
        received = listener.take(PATIENCE)
        if received is None:
            continue
        if count == 0:
            publisher.epoch_ns = received.stamp
            note("sensors: the base is there")
        count += 1
        missed += received.missed
        if received.missed:
            note(f"sensors: behind real time: cycles that were not sensed: {received.missed}")
        now = publisher.seconds(received.stamp)
        readings = scene.sensor_readings(now, received.state)
        publisher.readings(arrivals.until(now + scene.config.period / 2.0, readings))
    note(f"sensors: {count} cycles sensed, {missed} not, as they came too fast")
