"""A candidate whose matrix is degenerate is passed over wherever it turns up: at every place that solves a stack.

Members of the stacks are replaced at random by matrices that nothing can decompose, in start values, tests and causes.
A run may then end without a solution, and not in an internal error.
"""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import suppress
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

import mor
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


@pytest.mark.slow
def test_angles_in_the_wrong_unit_do_not_stop_the_start_values() -> None:
    """Degrees that are called gon contradict the distances so far that points of a part may coincide."""
    places = {"K1": (998, 2000), "K2": (1515, 2027), "A": (1072, 2128), "B": (1269, 2276), "C": (1384, 2138)}
    apart = {pair: np.subtract(places[pair[1]], places[pair[0]]) for pair in permutations(places, 2)}
    azimuth = {pair: np.degrees(np.arctan2(*away)) % 360.0 for pair, away in apart.items()}
    turned = [("A", "K1", "B"), ("B", "A", "C"), ("C", "B", "K2"), ("A", "K1", "C"), ("B", "A", "K2")]
    sights = ["K1 A", "K1 B", "K1 K2", "A B", "A C", "A K2", "B C", "B K2", "C K2", "C A"]
    lengths = ["K1 A", "A B", "B C", "C K2", "K1 B", "A C", "B K2", "K1 K2"]
    tables = {
        "angle": (
            ["at", "from", "to", "angle"],
            [[at, one, to, (azimuth[at, to] - azimuth[at, one]) % 360.0] for at, one, to in turned],
        ),
        "directions": (
            ["station", "to", "horizontal"],
            [[*pair, azimuth[pair]] for pair in (tuple(text.split()) for text in sights)],
        ),
        "distance": (
            ["from", "to", "distance"],
            [[*pair, float(np.hypot(*apart[pair]))] for pair in (tuple(text.split()) for text in lengths)],
        ),
    }
    project = {
        "mor": 1,
        "units": {"length": "m", "angle": "gon"},
        "points": [{"columns": ["id", "x", "y", "z"], "rows": [[name, *xy, 100.0] for name, xy in places.items()]}],
        "observations": [
            {
                "type": kind,
                "columns": columns,
                "rows": rows,
                "values": {"sigma": "5 mm" if kind == "distance" else "1 mgon"},
            }
            for kind, (columns, rows) in tables.items()
        ],
    }
    with suppress(MorError):  # no solution is an answer, an internal error is none
        assert not mor.adjust(project).accepted
