"""The curvature learnt from steps: of a quadratic it is the true one, and creeping iterations gain by it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mor.solve.iterate import NOTHING_LEARNT, Outcome, adjust
from tests.scenarios.gross_error_scenes import GON, disturbed, names_exchanged


def test_of_a_quadratic_the_few_directions_gauss_newton_has_wrong_are_learnt() -> None:
    random = np.random.default_rng(1)
    root = random.standard_normal((12, 12))
    normal = root @ root.T + np.eye(12)
    bent = random.standard_normal((12, 2))
    true = normal + 30.0 * bent @ bent.T  # what residual × curvature adds along two directions
    inverse = SimpleNamespace(solve=lambda rhs: np.linalg.solve(normal, rhs))
    solution, x, known = random.standard_normal(12), np.zeros(12), NOTHING_LEARNT
    for _ in range(3):  # N⁻¹ times the true curvature has three different eigenvalues
        rhs = true @ (solution - x)
        step = known.step(inverse, rhs)  # type: ignore[arg-type]
        share = (step @ rhs) / (step @ true @ step)
        known = known.after(share * step, rhs, rhs - share * true @ step)
        x = x + share * step
    np.testing.assert_allclose(x, solution, rtol=1e-6)


def test_a_step_against_which_the_gradient_grows_is_forgotten() -> None:
    known = NOTHING_LEARNT.after(np.ones(3), np.ones(3), np.zeros(3))
    assert len(known.steps) == 1
    assert known.after(np.ones(3), np.ones(3), 2.0 * np.ones(3)) is NOTHING_LEARNT


@pytest.mark.parametrize(("kind", "seed", "before"), [("aerial", 1, 22), ("close range", 5, 37)])
def test_two_names_exchanged_are_no_fifty_iterations(kind: str, seed: int, before: int) -> None:
    scene = names_exchanged(seed, kind)
    found = adjust(scene.problem, disturbed(scene, np.random.default_rng(seed), 0.01, GON))
    assert found.outcome is Outcome.CONVERGED
    assert len(found.iterations) < 0.8 * before  # of Gauss-Newton alone
