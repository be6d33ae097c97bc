"""The law of reactive pushing, as functions of contact, pose and target (O §II-B)."""

import math

from contactfusion.frames import planar_point

LIMIT = math.radians(89.0)
"""The greatest γ [rad]: tan grows without bound towards 90 degrees."""


def displacement(
    target: tuple[float, float], pose: tuple[float, float, float], contact: tuple[float, float]
) -> tuple[float, float]:
    """The remaining displacement of the contact, d = p_T - (p_R + R p_C) (O Eq 1).

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
    """The position of a contact in the world, p_R + R p_C [m]; arguments as above."""
    return planar_point(pose, contact)


def adaptive_rate(lateral: float, eta: float, zeta: float, beta: float, k: float) -> float:
    """The adaptive rate a_r = (ζ + (η - ζ) / (1 + e^((β - |l|) k))) sgn(l) (O Eq 2).

    Args:
        lateral: l, the contact to the left of the robot's middle [m].
        eta: η, the rate far from the middle.
        zeta: ζ, the rate at the middle.
        beta: β, the |l| of half the change [m].
        k: steepness of the change there [1/m].
    """
    if lateral == 0.0:
        return 0.0
    steepness = math.exp(min((beta - abs(lateral)) * k, 700.0))
    return math.copysign(zeta + (eta - zeta) / (1.0 + steepness), lateral)


def velocities(speed: float, rate: float) -> tuple[float, float]:
    """Components of a speed: v_x = v* / √(1 + a_r²), v_y = a_r v_x (O Eq 3) [m/s]."""
    forward = speed / math.sqrt(1.0 + rate * rate)
    return forward, rate * forward


def heading_error(offset: tuple[float, float], yaw: float) -> float:
    """The heading error θ* - θ, wrapped to (-π, π], with θ* = atan2(d_y, d_x) (O Eq 4) [rad]."""
    return wrapped(math.atan2(offset[1], offset[0]) - yaw)


def turn_rate(speed: float, error: float, gain: float, length: float) -> float:
    """The yaw rate ω = v tan(γ) / L with γ = K_h (θ* - θ), |γ| below 90 degrees (O Eq 4) [rad/s].

    Args:
        speed: v [m/s].
        error: θ* - θ [rad].
        gain: K_h.
        length: L; a smaller one turns sharper [m].
    """
    gamma = max(-LIMIT, min(LIMIT, gain * error))
    return speed * math.tan(gamma) / length


def wrapped(angle: float) -> float:
    """The same angle in (-π, π] [rad]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def limited(value: float, most: float) -> float:
    """The nearest value in [-most, most]."""
    return max(-most, min(most, value))
