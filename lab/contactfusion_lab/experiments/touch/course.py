"""What a method reports in the course of a touch or a motion, by an integrator that goes on."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.pipeline_config import PipelineConfig
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.experiments.touch.record import Instant
from contactfusion_lab.experiments.touch.rows import NEAR, Row, believed_robot, counted, receive
from contactfusion_lab.experiments.touch.trial import Trial

BEFORE = 0.3
"""Fusion begins so long before the first contact [s]."""
LIVE = 1.0
"""Evidence lives no longer [s]."""


@dataclass(frozen=True)
class Course:
    """What is reported in the course of a touch.

    Attributes:
        latency: time from the first contact to the first report near a true one [s]; NaN: none.
        lost: how often no report was near a true contact any more, though there still was one.
    """

    latency: float
    lost: int


def course_of(trial: Trial, row: Row, method: Method, config: PipelineConfig) -> Course:
    """Fuse a touch at 20 Hz from before its first contact on."""
    if np.isnan(trial.onset):
        return Course(np.nan, 0)
    latency, was_near, lost = np.nan, False, 0
    instants = trial.record.cycles(max(trial.onset - BEFORE, 0.0))
    for instant, places in reports(instants, row, method, config):
        if instant.stamp < trial.onset or not len(instant.contacts):
            continue
        is_near = cdist(places, instant.contacts).min(initial=np.inf) <= NEAR
        if is_near and np.isnan(latency):
            latency = instant.stamp - trial.onset
        lost += was_near and not is_near
        was_near = is_near
    return Course(latency, lost)


def reports(
    instants: Iterable[Instant], row: Row, method: Method, config: PipelineConfig
) -> Iterator[tuple[Instant, FloatArray]]:
    """The positions of the contacts that are reported at each instant, shape (n, 3) [m].

    Args:
        instants: of one touch or motion, in order.
        row: the modalities.
        method: the rule, the condensation, and how clouds count.
        config: the pipeline that received the readings.
    """
    integrator = method.integrator(config.integrator)
    received, silent = dict[str, HypothesisCloud](), -np.inf
    for instant in instants:
        clouds = counted(instant, row, method, config)
        if any(cloud.kind == HypothesisKind.REGULAR and len(cloud) for cloud in clouds):
            silent = instant.stamp + LIVE
        for cloud in clouds:
            # without evidence there is no contact, whatever else is received
            if cloud.kind != HypothesisKind.REGULAR and instant.stamp > silent:
                continue
            if received.get(cloud.source) is not instant.clouds[cloud.source]:
                received[cloud.source] = instant.clouds[cloud.source]
                receive(integrator, cloud, config)
        fusion = integrator.step(instant.stamp, believed_robot(instant, config).surface)
        yield instant, np.reshape([contact.position for contact in fusion.contacts], (-1, 3))
