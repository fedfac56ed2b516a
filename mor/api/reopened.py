"""Results opened again: a project solved where it stands, in its datum or in another one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mor.api.project import Project, read
from mor.errors import InputError, Problem
from mor.input_files import note_input

if TYPE_CHECKING:
    from mor.project.network.build import Network
    from mor.quality.solved import Solved

ADJUSTED = "adjusted.yaml"
REFERENCE = "reference.csv"


def reopen(path: Path) -> Project:
    """The project behind a results folder, or a project file.

    The datum of results refers to the coordinates that stand with them. Raises :class:`InputError`.
    """
    file = path / ADJUSTED if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        words = f"no {ADJUSTED} in this folder; expected the results of mor adjust"
        raise InputError([Problem(words, str(path))])
    project = read(file)
    reference = path / REFERENCE
    if not path.is_dir() or not reference.is_file():
        return project
    note_input(reference)
    return replace(project, network=_with_reference(project.network, reference))


def solve(project: Project) -> Solved:
    """The solution of a project. Raises :class:`InputError` if there is none."""
    from mor.pipeline import solve_network
    from mor.report.text.undetermined import section

    solved = solve_network(project.network)
    if solved.quality is None:
        words = "\n".join(part for part in (solved.adjustment.reason, section(solved)) if part)
        raise InputError([Problem(f"no solution: {words}", project.document.file)])
    return solved


def in_datum(project: Project, target: str, said: str) -> tuple[Project, Solved]:
    """The project with another datum, written as in a project file, and its solution; ``said``: where it was said.

    Fixed coordinates are released where the other datum is free. Raises :class:`InputError` if they strain the
    network: then its residuals depend on them, and only a new adjustment can do without.
    """
    from mor.quality.deformation.released_coordinates import released, strained

    other = _with_datum(project, target, said)
    if not other.network.datum.free:
        return other, solve(other)
    before = solve(project)
    free = released(before)
    if free is project.network:
        return other, solve(other)
    other = replace(other, network=replace(free, datum=other.network.datum))
    after = solve(other)
    if strained(before, after):
        words = "the fixed coordinates strain the network: another datum needs a new adjustment without them"
        raise InputError([Problem(words, project.document.file)])
    return other, after


def _with_datum(project: Project, target: str, said: str) -> Project:
    """The project with the other datum; start values and reference coordinates stay."""
    from mor.pipeline import read_network
    from mor.project.file.nodes import read_yaml

    data = read_yaml(f"datum: {{{target}}}" if ":" in target else f"datum: {target}", said).data
    document = replace(
        project.document,
        data={**project.document.data, **data},
        lines={**project.document.lines, ("datum",): 0},
        files={**project.document.files, ("datum",): said},
    )
    datum = read_network(document, project.folder).datum._replace(reference=project.network.datum.reference)
    return replace(project, document=document, network=replace(project.network, datum=datum))


def _with_reference(network: Network, path: Path) -> Network:
    import polars as pl

    from mor.observations.names import places
    from mor.project.tables.guarded import plain_column

    reference = network.start["point"].copy()
    points = network.things["point"]
    table = pl.read_csv(path, schema={"id": pl.String, **dict.fromkeys("xyz", pl.Float64)})
    table = table.with_columns(plain_column(table["id"]))
    place = places(table["id"].fill_null(""), pl.Series(points.ids, dtype=pl.String))
    known = place >= 0
    given = table.select("x", "y", "z").fill_null(np.nan).to_numpy()[known]
    reference[points.parts["position"][place[known]]] = given @ network.edge.matrix.T
    return replace(network, datum=network.datum._replace(reference=reference))
