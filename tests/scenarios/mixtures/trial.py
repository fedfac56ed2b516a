"""One world, started from the truth and from nothing: do both adjustments reach the same solution?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mor.api.pipeline import determinable_start, make_problem, read_document, read_network, solve_network
from mor.errors import InputError
from mor.linalg.cholesky import NotFiniteError
from mor.quality.solution import Solved
from mor.solve.iterate import Adjustment, Outcome, SolverSettings, adjust
from tests.scenarios.mixtures.project_file import write_project
from tests.scenarios.mixtures.world import World

MOST_ITERATIONS = 300
"""Gross errors make the adjustment creep, from the truth as well."""
SAME = 1e-9
"""Relative difference of σ0 at which two solutions are one."""


@dataclass(frozen=True)
class Trial:
    """What became of a world."""

    tags: frozenset[str]
    counts: bool
    """True where the adjustment from the truth converged."""
    reached: bool
    words: str


def tried(world: World, folder: Path) -> Trial:
    """Adjust a world from the truth and from nothing; where plain least squares differ, as ``mor adjust`` does."""
    return compared(*write_project(world, folder), frozenset(world.tags))


def compared(nothing: Path, truth: Path, tags: frozenset[str]) -> Trial:
    """Adjust a project with nothing given and the same with the truth given."""
    expected = _adjusted(truth)
    if isinstance(expected, str) or expected.outcome is not Outcome.CONVERGED:
        return Trial(tags, False, False, expected if isinstance(expected, str) else expected.reason)
    found = _adjusted(nothing)
    if isinstance(found, str):
        return Trial(tags, True, False, found)
    if found.outcome is Outcome.CONVERGED and _same(expected, found):
        return Trial(tags, True, True, "")
    if _same_without_suspects(truth, nothing):
        return Trial(tags | {"by mor adjust only"}, True, True, "")
    if found.outcome is not Outcome.CONVERGED:
        return Trial(tags, True, False, f"{found.outcome.value}: {found.reason}")
    objectives = expected.normals.objective, found.normals.objective
    return Trial(tags, True, False, f"another solution: v'Pv {objectives[1]:.6g}, not {objectives[0]:.6g}")


def _same(expected: Adjustment, found: Adjustment) -> bool:
    objectives = expected.normals.objective, found.normals.objective
    return abs(objectives[1] - objectives[0]) <= 2.0 * SAME * objectives[0] + 1e-12


def compared_as_adjusted(nothing: Path, truth: Path, tags: frozenset[str]) -> Trial:
    """What ``mor adjust`` ends at from the truth and with nothing given, whatever it leaves out as suspects.

    A world counts where it ends at a solution from the truth.
    """
    expected, found = _ended(truth), _ended(nothing)
    if isinstance(expected, str) or isinstance(found, str):
        counts = not isinstance(expected, str)
        return Trial(tags, counts, False, str(found) if counts else str(expected))
    left = [0 if one.suspects is None else one.suspects.count for one in (expected, found)]
    objectives = [one.adjustment.normals.objective for one in (expected, found)]
    words = f"v'Pv {objectives[1]:.6g} without {left[1]} suspects, not {objectives[0]:.6g} without {left[0]}"
    reached = _same(expected.adjustment, found.adjustment)
    return Trial(tags, True, reached, "" if reached else words)


def _ended(path: Path) -> Solved | str:
    """What ``mor adjust`` ends at, or why that is no solution."""
    try:
        solved = solve_network(read_network(read_document(path), path.parent))
    except InputError as error:
        return f"not started: {str(error)[:300]}"
    return f"{solved.adjustment.outcome.value}: {solved.adjustment.reason}" if solved.quality is None else solved


def _same_without_suspects(truth: Path, nothing: Path) -> bool:
    """True where ``mor adjust``, which may leave out what it suspects, ends at one solution from both."""
    expected, found = _ended(truth), _ended(nothing)
    if isinstance(expected, str) or isinstance(found, str):
        return False
    return _same(expected.adjustment, found.adjustment)


def _adjusted(path: Path) -> Adjustment | str:
    try:
        network, start = determinable_start(read_network(read_document(path), path.parent))
    except InputError as error:
        return f"not started: {str(error)[:300]}"
    try:
        return adjust(make_problem(network, start, start), start, SolverSettings(MOST_ITERATIONS))
    except NotFiniteError as error:
        return f"start values coincide: {error}"
