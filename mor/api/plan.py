"""A plan: the network as it is going to be measured, with the precision and reliability that can be expected.

σ, redundancy numbers and detectable errors need geometry and weights alone. So a plan is the adjustment of observations
that are free of errors at the place the project gives: its solution is that place, its statistics are those expected.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.api.pipeline import check_minimal, determinable_start, levels, make_problem
from mor.errors import InputError, Message, mistakes_in
from mor.linalg.compilation import chosen_by_size
from mor.model.parameters import Values, all_known
from mor.plan.requirements import Sighted
from mor.plan.simulation import conditions, measured_at, place_with_errors
from mor.plan.visibility import with_visible
from mor.project.document import Document
from mor.project.entities import said_thing
from mor.project.network import Network, build_network
from mor.project.planned_network import with_image_poses
from mor.project.schema import validate
from mor.quality.assessment import assess
from mor.quality.determinability import Means, adjust_determinable
from mor.quality.outliers import Attempt
from mor.quality.solution import Solved, with_poses
from mor.quality.test_statistics import critical_value
from mor.solve.iterate import SolverSettings, adjust
from mor.types import FloatArray


class PlannedProject(NamedTuple):
    """A project in which measured values may be missing, as it was read."""

    network: Network
    document: Document
    """The project, with the rows of what is visible."""
    sighted: tuple[Sighted, ...]
    """Visibility, where that was worked out."""


def read_plan(document: Document, folder: Path) -> PlannedProject:
    """The plan of a project. Raises :class:`InputError`."""
    document, sighted = with_visible(document, folder)
    return PlannedProject(build_network(validate(document), document, folder, planned=True), document, sighted)


def at_its_place(network: Network) -> Network:
    """The network at the place that its project gives, with observations that are free of errors there.

    Circles of levelled instruments without orientation are taken to stand at zero. Anything else that has no place is
    worked out where everything has been measured already; else it is a mistake (:class:`InputError`).
    """
    network = replace(network, start=with_image_poses(network, network.start))
    if all_known(network.start):
        return _measured_where_implied(network, network.start)
    if not network.unmeasured:
        found, place = determinable_start(network)
        measured = "missing start values are computed from the measured values"
        return _measured_where_implied(replace(found, notes=(*found.notes, Message(measured))), place)
    place, missing = _with_circles_at_zero(network)
    no_place = "a plan needs all start values: coordinates of points and poses of images"
    if missing:
        raise InputError([Message(f"{thing}: no place; {no_place}", network.file) for thing in missing])
    return _measured_where_implied(network, place)


def _measured_where_implied(network: Network, place: Values) -> Network:
    with chosen_by_size(network.observations):
        problem = make_problem(network, place, place)
        exact = [np.zeros(group.observed.shape) for group in problem.groups]
        there = place_with_errors(problem, place, exact, conditions(problem))
        return measured_at(_known_on_earth(network, there), there)


def _known_on_earth(network: Network, place: Values) -> Network:
    if network.world is None:
        return network
    from mor.project.planned_network import known_at_place  # most projects need nothing of it

    return known_at_place(network, place)


def _with_circles_at_zero(network: Network) -> tuple[dict[str, FloatArray], list[str]]:
    """Start values with free turns of circles, and what has no place still."""
    place = {kind: values.copy() for kind, values in network.start.items()}
    stations = network.things["station"].parts["rotation"]
    loose = stations[~np.isfinite(place["rotation"][stations]).all(axis=(1, 2))] if len(stations) else stations
    if len(loose):
        place["rotation"][loose] = np.eye(3)
    missing = [
        said_thing(kind, network.blocks[kind].ids[block])
        for kind, values in place.items()
        for block in np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1)).tolist()
    ]
    return place, list(dict.fromkeys(missing))


def solve_plan(network: Network) -> Solved:
    """The expected quality of a network that is :func:`at_its_place`; σ are those a priori.

    Where it is singular there is no quality, and the outcome says what is loose.
    """
    settings = network.project.settings

    def solve(some: Network, start: Values) -> Attempt:
        return Attempt(adjust(make_problem(some, start, start), start, SolverSettings(settings.max_iterations)))

    means = Means(
        lambda some, start: make_problem(some, start, start), solve, solve, critical_value(settings.snooping_level)
    )
    with chosen_by_size(network.observations), mistakes_in(network.file), np.errstate(all="ignore"):
        network, attempt = adjust_determinable(network, network.start, means)
        adjustment = attempt.adjustment
        if not adjustment.outcome.is_solution:
            return Solved(network, adjustment, None)
        check_minimal(network, adjustment)
        return with_poses(Solved(network, adjustment, assess(adjustment, levels(settings), aposteriori=False)))
