"""Kernels of the planar model of pushing: an object slides before a driven box with a skin.

A time-stepping scheme on impulses: each step finds where object and box meet, then projected
Gauss-Seidel finds impulses that let nothing enter and no friction leave its disk, then velocities
move the object. It is stable at any step, because friction is an impulse bounded by what stops the
motion. All kernels stand in this module because they call each other.
"""

import math

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.jit import kernel

IntArray = NDArray[np.int64]

MARGIN = 0.004
"""Gap under which bodies may touch within the next step [m]."""
SLOP = 0.0005
"""Overlap that is left as it is, so that contacts do not flicker [m]."""
RECOVERY = 0.2
"""Share of an overlap that one step corrects."""
REST = 1e-6
"""Speed under which an object without contact is at rest, sum of [m/s] and [rad/s]."""
BASE, OBJECT, SPEED = 0, 3, 6
"""First rows in a state of the pose of the base, that of the object's centre of mass, and its
velocity (world: x, y [m/s], yaw rate [rad/s])."""
STATE = 9
"""Numbers in a state."""
MOST = 16
"""Contacts at most in one step."""
FACING = math.cos(math.pi / 4.0)
"""Least cosine between a force and the normal of a strip that measures it."""


@kernel
def _meet_circle(
    x: float, y: float, radius: float, rear: float, front: float, half: float, found: FloatArray
) -> int:
    """Contact of a circle with the box, in the box's frame, 0 or 1; row: point, normal, gap."""
    near_x, near_y = min(max(x, rear), front), min(max(y, -half), half)
    offset_x, offset_y = x - near_x, y - near_y
    distance = math.sqrt(offset_x * offset_x + offset_y * offset_y)
    if distance - radius > MARGIN or distance < 1e-9:
        return 0
    found[0, 0], found[0, 1] = near_x, near_y
    found[0, 2], found[0, 3] = offset_x / distance, offset_y / distance
    found[0, 4] = distance - radius
    return 1


@kernel
def _clip(
    found: FloatArray,
    first: tuple[float, float],
    second: tuple[float, float],
    corner: tuple[float, float],
    normal: tuple[float, float],
    length: float,
    sign: float,
) -> int:
    """Clip an edge to a face of the other body; the number of points that are near it.

    The face begins at `corner` and goes counterclockwise for `length`; `sign` is 1.0 if it is one
    of the box's, else -1.0.
    """
    along_x, along_y = -normal[1], normal[0]
    begin = (first[0] - corner[0]) * along_x + (first[1] - corner[1]) * along_y
    end = (second[0] - corner[0]) * along_x + (second[1] - corner[1]) * along_y
    over = (first[0] - corner[0]) * normal[0] + (first[1] - corner[1]) * normal[1]
    rise = (second[0] - corner[0]) * normal[0] + (second[1] - corner[1]) * normal[1] - over
    if max(begin, end) < 0.0 or min(begin, end) > length:
        return 0
    count = 0
    for along in (begin, end):
        inside = min(max(along, 0.0), length)
        share = 0.0 if abs(end - begin) < 1e-12 else (inside - begin) / (end - begin)
        gap = over + share * rise
        if gap > MARGIN:
            continue
        lift = 0.0 if sign > 0.0 else gap  # a contact lies on the box
        found[count, 0] = corner[0] + inside * along_x + lift * normal[0]
        found[count, 1] = corner[1] + inside * along_y + lift * normal[1]
        found[count, 2], found[count, 3], found[count, 4] = sign * normal[0], sign * normal[1], gap
        count += 1
        if abs(end - begin) < 1e-9:
            break
    return count


@kernel
def _most_against(corners: FloatArray, normal: tuple[float, float]) -> int:
    """Index of the edge of a polygon whose outer normal is most against a direction."""
    best, least = 0, np.inf
    n = len(corners)
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        edge_x, edge_y = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        along = (edge_y * normal[0] - edge_x * normal[1]) / math.sqrt(edge_x**2 + edge_y**2)
        if along < least:
            best, least = i, along
    return best


@kernel
def _faces(corners: FloatArray, others: FloatArray) -> tuple[int, float]:
    """Index of the face of a convex polygon that is furthest from another, and its gap [m]."""
    best, furthest = 0, -np.inf
    n = len(corners)
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        edge_x, edge_y = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        length = math.sqrt(edge_x * edge_x + edge_y * edge_y)
        gap = np.inf
        for k in range(len(others)):
            offset_x, offset_y = others[k, 0] - corners[i, 0], others[k, 1] - corners[i, 1]
            gap = min(gap, (offset_x * edge_y - offset_y * edge_x) / length)
        if gap > furthest:
            best, furthest = i, gap
    return best, furthest


@kernel
def _meet_polygon(box: FloatArray, corners: FloatArray, found: FloatArray) -> int:
    """Contacts of a convex polygon with the box, both counterclockwise, in the box's frame."""
    face, gap = _faces(box, corners)
    if gap > MARGIN:
        return 0
    other_face, other_gap = _faces(corners, box)
    if other_gap > MARGIN:
        return 0
    of_box = gap > other_gap - 1e-4
    holder, other = (box, corners) if of_box else (corners, box)
    i = face if of_box else other_face
    j = i + 1 if i + 1 < len(holder) else 0
    edge_x, edge_y = holder[j, 0] - holder[i, 0], holder[j, 1] - holder[i, 1]
    length = math.sqrt(edge_x * edge_x + edge_y * edge_y)
    normal = (edge_y / length, -edge_x / length)
    k = _most_against(other, normal)
    m = k + 1 if k + 1 < len(other) else 0
    return _clip(
        found,
        (other[k, 0], other[k, 1]),
        (other[m, 0], other[m, 1]),
        (holder[i, 0], holder[i, 1]),
        normal,
        length,
        1.0 if of_box else -1.0,
    )


@kernel
def _contacts(
    state: FloatArray,
    box: FloatArray,
    outlines: FloatArray,
    sizes: IntArray,
    circles: FloatArray,
    found: FloatArray,
) -> int:
    """Number of contacts of the object with the box; they are in the box's frame."""
    yaw = state[OBJECT + 2] - state[BASE + 2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    back_cos, back_sin = math.cos(state[BASE + 2]), math.sin(state[BASE + 2])
    away_x, away_y = state[OBJECT] - state[BASE], state[OBJECT + 1] - state[BASE + 1]
    x, y = back_cos * away_x + back_sin * away_y, back_cos * away_y - back_sin * away_x
    count, first = 0, 0
    for row in range(len(circles)):
        there_x = x + cos * circles[row, 0] - sin * circles[row, 1]
        there_y = y + sin * circles[row, 0] + cos * circles[row, 1]
        count += _meet_circle(
            there_x, there_y, circles[row, 2], box[0, 0], box[1, 0], box[2, 1], found[count:]
        )
    for size in sizes:
        corners = np.empty((size, 2))
        for k in range(size):
            corner_x, corner_y = outlines[first + k]
            corners[k, 0] = x + cos * corner_x - sin * corner_y
            corners[k, 1] = y + sin * corner_x + cos * corner_y
        count += _meet_polygon(box, corners, found[count:])
        first += size
    return count


@kernel
def _solve(
    speed: FloatArray,
    base: tuple[float, float, float],
    arms: FloatArray,
    found: FloatArray,
    count: int,
    levers: FloatArray,
    limits: FloatArray,
    floor: FloatArray,
    pushes: FloatArray,
    numbers: FloatArray,
    iterations: int,
) -> None:
    """Solve for the impulses of floor and box, and so for the object's velocity (Gauss-Seidel).

    Args:
        speed: shape (3,), of the object; changed.
        base: velocity of the box at its origin, and its yaw rate.
        arms: shape (count, 4), from the object's centre of mass and from the box's origin to each
            contact.
        found: shape (count, 5), with normals in the world, and gaps.
        count: of contacts.
        levers: shape (n, 2), from the centre of mass to the supports.
        limits: shape (n,), of the impulses of friction there.
        floor: shape (n, 2), these impulses; those of the last step to begin with.
        pushes: shape (count, 2), along the normal and across it; changed.
        numbers: 1/mass, 1/inertia, friction with the box, step.
        iterations: of Gauss-Seidel.
    """
    light, nimble, friction, step = numbers
    for k in range(len(levers)):
        size = math.sqrt(floor[k, 0] ** 2 + floor[k, 1] ** 2)
        if size > limits[k]:
            floor[k, 0] *= limits[k] / size
            floor[k, 1] *= limits[k] / size
        speed[0] += light * floor[k, 0]
        speed[1] += light * floor[k, 1]
        speed[2] += nimble * (levers[k, 0] * floor[k, 1] - levers[k, 1] * floor[k, 0])
    for _ in range(iterations):
        for k in range(len(levers)):
            x, y = levers[k]
            response = light + nimble * (x * x + y * y)
            new_x = floor[k, 0] - (speed[0] - speed[2] * y) / response
            new_y = floor[k, 1] - (speed[1] + speed[2] * x) / response
            size = math.sqrt(new_x * new_x + new_y * new_y)
            if size > limits[k]:
                new_x *= limits[k] / size
                new_y *= limits[k] / size
            more_x, more_y = new_x - floor[k, 0], new_y - floor[k, 1]
            floor[k, 0], floor[k, 1] = new_x, new_y
            speed[0] += light * more_x
            speed[1] += light * more_y
            speed[2] += nimble * (x * more_y - y * more_x)
        for c in range(count):
            x, y, base_x, base_y = arms[c]
            normal_x, normal_y, gap = found[c, 2], found[c, 3], found[c, 4]
            for across in (True, False):
                axis_x, axis_y = (-normal_y, normal_x) if across else (normal_x, normal_y)
                lever = x * axis_y - y * axis_x
                slip_x = speed[0] - speed[2] * y - base[0] + base[2] * base_y
                slip_y = speed[1] + speed[2] * x - base[1] - base[2] * base_x
                slip = axis_x * slip_x + axis_y * slip_y
                response = light + nimble * lever * lever
                if across:
                    most = friction * pushes[c, 0]
                    new = min(max(pushes[c, 1] - slip / response, -most), most)
                    more, pushes[c, 1] = new - pushes[c, 1], new
                else:
                    bias = gap / step if gap > 0.0 else RECOVERY * min(gap + SLOP, 0.0) / step
                    new = max(pushes[c, 0] - (slip + bias) / response, 0.0)
                    more, pushes[c, 0] = new - pushes[c, 0], new
                speed[0] += light * more * axis_x
                speed[1] += light * more * axis_y
                speed[2] += nimble * more * lever


@kernel
def advance(
    state: FloatArray,
    floor: FloatArray,
    twist: tuple[float, float, float],
    box: FloatArray,
    outlines: FloatArray,
    sizes: IntArray,
    circles: FloatArray,
    supports: FloatArray,
    body: FloatArray,
    steps: int,
    iterations: int,
    touched: FloatArray,
) -> int:
    """Advance the state by one cycle, in which the base moves at a velocity in the world.

    Args:
        state: shape (STATE,); changed.
        floor: shape (n, 2), impulses of friction at the supports; changed.
        twist: of the base: x, y [m/s] in the world, and yaw rate [rad/s].
        box: shape (4, 2), corners of the base in its frame, from the rear right counterclockwise.
        outlines: shape (m, 2), corners of all polygons, about the centre of mass.
        sizes: number of corners of each polygon.
        circles: shape (k, 3), middle and radius of each circle.
        supports: shape (n, 3), points of support, and the greatest force of friction there.
        body: mass, inertia, friction with the base, duration of a step.
        steps: of the cycle.
        iterations: of the solver.
        touched: shape (steps · MOST, 6), takes the contacts that press: step, position and normal
            into the base in the base's frame, force [N].

    Returns:
        Number of these contacts.
    """
    mass, inertia, friction, step = body
    numbers = np.array([1.0 / mass, 1.0 / inertia, friction, step])
    found, arms, pushes = np.empty((MOST, 5)), np.empty((MOST, 4)), np.zeros((MOST, 2))
    local = np.empty((MOST, 5))
    levers, limits = np.empty((len(supports), 2)), np.empty(len(supports))
    speed = state[SPEED : SPEED + 3]
    rows = last = 0
    for at in range(steps):
        count = _contacts(state, box, outlines, sizes, circles, local)
        if count == 0 and abs(speed[0]) + abs(speed[1]) + abs(speed[2]) < REST:
            speed[:] = 0.0
            floor[:] = 0.0
            last = 0
        else:
            if count != last:
                pushes[:] = 0.0
            last = count
            cos, sin = math.cos(state[BASE + 2]), math.sin(state[BASE + 2])
            for c in range(count):
                x, y, normal_x, normal_y = local[c, 0], local[c, 1], local[c, 2], local[c, 3]
                arms[c, 2], arms[c, 3] = cos * x - sin * y, sin * x + cos * y
                arms[c, 0] = state[BASE] + arms[c, 2] - state[OBJECT]
                arms[c, 1] = state[BASE + 1] + arms[c, 3] - state[OBJECT + 1]
                found[c, 2] = cos * normal_x - sin * normal_y
                found[c, 3] = sin * normal_x + cos * normal_y
                found[c, 4] = local[c, 4]
                normal, across = pushes[c, 0], pushes[c, 1]
                push_x = found[c, 2] * normal - found[c, 3] * across
                push_y = found[c, 3] * normal + found[c, 2] * across
                speed[0] += push_x / mass
                speed[1] += push_y / mass
                speed[2] += (arms[c, 0] * push_y - arms[c, 1] * push_x) / inertia
            cos, sin = math.cos(state[OBJECT + 2]), math.sin(state[OBJECT + 2])
            for k in range(len(supports)):
                x, y = supports[k, 0], supports[k, 1]
                levers[k, 0], levers[k, 1] = cos * x - sin * y, sin * x + cos * y
                limits[k] = supports[k, 2] * step
            _solve(
                speed, twist, arms, found, count, levers, limits, floor, pushes, numbers, iterations
            )
        for axis in range(3):
            state[OBJECT + axis] += step * speed[axis]
            state[BASE + axis] += step * twist[axis]
        for c in range(count):
            if pushes[c, 0] > 0.0 and rows < len(touched):
                touched[rows, 0] = at
                touched[rows, 1], touched[rows, 2] = local[c, 0], local[c, 1]
                touched[rows, 3], touched[rows, 4] = -local[c, 2], -local[c, 3]
                touched[rows, 5] = pushes[c, 0] / step
                rows += 1
    return rows


@kernel
def _press(
    touched: FloatArray, steps: int, strip: FloatArray, activation: float, taxels: FloatArray
) -> None:
    """Mean force on each taxel of a strip; a point presses the two nearest."""
    facing_x, facing_y, along_x, along_y, middle, pitch, _ = strip
    n = len(taxels)
    for row in range(len(touched)):
        if -(touched[row, 3] * facing_x + touched[row, 4] * facing_y) < FACING:
            continue
        position = touched[row, 1] * along_x + touched[row, 2] * along_y - middle
        position = min(max(position / pitch + (n - 1) / 2.0, 0.0), n - 1.0)
        lower = min(int(position), n - 2)
        share, force = position - lower, touched[row, 5] / steps
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
    """Contacts as skin, generator `tactile` and integrator report them: runs of pressed taxels.

    Args:
        touched: shape (n, 6), as `advance` wrote it.
        steps: of the cycle.
        strips: shape (s, 7), of each strip of the skin its outer normal (x, y), the direction along
            it (x, y), its middle along that direction [m], pitch [m] and number of its taxels.
        activation: least mean force over the cycle at which a taxel responds [N].
        threshold: least likelihood at which a taxel counts.
        p_max: the largest likelihood.
        found: takes strip, position along it [m], variance [m²] and likelihood of each run.

    Returns:
        Number of runs.
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
