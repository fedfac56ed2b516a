"""Components of plain blocks, by name: value, σ, status, in the units of the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mor.arrays import FloatArray
from mor.parameters.kinds import IMAGE_VELOCITY, INTERIORS, ROTATION_RATE
from mor.project.network.features import feature_label
from mor.quality.solved import Solved
from mor.report.edge import Estimate, angle_unit, plain
from mor.units import ANGLE_UNITS, Component


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
    """Distance of a component from its neutral value, in units of σ."""
    sigma = float(estimate.sigma[0, k])
    return float((estimate.values[0, k] - neutral) / sigma) if sigma > 0.0 else None


def other_rows(solved: Solved) -> list[dict[str, Any]]:
    """Blocks with unknowns that belong to no table: instruments, heights, eccentricities, image-variant interiors."""
    rows = []
    features = {feature_label(feature) for feature in solved.network.project.features}
    for kind in (
        "distance meter",
        "refraction",
        "gnss frame",
        "height",
        "eccentricity",
        "readout",
        "position shift",
        "attitude shift",
        "time offset",
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
