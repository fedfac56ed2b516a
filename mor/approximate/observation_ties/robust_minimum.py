"""Many starts of one small problem at once: Σ log(1 + v²), by Gauss-Newton with Cauchy weights, damped."""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant

_STEP = 1e-6
_FEW, _MANY = 6, 30
"""Steps of the most promising starts, and of the best of these."""
_LOOKED_AT, _KEPT = 200, 16
_LARGEST = 0.5
"""Change of an unknown in one step, at the most."""

States = TypeVar("States", bound=tuple[FloatArray, ...])
"""Many states: arrays whose first axis counts them."""


class Searched(Protocol[States]):
    """What is minimised; every unknown is of the size of one."""

    @property
    def unknowns(self) -> int:
        """How many there are."""

    def residuals(self, states: States) -> FloatArray:
        """(k, n) of k states."""

    def moved(self, states: States, steps: FloatArray) -> States:
        """States after steps (k, unknowns)."""


class Minima(NamedTuple):
    """The best minima, the best first."""

    states: tuple[FloatArray, ...]
    objectives: FloatArray
    """(k,)"""
    residuals: FloatArray
    """(k, n)"""
    derivatives: FloatArray
    """(n, unknowns) at the best one."""


def minima(searched: Searched[States], starts: States) -> Minima:
    """The minima that the most promising of many starts lead to."""
    order = np.argsort(_objectives(searched.residuals(starts), 30.0), kind="stable")[:_LOOKED_AT]
    states, off = _iterated(searched, some(starts, order), _FEW, 10.0)
    states = some(states, np.argsort(_objectives(off, 3.0), kind="stable")[:_KEPT])
    states, off = _iterated(searched, states, _MANY, 5.0)
    order = np.argsort(_objectives(off, 1.0), kind="stable")
    states, off = some(states, order), off[order]
    return Minima(
        states, _objectives(off, 1.0), off, _derivatives(searched, some(states, np.array([0])), off[:1])[0]
    )


def some(states: States, numbers: IntArray) -> States:
    """Some of the states, by their numbers."""
    return type(states)(*(array[numbers] for array in states))


def _objectives(off: FloatArray, width: float) -> FloatArray:
    return np.asarray(np.log1p(np.square(off / width)).sum(axis=1))


def _derivatives(searched: Searched[States], states: States, off: FloatArray) -> FloatArray:
    """(k, n, u) by differences, all unknowns of all states in one call."""
    count, unknowns = len(off), searched.unknowns
    many = some(states, np.repeat(np.arange(count), unknowns))
    there = searched.residuals(searched.moved(many, np.tile(_STEP * np.eye(unknowns), (count, 1))))
    change = there.reshape(count, unknowns, -1) - off[:, None, :]
    return np.asarray(np.swapaxes(change, 1, 2) / _STEP)


def _iterated(
    searched: Searched[States], states: States, steps: int, width: float
) -> tuple[States, FloatArray]:
    """Steps that are not taken where they make it worse; large residuals count ever less."""
    off = searched.residuals(states)
    count, unknowns = len(off), searched.unknowns
    damping = np.full(count, 1e-2)
    for step in range(steps):
        wide = max(1.0, width * (1.0 - step / (0.6 * steps)))
        root = 1.0 / np.hypot(1.0, off / wide)
        rows = _derivatives(searched, states, off) * root[:, :, None]
        normal = np.swapaxes(rows, 1, 2) @ rows
        diagonal = np.einsum("kii->ki", normal)
        load = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
        side = np.einsum("kni,kn->ki", rows, root * off)
        normal[:, np.arange(unknowns), np.arange(unknowns)] += load
        change = -tolerant.solve(np.nan_to_num(normal), side[:, :, None])[:, :, 0]
        moved = searched.moved(states, np.clip(np.nan_to_num(change), -_LARGEST, _LARGEST))
        tried = searched.residuals(moved)
        better = _objectives(tried, wide) < _objectives(off, wide)
        both = type(states)(*(np.concatenate(pair) for pair in zip(states, moved, strict=True)))
        states = some(both, np.arange(count) + count * better)
        off = np.where(better[:, None], tried, off)
        damping = np.clip(np.where(better, 0.2 * damping, 8.0 * damping), 1e-9, 1e6)
    return states, off


__all__ = ["Minima", "Searched", "minima", "some"]
