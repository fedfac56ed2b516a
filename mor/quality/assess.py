"""From an adjustment to its quality: everything a report says about trust."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.s_transformation import STransformation
from mor.adjustment.state import Adjustment
from mor.arrays import BoolArray, FloatArray
from mor.quality.effort import Done, of_operations
from mor.quality.in_chunks import in_pieces
from mor.quality.precision.cofactors import datum_transformation, parameter_cofactors
from mor.quality.precision.follower_poses import FollowerCofactors, follower_cofactors
from mor.quality.precision.moving_points import MovingCofactors, moving_cofactors
from mor.quality.reliability.detectable_errors import Reliability
from mor.quality.reliability.observation_quality import ObservationQuality, redundancy_of
from mor.quality.reliability.redundancy import observation_quality
from mor.quality.tests.levels import noncentrality, sidak
from mor.quality.tests.test_statistics import GlobalTest, critical_value, global_test, normalised_residuals
from mor.sparse.block_matrix import BlockMatrix


class Levels(NamedTuple):
    """Levels of the tests: α0 and β0 of the test of single observations, level of the global test."""

    snooping: float = 0.001
    power: float = 0.8
    overall: float = 0.05
    familywise: float | None = None
    """Level of all tests of single observations together (Šidák); it takes the place of ``snooping``."""
    least_redundancy: float = 0.01
    """Redundancy number below which an observation is called uncontrolled."""


@dataclass(frozen=True)
class Quality:
    """Quality of an adjustment. Standard deviations are those of the report: a posteriori where there is redundancy."""

    adjustment: Adjustment
    redundancy: int
    redundancy_sum: float
    """Σ r, which must equal the redundancy: a self-check."""
    sigma0: float
    """A-posteriori standard deviation of unit weight; the a-priori one is 1."""
    sigma_factor: float
    """What cofactors are multiplied with to become standard deviations: σ0 a posteriori, 1 without redundancy."""
    levels: Levels
    global_test: GlobalTest
    critical: float
    """Critical value of |w|."""
    noncentrality: float
    """δ0² of α0 and β0."""
    groups: tuple[ObservationQuality, ...]
    reliability: tuple[Reliability, ...]
    """Test values, detectable errors and external reliability of each group."""
    cofactors: Mapping[str, FloatArray]
    """Cofactor matrices (n, k, k) of the blocks of each kind, in the datum of the adjustment; rotations as vectors."""
    datum: STransformation
    moving: MovingCofactors
    """Joint cofactors of the coordinates of points and of what moves them."""
    followers: FollowerCofactors
    """Of the poses of stereo followers, which are no blocks of their own."""

    @cached_property
    def flagged(self) -> tuple[BoolArray, ...]:
        """Observations whose test value |w| exceeds the critical value, by group; excluded ones are not among them."""
        groups = self.adjustment.problem.groups
        return tuple(
            _beyond(one, self.critical) & ~group.left_out
            for one, group in zip(self.reliability, groups, strict=True)
        )

    @property
    def w(self) -> tuple[FloatArray, ...]:
        """Normalised residuals v/σ_v of each group (n, m)."""
        return tuple(normalised_residuals(one) for one in self.groups)

    @property
    def omega(self) -> float:
        """vᵀPv."""
        return self.adjustment.normals.objective


def assess(
    adjustment: Adjustment, levels: Levels | None = None, aposteriori: bool = True, done: Done | None = None
) -> Quality:
    """Quality of a converged adjustment; standard deviations with σ0 a posteriori, or a priori (1).

    ``done`` is told how much more of :func:`mor.quality.effort.effort` is done.
    """
    levels = levels or Levels()
    problem = adjustment.problem
    cofactors = adjustment.inverse.selected(of_operations(done) if done is not None else None)
    datum = datum_transformation(adjustment)
    if levels.familywise is not None:
        levels = levels._replace(snooping=sidak(levels.familywise, problem.observations))
    redundancy = problem.observations - problem.index.count + adjustment.defect.dimension
    whole = Whole(redundancy, adjustment.normals.objective, levels, aposteriori)
    return assessed(adjustment, cofactors, datum, whole, done)


class Whole(NamedTuple):
    """Of a network as a whole, where only a part of it may be at hand."""

    redundancy: int
    omega: float
    """vᵀPv."""
    levels: Levels
    """With the level of single observations that follows from the one of all together."""
    aposteriori: bool

    @property
    def sigma0(self) -> float:
        """A-posteriori standard deviation of unit weight; 1 without redundancy."""
        return float(np.sqrt(self.omega / self.redundancy)) if self.redundancy > 0 else 1.0


def assessed(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    datum: STransformation,
    whole: Whole,
    done: Done | None = None,
) -> Quality:
    """Quality of an adjustment, or of a part of one, from the cofactors of its reduced unknowns."""
    problem, levels, sigma0 = adjustment.problem, whole.levels, whole.sigma0
    groups, of_eliminated = observation_quality(adjustment, cofactors, datum, done)
    ncp = noncentrality(levels.snooping, levels.power)
    blocks = {
        kind: parameter_cofactors(adjustment, cofactors, of_eliminated, datum, kind)
        for kind in problem.index.columns
    }
    return Quality(
        adjustment=adjustment,
        redundancy=whole.redundancy,
        redundancy_sum=float(sum(redundancy_of(group) for group in groups)),
        sigma0=sigma0,
        sigma_factor=sigma0 if whole.aposteriori else 1.0,
        levels=levels,
        global_test=global_test(whole.omega, whole.redundancy, levels.overall),
        critical=critical_value(levels.snooping),
        noncentrality=ncp,
        groups=groups,
        reliability=tuple(Reliability(one, ncp) for one in groups),
        cofactors=blocks,
        datum=datum,
        moving=moving_cofactors(adjustment, cofactors, datum),
        followers=follower_cofactors(adjustment, cofactors, datum),
    )


def _beyond(one: Reliability, critical: float) -> BoolArray:
    return in_pieces(one.quality.v.shape, lambda rows: np.abs(np.nan_to_num(one.at(rows).test)) > critical)


def standard_deviations(quality: Quality, kind: str) -> FloatArray:
    """Standard deviations (n, size) of the blocks of a kind (rotations: of their small rotation); 0 where fixed."""
    variances = np.diagonal(quality.cofactors[kind], axis1=1, axis2=2)
    with np.errstate(invalid="ignore"):
        sigma: FloatArray = quality.sigma_factor * np.sqrt(np.maximum(variances, 0.0))
    return sigma
