"""Flights that nothing has observed: exact where they are straight, and networks that start from control points."""

from __future__ import annotations

import numpy as np
import pytest

import mor
from mor.errors import NoStartValuesError
from mor.model.rotations import rotation_from_angles
from mor.start.along_trajectories import TimedRays, attitude_of, level_flight, positions_of
from tools.flight_start_trials import flown, said


def straight(
    turns: tuple[float, float, float], relief: float, climb: float = 0.0
) -> tuple[TimedRays, np.ndarray, np.ndarray]:
    """Nine points seen along a straight flight, its positions at the sights, and its rotation."""
    random = np.random.default_rng(3)
    time = np.linspace(100.0, 116.0, 9)
    D = rotation_from_angles(np.array(turns))
    velocity = np.array([40.0, -55.0, climb])
    positions = np.array([1000.0, 2000.0, 1500.0]) + (time - 108.0)[:, None] * velocity
    star = np.stack([random.uniform(-400, 400, 9), random.uniform(-300, 300, 9), np.full(9, -1000.0)], axis=1)
    star *= 1.0 + relief * random.uniform(-1.0, 1.0, 9)[:, None]
    points = positions + star @ D
    return TimedRays(time, star / np.linalg.norm(star, axis=1, keepdims=True), points), positions, D


def test_positions_follow_from_attitudes_and_attitudes_from_positions() -> None:
    sights, positions, D = straight((0.9, -0.4, 2.5), 0.2, 0.5)  # oblique, not level
    flight = positions_of(sights, np.broadcast_to(D, (9, 3, 3)))
    assert flight is not None
    assert flight.positions(sights.time) == pytest.approx(positions, abs=1e-7)
    found = attitude_of(sights, positions)
    assert found == pytest.approx(D, abs=1e-12)


def test_a_level_flight_is_exact_and_a_tilted_one_is_near() -> None:
    for turns, climb, off in (((0.0, 0.0, 2.5), 0.0, 1e-6), ((0.04, -0.03, -1.1), 0.5, 30.0)):
        sights, positions, D = straight(turns, 0.1, climb)
        flight = level_flight(sights)
        assert flight is not None
        found = flight.positions(sights.time)
        assert np.abs(found - positions).max() < off
        assert np.abs(flight.rotation @ D.T - np.eye(3)).max() < 0.03


def test_what_leaves_a_flight_open_starts_nothing() -> None:
    sights, positions, D = straight((0.0, 0.0, 2.5), 0.1)
    two = TimedRays(*(part[:2] for part in sights))
    assert level_flight(two) is None
    assert positions_of(two, np.broadcast_to(D, (2, 3, 3))) is None
    assert attitude_of(TimedRays(*(part[:1] for part in sights)), positions[:1]) is None
    assert level_flight(sights._replace(ray=-sights.ray)) is None  # upwards
    wrong = sights._replace(point=sights.point[::-1])
    assert level_flight(wrong) is None


@pytest.mark.parametrize(("kind", "seed"), [("lines", 1), ("lines, GNSS", 2), ("lines, INS", 3), ("images", 4)])
def test_strips_start_from_control_and_tie_points(kind: str, seed: int) -> None:
    assert said(kind, seed) == ""


@pytest.mark.slow
def test_without_enough_control_the_knots_are_named() -> None:
    data, _, _ = flown("lines", 0)
    data["points"][0]["rows"] = data["points"][0]["rows"][:1]
    kept = {row[0] for table in data["points"] for row in table["rows"]}
    rows = data["observations"][0]["rows"]
    data["observations"][0]["rows"] = [row for row in rows if row[1] in kept]
    with pytest.raises(NoStartValuesError, match="knot S0@0") as raised:
        mor.adjust(data)
    points = {thing.reason for thing in raised.value.things if thing.kind == "point"}
    assert points == {"seen from trajectories without start values at that time"}
    assert all(thing.observations for thing in raised.value.things if thing.kind == "point")
