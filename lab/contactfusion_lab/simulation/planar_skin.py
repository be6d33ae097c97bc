"""What the skin of the base feels in the plane: taxels, and the contacts that they become."""

import math

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.jit import kernel

FACING = math.cos(math.pi / 4.0)
"""A strip feels what presses it steeper than this."""
STRIPS = np.array(
    [
        [1.0, 0.0, 0.0, 1.0, 0.0, 0.05, 12.0],
        [0.0, 1.0, 1.0, 0.0, -0.06, 0.05, 14.0],
        [0.0, -1.0, 1.0, 0.0, -0.06, 0.05, 14.0],
    ]
)
"""The skin of `mobile_base.yaml`, front, left and right, as `feel` wants it."""
UNKNOWN, SKIN = np.full(3, math.nan), {"skin": 1.0}
"""Of contacts: the force, and who feels them."""
THRESHOLD, P_MAX = 0.1, 0.95
"""Of the integrator, and of the generator `tactile`."""
MOST = 16
"""So many contacts at most."""


def felt(
    touched: FloatArray, steps: int, activation: float, front: float, half_width: float
) -> list[Contact]:
    """Give contacts as skin, generator `tactile` and integrator would.

    Args:
        touched: shape (n, 6), as `planar_kernels.advance` wrote it.
        steps: of the cycle.
        activation: a taxel that is pressed by less on average over the cycle tells nothing [N].
        front: where the front lies [m].
        half_width: where the sides lie [m].
    """
    runs = np.empty((MOST, 4))
    count = feel(touched, steps, STRIPS, activation, THRESHOLD, P_MAX, runs)
    return [_contact(front, half_width, *run) for run in runs[:count].tolist()]


@kernel
def _press(
    touched: FloatArray, steps: int, strip: FloatArray, activation: float, taxels: FloatArray
) -> None:
    """Give the mean force on each taxel of a strip; a point presses the two nearest."""
    facing_x, facing_y, along_x, along_y, middle, pitch, _ = strip
    n = len(taxels)
    for row in range(len(touched)):
        if -(touched[row, 3] * facing_x + touched[row, 4] * facing_y) < FACING:
            continue
        place = touched[row, 1] * along_x + touched[row, 2] * along_y - middle
        place = min(max(place / pitch + (n - 1) / 2.0, 0.0), n - 1.0)
        lower = min(int(place), n - 2)
        share, force = place - lower, touched[row, 5] / steps
        taxels[lower] += force * (1.0 - share)
        taxels[lower + 1] += force * share
    for k in range(n):
        if taxels[k] < activation:
            taxels[k] = 0.0


@kernel
def feel(
    touched: FloatArray,
    steps: int,
    strips: FloatArray,
    activation: float,
    threshold: float,
    p_max: float,
    found: FloatArray,
) -> int:
    """Feel contacts as skin, generator `tactile` and integrator would: runs of pressed taxels.

    Args:
        touched: shape (n, 6), as `advance` wrote it.
        steps: of the cycle.
        strips: shape (s, 7), of each strip of the skin the way it faces (x, y), the way along it
            (x, y), its middle along that way [m], pitch [m] and number of its taxels.
        activation: a taxel that is pressed by less on average over the cycle tells nothing [N].
        threshold: the likelihood from which a taxel counts.
        p_max: the largest likelihood.
        found: takes strip, place along it [m], variance [m²] and likelihood of each run.

    Returns:
        How many runs there are.
    """
    total = int(strips[:, 6].sum())
    taxels = np.zeros(total)
    first = count = 0
    for strip in strips:
        last = first + int(strip[6])
        _press(touched, steps, strip, activation, taxels[first:last])
        first = last
    largest = taxels.max()
    first = 0
    for row in range(len(strips)):
        pitch, n = strips[row, 5], int(strips[row, 6])
        mass = moment = second = likeliest = 0.0
        for k in range(n + 1):
            p = 0.0
            if k < n and taxels[first + k] > 0.0:
                p = min(taxels[first + k] / largest, p_max)
            if p >= threshold:
                y = (k - (n - 1) / 2.0) * pitch
                mass, moment, second = mass + p, moment + p * y, second + p * y * y
                likeliest = max(likeliest, p)
            elif mass > 0.0 and count < len(found):
                mean = moment / mass
                found[count, 0], found[count, 1] = row, mean + strips[row, 4]
                found[count, 2] = max(second / mass - mean * mean, 0.0) + pitch * pitch / 12.0
                found[count, 3] = likeliest
                count += 1
                mass = moment = second = likeliest = 0.0
        first += n
    return count


def _contact(
    front: float, half_width: float, strip: float, place: float, variance: float, likelihood: float
) -> Contact:
    facing_x, facing_y, along_x, along_y = STRIPS[int(strip), :4].tolist()
    reach = front if facing_x else half_width
    position = np.array([facing_x * reach + along_x * place, facing_y * reach + along_y * place, 0])
    return Contact(
        position=position,
        likelihood=likelihood,
        dispersion=math.sqrt(variance),
        covariance=np.diag([along_x * variance, along_y * variance, 0.0]),
        extent=np.stack([position, position]),
        force=UNKNOWN,
        voxels=1,
        shares=SKIN,
        stamp=0.0,
        frame="base",
    )
