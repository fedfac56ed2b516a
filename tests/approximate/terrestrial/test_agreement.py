"""Measurements that agree are taken: one wrong identity does not draw a result away."""

import numpy as np
import pytest

from mor.start.free_station import FitQuality, StationOutcome, agreeing
from mor.start.levelled import station_that_agrees


def drawn(seed, count):
    """Stations or points (count, 2) around a place (2,), bearings to them from it, and distances."""
    rng = np.random.default_rng(seed)
    others, place = rng.uniform(-50, 50, (count, 2)), rng.uniform(-20, 20, 2)
    away = others - place
    return others, place, np.arctan2(*away.T), np.linalg.norm(away, axis=1)


@pytest.mark.parametrize("seed", range(10))
def test_one_wrong_arc_or_bearing_is_left_out(seed):
    stations, place, bearings, lengths = drawn(seed, 6)
    lengths[2] *= 1.2
    missing = np.full(6, np.nan)
    section = station_that_agrees(stations, missing, lengths, 0.05)
    np.testing.assert_allclose(section.position, place, atol=1e-9)
    assert len(section.residuals) == 5
    bearings[4] += 0.2
    section = station_that_agrees(stations, bearings, missing, 1.0, oriented=True)
    np.testing.assert_allclose(section.position, place, atol=1e-9)
    assert len(section.residuals) == 5


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_exchanged_names_do_not_turn_a_free_station(seed, measured):
    points, place, bearings, lengths = drawn(seed, 12)
    bearings[[3, 8]] = bearings[[8, 3]]
    found = station_that_agrees(points, bearings + 0.4, lengths if measured else np.full(12, np.nan), 0.1)
    assert found.outcome is StationOutcome.DETERMINED
    np.testing.assert_allclose(found.position, place, atol=1e-8)
    assert found.kappa == pytest.approx(0.4, abs=1e-9)


def test_where_too_many_would_have_to_go_all_stay():
    values = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])

    def fit(rows):
        return FitQuality(float(np.std(values[rows])), np.abs(values[rows] - values[rows].mean()))

    np.testing.assert_array_equal(agreeing(6, fit, 0.1, least=2), np.arange(6))
    assert len(agreeing(6, fit, 1.2, least=2)) == 4
