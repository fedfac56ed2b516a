"""Polar points, sections of bearings and arcs, free stations: geodetic constructions against simulated
truth."""

import numpy as np
import pytest

from mor.model.rotations import rotation_from_angles
from mor.start.free_station import (
    StationOutcome,
    free_station_level,
    resect_directions,
)
from mor.start.sights import bearing, orient, polar_rays


def observe(points, station, kappa):
    """Directions, vertical directions, slope distances from a levelled station by the frame equations."""
    star = (points - station) @ rotation_from_angles(np.array([0.0, 0.0, kappa])).T
    level = np.hypot(star[:, 0], star[:, 1])
    return np.arctan2(star[:, 0], star[:, 1]), np.arctan2(star[:, 2], level), np.linalg.norm(star, axis=1)


def setup(seed, n=6):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-100, 100, size=(n, 3)) * [1.0, 1.0, 0.2]
    return points, rng.uniform(-60, 60, size=3) * [1.0, 1.0, 0.1], rng.uniform(-np.pi, np.pi)


def test_bearings_run_clockwise_from_the_y_axis():
    np.testing.assert_allclose(
        bearing(np.zeros(2), np.array([[0, 1], [1, 0], [0, -1], [-1, 0.0]])),
        [0, np.pi / 2, np.pi, -np.pi / 2],
    )


@pytest.mark.parametrize("seed", range(5))
def test_polar_rays_invert_the_observations(seed):
    points, station, kappa = setup(seed)
    directions, verticals, distances = observe(points, station, kappa)
    rays = polar_rays(directions, verticals) * distances[:, None]
    np.testing.assert_allclose(rays @ rotation_from_angles(np.array([0, 0, kappa])) + station, points, atol=1e-10)


def test_orientation_is_a_median_on_the_circle():
    points, station, _ = setup(1)
    directions, _, _ = observe(points, station, np.pi - 1e-5)
    noisy = directions + np.array([1, -1, 2, -2, 3, -3]) * 1e-5
    found = orient(station, points, noisy)
    assert abs(np.angle(np.exp(1j * (found.kappa - np.pi)))) < 2e-5
    assert np.max(np.abs(found.residuals)) < 5e-5
    assert np.isnan(orient(station, points[:0], directions[:0]).kappa)
    wrong = np.where(np.arange(len(directions)) < 2, directions + 0.7, noisy)
    assert abs(np.angle(np.exp(1j * (orient(station, points, wrong).kappa - np.pi)))) < 5e-5


def by_bearings(stations, t):
    """A point from the bearings (n,) under which it is sighted from stations (n, 2)."""
    return free_station_level(stations, t + np.pi, np.full(len(t), np.nan), 1e-3, 1.0, oriented=True)


def by_arcs(stations, distances, sigma=0.01):
    """A point from its distances (n,) to stations (n, 2)."""
    return free_station_level(stations, np.full(len(distances), np.nan), distances, 1.0, sigma)


def test_bearings_meet_at_the_point():
    rng = np.random.default_rng(2)
    for n in (2, 3, 6):
        stations, point = rng.uniform(-50, 50, (n, 2)), rng.uniform(-50, 50, 2)
        found = by_bearings(stations, bearing(stations, point))
        assert found.outcome is StationOutcome.DETERMINED
        np.testing.assert_allclose(found.position, point, atol=1e-9)


def test_redundant_bearings_minimise_the_angles():
    rng = np.random.default_rng(3)
    stations, point = rng.uniform(-50, 50, (5, 2)), np.array([5.0, 7.0])
    t = bearing(stations, point) + 1e-3 * rng.normal(size=5)
    found = by_bearings(stations, t)

    def cost(p):
        return np.sum(np.angle(np.exp(1j * (bearing(stations, p) - t))) ** 2)

    assert found.sigma0 == pytest.approx(1e3 * np.sqrt(cost(found.position) / 3))
    for step in ([1e-2, 0], [0, 1e-2], [-1e-2, 0], [0, -1e-2]):
        assert cost(found.position + step) > cost(found.position)


def test_bearings_that_do_not_meet_are_named():
    stations = np.array([[0, 0], [10.0, 0]])
    assert by_bearings(stations, np.array([0.3, 0.3])).outcome is StationOutcome.PARALLEL
    assert by_bearings(stations, np.array([0.3, 0.3 + np.pi])).outcome is StationOutcome.PARALLEL
    assert by_bearings(stations, np.array([-0.3, 0.3])).outcome is StationOutcome.DOES_NOT_FIT
    assert by_bearings(stations[:1], np.array([0.1])).outcome is StationOutcome.TOO_FEW
    assert by_bearings(stations[[0, 0]], np.array([0.1, 0.5])).outcome is StationOutcome.TOO_FEW
    assert by_bearings(stations, np.array([np.nan, 0.5])).outcome is StationOutcome.TOO_FEW


def test_two_arcs_leave_two_points():
    found = by_arcs(np.array([[0, 0], [6.0, 0]]), np.array([5.0, 5.0]))
    assert found.outcome is StationOutcome.AMBIGUOUS
    both = sorted([found.position.tolist(), *(place.tolist() for place, _ in found.alternatives)])
    np.testing.assert_allclose(both, [[3, -4], [3, 4]], atol=1e-12)


def test_a_third_arc_decides_unless_the_stations_are_in_line():
    rng = np.random.default_rng(4)
    for _ in range(20):
        stations, point = rng.uniform(-50, 50, (4, 2)), rng.uniform(-50, 50, 2)
        found = by_arcs(stations, np.linalg.norm(stations - point, axis=1))
        assert found.outcome is StationOutcome.DETERMINED
        np.testing.assert_allclose(found.position, point, atol=1e-8)
    stations = np.array([[0, 0], [5.0, 0], [9.0, 0]])
    found = by_arcs(stations, np.linalg.norm(stations - [3.0, 4.0], axis=1))
    assert found.outcome is StationOutcome.AMBIGUOUS
    np.testing.assert_allclose(np.sort([found.position[1], found.alternatives[0][0][1]]), [-4, 4], atol=1e-9)


def test_redundant_arcs_minimise_the_misclosures():
    rng = np.random.default_rng(8)
    stations, point = rng.uniform(-50, 50, (5, 2)), np.array([5.0, 7.0])
    d = np.linalg.norm(stations - point, axis=1) + 0.05 * rng.normal(size=5)
    found = by_arcs(stations, d, 0.05)

    def cost(p):
        return np.sum((np.linalg.norm(stations - p, axis=1) - d) ** 2)

    assert found.outcome is StationOutcome.DETERMINED
    assert found.sigma0 == pytest.approx(20.0 * np.sqrt(cost(found.position) / 3))
    for step in ([1e-4, 0], [0, 1e-4], [-1e-4, 0], [0, -1e-4]):
        assert cost(found.position + step) > cost(found.position)


def test_arcs_that_touch_or_stay_apart_are_named():
    stations = np.array([[0, 0], [10.0, 0]])
    touching = by_arcs(stations, np.array([4.0, 6.0]))
    assert touching.outcome is StationOutcome.DETERMINED
    np.testing.assert_allclose(touching.position, [4.0, 0.0], atol=1e-6)
    for d in ([4.0, 5.0], [20.0, 5.0]):
        assert by_arcs(stations, np.array(d)).outcome is StationOutcome.DOES_NOT_FIT
    assert by_arcs(stations[[0, 0]], np.array([4.0, 6.0])).outcome is StationOutcome.TOO_FEW
    assert by_arcs(stations[:1], np.array([4.0])).outcome is StationOutcome.TOO_FEW


@pytest.mark.parametrize("seed", range(30))
def test_three_directions_give_the_station_in_closed_form(seed):
    points, station, kappa = setup(seed, n=3 + seed % 3)
    directions, _, _ = observe(points, station, kappa)
    position, found, _ = resect_directions(points[:, :2], directions)
    np.testing.assert_allclose(position, station[:2], atol=1e-6)
    assert np.angle(np.exp(1j * (found - kappa))) == pytest.approx(0.0, abs=1e-8)


def test_dangerous_circle_is_named():
    angles = np.array([0.3, 1.5, 2.9, 5.0])
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(4)]) * 50.0
    directions, _, _ = observe(circle[:3], circle[3], 0.4)
    missing = np.full(3, np.nan)
    found = free_station_level(circle[:3, :2], directions, missing, 1e-5, 1e-3)
    assert found.outcome is StationOutcome.DANGEROUS_CIRCLE
    beside = circle[3] + [5.0, -3.0, 0.0]
    directions, _, _ = observe(circle[:3], beside, 0.4)
    found = free_station_level(circle[:3, :2], directions, missing, 1e-5, 1e-3)
    assert found.outcome is StationOutcome.DETERMINED
    np.testing.assert_allclose(found.position, beside[:2], atol=1e-7)


# What is measured to each point: d direction, s distance, b both.
MIXTURES = ["bb", "bd", "bs", "ss", "ssd", "ddd", "bbbbb", "dddd", "sdsd", "dssb", "ddds", "sss"]


@pytest.mark.parametrize("mixture", MIXTURES)
def test_every_mixture_of_directions_and_distances_gives_the_station(mixture):
    for seed in range(25):
        points, station, kappa = setup(seed, n=len(mixture))
        directions, verticals, distances = observe(points, station, kappa)
        kinds = np.array(list(mixture))
        directions = np.where(np.isin(kinds, ["d", "b"]), directions, np.nan)
        level = np.where(np.isin(kinds, ["s", "b"]), distances * np.cos(verticals), np.nan)
        found = free_station_level(points[:, :2], directions, level, 1e-5, 1e-3)
        assert found.outcome.usable
        positions = [found.position, *(position for position, _ in found.alternatives)]
        assert min(np.linalg.norm(p - station[:2]) for p in positions) < 1e-5
        if mixture in ("bb", "bbbbb"):
            assert found.outcome is StationOutcome.DETERMINED
            assert np.angle(np.exp(1j * (found.kappa - kappa))) == pytest.approx(0.0, abs=1e-9)
        if mixture == "ss":
            assert found.outcome is StationOutcome.AMBIGUOUS
            assert np.isnan(found.kappa)


def test_stations_without_enough_or_with_wrong_measurements_are_named():
    points, station, kappa = setup(2, n=5)
    directions, verticals, distances = observe(points, station, kappa)
    level = distances * np.cos(verticals)
    missing = np.full(5, np.nan)
    two = np.where(np.arange(5) < 2, directions, np.nan)
    assert free_station_level(points[:, :2], two, missing, 1e-5, 1e-3).outcome is StationOutcome.TOO_FEW
    wrong = free_station_level(points[:, :2], directions, level * [1, 1, 1, 1, 1.5], 1e-5, 1e-3)
    assert wrong.outcome is StationOutcome.DOES_NOT_FIT
    one = np.where(np.arange(5) < 1, level, np.nan)
    assert free_station_level(points[:, :2], missing, one, 1e-5, 1e-3).outcome is StationOutcome.TOO_FEW
    short = np.where(np.arange(5) < 2, 1e-3 * level, np.nan)
    assert free_station_level(points[:, :2], missing, short, 1e-5, 1e-3).outcome is StationOutcome.DOES_NOT_FIT
