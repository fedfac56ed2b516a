"""How the components of an observation type go through the edge: axes, sense of rotation, zero of bearings."""

from __future__ import annotations

import numpy as np

from mor.geometry.arrays import FloatArray
from mor.observations import ObservationType
from mor.project.edge import Edge


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
