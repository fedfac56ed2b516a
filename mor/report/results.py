"""Write results: results.json, tables, reports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import polars as pl
from polars.io.plugins import register_io_source

from mor.errors import UndeterminedObject
from mor.input_files import inputs_of_run
from mor.linalg.compilation import as_here, kernels_used
from mor.long_arrays import is_limited
from mor.machine import worked_ahead
from mor.model.parameters import INTERIORS, Values
from mor.output_files import Content, Writer, listed_files, write_content
from mor.project.document import Document, any_unsafe, csv_lines, write_csv
from mor.project.network import Network
from mor.quality.solution import Solved
from mor.report import estimates
from mor.report.adjusted_project import Placed, adjusted_project, remarks
from mor.report.estimates import image_table
from mor.report.identity import FILE, RunIdentity, identity_of, may_write, note_rows, readme
from mor.report.language import LANGUAGES, words_of
from mor.report.observations import (
    SCHEMA,
    SHOWN,
    assessed_pieces,
    check_rows,
    fixed_point_rows,
    gross_errors,
    observation_table,
    possible_causes,
    suspects,
    table_of,
    tested_names,
    worst_residuals,
)
from mor.report.output_folder import Reservation, to_json, write_folder
from mor.report.summary import failure, summary
from mor.report.text import text_report
from mor.report.units import component_rows, forget, other_rows
from mor.report.verdict import FILE as EXTERNAL
from mor.report.verdict import external_reliability, reliability_rows, verdict_rows

# ---- ``results.json``: everything but the long residual table as plain data, in a stable order.

INLINE = 10_000
"""Tables of up to this many rows stand in ``results.json`` itself."""


def results(
    solved: Solved, tables: dict[str, str], of: RunIdentity, files: Sequence[str] | None = None
) -> dict[str, Any]:
    """Content of ``results.json``, ``of`` what was read.

    ``files`` are the names of all files of the run in its folder, ``tables`` those of the tables among them. Long
    tables of points and images stand only there, or in the content itself if ``files`` is ``None``: then nothing is
    written.
    """
    beside = files is not None
    listed, interiors = _rows(image_table(solved), beside), image_interiors(solved)
    return {
        **summary(solved),
        "identity": identity_of(solved.network.project, of),
        "notes": note_rows(solved.network.notes, of.folder),
        "verdict": verdict_rows(solved),
        "reliability": reliability_rows(solved),
        "points": None if beside and _points(solved) > INLINE else estimates.point_table(solved).to_dicts(),
        "images": None if listed is None else [{**row, **interiors.get(row["id"], {})} for row in listed],
        "motions": estimates.motion_table(solved).to_dicts(),
        "epochs": estimates.epoch_rows(solved),
        "trajectories": _rows(estimates.knot_table(solved), beside) if solved.network.trajectories else [],
        "boresights": estimates.boresight_rows(solved),
        "cameras": estimates.interior_rows(solved),
        "stations": estimates.station_table(solved).to_dicts(),
        "systems": estimates.system_table(solved).to_dicts(),
        "pairs": estimates.pair_table(solved).to_dicts(),
        "features": estimates.feature_table(solved).to_dicts(),
        "others": [row for row in other_rows(solved) if not row["kind"].startswith("interior/")],
        "groups": estimates.group_table(solved).to_dicts(),
        "variance_components": estimates.variance_components(solved),
        "gross_errors": gross_errors(solved),
        "suspects": suspects(solved),
        "possible_causes": possible_causes(solved),
        "fixed_points": fixed_point_rows(solved),
        "relative": estimates.relative_rows(solved, estimates.chosen_pairs(solved)),
        "checks": check_rows(solved),
        "failure": failure(solved),
        "tables": tables,
        "files": list(files or ()),
        "residuals": observation_table(solved).to_dicts() if entries(solved) <= INLINE else None,
    }


def _points(solved: Solved) -> int:
    return len(solved.network.things["point"].ids)


def entries(solved: Solved) -> int:
    """Rows of the table of residuals: observations, excluded ones and checks among them."""
    return sum(int(np.count_nonzero(group.mask)) for group in solved.adjustment.problem.groups)


def _rows(frame: pl.DataFrame, beside: bool) -> list[dict[str, Any]] | None:
    return frame.to_dicts() if frame.height <= INLINE or not beside else None


def image_interiors(solved: Solved) -> dict[str, dict[str, Any]]:
    """The key ``interior`` of images with components of the interior orientation of their own, by image."""
    images, cameras = solved.network.things["image"], solved.network.project.cameras
    found = {}
    for i, (name, camera) in enumerate(zip(images.ids, images.parts["camera"], strict=True)):
        model = cameras[solved.network.things["camera"].ids[camera]]
        if model.image_variant:
            kind, number = INTERIORS[model.model], int(images.parts["interior"][i])
            components = component_rows(solved, kind.key, number, kind.components)
            found[name] = {"interior": {own: components[own] for own in model.image_variant}}
    return found


# ---- Memory of reports and tables from their sizes, before they are made; measured as that of the adjustment is.

FEWER = "--no-html, and --tables worst"
"""Advice."""


def memory_of_reports(network: Network, html: bool, tables: Literal["none", "worst", "all"]) -> float:
    """Bytes that reports and tables take beside the adjusted network."""
    rays = sum(group.count for group in network.groups if len(group.type.components) == 2)
    others = sum(group.count for group in network.groups) - rays
    points = len(network.things["point"].ids)
    size = 30e6  # libraries
    size += 5_500 * (points if points <= INLINE else 0)  # a point that results.json lists, as Python objects
    size += 450 * points  # in the tables and in the adjusted project
    if tables == "all" or html:
        size += 120 * min(rays + others, 500_000)  # rows of the long table that are in memory at a time
    if html:
        size += 15e6 + 1200 * rays + 1000 * others
    return size


# ---- Tables as files: CSV or Parquet, the long one piece by piece.

Format = Literal["csv", "parquet"]
Done = Callable[[int], None]
"""Told how many more rows are written."""

_TABLES_FILES_ROWS_TOGETHER = 250_000
"""Rows of one row group of a Parquet file."""
_LEVEL = 1
"""Of compression by zstd. Measured numbers have nothing to compress: others take half as long again for 0.2 % less."""


def table_writer(frame: pl.DataFrame | str, kind: Format = "csv") -> Writer:
    """Writer of a table that is there as a whole, or as its text."""

    def write(path: Path) -> None:
        if isinstance(frame, str):
            path.write_text(frame, encoding="utf-8")
        elif kind == "parquet":
            frame.write_parquet(path, compression_level=_LEVEL, row_group_size=_TABLES_FILES_ROWS_TOGETHER)
        else:
            with path.open("wb") as file:
                write_csv(frame, file)

    return write


def residual_writer(solved: Solved, kind: Format, done: Done) -> Writer:
    """Writer of the whole table of residuals, which is never in memory as a whole."""
    names = (name for things in solved.network.things.values() for name in things.ids)
    unsafe = any_unsafe(names) or any_unsafe(group.name for group in solved.adjustment.problem.groups)

    def csv(path: Path) -> None:
        with path.open("wb") as file:
            file.write((",".join(SCHEMA) + "\n").encode())
            for height, text in worked_ahead(assessed_pieces(solved), lambda rows: _csv_lines(table_of(rows), unsafe)):
                file.write(text)
                done(height)

    def pieces() -> Iterator[pl.DataFrame]:
        for piece in worked_ahead(assessed_pieces(solved), table_of):
            yield piece
            done(piece.height)

    return (lambda path: _write_parquet(pieces, SCHEMA, path)) if kind == "parquet" else csv


def _write_parquet(pieces: Callable[[], Iterator[pl.DataFrame]], schema: Mapping[str, Any], path: Path) -> None:
    def source(
        columns: list[str] | None, predicate: pl.Expr | None, rows: int | None, batch: int | None
    ) -> Iterator[pl.DataFrame]:
        return pieces()

    whole = register_io_source(source, schema=schema)
    whole.sink_parquet(path, compression_level=_LEVEL, row_group_size=_TABLES_FILES_ROWS_TOGETHER)


def point_writer(solved: Solved, kind: Format) -> Writer:
    """Writer of the table of points; a long one is never in memory as a whole."""

    def write(path: Path) -> None:
        if not estimates.has_many_points(solved):
            table_writer(estimates.point_table(solved), kind)(path)
        elif kind == "parquet":
            schema = estimates.point_summary(solved).shown.schema
            _write_parquet(lambda: estimates.points_in_pieces(solved), schema, path)
        else:
            with path.open("wb") as file:
                for number, piece in enumerate(estimates.points_in_pieces(solved)):
                    file.write(csv_lines(piece, header=number == 0))

    return write


def _csv_lines(table: pl.DataFrame, unsafe: bool) -> tuple[int, memoryview]:
    lines = BytesIO()
    # Single precision has seven digits, and is written twice as fast; probabilities need the exponents of double.
    probabilities = ["p", "p_t", "p_joint"]
    statistics = ["sigma_adjusted", *(name for name in tested_names() if name not in probabilities)]
    # Significant digits of statistics in the long table as text; Parquet has all digits.
    shorter = table.with_columns(pl.col(statistics).cast(pl.Float32), pl.col(probabilities).round_sig_figs(7))
    if unsafe:
        return table.height, csv_lines(shorter, header=False)
    shorter.write_csv(lines, include_header=False)
    return table.height, lines.getbuffer()


# ---- All results of an adjustment, as files.

PROJECT = "project.yaml"
"""Name of a project that is written into a folder of its own."""
MOST_LISTED = 2_000_000
"""Observations up to which all residuals are written where nothing else is asked for."""
MOST_OF_PAGE = 200_000
"""Observations up to which the page is written, and rows of a table up to which it is CSV, unless asked for."""
WORST = 10_000
"""Observations in the table of the worst."""


class Choice(NamedTuple):
    """Tables to be written, and their format."""

    tables: Literal["none", "worst", "all"] = "all"
    kind: Format | None = None
    """``None``: CSV for tables that people open, Parquet for longer ones."""
    html: bool = True
    """True for the page for people, ``report.html``."""
    language: str = "en"
    """Language of the reports: en, de."""
    full: bool = False
    """True for a text report that leaves nothing to the tables beside it."""
    done: Callable[[int], None] = lambda rows: None
    """Told how many more rows of the table of residuals are written."""


def usual_files(tables: str | None, kind: Format | None) -> list[str]:
    """Names of the files that every adjustment with a solution writes."""
    shown = [] if tables == "none" else [f"{table}.{kind or 'csv'}" for table in ("points", "images")]
    return ["results.json", "report.txt", "adjusted.yaml", "reference.csv", *shown]


def is_large(solved: Solved) -> bool:
    """Return True if a table of all residuals is more than anybody looks at."""
    return entries(solved) > MOST_LISTED


def tables_by_size(solved: Solved) -> Literal["worst", "all"]:
    """All observations, or the worst where there are too many to be looked at."""
    return "worst" if is_large(solved) else "all"


def write_results(
    solved: Solved, document: Document, of: RunIdentity, place: Reservation, choice: Choice | None
) -> None:
    """Write report and ``results.json`` into a folder, and where it converged tables and the adjusted project.

    The reports are made beside the tables, which other processors are busy with; of very many observations before the
    long one, for then both at a time would take too much room.
    """
    choice = choice or Choice()
    tables = _tables(solved, choice) if solved.quality is not None else {}
    names = {key: name for key, (name, _) in tables.items()}
    starts = _starts(solved, document, of.folder, place.folder) if solved.quality is not None else {}
    rows = estimates.undeterminable_rows(solved)
    if rows:
        starts[estimates.FILE] = table_writer(estimates.undeterminable_table(rows))
    if solved.quality is not None and choice.tables != "none" and external_reliability(solved).height:
        starts[EXTERNAL] = lambda path: table_writer(external_reliability(solved))(path)
    long = dict(tables.values())
    # The list is completed below, before anything of the reports is made.
    files: list[str] = []
    reports = _reports(solved, of, names, files, choice)
    about = _readme([*starts, *long, *reports], place, choice)
    files += sorted([*about, *starts, *long, *reports])
    with (
        inputs_of_run(file.path for file in of.files),
        kernels_used(solved.adjustment.kernels),
        ThreadPoolExecutor(1) as beside,
    ):
        made = {name: _made(beside.submit(as_here(make))) for name, make in reports.items()}
        writers = {**made, **long} if _is_alone(solved, choice) else {**long, **made}
        try:
            write_folder(place, {**about, **starts, **writers})
        finally:
            beside.shutdown(wait=False, cancel_futures=True)


def write_undeterminable(things: Sequence[UndeterminedObject], place: Reservation) -> None:
    """Write a folder with nothing but the table of what has no start values, which are too many for a screen."""
    write_folder(place, {estimates.FILE: table_writer(estimates.undeterminable_table(things))})


def _reports(
    solved: Solved, of: RunIdentity, names: dict[str, str], files: Sequence[str], choice: Choice
) -> dict[str, Callable[[], str]]:
    """Functions that make the texts of the reports, by name; ``names`` of tables and ``files`` of the run are told."""
    reports: dict[str, Callable[[], str]] = {
        "results.json": lambda: to_json(results(solved, names, of, files)),
        "report.txt": lambda: text_report(solved, words_of(choice.language), of, choice.full),
    }
    if choice.html:
        file = names.get("residuals", names.get("residuals_worst", ""))
        reports["report.html"] = lambda: _page(solved, of, file, choice.language)
    if choice.html and estimates.found_movements(solved) is not None:
        reports["movements.html"] = lambda: _page_of_movements(solved, of, choice.language)
    return reports


def _readme(names: Sequence[str], place: Reservation, choice: Choice) -> dict[str, Content]:
    path = place.folder / FILE
    if path.exists() and FILE not in listed_files(place.folder):
        return {}
    if not may_write(place.folder, [words_of(language) for language in LANGUAGES]):
        return {FILE: path.read_bytes()}
    return {FILE: readme(names, words_of(choice.language))}


def _is_alone(solved: Solved, choice: Choice) -> bool:
    return is_limited() or (is_large(solved) and not choice.html)


def _starts(solved: Solved, document: Document, source: Path, folder: Path) -> dict[str, Writer]:
    """Writers of the adjusted project and its tables; a table that is written is gone."""
    snooped = solved.treatment is not None and solved.treatment.snooping is not None
    placed = Placed(solved.network.original or solved.network, _values_as_read(solved), snooped)
    text, frames = adjusted_project(placed, document, source.resolve(), folder)
    text = remarks(solved.network.undeterminable) + text
    frames["reference.csv"] = estimates.reference_table(solved)

    def writer(name: str) -> Writer:
        return lambda path: table_writer(frames.pop(name))(path)

    return {"adjusted.yaml": lambda path: write_content(path, text), **{name: writer(name) for name in frames}}


def _tables(solved: Solved, choice: Choice) -> dict[str, tuple[str, Writer]]:
    """Name and writer of each table that is wanted, by what ``results.json`` calls it."""
    if choice.tables == "none":
        return {}
    frames: dict[str, Callable[[Solved], pl.DataFrame]] = {"images": image_table}
    if estimates.found_movements(solved) is not None:
        frames |= {"motions": estimates.motion_table, "movements": estimates.movement_rows}
    if solved.network.trajectories:
        frames["trajectories"] = estimates.knot_table
    if solved.network.world is not None:
        frames["places"] = estimates.place_table
    if choice.tables == "worst":
        frames["residuals_worst"] = lambda solved: worst_residuals(solved, WORST)
    kinds = {key: _kind(choice, _points(solved) if key in ("points", "places") else 0) for key in ("points", *frames)}
    tables = {"points": (f"points.{kinds['points']}", point_writer(solved, kinds["points"]))}
    tables |= {key: (f"{key}.{kinds[key]}", _table_made_late(solved, make, kinds[key])) for key, make in frames.items()}
    if choice.tables == "all":
        kind = _kind(choice, entries(solved))
        write = residual_writer(solved, kind, choice.done)
        write = _by_itself(solved, write) if _is_alone(solved, choice) else write
        tables["residuals"] = f"residuals.{kind}", write
    return tables


def _kind(choice: Choice, rows: int) -> Format:
    return choice.kind or ("parquet" if rows > MOST_OF_PAGE else "csv")


def _table_made_late(solved: Solved, make: Callable[[Solved], pl.DataFrame], kind: Format) -> Writer:
    return lambda path: table_writer(make(solved), kind)(path)


def _by_itself(solved: Solved, write: Writer) -> Writer:
    """A writer that has the room of the tables that are remembered: it is the last that is called."""

    def alone(path: Path) -> None:
        forget(solved)
        write(path)

    return alone


def _values_as_read(solved: Solved) -> Values:
    """Adjusted values of the blocks that were read: far ones far away, those left out as they were given."""
    network, values = solved.network, solved.adjustment.values
    if network.original is None:
        return values
    own = {kind: values[kind][: len(start)].copy() for kind, start in network.original.start.items()}
    for kind, absent in network.absent.items():
        lost = np.flatnonzero(absent[: len(own[kind])])
        own[kind][lost] = network.original.start[kind][lost]
    present = own["point"][np.isfinite(own["point"]).all(axis=1)]
    extent = max(float(np.ptp(present, axis=0).max(initial=0.0)), 1.0)
    for point, rotation in network.directions.items():
        # Distance, in extents of the network, at which points at infinity are written: no parallax is left there.
        own["point"][point] = values["point"][point] + 1e9 * extent * values["rotation"][rotation][2]
    return own


def write_project(placed: Placed, document: Document, source: Path, place: Reservation) -> None:
    """Write a project with the placed values as start values, and its tables, into a folder."""
    text, starts = adjusted_project(placed, document, source.resolve(), place.folder)
    writers: dict[str, Writer] = {name: table_writer(frame) for name, frame in starts.items()}
    write_folder(place, {**writers, PROJECT: text})


def _page(solved: Solved, of: RunIdentity, file: str, language: str) -> str:
    from mor.report.page import failure_page, page
    from mor.report.view import view_of

    words = words_of(language, "page")
    if solved.quality is not None:
        return page(view_of(solved, observation_table(solved, SHOWN), file, of), words)
    notes = note_rows(solved.network.notes, of.folder)
    return failure_page(solved, identity_of(solved.network.project, of), notes, words)


def _page_of_movements(solved: Solved, of: RunIdentity, language: str) -> str:
    from mor.report.epochs import movements_page

    return movements_page(solved, of, words_of(language, "page"))


def _made(text: Future[str]) -> Writer:
    return lambda path: write_content(path, text.result())
