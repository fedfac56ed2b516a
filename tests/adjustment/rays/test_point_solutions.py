"""Points without an inverse of their own: coordinates whose pivot vanishes are held, as in the compiled passes."""

from __future__ import annotations

import numpy as np
import pytest

from mor.solve.elimination import inverse_roots


def test_a_point_of_parallel_rays_is_held_along_them():
    along = np.array([0.0, 0.0, 1.0])
    square = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 0.0]])
    regular = square + np.outer(along, along)
    roots, held = inverse_roots(np.stack([square, regular]))
    assert held.tolist() == [[False, False, True], [False, False, False]]
    expected = np.linalg.inv(regular)
    assert roots[1].T @ roots[1] == pytest.approx(expected)
    expected[2, 2] = 0.0
    assert roots[0].T @ roots[0] == pytest.approx(expected)
