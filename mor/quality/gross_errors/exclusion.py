"""Observations taken out of a problem, and put back: their weights vanish, their residuals stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mor.adjustment.problem import Cluster, Problem
from mor.arrays import BoolArray, FloatArray
from mor.observations import without
from mor.observations._contract import OUT


def exclude(problem: Problem, excluded: Sequence[BoolArray]) -> Problem:
    """The problem (with nothing excluded yet) without these entries, one mask (n, m) for each group.

    What was correlated with an excluded entry keeps its own covariances, as if the entry had never been measured.
    """
    groups = tuple(without(group, mask) for group, mask in zip(problem.groups, excluded, strict=True))
    return replace(problem, groups=groups, clusters=_clusters(problem, excluded))


def _clusters(problem: Problem, excluded: Sequence[BoolArray]) -> tuple[Cluster, ...]:
    if not problem.clusters:
        return ()
    flat = np.concatenate([mask.ravel() for mask in excluded])
    return tuple(_without(cluster, flat[cluster.entries]) for cluster in problem.clusters)


def _without(cluster: Cluster, out: BoolArray) -> Cluster:
    if not out.any():
        return cluster
    covariance = np.where(out[:, None] ^ out[None, :], 0.0, cluster.covariance)
    covariance[np.ix_(out, out)] = np.diag(np.diagonal(cluster.covariance)[out] * OUT**2)
    return cluster._replace(covariance=covariance)


def reweighted(problem: Problem, factors: Sequence[FloatArray]) -> Problem:
    """The problem with every σ multiplied by a factor, one array (n, m) for each group; correlations stay."""
    groups = tuple(
        replace(group, sigma=group.sigma * factor)
        for group, factor in zip(problem.groups, factors, strict=True)
    )
    flat = np.concatenate([factor.ravel() for factor in factors])
    clusters = tuple(
        cluster._replace(
            covariance=cluster.covariance * np.outer(flat[cluster.entries], flat[cluster.entries]),
        )
        for cluster in problem.clusters
    )
    return replace(problem, groups=groups, clusters=clusters)
