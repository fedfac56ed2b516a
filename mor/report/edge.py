"""Out through the edge: project axes and units for points, attitudes and observations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.rotations import angles_from_rotation
from mor.observations import External, ObservationGroup
from mor.parameters.index import moves_by_angles
from mor.parameters.kinds import KINDS
from mor.project.file.model import Project
from mor.quality.precision.cofactors import angle_cofactors
from mor.quality.solved import Solved
from mor.units import ANGLE_UNITS


class Estimate(NamedTuple):
    """Values (n, k) with standard deviations (n, k; NaN if there are none) and covariances (n, k, k) or ``None``."""

    values: FloatArray
    sigma: FloatArray
    covariance: FloatArray | None


def angle_unit(solved: Solved) -> str:
    """Unit of angles in reports: degrees where the project writes d-m-s."""
    return angle_unit_of(solved.network.project)


def angle_unit_of(project: Project) -> str:
    """The same of a project."""
    unit = project.units.angle
    return "deg" if unit == "dms" else unit


def plain(solved: Solved, kind: str, numbers: IntArray) -> Estimate:
    """Values and σ of plain blocks, in internal units (which are the project's for lengths and numbers)."""
    if len(numbers) == 0:
        return Estimate(np.zeros((0, KINDS[kind].size)), np.zeros((0, KINDS[kind].size)), None)
    values = solved.adjustment.values[kind][numbers]
    covariance = _covariance(solved, kind, numbers)
    return Estimate(values, _sigma(covariance, values.shape), covariance)


def points(solved: Solved, numbers: IntArray) -> Estimate:
    """Coordinates of points in project axes, with their covariances in the datum of the adjustment."""
    if len(numbers) == 0:
        return Estimate(np.zeros((0, 3)), np.zeros((0, 3)), None)
    values = solved.adjustment.values["point"][numbers]
    estimate = said_places(solved, values, _covariance(solved, "point", numbers))
    return _present(solved, "point", numbers, estimate)


def said_places(solved: Solved, values: FloatArray, covariance: FloatArray | None) -> Estimate:
    """Places (n, 3) with covariances (n, 3, 3) in project axes."""
    M = solved.network.edge.matrix
    if covariance is not None:
        covariance = M.T @ covariance @ M
    return Estimate(values @ M, _sigma(covariance, values.shape), covariance)


def rotations(solved: Solved, numbers: IntArray) -> Estimate:
    """ω, φ, κ against project axes, in the project's angle unit, with their rigorous covariances."""
    if len(numbers) == 0:
        return Estimate(np.zeros((0, 3)), np.zeros((0, 3)), None)
    D = solved.adjustment.values["rotation"][numbers]
    by_angles = moves_by_angles(solved.network.blocks["rotation"])[numbers]
    estimate = said_attitudes(solved, D, _covariance(solved, "rotation", numbers), by_angles)
    return _present(solved, "rotation", numbers, estimate)


def said_attitudes(
    solved: Solved, D: FloatArray, covariance: FloatArray | None, by_angles: BoolArray
) -> Estimate:
    """ω, φ, κ of attitudes (n, 3, 3), covariances (n, 3, 3) of small rotations, or of angles where ``by_angles``."""
    edge = solved.network.edge
    turned = D @ edge.matrix if edge.right_handed else D
    per_unit = ANGLE_UNITS[angle_unit(solved)]
    if covariance is not None:
        covariance = angle_cofactors(covariance, turned, by_angles) / per_unit**2
    values = angles_from_rotation(turned) / per_unit
    return Estimate(values, _sigma(covariance, values.shape), covariance)


def _present(solved: Solved, kind: str, numbers: IntArray, estimate: Estimate) -> Estimate:
    """The estimate with no values for what was left out or is at infinity."""
    if kind not in solved.network.absent:
        return estimate
    absent = _absent_among(solved, kind, numbers)[:, None]
    values, sigma = (np.where(absent, np.nan, array) for array in (estimate.values, estimate.sigma))
    return Estimate(values, sigma, estimate.covariance)


def _absent_among(solved: Solved, kind: str, numbers: IntArray) -> BoolArray:
    absent = np.zeros(len(solved.network.blocks[kind].ids), dtype=bool)
    known = solved.network.absent[kind]
    absent[: len(known)] = known
    return absent[numbers]


def _covariance(solved: Solved, kind: str, numbers: IntArray) -> FloatArray | None:
    quality = solved.quality
    if quality is None:
        return None
    covariance: FloatArray = quality.cofactors[kind][numbers] * quality.sigma_factor**2
    return covariance


def _sigma(covariance: FloatArray | None, shape: tuple[int, ...]) -> FloatArray:
    if covariance is None:
        return np.full(shape, np.nan)
    with np.errstate(invalid="ignore"):
        sigma: FloatArray = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    return sigma


class Said(NamedTuple):
    """Transformation of the arrays of a group to the units and axes of the user."""

    source: IntArray
    """(m,) internal component behind each reported one."""
    sign: FloatArray
    """(m,) its sign."""
    external: External


def said(group: ObservationGroup) -> Said:
    """Permutation and signs of a group's components on the way out."""
    external = group.external
    if external is None:
        size = len(group.type.components)
        external = External(np.eye(size), np.zeros(size), np.ones(size), ("",) * size)
    transform = external.transform
    source = np.argmax(np.abs(transform), axis=0)
    return Said(source, transform[source, np.arange(len(source))], external)


def said_values(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Observed or adjusted values (n, m) as the user gives them."""
    out = said(group)
    return ((internal - out.external.offset)[:, out.source] * out.sign) / out.external.factors


def said_differences(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Residuals (n, m): turned, without the offset."""
    out = said(group)
    return (internal[:, out.source] * out.sign) / out.external.factors


def said_sizes(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Standard deviations (n, m): permuted, without sign."""
    out = said(group)
    return internal[:, out.source] / out.external.factors


def said_signs(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Numbers without unit that carry a sign (w): permuted and turned."""
    out = said(group)
    return internal[:, out.source] * out.sign


def said_numbers(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Numbers without unit and sign (r): permuted."""
    return internal[:, said(group).source]
