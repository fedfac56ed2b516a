"""Simulated measurements of a project: the project again, with values that its instruments might have shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.observations import OBSERVED_PARAMETERS, ObservationGroup
from mor.output_files import Content
from mor.parameters.index import Values
from mor.pipeline import read_document
from mor.planning.plan import at_its_place, read_plan
from mor.preparation import make_problem
from mor.project.file.nodes import Document
from mor.project.network.build import Network
from mor.quality.simulation.implied import is_implied, place_with_errors, unwritten
from mor.quality.simulation.measurements import errors, measured_at
from mor.quality.simulation.planted import Planted, Wishes, planted, with_planted
from mor.report.results.folder import write_folder
from mor.report.results.reservation import Reservation
from mor.report.results.writing import PROJECT
from mor.report.simulation.project_files import planted_table, simulated_project, truth_table
from mor.report.tables.files import table_writer

LEFT_OUT = "something of the network has no place; a simulation needs one for everything"
USUAL_FILES = (PROJECT, "truth.csv", "planted.csv")
"""Files that every simulated project has."""


class Simulation(NamedTuple):
    """A network with simulated observations, the place they were measured at, and the errors planted in them."""

    network: Network
    place: Values
    planted: tuple[Planted, ...]
    document: Document
    folder: Path

    def write(self, place: Reservation) -> None:
        """Write the simulated project, its truth and what was planted into a folder."""
        text, tables = simulated_project(self.network, self.place, self.document, self.folder, place.folder)
        writers: dict[str, Content] = {name: table_writer(frame) for name, frame in tables.items()}
        truth: pl.DataFrame = truth_table(self.network, self.place)
        writers["truth.csv"] = table_writer(truth)
        writers["planted.csv"] = table_writer(planted_table(self.network, self.planted))
        head = "# Simulated observations: nothing of this was measured. truth.csv has the true values.\n"
        writers[PROJECT] = head + text
        write_folder(place, writers)


def placed_network(path: Path, form: str) -> tuple[Network, Document]:
    """The network of a project at its place, with everything in it. Raises :class:`InputError`."""
    plan = read_plan(read_document(path, form), path.parent)
    network = at_its_place(plan.network)
    if network.original is not None:
        raise InputError([Mistake(LEFT_OUT, network.file)])
    return network, plan.document


def simulated(path: Path, form: str, seed: int, wishes: Wishes, noise: bool = True) -> Simulation:
    """A project with simulated observations; the same for the same seed. Raises :class:`InputError`.

    Without ``noise`` there are no random errors, only what is planted.
    """
    network, document = placed_network(path, form)
    generator = np.random.default_rng(seed)
    problem = make_problem(network, network.start, network.start)
    drawn = errors(problem, generator) if noise else tuple(np.zeros(g.observed.shape) for g in problem.groups)
    place = place_with_errors(problem, network.start, drawn, unwritten(problem))
    there = measured_at(network, place)
    place = there.start
    problem = make_problem(there, place, place)
    found = planted(problem, wishes, generator)
    kept = len(there.groups)
    observed = [
        group.observed if is_implied(group) else group.observed + error
        for group, error in zip(problem.groups[:kept], drawn, strict=False)
    ]
    of_checks = [group.observed + error for group, error in zip(there.checks, drawn[kept:], strict=True)]
    observed = list(with_planted(problem, [*observed, *of_checks], found, wishes))
    groups = tuple(
        replace(group, observed=values) for group, values in zip(there.groups, observed, strict=False)
    )
    checks = tuple(
        replace(group, observed=values) for group, values in zip(there.checks, observed[kept:], strict=True)
    )
    there = replace(there, groups=groups, checks=checks, observed=_prior(there, groups))
    if there.world is not None:
        from mor.project.world.planned import with_control_moved  # most projects need nothing of it

        there = with_control_moved(there)
    return Simulation(there, place, tuple(found), document, path.parent)


def _prior(network: Network, groups: tuple[ObservationGroup, ...]) -> Mapping[str, FloatArray]:
    """Observed values of the things themselves, by kind, as the groups of observed parameters have them now."""
    observed = {kind: values.copy() for kind, values in network.observed.items()}
    kinds = {type_.key: kind for kind, type_ in OBSERVED_PARAMETERS.items()}
    for group in groups:
        if group.type.key in kinds and not len(group.lines):
            known = np.isfinite(group.observed)
            block = observed[kinds[group.type.key]]
            rows = group.blocks[0]
            block[rows] = np.where(known, group.observed, block[rows])
    return observed
