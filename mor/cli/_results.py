"""Results opened again: the network of a results folder, solved where it stands, in its datum or in another one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mor.errors import InputError, Problem

if TYPE_CHECKING:
    from mor.project.file.nodes import Document
    from mor.project.network.build import Network
    from mor.quality.solved import Solved

ADJUSTED = "adjusted.yaml"
REFERENCE = "reference.csv"


@dataclass(frozen=True)
class Opened:
    """A project, or the adjusted project of a results folder, and the folder its tables are found from."""

    document: Document
    network: Network
    folder: Path
    reference: Path | None
    """Table of the coordinates that the datum of results refers to."""


def open_results(path: Path) -> Opened:
    """The project behind a results folder, or a project file. Raises :class:`InputError`."""
    from mor.pipeline import read_document, read_network

    project = path / ADJUSTED if path.is_dir() else path
    if path.is_dir() and not project.is_file():
        words = f"no {ADJUSTED} in this folder; expected the results of mor adjust"
        raise InputError([Problem(words, str(path))])
    document = read_document(project)
    network = read_network(document, project.parent)
    reference = project.parent / REFERENCE if path.is_dir() else None
    found = reference if reference is not None and reference.is_file() else None
    return Opened(document, _with_reference(network, found), project.parent, found)


def inputs(opened: Opened) -> list[Path]:
    """Every file that opened results are read from."""
    tables = [opened.folder / name for name in opened.document.table_files()]
    reference = [] if opened.reference is None else [opened.reference]
    return [Path(opened.document.file), *tables, *reference]


def solve_again(opened: Opened) -> Solved:
    """The solution of opened results. Raises :class:`InputError` where there is none."""
    return _solved(opened.network, opened.document.file)


def in_datum(opened: Opened, target: str) -> tuple[Solved, Document]:
    """The solution in another datum, written as in a project file, and its project.

    Fixed coordinates are released where the other datum is free. Raises :class:`InputError` where they strain the
    network: then its residuals depend on them, and only a new adjustment can do without.
    """
    from mor.pipeline import read_network
    from mor.project.file.nodes import read_yaml
    from mor.quality.deformation.released_coordinates import released, strained

    data = read_yaml(f"datum: {{{target}}}" if ":" in target else f"datum: {target}", "--to").data
    document = replace(
        opened.document,
        data={**opened.document.data, **data},
        lines={**opened.document.lines, ("datum",): 0},
        files={**opened.document.files, ("datum",): "--to"},
    )
    network = _with_reference(read_network(document, opened.folder), opened.reference)
    if not network.datum.free:
        return _solved(network, document.file), document
    before = solve_again(opened)
    free = released(before)
    if free is opened.network:
        return _solved(network, document.file), document
    after = _solved(replace(free, datum=network.datum), document.file)
    if strained(before, after):
        words = "the fixed coordinates strain the network: another datum needs a new adjustment without them"
        raise InputError([Problem(words, document.file)])
    return after, document


def _solved(network: Network, file: str) -> Solved:
    from mor.pipeline import solve_network
    from mor.report.text.undetermined import section

    solved = solve_network(network)
    if solved.quality is None:
        words = "\n".join(part for part in (solved.adjustment.reason, section(solved)) if part)
        raise InputError([Problem(f"no solution: {words}", file)])
    return solved


def _with_reference(network: Network, path: Path | None) -> Network:
    import numpy as np
    import polars as pl

    from mor.observations.names import places

    if path is None:
        return network
    reference = network.start["point"].copy()
    points = network.things["point"]
    table = pl.read_csv(path, schema={"id": pl.String, **dict.fromkeys("xyz", pl.Float64)})
    place = places(table["id"].fill_null(""), pl.Series(points.ids, dtype=pl.String))
    known = place >= 0
    given = table.select("x", "y", "z").fill_null(np.nan).to_numpy()[known]
    reference[points.parts["position"][place[known]]] = given @ network.edge.matrix.T
    return replace(network, datum=replace(network.datum, reference=reference))
