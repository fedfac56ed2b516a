"""Variants of a plan: parts left out, other σ, another lens, candidates added."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from mor.arrays import BoolArray
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.observations import ObservationGroup
from mor.planning.plan import at_its_place, read_plan, solve_plan
from mor.project.file.nodes import Document
from mor.project.file.plans import Variant
from mor.project.network.build import Network
from mor.project.observations.correlations import Correlation
from mor.quality.design.requirements import chosen_names
from mor.quality.solved import Solved

_SPACES = {"points": "point", "images": "image", "stations": "station"}


def variant_network(document: Document, folder: Path, name: str, base: Network) -> Network:
    """The network of a variant, at its place. Raises :class:`InputError` for names of nothing."""
    variant = base.project.variants[name]
    network = _with_cameras(document, folder, name, variant) if variant.cameras else base
    problems: list[Mistake] = []
    at = f"{network.file}: variants: {name}"
    network = _with_candidates(network, variant, at, problems)
    network = _with_factors(network, variant, at, problems)
    network = _without(network, variant, at, problems)
    if problems:
        raise InputError(problems)
    return network


def solve_variant(network: Network) -> Solved:
    """The expected quality of a variant without what nothing determines any more; no solution where nothing is left."""
    settings = network.project.settings.model_copy(update={"undetermined": "leave_out"})
    lenient = replace(network, project=network.project.model_copy(update={"settings": settings}))
    try:
        return solve_plan(lenient)
    except InputError:  # nothing is left: told as it is told of a plan
        return solve_plan(network)


def _with_cameras(document: Document, folder: Path, name: str, variant: Variant) -> Network:
    cameras = dict(document.data.get("cameras") or {})
    problems = [
        Mistake(f"variants: {name}: there is no camera {camera!r}", document.file)
        for camera in variant.cameras
        if camera not in cameras
    ]
    if problems:
        raise InputError(problems)
    merged = {**cameras, **{c: _merged(cameras[c], keys) for c, keys in variant.cameras.items()}}
    changed = replace(document, data={**document.data, "cameras": merged})
    try:
        return at_its_place(read_plan(changed, folder).network)
    except InputError as error:
        place = f"variants: {name}: "
        told = [one._replace(message=place + one.message, line=0) for one in error.problems]
        raise InputError(told) from None


def _merged(given: Any, other: Any) -> Any:
    """Mappings merged key by key; what says free, fixed or observed is one value and replaced as a whole."""
    if not (isinstance(given, dict) and isinstance(other, dict)):
        return other
    if {"free", "fixed", "observed"} & given.keys():
        return other
    return {**given, **{key: _merged(given.get(key), value) for key, value in other.items()}}


def _with_candidates(network: Network, variant: Variant, at: str, problems: list[Mistake]) -> Network:
    names = [group.name for group in network.candidates]
    chosen = chosen_names(variant.candidates, names, "table of candidates", at, problems)
    kept = tuple(group for k, group in enumerate(network.candidates) if k not in chosen)
    return replace(
        network, groups=(*network.groups, *(network.candidates[k] for k in chosen)), candidates=kept
    )


def _with_factors(network: Network, variant: Variant, at: str, problems: list[Mistake]) -> Network:
    names = [group.name for group in network.groups]
    factors = np.ones(len(names))
    for pattern, factor in variant.factor.items():
        factors[chosen_names([pattern], names, "group of observations", at, problems)] *= factor
    groups = tuple(
        replace(group, sigma=group.sigma * f, ppm=group.ppm * f) if f != 1.0 else group
        for group, f in zip(network.groups, factors.tolist(), strict=True)
    )
    correlations = tuple(
        one._replace(covariance=one.covariance * np.outer(factors[one.groups], factors[one.groups]))
        for one in network.correlations
    )
    return replace(network, groups=groups, correlations=correlations)


def _without(network: Network, variant: Variant, at: str, problems: list[Mistake]) -> Network:
    """Observations that refer to what is left out are no more there."""
    wanted = variant.without
    names = [group.name for group in network.groups]
    whole = set(chosen_names(wanted.groups, names, "group of observations", at, problems))
    lost: dict[str, set[str]] = {}
    for key, space in _SPACES.items():
        things = network.things[space].ids
        numbers = chosen_names(getattr(wanted, key), things, space, at, problems)
        lost[space] = {things[k] for k in numbers}
    lost["station"] |= {name for name, (station, _) in network.sets.items() if station in lost["station"]}
    out = [_lost_rows(group, lost) | (number in whole) for number, group in enumerate(network.groups)]
    groups = tuple(
        replace(group, observed=np.where(rows[:, None], np.nan, group.observed)) if rows.any() else group
        for group, rows in zip(network.groups, out, strict=True)
    )
    return replace(network, groups=groups, correlations=_kept(network.correlations, out))


def _lost_rows(group: ObservationGroup, lost: dict[str, set[str]]) -> BoolArray:
    """(n,) rows that refer to something that is left out."""
    rows = np.zeros(group.count, dtype=bool)
    for reference, names in zip(group.type.references, group.references, strict=True):
        gone = set().union(*(lost[space] for space in reference.among if space in lost))
        if gone:
            rows |= names.texts().is_in(sorted(gone)).to_numpy()
    return rows


def _kept(correlations: Iterable[Correlation], out: Sequence[BoolArray]) -> tuple[Correlation, ...]:
    """Correlations of what is left."""
    found = []
    for one in correlations:
        stays = np.array([not out[g][r] for g, r in zip(one.groups, one.rows, strict=True)], dtype=bool)
        if stays.any():
            covariance = one.covariance[np.ix_(stays, stays)]
            found.append(Correlation(one.groups[stays], one.rows[stays], one.components[stays], covariance))
    return tuple(found)


def named_in(variant: Variant, name: str) -> bool:
    """Return True if a variant leaves a point out by its name: nothing is required of it then."""
    return any(fnmatchcase(name, pattern) for pattern in variant.without.points)
