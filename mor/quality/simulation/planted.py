"""Errors that are planted on purpose: gross ones, systematic ones, and observations that are lost."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray
from mor.errors import InputError, nearest
from mor.errors import Problem as Mistake


class Systematic(NamedTuple):
    """An error that all observations of some groups share."""

    pattern: str
    """Name of groups, or a pattern of names."""
    amount: float
    """In the units that the group is given in, or in parts per million of the value."""
    is_ppm: bool = False


class Wishes(NamedTuple):
    """What is planted, besides the random errors."""

    gross: int = 0
    """Number of gross errors, in observations drawn at random."""
    size: float = 20.0
    """Their size, in units of σ; the sign is drawn."""
    dropped: float = 0.0
    """Share of the rows of uncorrelated tables that are lost."""
    systematic: tuple[Systematic, ...] = ()


class Planted(NamedTuple):
    """One planted error, or a lost row (component −1, amount 0)."""

    kind: str
    """``gross``, ``systematic`` or ``dropped``."""
    group: int
    row: int
    component: int
    amount: float
    """Internal units."""


def measured_groups(problem: Problem) -> list[int]:
    """Groups whose values stand in tables of observations."""
    return [k for k, group in enumerate(problem.groups) if len(group.lines)]


def planted(problem: Problem, wishes: Wishes, generator: np.random.Generator) -> list[Planted]:
    """The errors to plant into a problem. Raises :class:`InputError` for more than there are observations."""
    entries = [
        (k, int(row), int(component))
        for k in measured_groups(problem)
        for row, component in np.argwhere(problem.groups[k].mask)
    ]
    if wishes.gross > len(entries):
        words = f"found {wishes.gross} gross errors, expected no more than the {len(entries)} observations"
        raise InputError([Mistake(words, "--gross")])
    lost = _lost(problem, wishes.dropped, generator)
    found: list[Planted] = []
    for number in generator.permutation(len(entries)).tolist():
        k, row, component = entries[number]
        if len(found) == wishes.gross:
            break
        if k in lost and lost[k][row]:
            continue
        sign = 1.0 if generator.random() < 0.5 else -1.0
        amount = sign * wishes.size * float(problem.groups[k].sigma[row, component])
        found.append(Planted("gross", k, row, component, amount))
    found += [
        Planted("dropped", k, int(row), -1, 0.0) for k, rows in lost.items() for row in np.flatnonzero(rows)
    ]
    return found


def _lost(problem: Problem, share: float, generator: np.random.Generator) -> dict[int, BoolArray]:
    correlated = np.zeros(int(problem.offsets[-1]), dtype=bool)
    for cluster in problem.clusters:
        correlated[cluster.entries] = True
    lost = {}
    for k in measured_groups(problem):
        group, first = problem.groups[k], problem.offsets[k]
        if correlated[first : first + group.observed.size].any():
            continue
        lost[k] = generator.random(group.count) < share
    return lost if share > 0.0 else {}


def systematic_errors(problem: Problem, wishes: Wishes) -> dict[int, list[tuple[int, float, bool]]]:
    """By group: component, amount in internal units or ppm, whether ppm. Raises :class:`InputError`."""
    names = [problem.groups[k].name for k in measured_groups(problem)]
    found: dict[int, list[tuple[int, float, bool]]] = {}
    problems = []
    for wish in wishes.systematic:
        pattern, _, component = wish.pattern.partition(":")
        here = [k for k in measured_groups(problem) if fnmatchcase(problem.groups[k].name, pattern)]
        if not here:
            words = f"no group of observations is called {pattern!r}{nearest(pattern, names)}"
            problems.append(Mistake(words, "--ppm" if wish.is_ppm else "--offset"))
        for k in here:
            group = problem.groups[k]
            known = [one.name for one in group.type.components]
            if component and component not in known:
                words = f"{group.name} has no component {component!r} (known: {', '.join(known)})"
                problems.append(Mistake(words))
                continue
            for c in [known.index(component)] if component else range(len(known)):
                unit = group.external.factors[c] if group.external is not None else 1.0
                found.setdefault(k, []).append((c, wish.amount * (1.0 if wish.is_ppm else unit), wish.is_ppm))
    if problems:
        raise InputError(problems)
    return found


def with_planted(
    problem: Problem, observed: Sequence[FloatArray], errors: Sequence[Planted], wishes: Wishes
) -> tuple[FloatArray, ...]:
    """Observed values (n, m) of each group with the planted errors in them; lost rows are NaN."""
    changed = [values.copy() for values in observed]
    for k, shared in systematic_errors(problem, wishes).items():
        for component, amount, is_ppm in shared:
            values = changed[k][:, component]
            changed[k][:, component] = values * (1.0 + 1e-6 * amount) if is_ppm else values + amount
    for one in errors:
        if one.kind == "dropped":
            changed[one.group][one.row] = np.nan
        else:
            changed[one.group][one.row, one.component] += one.amount
    return tuple(changed)
