"""Ports of underwater housings: refraction at a flat or spherical pane of glass between air and water.

A camera in a housing looks through air, glass and water. Its rays bend at the inner and at the outer face of the
glass, so its images are no central projections. The camera model itself stays as it is: it gets the *apparent point*
instead of the point, and its derivatives are multiplied by those of the apparent point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.model.lens import CameraModel, Projection
from mor.types import FloatArray
from mor.units import LENGTH, NUMBER, Component

# ---- The two faces of a port, g(Q) = 0, with g growing towards the water.
#
#     flat     g = N·Q − h       N = (tilt_x, tilt_y, −1) / |…|      h = distance, distance + glass
#     dome     g = |Q − C| − R   C = (centre_x, centre_y, centre_z)   R = radius, radius + glass
#
# Q, N, C are in the image system: the projection centre is 0, the camera looks along −z.


class _Face(NamedTuple):
    """The points at which n rays meet a face.

    The rays are the last axis of all arrays, which makes them several times faster.
    """

    reach: FloatArray
    """(n,) λ: the ray Q + λ d meets the face."""
    normal: FloatArray
    """(3, n) unit normal m = ∂g/∂Q there."""
    by_place: FloatArray
    """(3, 3, n) ∂m/∂Q."""
    shift: FloatArray
    """(k, n) ∂g/∂q by the k parameters of the port."""
    turn: FloatArray
    """(3, k, n) ∂m/∂q."""


def _flat_face(port: FloatArray, place: FloatArray, direction: FloatArray, outer: bool) -> _Face:
    normal = np.stack([port[0], port[1], np.full_like(port[0], -1.0)])
    length = np.sqrt(_dot(normal, normal))
    normal /= length
    reach = (port[2] + port[3] * outer - _dot(normal, place)) / _dot(normal, direction)
    turn = np.zeros((3, *port.shape))
    turn[:, :2] = _across(normal)[:, :2] / length
    shift = _dot((place + reach * direction)[:, None], turn)
    shift[2] = -1.0
    shift[3] = -float(outer)
    return _Face(reach, normal, np.zeros((3, 3, 1)), shift, turn)


def _dome_face(port: FloatArray, place: FloatArray, direction: FloatArray, outer: bool) -> _Face:
    from_centre = place - port[:3]
    radius = port[3] + port[4] * outer
    back = _dot(from_centre, direction)
    reach = np.sqrt(back**2 + radius**2 - _dot(from_centre, from_centre)) - back
    normal = (from_centre + reach * direction) / radius
    by_place = _across(normal) / radius
    shift, turn = np.zeros(port.shape), np.zeros((3, *port.shape))
    shift[:3], shift[3], shift[4] = -normal, -1.0, -float(outer)
    turn[:, :3] = -by_place
    return _Face(reach, normal, by_place, shift, turn)


class Port(NamedTuple):
    """A kind of port. Its last four parameters are the thickness of the glass and the three refractive indices."""

    key: str
    components: tuple[Component, ...]
    face: Callable[[FloatArray, FloatArray, FloatArray, bool], _Face]


_GLASS = (
    Component("glass", LENGTH, math.nan),
    Component("n_air", NUMBER, 1.0),
    Component("n_glass", NUMBER, math.nan),
    Component("n_water", NUMBER, math.nan),
)
FLAT_PORT = Port(
    "flat-port",
    (*(Component(name, NUMBER) for name in ("tilt_x", "tilt_y")), Component("distance", LENGTH, math.nan), *_GLASS),
    _flat_face,
)
DOME_PORT = Port(
    "dome-port",
    (*(Component(f"centre_{axis}", LENGTH) for axis in "xyz"), Component("radius", LENGTH, math.nan), *_GLASS),
    _dome_face,
)
PORTS = (FLAT_PORT, DOME_PORT)


# ---- The ray through a port, and the apparent point.
#
# Unfold the path of a ray from the projection centre to a point P into a straight line of the same length ℓ,
# in the direction d that the ray has in the air. Its end is the apparent point A = ℓ d. Path tracing is a
# smooth map T of A to P. At each face, with the unit normal m, c = m·d and η = n/n' of the media before and
# after it (Snell's law as a vector):
#
#     λ  from g(Q + λ d) = 0         Q ← Q + λ d         ℓ ← ℓ − λ
#     s  = √(1 − η² (1 − c²))        d ← η d + (s − η c) m
#
# and at the end P = Q + ℓ d. Where all indices are equal, T is the identity, and A is the point itself.
# The derivatives go along; that of λ follows from g = 0:
#
#     dλ = −(m·(dQ + λ dd) + ∂g/∂q dq) / c
#
# A is found from P by Newton's method, and T(A, q) = P gives its derivatives by the point and by the
# parameters q of the port:
#
#     ∂A/∂P = (∂T/∂A)⁻¹              ∂A/∂q = −(∂T/∂A)⁻¹ ∂T/∂q
#
# Source: the path is that of R. Kotowski, Phototriangulation in multi-media photogrammetry, IAPRS 27-B5 (1988);
# the apparent point makes it independent of the camera model.


class Apparent(NamedTuple):
    """Apparent points and their derivatives."""

    star: FloatArray
    """(n, 3) in the image system; NaN where no ray through the port reaches the point."""
    by_star: FloatArray
    """(n, 3, 3) by the points."""
    by_port: FloatArray
    """(n, 3, k) by the parameters of the port."""


def apparent_points(port: Port, star: FloatArray, parameters: FloatArray) -> Apparent:
    """Return where points (n, 3) in the image system seem to be through a port of the ``parameters`` (n, k)."""
    points, q = star.T.copy(), parameters.T.copy()
    found, off = points.copy(), np.full(len(star), np.inf)
    distance = np.sqrt(_dot(points, points))
    # Last step, as a part of the distance: Newton's method doubles the digits, so the next one is round-off.
    enough = 1e-9
    with np.errstate(all="ignore"):
        for _ in range(20):
            left = np.flatnonzero(off > enough)
            if len(left) == 0:
                break
            reached, by = _trace(port, found[:, left], q[:, left], by_port=False)
            step = _product(_inverted(by), (points[:, left] - reached)[:, None])[:, 0]
            found[:, left] += step
            off[left] = np.sqrt(_dot(step, step)) / distance[left]
        _, by = _trace(port, found, q, by_port=True)
        inverse = _inverted(by[:, :3])
        by_port = -_product(inverse, by[:, 3:])
    found[:, ~(off <= enough)] = np.nan
    # Derivatives, as parts of the distance, that are none: those by the radius of a dome round the projection centre.
    round_off = 1e-12
    by_port[np.abs(by_port) < round_off * distance] = 0.0
    return Apparent(found.T, np.moveaxis(inverse, 2, 0), np.moveaxis(by_port, 2, 0))


def _trace(port: Port, apparent: FloatArray, parameters: FloatArray, *, by_port: bool) -> tuple[FloatArray, FloatArray]:
    """Points T (3, n) that are seen as ``apparent`` (3, n), and their derivatives (3, 3, n) by the apparent points.

    ``by_port`` appends those by the k ``parameters`` (k, n): (3, 3 + k, n).
    """
    k, n = parameters.shape
    size = 3 + k * by_port
    left = np.sqrt(_dot(apparent, apparent))
    direction = apparent / left
    by_left, by_direction = np.zeros((size, n)), np.zeros((3, size, n))
    by_left[:3] = direction
    by_direction[:, :3] = _across(direction) / left
    place, by_place = np.zeros((3, n)), np.zeros((3, size, n))
    for outer in (False, True):
        face = port.face(parameters, place, direction, outer)
        m, c = face.normal, _dot(face.normal, direction)
        by_place = by_place + face.reach * by_direction
        by_reach = _dot(m[:, None], by_place)
        by_reach[3:] += face.shift[: size - 3]
        by_reach /= -c
        place = place + face.reach * direction
        by_place += direction[:, None] * by_reach
        left, by_left = left - face.reach, by_left - by_reach

        before, after = parameters[outer - 3], parameters[outer - 2]
        ratio, by_ratio = before / after, np.zeros((3 + k, n))
        by_ratio[outer - 3], by_ratio[outer - 2] = 1.0 / after, -ratio / after
        by_ratio = by_ratio[:size]
        by_m = _product(face.by_place, by_place)
        by_m[:, 3:] += face.turn[:, : size - 3]
        by_c = _dot(direction[:, None], by_m) + _dot(m[:, None], by_direction)
        s = np.copysign(np.sqrt(1.0 - ratio**2 * (1.0 - c**2)), c)
        by_s = (ratio**2 * c * by_c - ratio * (1.0 - c**2) * by_ratio) / s
        bend, by_bend = s - ratio * c, by_s - ratio * by_c - c * by_ratio
        by_direction = ratio * by_direction + direction[:, None] * by_ratio + bend * by_m + m[:, None] * by_bend
        direction = ratio * direction + bend * m
    return place + left * direction, by_place + left * by_direction + direction[:, None] * by_left


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products (3, k, n) of matrices (3, 3, n) and (3, k, n)."""
    return np.stack([_dot(row[:, None], b) for row in a])


def _across(direction: FloatArray) -> FloatArray:
    """I − u uᵀ (3, 3, n) of unit vectors u (3, n)."""
    return np.asarray(np.eye(3)[:, :, None] - direction[:, None] * direction)


def _inverted(matrix: FloatArray) -> FloatArray:
    """Inverses of matrices (3, 3, n) by their adjugates; not finite where there is none."""
    a, b, c = matrix
    columns = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    return np.asarray(columns / _dot(a, columns[:, 0]))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.stack([a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))])


def behind(port: Port, lens: CameraModel) -> CameraModel:
    """Return the model of a camera with this lens behind a port: its components are those of the lens and of the port.

    ``lens`` must look along straight rays through one projection centre.
    """
    own = len(lens.components)

    def project(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
        seen = apparent_points(port, star, interior[:, own:])
        projection = lens.project(seen.star, interior[:, :own], constants, measured)
        by_port = projection.by_star @ seen.by_port
        return Projection(
            projection.xy, projection.by_star @ seen.by_star, np.concatenate([projection.by_interior, by_port], axis=2)
        )

    return lens._replace(
        key=f"{lens.key}+{port.key}",
        components=(*lens.components, *port.components),
        project=project,
        sees_behind=lens.sees_behind and port is not FLAT_PORT,
    )
