"""Observation types on the earth: derivatives against differences, values against PROJ and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Geod, Transformer

from mor.api.pipeline import read_document, read_network, solve_network
from mor.model.contract import wrap
from mor.model.earth import Ellipsoid, Horizon, east_north_up
from mor.model.geodetic import control, earth_types, projected_attitude, projected_bearing
from mor.model.parameters import KINDS
from mor.model.rotations import rotate, rotation_from_angles
from mor.project.earth import plane_of
from mor.project.reference_system import EarthModel, reference_system
from tests.scenarios.small_projects import write

GRS80 = Ellipsoid(6378137.0, 1.0 / 298.257222101)
HORIZON = Horizon(GRS80, np.radians(47.3), np.radians(11.4))
SYSTEM = reference_system("EPSG:25832")
WORLD = EarthModel(SYSTEM, HORIZON, 1.0, orthometric=False, extent=np.array([[-3e4, -3e4], [3e4, 3e4]]))
PLANE = plane_of(SYSTEM, WORLD)
OTHERS = (control(HORIZON), projected_attitude(HORIZON), projected_bearing(HORIZON, PLANE))
TYPES = {**earth_types(HORIZON), **{type_.key: type_ for type_ in OTHERS}}
ROWS = 5


def _blocks(type_, random):
    """Places 20 km around, their ends some 300 m apart."""
    centre = random.uniform(-2e4, 2e4, (ROWS, 3)) * [1.0, 1.0, 0.05]
    blocks = []
    for slot in type_.slots:
        kind = KINDS[slot.kind]
        if slot.part == "position":
            blocks.append(centre + random.uniform(-300.0, 300.0, (ROWS, 3)))
        elif kind.is_rotation:
            blocks.append(rotation_from_angles(random.uniform(-0.3, 0.3, (ROWS, 3))))
        elif kind.key == "distance meter":
            blocks.append(np.stack([random.uniform(0.9, 1.1, ROWS), random.uniform(-0.4, 0.4, ROWS)], axis=1))
        else:
            blocks.append(random.uniform(0.5, 1.5, (ROWS, kind.size)))
    return blocks


def _constants(type_, random):
    sizes = {"earth radius": 6.371e6, "face": 1.0}
    columns = [sizes.get(c.name, random.uniform(-1e-4, 1e-4)) for c in type_.constants]
    return np.tile(np.array(columns), (ROWS, 1)) if columns else np.zeros((ROWS, 0))


@pytest.mark.parametrize("key", TYPES)
def test_derivatives_against_differences(key):
    """Everything but the turn of the vertical with its place, which is 1/R for every metre."""
    random = np.random.default_rng(len(key))
    type_ = TYPES[key]
    blocks, constants = _blocks(type_, random), _constants(type_, random)
    computed = type_.equation([b.copy() for b in blocks], constants)
    for slot, (block, jacobian) in enumerate(zip(blocks, computed.jacobians, strict=True)):
        rotation = KINDS[type_.slots[slot].kind].is_rotation
        small = rotation or KINDS[type_.slots[slot].kind].key == "gnss frame" or block.shape[1] < 3
        step = 1e-6 if small else 1e-2
        for k in range(3 if rotation else block.shape[1]):
            moved = []
            for sign in (1.0, -1.0):
                changed = [b.copy() for b in blocks]
                if rotation:
                    delta = np.zeros((ROWS, 3))
                    delta[:, k] = sign * step
                    changed[slot] = rotate(block, delta)
                else:
                    changed[slot][:, k] += sign * step
                moved.append(type_.equation(changed, constants).values)
            difference = moved[0] - moved[1]
            difference[:, type_.wraps] = wrap(difference[:, type_.wraps])
            difference /= 2.0 * step
            turned = np.where(type_.wraps, 1e-6, 1e-4)  # rad/m; m/m at 600 m: 600/R
            noise = 1e-9 * np.abs(jacobian[:, :, k]).max() + 3e-8 * np.abs(computed.values).max() * 1e-7 / step
            assert (np.abs(difference - jacobian[:, :, k]) <= turned + noise + 1e-9).all()


def test_the_way_to_latitude_longitude_and_height_and_back_is_that_of_proj():
    random = np.random.default_rng(3)
    proj = Transformer.from_pipeline("+proj=cart +ellps=GRS80")
    for latitude, longitude in ((47.3, 11.4), (-37.0, 145.0), (84.0, -179.95), (0.0, 0.0)):
        horizon = Horizon(GRS80, np.radians(latitude), np.radians(longitude))
        geodetic = np.stack(
            [
                np.radians(latitude + random.uniform(-3.0, 3.0, 50)),
                np.radians(longitude + random.uniform(-3.0, 3.0, 50)),
                random.uniform(-11e3, 12e3, 50),
            ],
            axis=1,
        )
        expected = np.stack(proj.transform(*geodetic[:, [1, 0, 2]].T, radians=True), axis=1)
        np.testing.assert_allclose(GRS80.geocentric(geodetic), expected, atol=3e-9)
        position = horizon.from_geocentric(expected)
        back = horizon.to_geodetic(position)
        for found in (back, GRS80.geodetic(expected)):
            found[:, 1] = geodetic[:, 1] + wrap(found[:, 1] - geodetic[:, 1])
            np.testing.assert_allclose(found[:, :2], geodetic[:, :2], atol=2e-15)
            np.testing.assert_allclose(found[:, 2], geodetic[:, 2], atol=8e-9)
        deflection = random.uniform(-1e-4, 1e-4, (50, 2))
        zenith = geodetic[:, :2] + deflection / np.stack([np.ones(50), np.cos(geodetic[:, 0])], axis=1)
        np.testing.assert_allclose(
            horizon.local_axes(position, deflection), east_north_up(*zenith.T) @ horizon.axes.T, atol=2e-15
        )


def test_heights_near_the_middle_are_known_to_the_last_digit():
    """By way of geocentric coordinates a height of 50 m would be known to 1e-9 m."""
    position = np.array([[0.0, 0.0, 50.0], [1000.0, 0.0, 0.0], [0.0, 1000.0, 0.0]])
    M, N = GRS80.radii(np.array([HORIZON.latitude]))
    heights = HORIZON.foot(position).height
    assert heights[0] == pytest.approx(50.0, abs=1e-14)
    # the parabola, and the next term of a circle
    assert heights[1] == pytest.approx(1e6 / (2 * N[0]) - 1e12 / (8 * N[0] ** 3), abs=1e-10)
    assert heights[2] == pytest.approx(1e6 / (2 * M[0]) - 1e12 / (8 * M[0] ** 3), abs=1e-6)


def _line(length, azimuth, heights):
    """Two places by their geodesic (PROJ), and their latitudes and longitudes."""
    geod = Geod(ellps="GRS80")
    lon, lat, _ = geod.fwd(11.5, 47.2, azimuth, length)
    geodetic = np.radians([[47.2, 11.5, 0.0], [lat, lon, 0.0]]) + np.array([[0, 0, heights[0]], [0, 0, heights[1]]])
    return HORIZON.from_geodetic(geodetic), geodetic


@pytest.mark.parametrize("azimuth", [0.0, 37.0, 90.0, 200.0])
@pytest.mark.parametrize(("length", "tolerance"), [(50.0, 1e-8), (3e3, 1e-8), (1e5, 2e-5)])
def test_the_arc_is_the_geodesic(length, azimuth, tolerance):
    places, _ = _line(length, azimuth, (700.0, 2400.0))
    meter = np.array([[1.0, 0.0]])
    arc = TYPES["ellipsoid_arc"].equation([places[:1], places[1:], meter], np.zeros((1, 0))).values[0, 0]
    assert arc == pytest.approx(length, abs=tolerance)
    sea = TYPES["mean_sea_level_distance"].equation([places[:1], places[1:], meter], np.array([[40.0, 50.0]]))
    assert sea.values[0, 0] == pytest.approx(length * (1 + 45.0 / 6.38e6), rel=3e-8)
    chord = TYPES["ellipsoid_chord"].equation([places[:1], places[1:], meter], np.zeros((1, 0))).values[0, 0]
    assert chord == pytest.approx(length - length**3 / (24 * 6.38e6**2), rel=1e-7, abs=1e-9)


def test_azimuth_zenith_angle_and_heights_of_a_line():
    """The azimuth of a short normal section is that of the geodesic; two zenith angles leave the arc between them."""
    places, geodetic = _line(2000.0, 41.0, (500.0, 0.0))  # a target on the ellipsoid: no correction for its height
    none = np.zeros((1, 1))
    ends = [places[:1], none, places[1:], none]
    azimuth = TYPES["azimuth"].equation(ends, np.zeros((1, 0))).values[0, 0]
    assert np.degrees(azimuth) == pytest.approx(41.0, abs=1e-6)
    flat = np.array([[6.371e6, 1.0, 0, 0, 0, 0]])
    there = TYPES["zenith_angle"].equation([*ends, none], flat).values[0, 0]
    back = TYPES["zenith_angle"].equation([*ends[2:], *ends[:2], none], flat).values[0, 0]
    M, N = GRS80.radii(geodetic[:1, 0])
    radius = 1.0 / (np.cos(azimuth) ** 2 / M[0] + np.sin(azimuth) ** 2 / N[0])
    assert there + back == pytest.approx(np.pi + 2000.0 / radius, abs=1e-9)
    xi, eta = (
        1e-4,
        -3e-5,
    )  # the plumb line leans: z shrinks by ξ cos A + η sin A, the azimuth by Laplace's equation
    leaning = np.array([[6.371e6, 1.0, xi, eta, 0, 0]])
    zenith = TYPES["zenith_angle"].equation([*ends, none], leaning).values[0, 0]
    assert zenith - there == pytest.approx(-xi * np.cos(azimuth) - eta * np.sin(azimuth), abs=1e-8)
    astronomic = TYPES["astronomic_azimuth"].equation(ends, leaning[:, 2:]).values[0, 0]
    laplace = eta * np.tan(geodetic[0, 0]) + (xi * np.sin(azimuth) - eta * np.cos(azimuth)) / np.tan(there)
    assert astronomic - azimuth == pytest.approx(laplace, abs=1e-8)
    levelled = TYPES["height_difference"].equation(ends, np.array([[47.0, 47.3]])).values[0, 0]
    assert levelled == pytest.approx(-500.0 - 0.3, abs=3e-9)
    slope = np.linalg.norm(places[1] - places[0])
    meter = np.array([[1.0, 0.0]])
    reduced = TYPES["height_reduced_distance"].equation([places[:1], places[1:], meter], np.zeros((1, 0)))
    assert reduced.values[0, 0] == pytest.approx(np.sqrt(slope**2 - 500.0**2), abs=1e-8)


def test_heights_of_antennas_stand_on_the_normals():
    places, geodetic = _line(5000.0, 120.0, (500.0, 650.0))
    raised = HORIZON.from_geodetic(geodetic + np.array([[0, 0, 1.5], [0, 0, 2.0]]))
    heights = [np.array([[1.5]]), np.array([[2.0]])]
    frame = np.array([[0.0] * 6 + [1.0]])
    vector = TYPES["gnss_vector"].equation([places[:1], heights[0], places[1:], heights[1], frame], np.zeros((1, 0)))
    expected = HORIZON.to_geocentric(raised)
    np.testing.assert_allclose(vector.values[0], expected[1] - expected[0], atol=5e-9)
    distance = TYPES["distance"].equation(
        [places[:1], heights[0], places[1:], heights[1], np.array([[1.0, 0.0]])], np.zeros((1, 4))
    )
    assert distance.values[0, 0] == pytest.approx(np.linalg.norm(expected[1] - expected[0]), abs=5e-9)


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:3035", "EPSG:31287", "EPSG:3857"])
@pytest.mark.parametrize("extent", [3e4, 3e5])
def test_bearings_in_the_plane_are_those_of_proj(crs, extent):
    """To 1e-9 rad over sights of 300 m at any height: conformal projections and others, 60 and 600 km wide."""
    system = reference_system(crs)
    ellipsoid = system.ellipsoid
    horizon = Horizon(ellipsoid, HORIZON.latitude, HORIZON.longitude)
    world = EarthModel(system, horizon, 1.0, orthometric=False, extent=np.array([[-extent, -extent], [extent, extent]]))
    random = np.random.default_rng(9)
    start = random.uniform(-extent, extent, (200, 3)) * [1.0, 1.0, 0.01]
    end = start + random.uniform(-300.0, 300.0, (200, 3))
    plane = Transformer.from_crs(system.crs.geodetic_crs, system.crs, always_xy=True)
    places = []
    for position in (start, end):
        latitude, longitude, _ = np.degrees(horizon.to_geodetic(position)).T
        places.append(np.stack(plane.transform(longitude, latitude), axis=1))
    expected = np.arctan2(*(places[1] - places[0]).T)
    computed = projected_bearing(horizon, plane_of(system, world)).equation([start, end], np.zeros((200, 0)))
    assert np.abs(wrap(computed.values[:, 0] - expected)).max() < 3e-9


def test_a_projection_reaches_points_that_are_found_far_away(tmp_path):
    """Control within a kilometre, a point 400 km from it: its bearing is that of PROJ, not of a line that goes on."""
    text = """mor: 1
units: {length: m, angle: rad}
world: {crs: "EPSG:25832", heights: ellipsoidal}
points:
  - {columns: [id, east, north, height], rows: [[A, 500000, 5500000, 0], [B, 501000, 5500000, 0]], fixed: [x, y, z]}
  - {columns: [id], rows: [[C]]}
observations:
  - {type: gnss_vector, columns: [from, to, dx, dy, dz, sigma], rows: [[A, C, DX, 0.001]]}
  - {type: projected_bearing, columns: [from, to, bearing, sigma], rows: [[B, C, BEARING, 1e-9]]}
"""
    to_geocentric = Transformer.from_crs("EPSG:25832", "EPSG:4936", always_xy=True)
    a, c = (500000.0, 5500000.0, 0.0), (830000.0, 5740000.0, 200.0)
    d = np.subtract(to_geocentric.transform(*c), to_geocentric.transform(*a)).tolist()
    bearing = np.arctan2(c[0] - 501000.0, c[1] - a[1])
    text = text.replace("DX", ", ".join(map(repr, d))).replace("BEARING", repr(float(bearing)))
    solved = solve_network(read_network(read_document(write(tmp_path, text)), tmp_path))
    assert solved.quality is not None
    v = next(
        q.v
        for g, q in zip(solved.network.groups, solved.quality.groups, strict=True)
        if g.count == 1 and q.v.shape[1] == 1
    )
    assert abs(v[0, 0]) < 1e-11
