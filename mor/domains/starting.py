"""Start values of a domain: points that have none are intersected by its rays, which are all that a point has.

What is not divided sees only names of such points; it is told where the others have found them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Undeterminable
from mor.errors import Problem as Mistake
from mor.parameters.index import Values, all_known, with_shared_components
from mor.project.domains.part_network import PartNetwork
from mor.project.network.build import Network
from mor.quality.tests.test_statistics import critical_value

RAYS_ALONE = "too few rays see it to intersect it, and domains ask nothing else (mor approximate does)"
"""Why a point stays without start values that other observations name, too."""
Places = Mapping[str, FloatArray]
"""Coordinates (3,) of points by name, internal axes."""


class Started(NamedTuple):
    """Start values of a domain, as far as there are any."""

    values: Values
    missing: tuple[Undeterminable, ...] = ()
    """Points that cannot be intersected, and why."""
    found: Places = MappingProxyType({})
    """Those that were, and that another domain has, too."""


def started(part: PartNetwork, places: Places | None) -> Started:
    """Start values of a domain; of what is not divided from the ``places`` of points that the others have found.

    Raises :class:`InputError` where anything else has none.
    """
    network = part.network
    if all_known(network.start):
        return Started(with_shared_components(network.blocks, network.start))
    ids, unknown = network.blocks["point"].ids, np.isnan(network.start["point"]).any(axis=1)
    if places is not None:
        values = _with_places(network, places)
        _refuse_unknown(network, values)
        return Started(with_shared_components(network.blocks, values))
    _refuse_unknown(network, {kind: values for kind, values in network.start.items() if kind != "point"})
    values, missing = _intersected(network)
    shared = [k for k in np.flatnonzero(unknown).tolist() if part.is_common("point", ids[k])]
    found = {ids[k]: values["point"][k] for k in shared if np.isfinite(values["point"][k]).all()}
    both = {ids[k] for k in shared}
    missing = tuple(
        one._replace(reason=RAYS_ALONE) if one.name in both and not one.treatment else one for one in missing
    )
    return Started(with_shared_components(network.blocks, values), missing, found)


def _with_places(network: Network, places: Places) -> Values:
    points = network.start["point"].copy()
    ids = network.blocks["point"].ids
    for k in np.flatnonzero(np.isnan(points).any(axis=1)).tolist():
        if ids[k] in places:
            points[k] = np.where(np.isnan(points[k]), places[ids[k]], points[k])
    return {**network.start, "point": points}


def _intersected(network: Network) -> tuple[Values, tuple[Undeterminable, ...]]:
    # Imported here: with start values for everything nothing of it is needed.
    from mor.approximate.assembly.points_of_given_poses import with_points_of_given_poses
    from mor.approximate.parts.transfer import missing_start_values
    from mor.quality.diagnosis.determinable import completed_or_at_infinity

    found: Values = with_points_of_given_poses(network)
    missing = missing_start_values(network, found)
    if missing:
        critical = critical_value(network.project.settings.snooping_level)
        found, missing = completed_or_at_infinity(network, found, missing, critical)
    return found, missing


def _refuse_unknown(network: Network, start: Values) -> None:
    """Raise :class:`InputError` where something has no start value that is not intersected; the first are named."""
    names = [
        network.blocks[kind].ids[block]
        for kind, values in start.items()
        for block in np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))[:3].tolist()
    ]
    if names:
        words = ", ".join(names[:5])
        needed = "domains need those of all but points that images in tables see"
        raise InputError(
            [Mistake(f"no start value: {words}; {needed} (mor approximate works them out)", network.file)]
        )
