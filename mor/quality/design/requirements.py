"""What a project requires of its plan, and whether an adjustment reaches it.

Standard deviations are those of the quality that is asked, in its datum: a priori for a plan. Redundancy numbers and
external reliability do not depend on the datum.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import NamedTuple, TypeVar

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import InputError, Problem, nearest
from mor.geometry import tolerant
from mor.project.edge import UnitError
from mor.project.file.plans import RequiredReliability, RequiredSigma
from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.units import LENGTH

_Given = TypeVar("_Given", RequiredSigma, RequiredReliability)
_COORDINATES = {"x": "x", "y": "y", "z": "z", "xy": "xy", "xyz": "xyz"}
_ROUND_OFF = 1e-9
"""Part of a limit that a value may be beyond it."""


class RequiredPrecision(NamedTuple):
    """A largest σ of coordinates of points, or of the longest semi-axis of their error ellipsoids."""

    of: str
    """What: ``x``, ``xy``, …, ``ellipsoid``."""
    pattern: tuple[str, ...]
    names: tuple[str, ...]
    blocks: IntArray
    """(k,) point blocks."""
    components: tuple[int, ...]
    """Internal components that are looked at; none for the ellipsoid."""
    limit: float
    """Length unit of the project."""


class RequiredControl(NamedTuple):
    """A least redundancy number, or a largest external reliability, of the observations of some groups."""

    of: str
    """``r`` or ``external``."""
    pattern: tuple[str, ...]
    groups: tuple[int, ...]
    """Numbers of the groups."""
    limit: float


Requirement = RequiredPrecision | RequiredControl


@dataclass(frozen=True)
class Judged:
    """Whether a requirement is met, and how far the worst is from it."""

    requirement: Requirement
    worst: float
    """Largest σ or δ̄0, smallest r; infinite where something is not controlled at all."""
    where: tuple[int, ...]
    """Number of the point among its names; group, row and component of the observation."""
    count: int
    """Points or observations that it is about."""
    failing: int
    """Those of them that do not reach it."""

    @property
    def met(self) -> bool:
        """True where nothing fails."""
        return self.failing == 0


def requirements(network: Network) -> tuple[Requirement, ...]:
    """What the project requires, with what its names stand for. Raises :class:`InputError` for those of nothing."""
    problems: list[Problem] = []
    wanted = network.project.require
    result: list[Requirement] = []
    for precision in _listed(wanted.sigma):
        result += _precision(network, precision, problems)
    for control in _listed(wanted.reliability):
        result += _control(network, control, problems)
    if problems:
        raise InputError(problems)
    return tuple(result)


def _listed(given: _Given | list[_Given]) -> list[_Given]:
    return given if isinstance(given, list) else [given]


def chosen_names(
    patterns: Iterable[str], names: Sequence[str], what: str, file: str, problems: list[Problem]
) -> list[int]:
    """Numbers of the names that patterns stand for, each once; a pattern that stands for nothing is a mistake."""
    found: set[int] = set()
    for pattern in patterns:
        here = [k for k, name in enumerate(names) if name == pattern or fnmatchcase(name, pattern)]
        if not here:
            words = f"no {what} is called {pattern!r}{nearest(pattern, names)}"
            problems.append(Problem(words, file))
        found.update(here)
    return sorted(found)


def _precision(network: Network, wanted: RequiredSigma, problems: list[Problem]) -> list[RequiredPrecision]:
    things = network.things["point"]
    positions = things.parts["position"]
    of_group: dict[str, list[int]] = {}
    for k, block in enumerate(positions.tolist()):
        of_group.setdefault(network.point_groups.get(block, ""), []).append(k)
    groups = [p for p in wanted.points if p in of_group and p not in things.numbers]
    plain = [p for p in wanted.points if p not in groups]
    chosen = set(chosen_names(plain, things.ids, "point", network.file, problems))
    chosen.update(k for name in groups for k in of_group[name])
    free = np.asarray(network.blocks["point"].free[positions].any(axis=1))
    numbers = np.array([k for k in sorted(chosen) if free[k]], dtype=np.int64)
    if chosen and not len(numbers):
        problems.append(Problem(f"require: all of {', '.join(wanted.points)} are fixed", network.file))
    source = np.argmax(np.abs(network.edge.matrix), axis=0)
    found = []
    for key in (*_COORDINATES, "ellipsoid"):
        text = getattr(wanted, key)
        if text is None:
            continue
        try:
            limit = network.edge.number(text, LENGTH)
            if limit <= 0.0:
                raise UnitError(f"found {text}, expected a σ > 0")
        except UnitError as error:
            problems.append(Problem(f"require: sigma: {key}: {error}", network.file))
            continue
        components = tuple(int(source["xyz".index(axis)]) for axis in _COORDINATES.get(key, ""))
        names = tuple(things.ids[k] for k in numbers)
        found.append(
            RequiredPrecision(key, tuple(wanted.points), names, positions[numbers], components, limit)
        )
    return found


def _control(network: Network, wanted: RequiredReliability, problems: list[Problem]) -> list[RequiredControl]:
    names = [group.name for group in network.groups]
    groups = tuple(chosen_names(wanted.groups, names, "group of observations", network.file, problems))
    pairs = (("r", wanted.r), ("external", wanted.external))
    return [
        RequiredControl(of, tuple(wanted.groups), groups, limit) for of, limit in pairs if limit is not None
    ]


def judged(requirement: Requirement, quality: Quality, absent: BoolArray | None = None) -> Judged:
    """Whether a quality reaches a requirement; point blocks that are ``absent`` (n,) have no σ and do not."""
    if isinstance(requirement, RequiredPrecision):
        return _judged_precision(requirement, quality, absent)
    return _judged_control(requirement, quality)


def sigmas(requirement: RequiredPrecision, covariance: FloatArray) -> FloatArray:
    """(k,) the largest σ that a requirement is about of each point, for covariances (k, 3, 3), internal axes."""
    if requirement.components:
        variance = np.diagonal(covariance, axis1=1, axis2=2)[:, list(requirement.components)].max(axis=1)
    else:
        variance = tolerant.eigvalsh(covariance)[:, -1] if len(covariance) else np.zeros(0)
    found: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    return found


def _judged_precision(requirement: RequiredPrecision, quality: Quality, absent: BoolArray | None) -> Judged:
    covariance = quality.sigma_factor**2 * np.nan_to_num(quality.cofactors["point"][requirement.blocks])
    sigma = sigmas(requirement, covariance)
    if absent is not None:
        sigma = np.where(absent[requirement.blocks], np.inf, sigma)
    failing = int(np.count_nonzero(sigma > requirement.limit * (1.0 + _ROUND_OFF)))
    worst = int(np.argmax(sigma))
    return Judged(requirement, float(sigma[worst]), (worst,), len(sigma), failing)


def _judged_control(requirement: RequiredControl, quality: Quality) -> Judged:
    """The worst of all observations of the groups; one that is not controlled has r = 0 and any effect whatever."""
    worst, where, count, failing = np.inf, (-1, -1, -1), 0, 0  # type: float, tuple[int, ...], int, int
    sign = 1.0 if requirement.of == "r" else -1.0
    for number in requirement.groups:
        r = quality.groups[number].r
        values = r if requirement.of == "r" else quality.reliability[number].external
        values = np.where(np.isfinite(r) & ~np.isfinite(values), np.inf, values)
        known = np.isfinite(r)
        if not known.any():
            continue
        signed = np.where(known, sign * values, np.inf)
        count += int(np.count_nonzero(known))
        failing += int(np.count_nonzero(signed < sign * requirement.limit - _ROUND_OFF))
        at = int(np.argmin(signed))
        if signed.flat[at] < worst:
            worst = float(signed.flat[at])
            where = (number, *(int(k) for k in np.unravel_index(at, signed.shape)))
    return Judged(requirement, sign * worst, where, count, failing)
