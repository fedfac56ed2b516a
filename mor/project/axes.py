"""How the components of an observation type go through the edge: axes, sense of rotation, zero of bearings."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.observations import External, ObservationType
from mor.project.edge import Edge, ImageScale


def edge_transform(type_: ObservationType, edge: Edge) -> tuple[FloatArray, FloatArray]:
    """(m, m) signed permutation T and (m,) offset t: internal = T · given + t; given = Tᵀ · (internal − t)."""
    size = len(type_.components)
    transform, offset = np.eye(size), np.zeros(size)
    for component in type_.turns:
        transform[component, component] = edge.sense
    for component in type_.bearings:
        offset[component] = edge.zero_azimuth
    if type_.in_object_axes and size == 3:
        transform = edge.matrix
    return transform, offset


def external_image(scale: ImageScale) -> External:
    """How image coordinates of a camera are reported: in the unit and from the origin they are measured in."""
    unit = scale.coordinate_unit
    factor = scale.factor(unit)
    if not scale.corner:
        return External(np.eye(2), np.zeros(2), np.full(2, factor), (unit, unit))
    flip = np.diag([1.0, -1.0])
    centre = np.array(scale.centre) * scale.factor("px")
    return External(flip, -flip @ centre, np.full(2, factor), (unit, unit))


def external(type_: ObservationType, edge: Edge, scale: ImageScale | None = None) -> External:
    """How the components of a type are reported: project axes, senses and units, the camera's image unit."""
    units = tuple(edge.default_unit(component.quantity, scale) for component in type_.components)
    transform, offset = edge_transform(type_, edge)
    factors = np.array(
        [edge.factor(c.quantity, unit, scale) for c, unit in zip(type_.components, units, strict=True)]
    )
    return External(transform, offset, factors, units)
