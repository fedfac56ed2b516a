"""From a network to its adjustment problem: start values, unknowns numbered, observations with their σ.

Start values are worked out where none are given; of several that are possible the adjustment decides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from mor.adjustment.problem import Cluster, Datum, Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Outcome
from mor.approximate.approximation import Approximation
from mor.arrays import FloatArray
from mor.errors import InputError, NoStartValuesError
from mor.errors import Problem as Mistake
from mor.observations import without
from mor.observations.sigma import with_sigma_model
from mor.parameters.index import all_known, index_unknowns, with_shared_components
from mor.project.network.build import Network
from mor.project.trajectories.read_out import read_out_at
from mor.quality.diagnosis.determinable import completed, without_unknown
from mor.quality.tests.test_statistics import critical_value
from mor.sparse.cholesky import NotFiniteError

SETTLING = 40
"""Iterations in which start values that are in doubt have to lead to a solution."""


def make_problem(
    network: Network, start: Mapping[str, FloatArray], place: Mapping[str, FloatArray]
) -> Problem:
    """The adjustment problem of a network: unknowns numbered, correlations and datum set, σ models evaluated.

    The datum refers to the given coordinates, and to those of ``start`` for points without. Distances in σ models, and
    times by which rows are read out on trajectories, are those of ``place``.
    """
    groups, checks = (
        tuple(with_sigma_model(read_out_at(network, group, place), place) for group in some)
        for some in (network.groups, network.checks)
    )
    groups += tuple(without(group, group.mask) for group in checks)
    offsets = np.concatenate([[0], np.cumsum([group.observed.size for group in groups])])
    widths = np.array([group.observed.shape[1] for group in groups])
    clusters = tuple(
        Cluster(offsets[c.groups] + c.rows * widths[c.groups] + c.components, c.covariance)
        for c in network.correlations
    )
    reference = {"point": network.datum.reference_from(start["point"])}
    movements = reference if network.datum.at_reference else None
    datum = Datum(network.datum.name, network.datum.free, {"point": network.datum.mask}, reference, movements)
    return Problem(index_unknowns(network.blocks), groups, clusters, datum)


def determinable_start(
    network: Network, work_out: Callable[[Network], Approximation] | None = None
) -> tuple[Network, Mapping[str, FloatArray]]:
    """The network and start values of all blocks, worked out where none are given (:func:`worked_out`).

    Points at infinity stay without coordinates. What nobody could start is left out where the project wants that;
    otherwise it raises :class:`NoStartValuesError`.
    """
    if network.trajectories:
        from mor.approximate.along_trajectories import along_trajectories

        network = along_trajectories(network)
    if all_known(network.start):
        return _over_its_places(network, network.start)
    # Imported here: its libraries take as long to load as a small project to adjust.
    from mor.approximate.parts.lines import with_lines_turned

    found = (work_out or worked_out)(network)
    replaced = tuple(
        Mistake(f"start value of {words}; another one takes its place") for words in found.replaced
    )
    ambiguous = tuple(
        Mistake(
            f"start values: the part that began with {join.began} fits in {join.tie.alternatives + 1} ways; "
            "the likeliest one is taken"
        )
        for join in found.parts
        if join.tie is not None and join.tie.alternatives and not join.tie.open
    )
    untied = tuple(
        Mistake(
            f"start values: the part that began with {join.began} ({len(join.points)} points) was put anywhere: "
            "nothing was found that ties it to the rest"
        )
        for join in found.untied
    )
    network = replace(network, notes=(*network.notes, *replaced, *ambiguous), untied=untied)
    settings = network.project.settings
    start: Mapping[str, FloatArray]
    network, start = with_lines_turned(network, found.start)
    start, missing = completed(network, start, found.missing, critical_value(settings.snooping_level))
    if missing and settings.undetermined == "refuse":
        raise NoStartValuesError(missing, map(str, found.remarks))
    if missing:
        network = without_unknown(network, start, missing)
        start = network.start
    return _over_its_places(network, with_shared_components(network.blocks, start))


def _over_its_places(
    network: Network, start: Mapping[str, FloatArray]
) -> tuple[Network, Mapping[str, FloatArray]]:
    """The network and its start values, on the earth with projections as far as these reach."""
    if network.world is None:
        return network, start
    from mor.project.world.planes_over import with_planes_over  # most projects need nothing of it

    return with_planes_over(network, start), start


def worked_out(network: Network) -> Approximation:
    """Start values worked out; of several that are possible those that the adjustment agrees with best."""
    from mor.approximate.growth.strategy import approximate

    return approximate(network, partial(_settled, network))


def _settled(
    network: Network, start: Mapping[str, FloatArray]
) -> tuple[Mapping[str, FloatArray], float] | None:
    """Values to which start values lead and their v'Pv, infinite if singular; ``None`` if they lead nowhere."""
    from mor.approximate.parts.lines import with_lines_turned

    network, start = with_lines_turned(network, start)
    start, _ = completed(network, start, (), critical_value(network.project.settings.snooping_level))
    start = with_shared_components(network.blocks, start)
    if not all_known(start):
        return None
    try:
        found = adjust(make_problem(network, start, start), start, Settings(SETTLING))
    except NotFiniteError:
        return None
    if found.outcome is Outcome.SINGULAR:
        return found.values, np.inf
    return (found.values, found.normals.objective) if found.outcome.is_solution else None


def _worked_out_once(network: Network) -> Approximation:
    """Start values of a change that is only tried: of a wrong one no answer agrees, and all would be asked for."""
    from mor.approximate.growth.strategy import approximate

    return approximate(network, others=0)


def start_or_nothing(network: Network) -> Mapping[str, FloatArray] | None:
    """Start values of a changed network; nothing if there are none, or where it is no more as large."""
    try:
        reduced, start = determinable_start(network, _worked_out_once)
    except (InputError, NoStartValuesError):
        return None
    sizes = [group.count for group in reduced.groups]
    return start if sizes == [group.count for group in network.groups] else None
