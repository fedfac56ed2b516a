"""Names of a plan: which targets, images, stations and points patterns stand for, and where these are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import Problem
from mor.project.network.reading import Reading
from mor.project.tables.tables import Place
from mor.quality.design.requirements import chosen_names

NO_PLACE = "no coordinates; what is seen depends on where it is"


class Targets(NamedTuple):
    """The points of a project."""

    names: tuple[str, ...]
    numbers: Mapping[str, int]
    blocks: IntArray
    """(n,) their blocks."""
    positions: FloatArray
    """(n, 3) where they are, internal axes; NaN if they are nowhere yet."""
    groups: Mapping[str, list[int]]
    """Blocks of the groups of points."""


def targets_of(reading: Reading, positions: FloatArray) -> Targets:
    """The points of a project, of which all blocks are at ``positions`` (blocks, 3)."""
    points = reading.shop.things["point"]
    blocks = points.parts["position"]
    return Targets(tuple(points.ids), points.numbers, blocks, positions[blocks], reading.groups)


def targets_named(
    patterns: Sequence[str], targets: Targets, place: Place, key: str, problems: list[Problem]
) -> IntArray:
    """Numbers of the points that names, groups and patterns stand for, each once."""
    grouped = [p for p in patterns if p in targets.groups and p not in targets.numbers]
    plain = [p for p in patterns if p not in grouped]
    found = set(named(plain, targets.names, "point", place, key, problems))
    blocks = [block for name in grouped for block in targets.groups[name]]
    found.update(np.flatnonzero(np.isin(targets.blocks, blocks)).tolist())
    return np.array(sorted(found), dtype=np.int64)


def named(
    patterns: Sequence[str],
    names: Sequence[str],
    what: str,
    place: Place,
    key: str,
    problems: list[Problem],
) -> list[int]:
    """Numbers of the names that patterns stand for; one that stands for nothing is a mistake at its place."""
    wrong: list[Problem] = []
    found = chosen_names(patterns, names, what, "", wrong)
    problems += [place.problem(f"{key}: {one.message}") for one in wrong]
    return found
