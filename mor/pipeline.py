"""The story of an adjustment: one call for every arrow.

project file → Project → Network → Problem + start values → Adjustment → Quality → Report
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mor.adjustment.problem import Cluster, Datum, Problem
from mor.adjustment.solve import Settings, Watcher, adjust
from mor.approximate.strategy import approximate
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.geometry.arrays import FloatArray
from mor.observations.sigma import with_sigma_model
from mor.parameters.index import index_unknowns
from mor.project.network import Network, build_network
from mor.project.nodes import Document, read_yaml
from mor.project.validation import validate
from mor.quality.assess import Levels, assess
from mor.quality.solved import Solved


def read_document(path: Path) -> Document:
    """Plain data of a project file, with lines. Raises :class:`InputError`."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError([Mistake("this file does not exist", str(path))]) from None
    except IsADirectoryError:
        raise InputError([Mistake("this is a folder, expected a project file", str(path))]) from None
    except UnicodeDecodeError:
        raise InputError([Mistake("this is not UTF-8 text", str(path))]) from None
    return read_yaml(text, str(path))


def read_network(document: Document, folder: Path) -> Network:
    """The network a project describes; its tables are found from ``folder``. Raises :class:`InputError`."""
    return build_network(validate(document), document, folder)


def solve_network(network: Network, watch: Watcher | None = None) -> Solved:
    """Adjust a network and assess the outcome."""
    start = start_values(network)
    problem = make_problem(network, start)
    settings = network.project.settings
    adjustment = adjust(problem, start, Settings(settings.max_iterations), watch)
    if adjustment.outcome.is_solution:
        levels = Levels(settings.snooping_level, settings.power, settings.global_level)
        return Solved(network, adjustment, assess(adjustment, levels, settings.sigma == "aposteriori"))
    return Solved(network, adjustment, None)


def start_values(network: Network) -> Mapping[str, FloatArray]:
    """Start values of all blocks, worked out where none are given. Raises :class:`InputError` where some stay missing."""
    approximation = approximate(network)
    if approximation.missing:
        raise InputError([Mistake(words) for words in approximation.missing])
    return approximation.start


def make_problem(network: Network, start: Mapping[str, FloatArray]) -> Problem:
    """The adjustment problem of a network: unknowns numbered, σ models evaluated, correlations and datum set."""
    groups = tuple(with_sigma_model(group, start) for group in network.groups)
    offsets = np.concatenate([[0], np.cumsum([group.observed.size for group in groups])])
    widths = np.array([group.observed.shape[1] for group in groups])
    clusters = tuple(
        Cluster(offsets[c.groups] + c.rows * widths[c.groups] + c.components, c.covariance)
        for c in network.correlations
    )
    reference = {"point": start["point"]}
    movements = reference if network.datum.at_reference else None
    datum = Datum(network.datum.name, network.datum.free, {"point": network.datum.mask}, reference, movements)
    return Problem(index_unknowns(network.blocks), groups, clusters, datum)
