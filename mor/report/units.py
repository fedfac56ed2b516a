"""Units and names of estimated quantities on the way out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from threading import Lock
from typing import Any, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from mor.model.contract import External, ObservationGroup
from mor.model.parameters import IMAGE_VELOCITY, INTERIORS, KINDS, ROTATION_RATE, moves_by_angles
from mor.model.rotations import angles_from_rotation
from mor.project.prior_knowledge import feature_label
from mor.project.schema import ProjectFile
from mor.quality.precision import angle_cofactors
from mor.quality.solution import Solved
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE_UNITS, Component, Quantity

# ---- Out through the edge: project axes and units for points, attitudes and observations.


class Estimate(NamedTuple):
    """Values (n, k) with standard deviations (n, k; NaN if there are none) and covariances (n, k, k) or ``None``."""

    values: FloatArray
    sigma: FloatArray
    covariance: FloatArray | None


def angle_unit(solved: Solved) -> str:
    """Unit of angles in reports: degrees where the project writes d-m-s."""
    return angle_unit_of(solved.network.project)


def angle_unit_of(project: ProjectFile) -> str:
    """The same of a project."""
    unit = project.units.angle
    return "deg" if unit == "dms" else unit


def unit_of(solved: Solved, quantity: Quantity) -> str:
    """Unit of a quantity of plain blocks in reports; image units are those of the first camera."""
    image = next((scale.unit for scale in solved.network.scales.values()), "mm")
    return quantity.unit(solved.network.project.units.length, angle_unit(solved), image)


def picked(record: object, *names: str) -> dict[str, Any]:
    """Attributes of a record by their names."""
    return {name: getattr(record, name) for name in names}


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
    estimate = said_places(solved, solved.adjustment.values["point"][numbers], _covariance(solved, "point", numbers))
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


def said_attitudes(solved: Solved, D: FloatArray, covariance: FloatArray | None, by_angles: BoolArray) -> Estimate:
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
    return np.asarray(quality.cofactors[kind][numbers] * quality.sigma_factor**2)


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


def ends_of_group(group: ObservationGroup) -> Said:
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
    out = ends_of_group(group)
    return ((internal - out.external.offset)[:, out.source] * out.sign) / out.external.factors


def said_differences(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Residuals (n, m): turned, without the offset."""
    out = ends_of_group(group)
    return (internal[:, out.source] * out.sign) / out.external.factors


def said_sizes(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Standard deviations (n, m): permuted, without sign."""
    out = ends_of_group(group)
    return internal[:, out.source] / out.external.factors


def said_signs(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Numbers without unit that carry a sign (w): permuted and turned."""
    out = ends_of_group(group)
    return internal[:, out.source] * out.sign


def said_numbers(group: ObservationGroup, internal: FloatArray) -> FloatArray:
    """Numbers without unit and sign (r): permuted."""
    return internal[:, ends_of_group(group).source]


def reported_component(group: ObservationGroup, component: int) -> int:
    """Number of the reported component behind an internal one."""
    return int(np.flatnonzero(ends_of_group(group).source == component)[0])


def said_one(
    said: Callable[[ObservationGroup, FloatArray], FloatArray], group: ObservationGroup, component: int, value: float
) -> float:
    """One value of an internal component as ``said`` (:func:`said_sizes`, …) reports it."""
    internal = np.zeros((1, group.observed.shape[1]))
    internal[0, component] = value
    return float(said(group, internal)[0, reported_component(group, component)])


# ---- Components of plain blocks, by name: value, σ, status, in the units of the report.


def component_rows(solved: Solved, kind: str, number: int, components: Any) -> dict[str, Any]:
    """Components of a block by name: value, σ, status, and how significant those are that are unknowns."""
    estimate = plain(solved, kind, np.array([number]))
    blocks = solved.network.blocks[kind]
    factors = factors_of(solved, components)
    return {
        component.name: {
            "value": float(estimate.values[0, k] / factors[k]),
            "sigma": number_or_none(estimate.sigma[0, k] / factors[k]) if blocks.free[number, k] else None,
            "status": "free" if blocks.free[number, k] else "fixed",
            **({"t": _significance(estimate, k, component.default)} if blocks.free[number, k] else {}),
        }
        for k, component in enumerate(components)
    }


def factors_of(solved: Solved, components: Sequence[Component]) -> list[float]:
    """Internal units per unit of the report, of components of plain blocks."""
    unit = ANGLE_UNITS[angle_unit(solved)]
    return [unit**component.quantity.angle for component in components]


def _significance(estimate: Estimate, k: int, neutral: float) -> float | None:
    """Distance of a component from its neutral value, in units of σ; ``None`` if it has none."""
    sigma = float(estimate.sigma[0, k])
    return number_or_none((estimate.values[0, k] - neutral) / sigma) if sigma > 0.0 else None


def other_rows(solved: Solved) -> list[dict[str, Any]]:
    """Blocks with unknowns that belong to no table: instruments, heights, eccentricities, image-variant interiors."""
    rows = []
    features = {feature_label(feature) for feature in solved.network.project.features}
    for kind in (
        *("distance meter", "refraction", "gnss frame", "height", "eccentricity"),
        *("shape", "readout", "position shift", "attitude shift", "time offset"),
        *(k.key for k in INTERIORS.values()),
    ):
        blocks = solved.network.blocks.get(kind)
        if blocks is None:
            continue
        shown = set(solved.network.things["camera"].ids) if kind.startswith("interior/") else features
        for number in np.flatnonzero(blocks.free.any(axis=1)):
            if blocks.ids[number] not in shown:
                components = component_rows(solved, kind, int(number), blocks.kind.components)
                own = {n: c for n, c in components.items() if c["status"] == "free"}
                rows.append({"kind": kind, "id": blocks.ids[number], "components": own})
    return rows


def motion_columns(solved: Solved) -> dict[str, FloatArray]:
    """Velocities and rates of rotation of the images that are read out row by row, with σ; nothing if none is."""
    parts, columns = solved.network.things["image"].parts, dict[str, FloatArray]()
    for kind in (IMAGE_VELOCITY, ROTATION_RATE):
        here = np.flatnonzero(parts[kind.key] >= 0)
        if not len(here):
            continue
        estimate = plain(solved, kind.key, parts[kind.key][here])
        free = solved.network.blocks[kind.key].free[parts[kind.key][here]]
        for k, (name, factor) in enumerate(zip(kind.names, factors_of(solved, kind.components), strict=True)):
            columns[name], columns[f"s{name}"] = (np.full(len(parts["camera"]), np.nan) for _ in range(2))
            columns[name][here] = estimate.values[:, k] / factor
            columns[f"s{name}"][here] = np.where(free[:, k], estimate.sigma[:, k] / factor, 0.0)
    return columns


def number_or_none(value: float) -> float | None:
    """The number, or nothing if it is none."""
    return float(value) if np.isfinite(value) else None


# ---- Tables that several reports show are worked out once for an adjustment, whichever of them comes first.

Table = TypeVar("Table")


_REMEMBERED: list[WeakKeyDictionary[Solved, Any]] = []


def once(work: Callable[[Solved], Table]) -> Callable[[Solved], Table]:
    """Remember what the work made of an adjustment for as long as that is there; nobody may change it.

    Reports are made side by side: who comes second waits for the first. No such work may ask for itself.
    """
    known: WeakKeyDictionary[Solved, Table] = WeakKeyDictionary()
    _REMEMBERED.append(known)
    working = Lock()

    @wraps(work)
    def remembered(solved: Solved) -> Table:
        with working:
            if solved not in known:
                known[solved] = work(solved)
            return known[solved]

    return remembered


def forget(solved: Solved) -> None:
    """Give back the room of all tables of an adjustment; who asks for one again has it worked out again."""
    for known in _REMEMBERED:
        known.pop(solved, None)
