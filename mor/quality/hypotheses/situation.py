"""Where hypotheses begin: the network, how its adjustment ended, and where most of its observations fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Adjustment, Iteration, Watcher
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import InputError
from mor.observations import ObservationGroup
from mor.parameters.index import Values, all_known, with_shared_components
from mor.project.network.build import Network
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.gross_errors.graduated_weights import robust_scales
from mor.quality.hypotheses.description_length import cost_of_choice, cost_of_residuals, price_of_gross_error
from mor.quality.hypotheses.hypothesis import Fit, Hypothesis
from mor.sparse.cholesky import NotFiniteError

SMALL = 20_000
"""Observations up to which graduated weights and many adjustments cost next to nothing."""
_ITERATIONS = 15
_AT_LEAST = 3
"""Rows of an image or a station of which half is more than chance."""
_AS_EXPECTED = 2.0
"""vᵀPv over its degrees of freedom up to which no other beginning is tried."""
_PATIENCE = 2
"""Iterations one after the other that do not halve vᵀPv, as long as it is far from what is expected."""
SUSPECT = 4.5
"""|v|/σ beyond which an observation is looked at: nothing is decided by it."""


class HopelessError(Exception):
    """An iteration that leads nowhere."""


Make = Callable[[Network, Values, Values], Problem]
Begin = Callable[[Network], Values | None]


@dataclass(frozen=True)
class Situation:
    """What is known of a network whose observations do not agree."""

    network: Network
    start: Values
    values: Values
    """Where most observations fit: the solution, or where graduated weights lead."""
    solution: Adjustment | None
    """The adjustment, where there is one; suspects may be left out of it."""
    make: Make
    begin: Begin

    @cached_property
    def sizes(self) -> tuple[FloatArray, ...]:
        """|v|/σ (n, m) of every group, 0 where not observed."""
        problem = self.make(self.network, self.start, self.values)
        return sizes_of(problem.groups, self.values)

    @property
    def count(self) -> int:
        """Number of observations."""
        return self.network.observations

    def worst_rows(self, group: int, most: int) -> IntArray:
        """Rows of a group with an observation that does not fit beside the others, the worst first."""
        largest = self.sizes[group].max(axis=1, initial=0.0)
        order = np.argsort(-largest, kind="stable")[:most]
        worst: IntArray = order[largest[order] > self.limit]
        return worst

    @cached_property
    def limit(self) -> float:
        """|v|/σ beyond which an observation does not fit beside the others.

        In large networks few errors leave half of all residuals as they are: the median tells how large chance makes
        them. In small ones an error is in all residuals.
        """
        if self.count <= SMALL:
            return SUSPECT
        scale = robust_scales(self.make(self.network, self.start, self.values), self.sizes).overall
        return max(SUSPECT, scale * price_of_gross_error(self.count))

    def without_row(self, group: int, row: int) -> Values:
        """Where the others lead without a row; where most fit, if they have no solution."""
        try:
            problem = self.make(self.network, self.start, self.values)
            masks = [own.left_out.copy() for own in problem.groups]
            masks[group][row] = True
            with np.errstate(all="ignore"):
                found = adjust(exclude(problem, masks), self.values, Settings(_ITERATIONS), _impatient())
        except (InputError, NotFiniteError, HopelessError):
            return self.values
        return found.values if found.outcome.is_solution else self.values

    @cached_property
    def misfitting(self) -> tuple[BoolArray, ...]:
        """(n, m) observations that do not fit."""
        return tuple(size > SUSPECT for size in self.sizes)

    @cached_property
    def something_is_wrong_as_a_whole(self) -> bool:
        """True where half of a group, of an image or of a station does not fit: only then a change of all of it may."""
        for group, bad in zip(
            self.network.groups, self.misfitting, strict=False
        ):  # checks, left out, come last
            rows = bad.any(axis=1)
            if group.count >= _AT_LEAST and 2 * np.count_nonzero(rows) >= group.count:
                return True
            whole = np.bincount(group.references[0].numbers)
            wrong = np.bincount(group.references[0].numbers, weights=rows, minlength=len(whole))
            if ((whole >= _AT_LEAST) & (2 * wrong >= whole)).any():
                return True
        return False

    @cached_property
    def fit(self) -> Fit:
        """How well the network fits as it is."""
        return self._fit(self.network, self.values, 0.0)

    def tried(self, hypothesis: Hypothesis, afresh: bool = True) -> Fit | None:
        """The network changed and adjusted; nothing where that does not converge.

        ``afresh`` allows that start values are worked out for it, which takes longer than all else.
        """
        network = hypothesis.change(self.network)
        cost = cost_of_choice(self.count, hypothesis.candidates, hypothesis.parameters, hypothesis.stretch)
        best: Fit | None = None
        for begin in self._beginnings(network, hypothesis, afresh):
            values = self._adjusted(network, begin, hypothesis)
            fit = None if values is None else self._fit(network, values, cost)
            if fit is not None and (best is None or fit.length < best.length):
                best = fit
            if best is not None and best.omega <= _AS_EXPECTED * best.freedom:
                break
        return best

    def _beginnings(self, network: Network, hypothesis: Hypothesis, afresh: bool) -> Iterator[Values]:
        """Where to begin: where most observations fit; for what is not local, at new start values, too.

        Which of them is better is not seen before the adjustment: what fits a wrong observation well begins far off.
        """
        here = {kind: _longer(values, network.start[kind]) for kind, values in self.values.items()}
        for kind, blocks in hypothesis.anew.items():
            given = network.start[kind][blocks]
            told: BoolArray = np.asarray(np.isfinite(given.reshape(len(given), -1)).all(axis=1))
            here[kind] = here[kind].copy()
            here[kind][blocks[told]] = given[told]
        here = with_shared_components(network.blocks, here)
        yield here
        if not hypothesis.rows and ((afresh and hypothesis.afresh) or all_known(network.start)):
            begin = self.begin(network)
            if begin is not None:
                yield begin

    def _adjusted(self, network: Network, begin: Values, hypothesis: Hypothesis) -> Values | None:
        """Values of the changed network; with a change of few observations the others that do not fit are left out."""
        try:
            problem = self.make(network, begin, begin)
            if hypothesis.rows:
                out = [mask.copy() for mask in self.misfitting]
                for group, row in hypothesis.rows:
                    out[group][row] = False
                with np.errstate(all="ignore"):
                    reduced = exclude(
                        problem, [o | g.left_out for o, g in zip(out, problem.groups, strict=True)]
                    )
                    found = adjust(reduced, begin, Settings(_ITERATIONS), _impatient())
                if found.outcome.is_solution:
                    return self._with_all(problem, found.values)
            with np.errstate(all="ignore"):
                found = adjust(problem, begin, Settings(_ITERATIONS), _impatient())
        except (InputError, NotFiniteError, HopelessError):
            return None
        return found.values if found.outcome.is_solution else None

    def _with_all(self, problem: Problem, values: Values) -> Values:
        """The adjustment of all observations from there, where it converges and does not go anywhere else."""
        try:
            with np.errstate(all="ignore"):
                found = adjust(problem, values, Settings(_ITERATIONS), _impatient())
        except (NotFiniteError, HopelessError):
            return values
        costs = [cost_of_residuals(sizes_of(problem.groups, v), self.count) for v in (found.values, values)]
        return found.values if found.outcome.is_solution and costs[0] <= costs[1] + 1.0 else values

    def _fit(self, network: Network, values: Values, cost: float) -> Fit:
        problem = self.make(network, values, values)
        sizes = sizes_of(problem.groups, values)
        used = [size[~group.left_out] for size, group in zip(sizes, problem.groups, strict=True)]
        return Fit(
            values,
            float(sum(np.sum(size**2) for size in used)),
            problem.observations - problem.index.count + self._defect,
            cost_of_residuals(used, self.count) + cost,
        )

    @property
    def _defect(self) -> int:
        return 0 if self.solution is None else int(self.solution.defect.datum.shape[1])


def _impatient() -> Watcher:
    """A watcher that ends an iteration which does not come near to a solution as quickly as one that will."""
    seen: list[float] = []

    def watch(iteration: Iteration) -> None:
        seen.append(iteration.objective)
        last = seen[-1 - _PATIENCE :]
        slow = len(last) > _PATIENCE and all(b > 0.5 * a for a, b in pairwise(last))
        if (
            slow
            and iteration.objective > 25.0 * max(iteration.redundancy, 1)
            and iteration.largest_change > 1.0
        ):
            raise HopelessError

    return watch


def sizes_of(groups: Sequence[ObservationGroup], values: Values) -> tuple[FloatArray, ...]:
    """|v|/σ (n, m) of every group at some values, 0 where not observed."""
    return tuple(
        np.nan_to_num(np.abs(misclosures(group, values)) / group.given_sigma, nan=0.0, posinf=1e30)
        for group in groups
    )


def _longer(values: FloatArray, start: FloatArray) -> FloatArray:
    """Values (n, …) with those of blocks that were added."""
    return values if len(values) == len(start) else np.concatenate([values, start[len(values) :]])
