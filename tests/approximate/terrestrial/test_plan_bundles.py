import numpy as np
import pytest

from mor.start.free_station import three_bundles


def scene(seed, count):
    draw = np.random.default_rng(seed)
    points = draw.uniform([0.0, 0.0], [60.0, 40.0], (count, 2))
    angles = draw.uniform(0.0, 2.0 * np.pi) + np.array([0.0, 1.5, 3.4])
    stations = [30.0, 20.0] + 60.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    kappas = draw.uniform(0.0, 2.0 * np.pi, 3)
    away = points - stations[:, None]
    directions = np.arctan2(away[..., 0], away[..., 1]) + kappas[:, None]
    return stations, kappas - kappas[0], points, directions


@pytest.mark.parametrize("seed", range(6))
def test_one_of_at_most_two_shapes_is_the_true_one(seed):
    stations, kappas, points, directions = scene(seed, 9)
    shapes = [shape for shape in three_bundles(directions) if shape.misfit < 1e-7]
    assert 1 <= len(shapes) <= 2
    right = min(shapes, key=lambda shape: np.abs(np.exp(1j * shape.kappas) - np.exp(1j * kappas)).max())
    unit = np.linalg.norm(stations - stations[0], axis=1).max()
    # κ of the first bundle is 0: its axes are turned against those of the scene.
    turn = np.linalg.lstsq(right.stations, (stations - stations[0]) / unit, rcond=None)[0]
    assert turn @ turn.T == pytest.approx(np.eye(2), abs=1e-5)
    assert right.points @ turn == pytest.approx((points - stations[0]) / unit, abs=1e-5)


def test_bundles_of_different_points_have_no_shape():
    directions = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (3, 12))
    assert all(shape.misfit > 1e-2 for shape in three_bundles(directions))
