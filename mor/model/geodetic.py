"""Observations on the curved Earth: GNSS vectors, geodetic and projected coordinates, plumb lines, heights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mor.model.contract import (
    BETWEEN_SLOTS,
    FROM_TO,
    POSITIONS,
    Computed,
    Equation,
    ObservationType,
    Reference,
    Slot,
    spatial_length,
)
from mor.model.coordinates import LEVEL, LOCAL
from mor.model.earth import Horizon
from mor.model.rotations import angles_by_tangent, angles_from_rotation, rotation_from_angles
from mor.model.terrestrial import (
    ANGLE_TYPE,
    BEARING,
    DIRECTIONS,
    DISTANCE,
    DISTANCE_RATIO,
    HORIZONTAL_DISTANCE,
    SPATIAL_ANGLE,
    VERTICAL_DIRECTION,
    ZENITH_ANGLE,
    ZENITH_DIRECTIONS,
)
from mor.types import BoolArray, FloatArray
from mor.units import ANGLE, LENGTH, NUMBER, Component

# ---- Verticals at the ends of an observation on the earth, and marks lifted to instrument and target.

DEFLECTIONS = ("deflection_north", "deflection_east")
"""ξ and η of the plumb line, north and east positive: the astronomic zenith lies there from the geodetic one."""
GEOID = "geoid"
"""Height N of the geoid above the ellipsoid."""


def end_constants(ends: Sequence[str], names: Sequence[str]) -> tuple[Component, ...]:
    """Constants of a type that belong to the points at its ends: ``geoid of from``."""
    quantities = {**dict.fromkeys(DEFLECTIONS, ANGLE), GEOID: LENGTH}
    return tuple(Component(f"{name} of {end}", quantities[name]) for end in ends for name in names)


class End(NamedTuple):
    """Slots of one end of an observation."""

    name: str
    position: int
    height: int
    """−1 where the type knows no height of instrument or target there."""


def ends_of(type_: ObservationType) -> tuple[End, ...]:
    """The ends of a type in the order of their positions: the first is where the instrument stands."""
    slots = {(slot.of, slot.part): k for k, slot in enumerate(type_.slots)}
    names = [slot.of for slot in type_.slots if slot.part == "position"]
    return tuple(End(name, slots[name, "position"], slots.get((name, "height"), -1)) for name in dict.fromkeys(names))


# ---- Distances that were reduced: to the ellipsoid (chord and arc), to the geoid, and by the heights of their ends.
#
# The chord c joins the feet of both marks on the ellipsoid. The arc above it is that of the circle with
# Euler's radius R in the azimuth of the line at its middle, s = 2R asin(c / 2R).


class Reduced(NamedTuple):
    """A length (n,) with its derivatives (n, 3) by both ends."""

    length: FloatArray
    by_start: FloatArray
    by_end: FloatArray


def chord(horizon: Horizon, start: FloatArray, end: FloatArray) -> tuple[Reduced, FloatArray]:
    """The chord between the feet on the ellipsoid, and Euler's radius (n,) in its direction."""
    feet, moves = zip(*(foot_with_derivatives(horizon, place) for place in (start, end)), strict=True)
    length, by_vector = spatial_length(feet[1] - feet[0])
    middle = 0.5 * (start + end)
    M, N = horizon.ellipsoid.radii(horizon.to_geodetic(middle)[:, 0])
    along = np.einsum("nij,nj->ni", horizon.local_axes(middle), by_vector)
    north = along[:, 1] ** 2 / np.maximum(along[:, 0] ** 2 + along[:, 1] ** 2, np.finfo(float).tiny)
    radius = 1.0 / (north / M + (1.0 - north) / N)
    by_ends = [np.einsum("nj,nji->ni", by_vector, move) for move in moves]
    return Reduced(length, -by_ends[0], by_ends[1]), radius


def foot_with_derivatives(horizon: Horizon, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Feet (n, 3) on the ellipsoid and their derivatives (n, 3, 3) by the positions."""
    foot = horizon.foot(position)
    M, N = horizon.ellipsoid.radii(horizon.to_geodetic(position)[:, 0])
    axes = horizon.local_axes(position)
    shrinking = np.stack([N / (N + foot.height), M / (M + foot.height), np.zeros_like(M)], axis=1)
    return foot.position, np.einsum("nki,nk,nkj->nij", axes, shrinking, axes)


def arc(horizon: Horizon, start: FloatArray, end: FloatArray) -> tuple[Reduced, FloatArray]:
    """The arc on the ellipsoid, and Euler's radius."""
    straight, radius = chord(horizon, start, end)
    half = straight.length / (2.0 * radius)
    growth = (1.0 / np.sqrt(1.0 - half**2))[:, None]
    bent = Reduced(2.0 * radius * np.arcsin(half), straight.by_start * growth, straight.by_end * growth)
    return bent, radius


def by_heights(horizon: Horizon, start: FloatArray, end: FloatArray) -> Reduced:
    """√(s² − Δh²) of the slope distance s and the ellipsoidal heights."""
    vector = end - start
    low, high = horizon.foot(start), horizon.foot(end)
    rise = high.height - low.height
    length = np.sqrt(np.maximum(np.sum(vector**2, axis=1) - rise**2, np.finfo(float).tiny))
    by_start = (-vector + rise[:, None] * low.up) / length[:, None]
    by_end = (vector - rise[:, None] * high.up) / length[:, None]
    return Reduced(length, by_start, by_end)


def ellipsoid_chord(horizon: Horizon) -> ObservationType:
    """The straight line between the feet."""
    return _type("ellipsoid_chord", lambda start, end, _: chord(horizon, start, end)[0])


def ellipsoid_arc(horizon: Horizon) -> ObservationType:
    """The arc on the ellipsoid."""
    return _type("ellipsoid_arc", lambda start, end, _: arc(horizon, start, end)[0])


def height_reduced_distance(horizon: Horizon) -> ObservationType:
    """Return the slope distance reduced with the heights of its ends."""
    return _type("height_reduced_distance", lambda start, end, _: by_heights(horizon, start, end))


def mean_sea_level_distance(horizon: Horizon) -> ObservationType:
    """The arc at the height of the geoid, s (1 + N/R) with the mean N of both ends."""

    def length(start: FloatArray, end: FloatArray, geoid: FloatArray) -> Reduced:
        on_ellipsoid, radius = arc(horizon, start, end)
        growth = 1.0 + 0.5 * (geoid[:, 0] + geoid[:, 1]) / radius
        by_ends = (by * growth[:, None] for by in (on_ellipsoid.by_start, on_ellipsoid.by_end))
        return Reduced(on_ellipsoid.length * growth, *by_ends)

    return _type("mean_sea_level_distance", length, end_constants(["from", "to"], [GEOID]))


def _type(
    key: str, length: Callable[[FloatArray, FloatArray, FloatArray], Reduced], constants: tuple[Component, ...] = ()
) -> ObservationType:

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        start, end, meter = blocks
        reduced = length(start, end, constants)
        scale = meter[:, :1]
        computed = (reduced.length[:, None] - meter[:, 1:]) / scale
        by_ends = ((by / scale)[:, None, :] for by in (reduced.by_start, reduced.by_end))
        by_meter = np.stack([-computed / scale, -1.0 / scale], axis=2)
        return Computed(computed, (*by_ends, by_meter))

    return ObservationType(
        key=key,
        drawn="distance",
        components=(Component("distance", LENGTH),),
        references=FROM_TO,
        slots=(
            Slot("point", "from", "position"),
            Slot("point", "to", "position"),
            Slot("distance meter", "instrument", "distance meter"),
        ),
        equation=equation,
        constants=constants,
        distances=("from", "to"),
    )


# ---- Control points on the earth: the shift of a position from where it was given, in east, north, up of the place.


def control(horizon: Horizon) -> ObservationType:
    """(east, north, up) from the given place, whose object coordinates are the constants; observed as zero."""

    def equation(blocks: Sequence[FloatArray], given: FloatArray) -> Computed:
        axes = horizon.local_axes(given)
        return Computed(np.einsum("nij,nj->ni", axes, blocks[0] - given), (axes,))

    return ObservationType(
        key="control",
        components=(Component("east", LENGTH), Component("north", LENGTH), Component("up", LENGTH)),
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"),),
        equation=equation,
        constants=tuple(Component(f"given {name}", LENGTH) for name in "xyz"),
    )


# ---- Observed latitude, longitude and height of a position; heights alone, above the ellipsoid and above the geoid.


def _of_position(key: str, components: tuple[Component, ...], equation: Equation) -> ObservationType:
    return ObservationType(
        key=key,
        components=components,
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"),),
        equation=equation,
    )


def geodetic_position(horizon: Horizon) -> ObservationType:
    """(φ, λ, h): geodetic latitude, longitude, ellipsoidal height."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        geodetic = horizon.to_geodetic(blocks[0])
        by_position = horizon.local_axes(blocks[0])[:, [1, 0, 2]]
        M, N = horizon.ellipsoid.radii(geodetic[:, 0])
        by_position[:, 0] /= (M + geodetic[:, 2])[:, None]
        by_position[:, 1] /= ((N + geodetic[:, 2]) * np.cos(geodetic[:, 0]))[:, None]
        return Computed(geodetic, (by_position,))

    components = (Component("latitude", ANGLE), Component("longitude", ANGLE), Component("height", LENGTH))
    return _of_position("geodetic_position", components, equation)


def ellipsoidal_height(horizon: Horizon) -> ObservationType:
    """h, along the normal of the ellipsoid."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        foot = horizon.foot(blocks[0])
        return Computed(foot.height[:, None], (foot.up[:, None, :],))

    return _of_position("ellipsoidal_height", (Component("height", LENGTH),), equation)


def orthometric_height(horizon: Horizon) -> ObservationType:
    """H = h − N, above the geoid (or quasigeoid) that N is of."""
    above_ellipsoid = ellipsoidal_height(horizon).equation

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        height = above_ellipsoid(blocks, constants)
        return Computed(height.values - constants, height.jacobians)

    found = _of_position("orthometric_height", (Component("height", LENGTH),), equation)
    return found._replace(constants=end_constants(["point"], [GEOID]))


# ---- GNSS vectors and positions in geocentric axes of a reference frame of their own.
#
# The frame of a GNSS solution may lie, turn and scale a little differently from that of the points. About the
# origin X₀ of the object system, the middle of the network,
#
#     X_obs = X₀ + t + m R (X − X₀),    ΔX_obs = m R ΔX,    R = R_z(r_z) R_y(r_y) R_x(r_x)
#
# with right-handed turns of the vectors about the geocentric axes (the *position vector* convention). About
# the geocentre the shift would differ, t − (m R − 1) X₀, and could hardly be told from the turn.

_MIDDLE = np.array([0.0, 0.0, 1.0])
"""Normal at the middle of the network: near enough for the derivative by heights that are all 0."""
_FRAME_SLOT = Slot("gnss frame", "instrument", "gnss frame")
_AXES = np.eye(3)
_TURNS = np.array([np.cross(axis, _AXES).T for axis in _AXES])
"""(3, 3, 3) matrices of the vector products with the axes."""


class _SatelliteVectors(NamedTuple):
    """Vectors (n, 3) in the frame of the satellites."""

    values: FloatArray
    by_vector: FloatArray
    """(n, 3, 3) by the vector in geocentric axes."""
    by_frame: FloatArray
    """(n, 3, 7) by shift, turn and scale."""


def _in_frame(vector: FloatArray, frame: FloatArray) -> _SatelliteVectors:
    """m R of geocentric vectors (n, 3); the shift (n, 3) in front of it is not added."""
    about = [_about(k, frame[:, 3 + k]) for k in range(3)]
    R = about[2] @ about[1] @ about[0]
    matrix = frame[:, 6:, None] * R
    values = np.einsum("nij,nj->ni", matrix, vector)
    by_frame = np.zeros((len(vector), 3, 7))
    by_frame[:, :, :3] = _AXES
    by_frame[:, :, 3] = np.einsum("nij,jk,nk->ni", matrix, _TURNS[0], vector)
    turned = np.einsum("nij,nj->ni", about[1] @ about[0], vector)
    by_frame[:, :, 4] = frame[:, 6:] * np.einsum("nij,jk,nk->ni", about[2], _TURNS[1], turned)
    by_frame[:, :, 5] = values @ _TURNS[2].T
    by_frame[:, :, 6] = values / frame[:, 6:]
    return _SatelliteVectors(values, matrix, by_frame)


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """(n, 3, 3) right-handed turns about one axis."""
    K = _TURNS[axis]
    sine, versine = np.sin(angle)[:, None, None], 2.0 * (np.sin(0.5 * angle) ** 2)[:, None, None]
    return np.asarray(_AXES + sine * K + versine * (K @ K))


def gnss_vector(horizon: Horizon) -> ObservationType:
    """Geocentric (ΔX, ΔY, ΔZ) between marks, or between antennas at heights along the normals above them."""
    turn = horizon.axes.T

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        start, start_height, end, end_height, frame = blocks
        vector = end - start
        up_start = up_end = np.broadcast_to(_MIDDLE, vector.shape)
        if start_height.any() or end_height.any():  # from mark to mark nothing needs the normals
            up_start, up_end = np.split(horizon.foot(np.concatenate([start, end])).up, 2)
            vector = vector + end_height * up_end - start_height * up_start
        there = _in_frame(vector @ turn.T, frame)
        there.by_frame[:, :, :3] = 0.0  # vectors know nothing of a shift
        by_end = there.by_vector @ turn
        by_heights = [np.einsum("nij,nj->ni", by_end, up)[:, :, None] for up in (up_start, up_end)]
        return Computed(there.values, (-by_end, -by_heights[0], by_end, by_heights[1], there.by_frame))

    return ObservationType(
        key="gnss_vector",
        drawn="vector",
        components=(Component("dx", LENGTH), Component("dy", LENGTH), Component("dz", LENGTH)),
        references=FROM_TO,
        slots=(*BETWEEN_SLOTS, _FRAME_SLOT),
        equation=equation,
        distances=("from", "to"),
        between_marks=True,
    )


def gnss_position(horizon: Horizon) -> ObservationType:
    """Geocentric (X, Y, Z) of a position."""
    turn = horizon.axes.T

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, frame = blocks
        there = _in_frame(position @ turn.T, frame)
        return Computed(horizon.origin + frame[:, :3] + there.values, (there.by_vector @ turn, there.by_frame))

    return ObservationType(
        key="gnss_position",
        components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"), _FRAME_SLOT),
        equation=equation,
    )


# ---- Height differences on the earth: of heights above the geoid, as levels give them, and above the ellipsoid.


def ellipsoidal_height_difference(horizon: Horizon) -> ObservationType:
    """Δh = h(to) − h(from), with the heights of instrument and target above their marks."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        start, start_height, end, end_height = blocks
        below, above = horizon.foot(start), horizon.foot(end)
        one = np.ones((len(start), 1, 1))
        difference = (above.height - below.height)[:, None] + end_height - start_height
        return Computed(difference, (-below.up[:, None, :], -one, above.up[:, None, :], one))

    return ObservationType(
        key="ellipsoidal_height_difference",
        drawn="levelling",
        components=(Component("dz", LENGTH),),
        references=FROM_TO,
        slots=BETWEEN_SLOTS,
        equation=equation,
        distances=("from", "to"),
        between_marks=True,
    )


def height_difference(horizon: Horizon) -> ObservationType:
    """ΔH = Δh − (N(to) − N(from)): levelled, with the corrections of its height system already on it."""
    plain = ellipsoidal_height_difference(horizon)

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        above_ellipsoid = plain.equation(blocks, constants)
        rise = constants[:, 1:] - constants[:, :1]
        return Computed(above_ellipsoid.values - rise, above_ellipsoid.jacobians)

    return ObservationType(
        key="height_difference",
        drawn=plain.drawn,
        components=plain.components,
        references=plain.references,
        slots=plain.slots,
        equation=equation,
        constants=end_constants(["from", "to"], [GEOID]),
        distances=plain.distances,
        between_marks=True,
    )


# ---- Observations about the vertical of their place: the twins of the terrestrial types on the earth.
#
# What an instrument measures refers to the vertical where it stands, and instrument and target are above
# their marks along the verticals there. With the local axes R (east, north, up; of the plumb line where its
# deflection is given) at the instrument, and the direction u_i to the zenith at each end,
#
#     X_i* = R (X_i + h_i u_i − X_instrument)
#
# are the positions the plain type sees, without heights. R and u are evaluated at the adjusted places; that
# they turn by 1/R_earth with every metre the place moves stays out of the Jacobian, never out of the
# function.


def about_plumb_line(type_: ObservationType, horizon: Horizon) -> ObservationType:
    """The twin of a type about the plumb line; constants besides its own: ξ, η at each end."""
    further = end_constants([end.name for end in ends_of(type_)], DEFLECTIONS)
    return _about_vertical(type_, horizon, (*type_.constants, *further))


def _about_vertical(type_: ObservationType, horizon: Horizon, constants: tuple[Component, ...]) -> ObservationType:
    ends, own_constants = ends_of(type_), len(type_.constants)
    deflected = len(constants) > own_constants

    def equation(blocks: Sequence[FloatArray], given: FloatArray) -> Computed:
        own = list(blocks)
        station = blocks[ends[0].position]
        axes = []
        for k, end in enumerate(ends):
            first = own_constants + 2 * k
            deflection = given[:, first : first + 2] if deflected else None
            axes.append(horizon.local_axes(blocks[end.position], deflection))
        for end, there in zip(ends, axes, strict=True):
            vector = blocks[end.position] - station
            if end.height >= 0:
                vector = vector + blocks[end.height] * there[:, 2]
                own[end.height] = np.zeros_like(blocks[end.height])
            own[end.position] = np.einsum("nij,nj->ni", axes[0], vector)
        computed = type_.equation(own, given[:, :own_constants])
        jacobians = list(computed.jacobians)
        for end, there in zip(ends, axes, strict=True):
            jacobians[end.position] = jacobians[end.position] @ axes[0]
            if end.height >= 0:
                jacobians[end.height] = jacobians[end.position] @ there[:, 2][:, :, None]
        return Computed(computed.values, tuple(jacobians))

    return type_._replace(constants=constants, equation=equation, about_local_vertical=True)


# ---- Observed coordinates in the projection of the project: antennas of cameras, control that is measured again.


def projected_position(horizon: Horizon) -> ObservationType:
    """(east, north, height) of a position, the projection linearised where the position was observed.

    Between there and the place of the adjustment lies a residual v: what is left out is of the order v²/R.
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        place, grid, observed = constants[:, :3], constants[:, 3:7].reshape(-1, 2, 2), constants[:, 7:]
        by_position = horizon.local_axes(place)
        by_position[:, :2] = grid @ by_position[:, :2]
        moved = np.einsum("nij,nj->ni", by_position, blocks[0] - place)
        return Computed(observed + moved, (by_position,))

    # Object coordinates of what was observed.
    given_place = tuple(Component(f"given {name}", LENGTH) for name in "xyz")
    # ∂(east, north)/∂(e, n) there: scale and convergence of the projection.
    grid_factors = tuple(Component(f"grid {name}", NUMBER) for name in ("ee", "en", "ne", "nn"))
    observed_coordinates = tuple(Component(f"observed {name}", LENGTH) for name in ("east", "north", "height"))
    return ObservationType(
        key="projected_position",
        components=tuple(Component(name, LENGTH) for name in ("east", "north", "height")),
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"),),
        equation=equation,
        constants=(*given_place, *grid_factors, *observed_coordinates),
    )


# ---- Bearings in the plane of a projection: of the straight line between both ends there, clockwise from grid north.
#
# The projection is a polynomial in the object coordinates x, y of the feet on the ellipsoid, in Chebyshev
# form over the area of the network, so that the solver knows of no library of projections:
#
#     (E, N) = Σ c_ij T_i(ξ) T_j(η),   t = atan2(E_to − E_from, N_to − N_from).


class ProjectionPolynomial(NamedTuple):
    """A projection as a polynomial over a rectangle of object coordinates."""

    middle: FloatArray
    """(2,) of the rectangle."""
    half: FloatArray
    """(2,) its sides, halved."""
    coefficients: FloatArray
    """(d + 1, d + 1, 2) of E and N, less those of a place of the area."""
    crs: str | None = None
    """What names the projection; ``None`` that of the network."""

    def holds(self, xy: FloatArray) -> BoolArray:
        """(n,) false where a foot (n, 2) is beyond the rectangle."""
        return np.asarray((np.abs(xy - self.middle) <= self.half).all(axis=1))

    def at(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """E, N (n, 2), less those of that place, at feet (n, 2), and their derivatives (n, 2, 2).

        Beyond the rectangle it goes on linearly.
        """
        from numpy.polynomial import chebyshev  # no network without a projection waits for it

        place = (xy - self.middle) / self.half
        inside = np.clip(place, -1.0, 1.0)
        x, y = inside.T
        values = np.asarray(chebyshev.chebval2d(x, y, self.coefficients)).T
        by = [
            np.asarray(chebyshev.chebval2d(x, y, chebyshev.chebder(self.coefficients, axis=k))).T / self.half[k]
            for k in range(2)
        ]
        derivatives = np.stack(by, axis=2)
        values = values + np.einsum("nij,nj->ni", derivatives, (place - inside) * self.half)
        return values, derivatives


@dataclass(frozen=True, eq=False)
class InPlane:
    """The equation of a bearing in the plane of a projection."""

    horizon: Horizon
    plane: ProjectionPolynomial

    def __call__(self, blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        """t of n lines, from blocks of both ends."""
        ends, moves = [], []
        for position in blocks:
            foot, by_position = foot_with_derivatives(self.horizon, position)
            there, by_foot = self.plane.at(foot[:, :2])
            ends.append(there)
            moves.append(by_foot @ by_position[:, :2])
        east, north = (ends[1] - ends[0]).T
        by_plane = np.stack([north, -east], axis=1) / (east**2 + north**2)[:, None]
        by_ends = [np.einsum("ni,nij->nj", by_plane, move)[:, None, :] for move in moves]
        return Computed(np.arctan2(east, north)[:, None], (-by_ends[0], by_ends[1]))


def projected_bearing(horizon: Horizon, plane: ProjectionPolynomial) -> ObservationType:
    """t in the plane of a projection."""
    return open_projection()._replace(equation=InPlane(horizon, plane))


def open_projection() -> ObservationType:
    """The type before anything says which projection is meant."""
    slots = tuple(Slot("point", end, "position") for end in ("from", "to"))
    return BEARING._replace(key="projected_bearing", references=FROM_TO, slots=slots, equation=_open)


def _open(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    raise AssertionError("a projection is still to be named")


def is_open(type_: ObservationType) -> bool:
    """Return True if the projection is still to be named."""
    return type_.equation is _open


# ---- Observed attitudes of images on the earth: ω, φ, κ in the axes of a projection; roll, pitch, yaw of navigation.
#
# With the local axes R (rows east, north, up) at the image, turned about the vertical by the convergence γ of the
# projection (from true to grid north, clockwise), an image that stands at D in object axes stands at
#
#     D′ = D Rᵀ Γᵀ,   Γ = (cos γ, −sin γ, 0; sin γ, cos γ, 0; 0, 0, 1)
#
# in the axes of the projection; for navigation γ = 0. The inertial system stands at B D′, with the
# misalignment B from the axes of the image to its own (boresight), I where nothing is said. Body axes are
# forward = y*, right = x*, down = −z* of the image, and R_body = R_z(yaw) R_y(pitch) R_x(roll) leads from
# them to north, east, down (ARINC 705), so that
#
#     yaw = atan2(D′21, D′22),   pitch = asin D′23,   roll = atan2(−D′13, D′33)
#
# with B D′ for D′. γ is that of a given place, or that at the image itself: in the plane (E, N) of the
# projection grid north keeps E as it is, so that γ = atan2(−∂E/∂n, ∂E/∂e) with the derivatives along local
# east e and north n.
#
# R and γ are evaluated at the adjusted place; that R turns by 1/R_earth with every metre, and γ by about as
# much, stays out of the Jacobian.

CONVERGENCE = Component("convergence", ANGLE)
"""Constant of a row: the direction of grid north, clockwise from true north; NaN: that at the image."""
Reading = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""From D′ (n, 3, 3) to its three angles (n, 3), and their derivatives (n, 3, 3) by a small rotation."""


def projected_attitude(horizon: Horizon, plane: ProjectionPolynomial | None = None) -> ObservationType:
    """ω, φ, κ of an image in the axes of the projection: grid east, grid north, up along the normal.

    Without its ``plane`` the convergence of every row has to be given.
    """
    equation = Attitude(_cardan, horizon, True, plane)
    return _attitude("projected_attitude", ("omega", "phi", "kappa"), equation, (CONVERGENCE,))


def navigation_attitude(horizon: Horizon) -> ObservationType:
    """Roll, pitch, yaw of an image against true north and the normal of its place."""
    equation = Attitude(_navigation, horizon, False)
    return _attitude("navigation_attitude", ("roll", "pitch", "yaw"), equation, ())


def rotation_from_navigation(angles: FloatArray) -> FloatArray:
    """D′ (n, 3, 3) of roll, pitch, yaw (n, 3), radians."""
    roll, pitch, yaw = angles.T
    sr, cr, sp, cp, sy, cy = (np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch), np.sin(yaw), np.cos(yaw))
    right = np.stack([sr * sp * sy + cr * cy, sr * sp * cy - cr * sy, -sr * cp], axis=1)
    forward = np.stack([cp * sy, cp * cy, sp], axis=1)
    up = np.stack([sr * cy - cr * sp * sy, -sr * sy - cr * sp * cy, cr * cp], axis=1)
    return np.stack([right, forward, up], axis=1)


def in_object_axes(
    type_: ObservationType, angles: FloatArray, constants: FloatArray, boresight: FloatArray
) -> FloatArray:
    """ω, φ, κ (n, 3) of images against east, north, up of observed angles (n, 3): what start values take for observed.

    ``boresight`` (n, 3, 3) is where the misalignments start. Where no convergence is given, it is that of the origin.
    """
    if isinstance(type_.equation, Attitude) and type_.equation.to_grid:
        convergence = type_.equation.convergence(np.zeros((len(angles), 3)), constants)
        attitude = rotation_from_angles(angles) @ _to_grid(convergence)
    else:
        attitude = rotation_from_navigation(angles)
    return angles_from_rotation(np.swapaxes(boresight, 1, 2) @ attitude)


@dataclass(frozen=True, eq=False)
class Attitude:
    """The equation of an attitude: how its angles are read, and against which axes."""

    read: Reading
    horizon: Horizon
    to_grid: bool
    """True if the axes are turned by the convergence."""
    plane: ProjectionPolynomial | None = None

    def __call__(self, blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        """Angles of n images, from blocks of position, rotation and misalignment."""
        position, rotation, boresight = blocks
        axes = self.horizon.local_axes(position)
        if self.to_grid:
            axes = _to_grid(self.convergence(position, constants)) @ axes
        angles, by_boresight = self.read(boresight @ rotation @ np.swapaxes(axes, 1, 2))
        return Computed(angles, (np.zeros((len(angles), 3, 3)), by_boresight @ boresight, by_boresight))

    def convergence(self, position: FloatArray, constants: FloatArray) -> FloatArray:
        """γ (n,) as it is given, or that at positions (n, 3)."""
        given: FloatArray = constants[:, 0]
        if self.plane is None:
            return given
        east, north = self.horizon.local_axes(position)[:, :2, :2].transpose(1, 0, 2)
        _, by_foot = self.plane.at(self.horizon.foot(position).position[:, :2])
        by_east, by_north = (np.einsum("nj,nj->n", by_foot[:, 0], along) for along in (east, north))
        return np.where(np.isnan(given), np.arctan2(-by_north, by_east), given)


def _attitude(key: str, names: Sequence[str], equation: Attitude, constants: tuple[Component, ...]) -> ObservationType:
    return ObservationType(
        key=key,
        components=tuple(Component(name, ANGLE) for name in names),
        references=(Reference("image", ("image",)),),
        slots=(
            Slot("point", "image", "position"),
            Slot("rotation", "image", "rotation"),
            Slot("rotation", "instrument", "boresight"),
        ),
        equation=equation,
        constants=constants,
    )


def _to_grid(convergence: FloatArray) -> FloatArray:
    """Γ (n, 3, 3): from east, north, up to grid east, grid north, up."""
    result = np.zeros((len(convergence), 3, 3))
    sine, cosine = np.sin(convergence), np.cos(convergence)
    result[:, 0, 0], result[:, 0, 1], result[:, 1, 0], result[:, 1, 1] = cosine, -sine, sine, cosine
    result[:, 2, 2] = 1.0
    return result


def _cardan(D: FloatArray) -> tuple[FloatArray, FloatArray]:
    angles = angles_from_rotation(D)
    return angles, angles_by_tangent(angles)


def _navigation(D: FloatArray) -> tuple[FloatArray, FloatArray]:
    """With D ← exp(−[δ]×) D its column j moves by D_j × δ."""
    by = np.cross(np.swapaxes(D, 1, 2)[:, :, None, :], np.eye(3))  # [n, j, k, i]: D_ij by δ_k
    roll, pitch, yaw = (
        np.arctan2(-D[:, 0, 2], D[:, 2, 2]),
        np.arctan2(D[:, 1, 2], np.hypot(D[:, 1, 0], D[:, 1, 1])),
        np.arctan2(D[:, 1, 0], D[:, 1, 1]),
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # no roll, no yaw where forward is vertical
        of_roll = D[:, 0, 2] ** 2 + D[:, 2, 2] ** 2
        of_yaw = D[:, 1, 0] ** 2 + D[:, 1, 1] ** 2
        by_roll = (D[:, :1, 2] * by[:, 2, :, 2] - D[:, 2:, 2] * by[:, 2, :, 0]) / of_roll[:, None]
        by_pitch = by[:, 2, :, 1] / np.sqrt(of_yaw)[:, None]
        by_yaw = (D[:, 1, 1:2] * by[:, 0, :, 1] - D[:, 1, :1] * by[:, 1, :, 1]) / of_yaw[:, None]
    return np.stack([roll, pitch, yaw], axis=1), np.stack([by_roll, by_pitch, by_yaw], axis=1)


# ---- The types there are on the earth, made for the object system of a network.

_OF_THE_EARTH = (
    gnss_vector,
    gnss_position,
    geodetic_position,
    ellipsoidal_height,
    orthometric_height,
    height_difference,
    ellipsoidal_height_difference,
    ellipsoid_arc,
    ellipsoid_chord,
    mean_sea_level_distance,
    height_reduced_distance,
    navigation_attitude,
)
EARTH_TYPES = (
    "azimuth",
    "astronomic_azimuth",
    *(make.__name__ for make in _OF_THE_EARTH if make is not height_difference),
    "projected_position",
    "projected_attitude",
    "projected_bearing",
)
"""Types that only a project with ``world`` has."""
NOT_ON_EARTH = {
    "bearing": "azimuth (about the ellipsoidal normal) or astronomic_azimuth (about the plumb line)",
    "vector": "gnss_vector (in geocentric axes)",
    "coordinates": "gnss_position (in geocentric axes) or geodetic_position",
}
"""Plain types that leave open on the earth what they refer to, and those that say it."""


def earth_types(horizon: Horizon) -> dict[str, ObservationType]:
    """All types of a project with ``world``, by their keys."""
    of_plumb_line = (
        DISTANCE,
        HORIZONTAL_DISTANCE,
        DISTANCE_RATIO,
        DIRECTIONS,
        ZENITH_DIRECTIONS,
        VERTICAL_DIRECTION,
        ZENITH_ANGLE,
        ANGLE_TYPE,
        SPATIAL_ANGLE,
    )
    types = [
        *(about_plumb_line(type_, horizon) for type_ in of_plumb_line),
        LOCAL,
        LEVEL,
        _as("azimuth", _about_vertical(BEARING, horizon, BEARING.constants)),
        _as("astronomic_azimuth", about_plumb_line(BEARING, horizon)),
        *(make(horizon) for make in _OF_THE_EARTH),
        open_projection(),
    ]
    return {type_.key: type_ for type_ in types}


def _as(key: str, bearing: ObservationType) -> ObservationType:
    component = bearing.components[0]._replace(name="azimuth")
    return bearing._replace(key=key, components=(component,))
