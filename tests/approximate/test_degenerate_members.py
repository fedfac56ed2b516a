"""A candidate whose matrix is degenerate is passed over wherever it turns up: at every place that solves a stack.

Members of the stacks are replaced at random by matrices that nothing can decompose, in start values, tests and causes.
A run may then end without a solution, and not in an internal error.
"""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import diagnose_network, read_document, read_network, solve_network
from mor.errors import MorError
from mor.model import rotations as tolerant
from tests.scenarios.mixtures.ingredients import mixture
from tests.scenarios.mixtures.project_file import write_project
from tests.selection import slow_after

FUNCTIONS = (
    "solve",
    "inv",
    "cholesky",
    "pinv",
    "eigh",
    "eigvalsh",
    "eig",
    "eigvals",
    "svd",
    "singular_values",
)
PART = 0.1
"""Part of the stacks that get a degenerate member."""
TRIALS = 10
"""Causes that are tried."""


def spoil(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> Counter[tuple[str, int]]:
    """Let stacks have degenerate members from now on; returns how often, by the place of the call."""
    places: Counter[tuple[str, int]] = Counter()

    def spoilt(name):
        function = getattr(tolerant, name)

        def call(matrix, *more, **options):
            if np.ndim(matrix) > 2 and len(matrix) and rng.random() < PART:
                caller = sys._getframe(1)
                places[Path(caller.f_code.co_filename).name, caller.f_lineno] += 1
                matrix = np.array(matrix)
                shape = matrix.shape[-2:]
                matrix[rng.integers(len(matrix))] = [
                    np.zeros(shape),
                    -np.eye(*shape),
                    np.full(shape, np.nan),
                ][rng.integers(3)]
            return function(matrix, *more, **options)

        return call

    for name in FUNCTIONS:
        monkeypatch.setattr(tolerant, name, spoilt(name))
    return places


@pytest.mark.parametrize("seed", slow_after(1, [4, *range(4), *range(5, 12)]))
def test_no_degenerate_candidate_ends_a_run(seed, tmp_path, monkeypatch, capfd):
    write_project(mixture(seed + 7100), tmp_path)
    document = read_document(tmp_path / "project.yaml")
    rng = np.random.default_rng(seed)
    places = spoil(monkeypatch, rng)
    trials = iter(range(TRIALS))
    with np.errstate(all="ignore"), suppress(MorError):
        network = read_network(document, tmp_path)
        solve_network(network)
        diagnose_network(network, lambda: next(trials, None) is not None)
    assert places
    assert capfd.readouterr() == ("", "")  # LAPACK writes there of arguments that it does not like
