"""Points on the surfaces of robot-like and object-like bodies."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A solid with a surface: a box, a closed cylinder along its own z, or a ball.

    Attributes:
        shape: which solid; a ball uses ``size[0]`` alone, a cylinder ``size[0]`` and ``size[2]``.
        size: shape (3,) [m], edge lengths, or diameters and height.
        centre: shape (3,) [m].
        rotation: shape (3, 3), its columns the body's axes.
    """

    shape: Literal["box", "cylinder", "ball"]
    size: Floats
    centre: Floats
    rotation: Floats

    @property
    def area(self) -> float:
        """The area of the surface [m²]."""
        a, b, c = (float(edge) for edge in self.size)
        if self.shape == "box":
            return 2.0 * (a * b + b * c + c * a)
        if self.shape == "cylinder":
            return np.pi * a * (c + a / 2.0)
        return np.pi * a * a

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw points, uniform over the surface.

        Args:
            rng: the only source of chance.
            count: how many points.

        Returns:
            shape (count, 3) [m], in random order.
        """
        draw = {"box": _on_box, "cylinder": _on_cylinder, "ball": _on_ball}[self.shape]
        points: Floats = draw(rng, self.size, count) @ self.rotation.T + self.centre
        return points


def _on_box(rng: np.random.Generator, size: Floats, count: int) -> Floats:
    areas = size.prod() / size
    axis = rng.choice(3, size=count, p=areas / areas.sum())
    points = rng.uniform(-0.5, 0.5, (count, 3))
    points[np.arange(count), axis] = rng.choice((-0.5, 0.5), size=count)
    return points * size


def _on_cylinder(rng: np.random.Generator, size: Floats, count: int) -> Floats:
    radius, height = size[0] / 2.0, size[2]
    on_cap = rng.random(count) < radius / (radius + height)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    distance = np.where(on_cap, radius * np.sqrt(rng.random(count)), radius)
    z = np.where(on_cap, rng.choice((-0.5, 0.5), size=count), rng.uniform(-0.5, 0.5, count))
    return np.column_stack((distance * np.cos(angle), distance * np.sin(angle), height * z))


def _on_ball(rng: np.random.Generator, size: Floats, count: int) -> Floats:
    normal = rng.standard_normal((count, 3))
    points: Floats = normal * (0.5 * size[0] / np.linalg.norm(normal, axis=1, keepdims=True))
    return points


def random_rotation(rng: np.random.Generator) -> Floats:
    """Draw a rotation, so that no surface is aligned with the voxels.

    Args:
        rng: the only source of chance.

    Returns:
        shape (3, 3), orthonormal.
    """
    basis: Floats = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return basis


def on_bodies(rng: np.random.Generator, bodies: list[Body], count: int) -> Floats:
    """Draw points on several bodies, in proportion to their areas.

    Args:
        rng: the only source of chance.
        bodies: where the points lie.
        count: how many points in all.

    Returns:
        shape (count, 3) [m], shuffled across the bodies.
    """
    areas = np.array([body.area for body in bodies])
    counts = rng.multinomial(count, areas / areas.sum())
    points = [body.sample(rng, int(n)) for body, n in zip(bodies, counts, strict=True)]
    return rng.permutation(np.concatenate(points))
