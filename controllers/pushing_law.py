"""The law of reactive pushing, as functions of contact, pose and target (O §II-B)."""

import math

from contactfusion.frames import planar_point

LIMIT = math.radians(89.0)
"""tan grows without bound towards 90 degrees."""


def displacement(
    target: tuple[float, float], pose: tuple[float, float, float], contact: tuple[float, float]
) -> tuple[float, float]:
    """Give the way that is left, d = p_T - (p_R + R p_C) (O Eq 1).

    Args:
        target: p_T, x and y in the world [m].
        pose: p_R and θ of the robot: x, y [m] and yaw [rad] in the world.
        contact: p_C, x and y in the robot's frame [m].

    Returns:
        x and y in the world [m].
    """
    x, y = place_of(contact, pose)
    return target[0] - x, target[1] - y


def place_of(contact: tuple[float, float], pose: tuple[float, float, float]) -> tuple[float, float]:
    """Give the place of a contact in the world, p_R + R p_C [m]; arguments as above."""
    return planar_point(pose, contact)


def adaptive_rate(lateral: float, eta: float, zeta: float, beta: float, k: float) -> float:
    """Give a_r = (ζ + (η - ζ) / (1 + e^((β - |l|) k))) sgn(l) (O Eq 2).

    Args:
        lateral: l, the contact to the left of the robot's middle [m].
        eta: η, the rate far from the middle.
        zeta: ζ, the rate at the middle.
        beta: β, where it is halfway between [m].
        k: how steep it changes there [1/m].
    """
    if lateral == 0.0:
        return 0.0
    steepness = math.exp(min((beta - abs(lateral)) * k, 700.0))
    return math.copysign(zeta + (eta - zeta) / (1.0 + steepness), lateral)


def velocities(speed: float, rate: float) -> tuple[float, float]:
    """Share a speed: v_x = v* / √(1 + a_r²), v_y = a_r v_x (O Eq 3) [m/s]."""
    ahead = speed / math.sqrt(1.0 + rate * rate)
    return ahead, rate * ahead


def heading_error(way: tuple[float, float], yaw: float) -> float:
    """Give θ* - θ, wrapped to (-π, π], with θ* = atan2(d_y, d_x) (O Eq 4) [rad]."""
    return wrapped(math.atan2(way[1], way[0]) - yaw)


def turn_rate(speed: float, error: float, gain: float, length: float) -> float:
    """Give ω = v tan(γ) / L with γ = K_h (θ* - θ), γ kept below 90 degrees (O Eq 4) [rad/s].

    Args:
        speed: v [m/s].
        error: θ* - θ [rad].
        gain: K_h.
        length: L, the smaller the sharper [m].
    """
    gamma = max(-LIMIT, min(LIMIT, gain * error))
    return speed * math.tan(gamma) / length


def wrapped(angle: float) -> float:
    """Give the same angle in (-π, π] [rad]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def limited(value: float, most: float) -> float:
    """Give the nearest value that is no larger than `most`, either way."""
    return max(-most, min(most, value))
