"""The loop of :mod:`mor.adjustment.solve` over domains: the same steps, the same end, sums over domains for sums.

Steps are those of Gauss-Newton, damped (Levenberg-Marquardt) where one would make the objective larger. After a step
that hardly moves anything the next one has the same matrix, and a new right-hand side (C. T. Kelley, 1995, the chord
method): wide borders make matrices dear. The solution is factorised at its own values. Directions that the observations
hardly determine are left to one machine: here they end the adjustment, and it is said.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.adjustment.convergence import ACCURACY, left_after, stands_still, without_progress
from mor.adjustment.domains.null_space import NullSpace, explain
from mor.adjustment.domains.tasks import (
    Followed,
    Turned,
    advance,
    follow,
    linearise,
    move_on,
    null_of,
    round_off_of,
    rows_of_datum,
    shifted,
    turn,
    variances_of_datum,
)
from mor.adjustment.domains.tree import Boundaries, Engine, Root, down, down_step, nodes, solve, up
from mor.adjustment.inverse import anchors_of
from mor.adjustment.state import Iteration, Outcome, Watcher
from mor.arrays import FloatArray, IntArray
from mor.sparse.joining import dense, one_block
from mor.sparse.symbolic_factorisation import analyse

_EPS = float(np.finfo(float).eps)
_EXPECTED = 0.25
"""Part of the gain a damped step promises that it must keep."""
_MATRIX_STAYS = 0.1
"""Change in units of σ after which the matrix is the same to some digits: the next step shrinks as much at least."""

HARDLY = "directions are hardly determined, which domains are not made for: adjust it on one machine"
LOOSE = "unknowns are not determined by the observations"
NO_DATUM = "the datum is not defined"
NOT_SETTLED = "the datum points do not settle the datum"
"""Reasons of outcomes."""


class Sizes(NamedTuple):
    """Of the network as a whole."""

    observations: int
    unknowns: int


class Joined(NamedTuple):
    """An adjustment of domains; what is longer than their boundaries is in the store."""

    boundaries: Boundaries
    sizes: Sizes
    outcome: Outcome
    reason: str
    stage: str
    """The last stage; of a solution the one at which the system is factorised."""
    root: Root
    objective: float
    null_space: NullSpace
    iterations: tuple[Iteration, ...]
    free: bool
    """True where a defect may be settled by the datum."""
    loose: tuple[tuple[str, str, int], ...] = ()
    """Unknowns inside domains that nothing determines."""
    moved: bool = False
    """True where the solution lies a last step away from the stage, at the values of ``solution``."""
    factored: str = "0"
    """The stage at which root and nodes are factorised."""
    left: tuple[FloatArray, ...] = ()
    """(s, 1) of each domain, right-hand sides of outer unknowns at the last stage, where that is a later one."""

    @property
    def values(self) -> str:
        """Stage whose values are those of the solution."""
        return "solution" if self.moved else self.stage

    @property
    def defect(self) -> int:
        """Number of free movements of the network."""
        return len(self.null_space.movements)

    @property
    def redundancy(self) -> int:
        """n − u + d."""
        return self.sizes.observations - self.sizes.unknowns + self.defect

    @property
    def domains(self) -> range:
        """Numbers of the domains."""
        return range(len(self.boundaries.numbers))


def adjust(
    engine: Engine,
    boundaries: Boundaries,
    sizes: Sizes,
    free: bool,
    max_iterations: int = 50,
    watch: Watcher | None = None,
) -> Joined:
    """Adjust planned domains, whose start values are in the store as those of stage 0."""
    state = _begin(engine, boundaries, sizes, free)
    while state.outcome is Outcome.NOT_CONVERGED and without_progress(state.iterations) < max_iterations:
        state = _advance(engine, state)
        if watch is not None and state.iterations:
            watch(state.iterations[-1])
        if state.outcome is Outcome.NOT_CONVERGED and stands_still(state.iterations):
            return state._replace(reason="the iteration stands still")
    return state


def _begin(engine: Engine, boundaries: Boundaries, sizes: Sizes, free: bool) -> Joined:
    root, handed = up(engine, boundaries, "0", lambda d: engine.submit(linearise, d, "0"))
    nothing = NullSpace(np.zeros(0, dtype=np.int64), (), 0, 0)
    state = Joined(
        boundaries,
        sizes,
        Outcome.NOT_CONVERGED,
        "",
        "0",
        root,
        handed.objective,
        nothing,
        (),
        free,
        handed.vanished,
    )
    if handed.vanished:
        return state._replace(outcome=Outcome.SINGULAR, reason=LOOSE)
    anchors = anchors_of(dense(root.matrix), analyse(one_block(len(root.matrix)))).unknowns
    return _judged(state, explain(engine, boundaries, "0", root, anchors))


def _judged(state: Joined, found: NullSpace) -> Joined:
    """The state with its null space; singular where something is loose, or the datum does not settle what is free."""
    state = state._replace(null_space=found)
    if found.undetermined:
        return state._replace(outcome=Outcome.SINGULAR, reason=LOOSE)
    if found.weak:
        return state._replace(outcome=Outcome.SINGULAR, reason=HARDLY)
    if found.movements and not state.free:
        return state._replace(outcome=Outcome.SINGULAR, reason=NO_DATUM)
    return state


class _Step(NamedTuple):
    """A step that is worked out, and where it leads in the datum."""

    gain: float
    """bᵀδ."""
    movement: FloatArray
    """(d,) in units of the null vectors."""
    across: FloatArray
    followed: list[Followed]

    @property
    def change(self) -> float:
        """How far it moves the unknowns, in units of σ."""
        return float(np.sqrt(max(self.gain, 0.0)))


def _step(engine: Engine, state: Joined, anchors: IntArray, tolerance: float) -> _Step:
    root, factor = state.root, state.root.factor(anchors, tolerance)
    of_nodes = engine, state.boundaries, state.factored, root
    outer = (
        solve(*of_nodes, factor, list(state.left))
        if state.left
        else down_step(*of_nodes, root.solve(factor, root.rhs))
    )
    held = down(*of_nodes, root.held(factor, anchors))
    parts = [engine.submit(follow, d, state.stage, outer[d][:, 0], held[d]) for d in state.domains]
    followed: list[Followed] = [engine.result(part) for part in parts]
    across = sum((one.across for one in followed), np.zeros((len(anchors),) * 2))
    missing = sum((one.missing for one in followed), np.zeros(len(anchors)))
    if len(anchors) and not np.linalg.cond(across) < 1e12:
        return _Step(0.0, np.full(len(anchors), np.nan), across, followed)
    movement = np.asarray(np.linalg.solve(across, missing) if len(anchors) else missing, dtype=np.float64)
    return _Step(sum(one.gain for one in followed), movement, across, followed)


def _advance(engine: Engine, state: Joined) -> Joined:
    """One accepted step, or the end."""
    step = _step(engine, state, state.null_space.anchors, 1e-10)
    if not np.isfinite(step.movement).all():
        return state._replace(outcome=Outcome.SINGULAR, reason=NOT_SETTLED)
    change, number = step.change, len(state.iterations) + 1
    over = _is_over(engine, state, step) and _is_in_datum(engine, state, step)
    iteration = Iteration(number, state.objective, change, 0.0, state.redundancy)
    iterations = (*state.iterations, iteration)
    if over and change <= ACCURACY and state.factored == state.stage:
        _each(engine, state, lambda d: engine.submit(move_on, d, state.stage, step.movement, "solution"))
        objective = max(state.objective - change**2, 0.0)
        return _converged(engine, state._replace(iterations=iterations, objective=objective, moved=True))
    to = str(number)
    if not over and _matrix_stays(state, change):
        return _turned(engine, state, step, iteration, to)
    root, handed = up(
        engine, state.boundaries, to, lambda d: engine.submit(advance, d, state.stage, step.movement, to)
    )
    if not _keeps(state, handed.objective):
        return _damped(engine, state, iteration, to)
    _forget(engine, state)
    moved = _factored(state, to, root)._replace(objective=handed.objective, iterations=iterations)
    if handed.vanished:
        return moved._replace(outcome=Outcome.SINGULAR, reason=LOOSE, loose=handed.vanished)
    return _converged(engine, moved) if over else moved


def _factored(state: Joined, stage: str, root: Root) -> Joined:
    return state._replace(stage=stage, factored=stage, root=root, left=())


def _matrix_stays(state: Joined, change: float) -> bool:
    """True where a step moves so little that the next one may have the same matrix.

    Not where a datum is to be settled: the movement into it is no part of the change.
    """
    return change <= _MATRIX_STAYS and state.defect == 0


def _turned(engine: Engine, state: Joined, step: _Step, iteration: Iteration, to: str) -> Joined:
    """The next stage with a right-hand side of its own and the factor of the one before."""
    parts: list[Turned] = _each(
        engine, state, lambda d: engine.submit(turn, d, state.stage, step.movement, to)
    )
    objective = sum(one.objective for one in parts)
    if not _keeps(state, objective):
        return _damped(engine, state, iteration, to)
    _forget(engine, state, nodes_too=False)
    left = tuple(one.left for one in parts)
    iterations = (*state.iterations, iteration)
    return state._replace(stage=to, left=left, objective=objective, iterations=iterations)


def _keeps(state: Joined, objective: float) -> bool:
    """True where a step makes the objective no larger than round-off may."""
    return objective <= state.objective * (1.0 + 1e-6) + 1e-6


def _damped(engine: Engine, state: Joined, iteration: Iteration, to: str) -> Joined:
    """The least damped step that makes the objective smaller, and by no mere fraction of what it promises."""
    damping = max(state.iterations[-1].damping * 0.1, 1e-6) if state.iterations else 1e-6
    while damping < 1e6:
        taken = _tried(engine, state, to, damping)
        if taken is not None:
            root, objective = taken
            _forget(engine, state)
            iterations = (*state.iterations, iteration._replace(damping=damping))
            return _factored(state, to, root)._replace(objective=objective, iterations=iterations)
        damping *= 10.0
    return state._replace(outcome=Outcome.DIVERGED, reason="no step makes the sum of squares smaller")


def _tried(engine: Engine, state: Joined, to: str, damping: float) -> tuple[Root, float] | None:
    """The root and the objective after a damped step; nothing where it gains too little."""
    none, stage, there = np.zeros(0, dtype=np.int64), f"{state.stage} damped", f"{to} damped"

    def damped(d: int) -> object:
        return engine.submit(linearise, d, state.stage, damping, stage)

    root, _ = up(engine, state.boundaries, stage, damped)
    step = _step(engine, _factored(state, stage, root), none, 1e-16)

    def advanced(d: int) -> object:
        return engine.submit(advance, d, stage, step.movement, there)

    _, handed = up(engine, state.boundaries, there, advanced)
    if not state.objective - handed.objective > _EXPECTED * step.gain:
        return None
    _each(engine, state, lambda d: engine.submit(move_on, d, stage, step.movement, to))
    root, handed = up(engine, state.boundaries, to, lambda d: engine.submit(linearise, d, to))
    return root, handed.objective


def _is_over(engine: Engine, state: Joined, step: _Step) -> bool:
    """As :func:`mor.adjustment.convergence.is_over`."""
    if left_after(state, step.change) <= ACCURACY:
        return True
    change = step.change
    if change > 1.0 or not state.iterations or change < 0.5 * state.iterations[-1].largest_change:
        return False
    noise = _each(engine, state, lambda d: engine.submit(round_off_of, d, state.stage))
    return change <= float(np.sqrt(sum(noise)))


def _is_in_datum(engine: Engine, state: Joined, step: _Step) -> bool:
    """As :func:`mor.adjustment.convergence.is_in_datum`."""
    if state.defect == 0:
        return True
    found = _each(engine, state, lambda d: engine.submit(shifted, d, state.stage, step.movement))
    moving, farthest = max((size, -d) for d, (size, _) in enumerate(found))
    change, d = step.change, -farthest
    largest = max(one.largest for one in step.followed)
    digits = 4.0 * _EPS * largest * float(np.linalg.cond(step.across))
    sigma = max(one.moving for one in step.followed) / change if change > 0.0 else 0.0
    if moving <= max(ACCURACY, min(change, 1e-3)) * sigma + digits:
        return True
    in_datum, anchored = _sigmas(engine, state, step, d, found[d][1])
    return bool(moving <= max(ACCURACY * in_datum, min(ACCURACY, change) * anchored) + digits)


def _sigmas(engine: Engine, state: Joined, step: _Step, d: int, unknown: int) -> FloatArray:
    """σ of an unknown of domain d in the datum and in that of the anchors."""
    null = engine.result(engine.submit(null_of, d, state.stage, unknown))
    left = _each(
        engine,
        state,
        lambda k: engine.submit(rows_of_datum, k, state.stage, unknown if k == d else -1, null, step.across),
    )
    factor = state.root.factor(state.null_space.anchors)
    outer = solve(engine, state.boundaries, state.factored, state.root, factor, left)
    parts = _each(engine, state, lambda k: engine.submit(variances_of_datum, k, state.stage, outer[k]))
    return np.asarray(np.sqrt(np.maximum(sum(parts), 0.0)))


def _converged(engine: Engine, state: Joined) -> Joined:
    """The solution, with what the anchors hold worked out once more there."""
    if len(state.null_space.anchors) or not state.moved:
        found = explain(engine, state.boundaries, state.stage, state.root, state.null_space.anchors)
        state = _judged(state, found)
    if state.outcome is not Outcome.NOT_CONVERGED:
        return state
    return state._replace(outcome=Outcome.CONVERGED)


def _each(engine: Engine, state: Joined, task: Callable[[int], object]) -> list:  # type: ignore[type-arg]
    """What a task finds in each domain."""
    return [engine.result(part) for part in [task(d) for d in state.domains]]


def _forget(engine: Engine, state: Joined, nodes_too: bool = True) -> None:
    """Drop what nobody asks for any more once the next stage is accepted."""
    for d in state.domains:
        for name in ("values", "stage", "step"):
            for stage in (state.stage, f"{state.stage} damped", f"{int(state.stage) + 1} damped"):
                engine.store.drop(f"{name}/{stage}/{d}")
    for name in nodes(state.boundaries) if nodes_too else ():
        engine.store.drop(f"node/{state.factored}/{name}")
