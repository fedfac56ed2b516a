"""Observations whose values stand in no table: planes, levels of instruments, image-variant interiors.

They are observed as zero. In a simulation that is to be read again as a project the error hence cannot be in the
observation: the truth has it. Points lie beside their plane, an instrument is tilted, an image differs from its camera,
each by a random amount of the σ given. The place is changed by the smallest steps that do this,

    A dx = l − e − f(x),  |dx| least.

Shift and drift that an instrument has anew on every strip are observed once for all of them: they go the same way, with
what was observed as l, which is 0 otherwise. Constancy and smoothness of trajectories say how a flight usually is, and
not where it goes: the path stays as it is planned.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.observations import ObservationGroup
from mor.observations.parameter import OBSERVED_PARAMETERS
from mor.observations.time.steadiness import STEADINESS
from mor.parameters.index import Values, move
from mor.parameters.kinds import ATTITUDE_SHIFT, POSITION_SHIFT

_STEPS = 20
_CLOSE = 1e-6
"""Parts of σ that may be left of an error."""
_OF_STRIPS = {OBSERVED_PARAMETERS[kind.key].key for kind in (POSITION_SHIFT, ATTITUDE_SHIFT)}
_WRITTEN = {kind.key for kind in OBSERVED_PARAMETERS.values()} - _OF_STRIPS
_STEADY = {kind.key for kind in STEADINESS}


def is_implied(group: ObservationGroup) -> bool:
    """True for groups of whose observed values a project has none for each row."""
    return not len(group.lines) and group.type.key not in _WRITTEN


def conditions(problem: Problem) -> list[int]:
    """Groups that say where things are: points on planes, levels, interiors of images."""
    return [k for k in unwritten(problem) if problem.groups[k].type.key not in _OF_STRIPS]


def unwritten(problem: Problem) -> list[int]:
    """Groups whose errors have to be in the place."""
    return [
        k for k, group in enumerate(problem.groups) if is_implied(group) and group.type.key not in _STEADY
    ]


def place_with_errors(
    problem: Problem, place: Values, errors: Sequence[FloatArray], chosen: Sequence[int]
) -> Values:
    """The place at which the ``chosen`` groups have the ``errors`` (n, m), and observed is what was observed."""
    if not chosen:
        return place
    for _ in range(_STEPS):
        jacobians, misclosures, sizes = [], [], []
        tangent = rotation_tangents(problem.index, place)
        for k in chosen:
            group = problem.groups[k]
            part = linearise(group, problem.index, place, tangent, slice(None))
            mask = group.mask
            rows = np.zeros((int(np.count_nonzero(mask)), problem.index.count + 1))
            row = np.broadcast_to(np.arange(len(mask))[:, None], mask.shape)[mask]
            np.add.at(rows, (np.arange(len(row))[:, None], part.columns[row]), part.jacobian[mask])
            computed = group.observed - part.misclosure
            jacobians.append(rows[:, :-1])
            misclosures.append((group.observed - errors[k] - computed)[mask])
            sizes.append(group.sigma[mask])
        wanted, sigma = np.concatenate(misclosures), np.concatenate(sizes)
        if np.abs(wanted / sigma).max() < _CLOSE:
            break
        A = np.concatenate(jacobians)
        used = _used(A)
        step = np.zeros(problem.index.count)
        step[used] = tolerant.lstsq(A[:, used] / sigma[:, None], wanted / sigma, rcond=1e-12)
        place = move(problem.index, place, step)
    return place


def _used(A: FloatArray) -> BoolArray:
    return np.asarray((A != 0.0).any(axis=0))
