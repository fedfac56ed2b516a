"""All results of an adjustment, as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from mor.compilation import as_here, kernels_used
from mor.errors import Undeterminable
from mor.input_files import inputs_of_run
from mor.long_arrays import is_limited
from mor.output_files import Content, listed_files, write_content
from mor.parameters.index import Values
from mor.project.file.nodes import Document
from mor.quality.solved import Solved
from mor.report.identity import Identity, identity_of
from mor.report.motions.table import found_movements, motion_table, movement_rows
from mor.report.notes import note_rows
from mor.report.places.table import place_table
from mor.report.readme import FILE as README
from mor.report.readme import may_write, readme
from mor.report.results.adjusted.adjusted_project import adjusted_project, remarks
from mor.report.results.adjusted.start_columns import Placed
from mor.report.results.folder import Writer, write_folder
from mor.report.results.json import entries, results
from mor.report.results.json_text import to_json
from mor.report.results.reservation import Reservation
from mor.report.tables.estimates import image_table, point_table, reference_table
from mor.report.tables.files import Format, residual_writer, table_writer
from mor.report.tables.observations import SHOWN, observation_table
from mor.report.tables.shared import forget
from mor.report.tables.undeterminable import FILE, undeterminable_rows, undeterminable_table
from mor.report.tables.worst import worst_residuals
from mor.report.text_report import text_report
from mor.report.trajectories.table import knot_table
from mor.report.verdict.external_reliability import FILE as EXTERNAL
from mor.report.verdict.external_reliability import external_reliability
from mor.report.words.language import LANGUAGES, words_of, words_of_page

PROJECT = "project.yaml"
"""Name of a project that is written into a folder of its own."""
MOST_LISTED = 2_000_000
"""Observations up to which all residuals and the page are written where nothing else is asked for."""
FAR = 1e9
"""Distance, in extents of the network, at which points at infinity are written: no parallax is left there."""
WORST = 10_000
"""Observations in the table of the worst."""


class Choice(NamedTuple):
    """Tables to be written, and their format."""

    tables: Literal["none", "worst", "all"] = "all"
    kind: Format = "csv"
    html: bool = True
    """True for the page for people, ``report.html``."""
    language: str = "en"
    """Language of the reports: en, de."""
    full: bool = False
    """True for a text report that leaves nothing to the tables beside it."""
    done: Callable[[int], None] = lambda rows: None
    """Told how many more rows of the table of residuals are written."""


def usual_files(tables: str | None, kind: Format) -> list[str]:
    """Names of the files that every adjustment with a solution writes."""
    shown = [] if tables == "none" else [f"points.{kind}", f"images.{kind}"]
    return ["results.json", "report.txt", "adjusted.yaml", "reference.csv", *shown]


def is_large(solved: Solved) -> bool:
    """Return True if a table of all residuals, and a page of them, is more than anybody looks at."""
    return entries(solved) > MOST_LISTED


def tables_by_size(solved: Solved) -> Literal["worst", "all"]:
    """All observations, or the worst where there are too many to be looked at."""
    return "worst" if is_large(solved) else "all"


def write_results(
    solved: Solved,
    document: Document,
    of: Identity,
    place: Reservation,
    choice: Choice | None = None,
) -> None:
    """Write report and ``results.json`` into a folder, and where it converged tables and the adjusted project.

    The reports are made beside the tables, which other processors are busy with; of very many observations before the
    long one, for then both at a time would take too much room.
    """
    choice = choice or Choice()
    tables = _tables(solved, choice) if solved.quality is not None else {}
    names = {key: name for key, (name, _) in tables.items()}
    starts = _starts(solved, document, of.folder, place.folder) if solved.quality is not None else {}
    starts |= _undeterminable(solved) | _external(solved, choice)
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


def write_undeterminable(things: Sequence[Undeterminable], place: Reservation) -> None:
    """Write a folder with nothing but the table of what has no start values, which are too many for a screen."""
    write_folder(place, {FILE: table_writer(undeterminable_table(things))})


def _undeterminable(solved: Solved) -> dict[str, Writer]:
    """The table of what nothing determines, where there is any."""
    rows = undeterminable_rows(solved)
    return {FILE: table_writer(undeterminable_table(rows))} if rows else {}


def _external(solved: Solved, choice: Choice) -> dict[str, Writer]:
    """The table of the external reliability of points, where there is any, and tables are wanted at all."""
    if solved.quality is None or choice.tables == "none" or not external_reliability(solved).height:
        return {}
    return {EXTERNAL: lambda path: table_writer(external_reliability(solved))(path)}


def _reports(
    solved: Solved, of: Identity, names: dict[str, str], files: Sequence[str], choice: Choice
) -> dict[str, Callable[[], str]]:
    """The reports by their names, each as what makes its text.

    ``names`` are those of the tables beside them, ``files`` all files of the run.
    """
    reports: dict[str, Callable[[], str]] = {
        "results.json": lambda: to_json(results(solved, names, of, files)),
        "report.txt": lambda: text_report(solved, words_of(choice.language), of, choice.full),
    }
    if solved.quality is None and choice.html:
        reports["report.html"] = lambda: _failure_page(solved, of, choice.language)
    if solved.quality is not None and choice.html:
        file = names.get("residuals", names.get("residuals_worst", ""))
        reports["report.html"] = lambda: _page(solved, of, file, choice.language)
    if choice.html and found_movements(solved) is not None:
        reports["movements.html"] = lambda: _page_of_movements(solved, of, choice.language)
    return reports


def _readme(names: Sequence[str], place: Reservation, choice: Choice) -> dict[str, Content]:
    """The readme of the folder; one that the user has put there stays."""
    path = place.folder / README
    if path.exists() and README not in listed_files(place.folder):
        return {}
    if not may_write(place.folder, [words_of(language) for language in LANGUAGES]):
        return {README: path.read_bytes()}
    return {README: readme(names, words_of(choice.language))}


def _is_alone(solved: Solved, choice: Choice) -> bool:
    """True where the long table is written last, with the room of all others."""
    return is_limited() or (is_large(solved) and not choice.html)


def _starts(solved: Solved, document: Document, source: Path, folder: Path) -> dict[str, Writer]:
    """Writers of the adjusted project and its tables; a table that is written is gone."""
    text, frames = adjusted_project(_placed(solved), document, source.resolve(), folder)
    text = remarks(solved.network.undeterminable) + text
    frames["reference.csv"] = reference_table(solved)

    def writer(name: str) -> Writer:
        return lambda path: table_writer(frames.pop(name))(path)

    return {
        "adjusted.yaml": lambda path: write_content(path, text),
        **{name: writer(name) for name in frames},
    }


def _tables(solved: Solved, choice: Choice) -> dict[str, tuple[str, Writer]]:
    """Name and writer of each table that is wanted, by what ``results.json`` calls it."""
    if choice.tables == "none":
        return {}
    kind = choice.kind
    tables: dict[str, Writer] = {
        "points": lambda path: table_writer(point_table(solved), kind)(path),
        "images": lambda path: table_writer(image_table(solved), kind)(path),
    }
    if found_movements(solved) is not None:
        tables["motions"] = lambda path: table_writer(motion_table(solved), kind)(path)
        tables["movements"] = lambda path: table_writer(movement_rows(solved), kind)(path)
    if solved.network.trajectories:
        tables["trajectories"] = lambda path: table_writer(knot_table(solved), kind)(path)
    if solved.network.world is not None:
        tables["places"] = lambda path: table_writer(place_table(solved), kind)(path)
    if choice.tables == "all":
        write = residual_writer(solved, kind, choice.done)
        tables["residuals"] = _by_itself(solved, write) if _is_alone(solved, choice) else write
    else:
        tables["residuals_worst"] = lambda path: table_writer(worst_residuals(solved, WORST), kind)(path)
    return {key: (f"{key}.{kind}", write) for key, write in tables.items()}


def _by_itself(solved: Solved, write: Writer) -> Writer:
    """A writer that has the room of the tables that are remembered: it is the last that is called."""

    def alone(path: Path) -> None:
        forget(solved)
        write(path)

    return alone


def _placed(solved: Solved) -> Placed:
    snooped = solved.treatment is not None and solved.treatment.snooping is not None
    return Placed(solved.network.original or solved.network, _values_as_read(solved), snooped)


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
        own["point"][point] = values["point"][point] + FAR * extent * values["rotation"][rotation][2]
    return own


def write_project(placed: Placed, document: Document, source: Path, place: Reservation) -> None:
    """Write a project with the placed values as start values, and its tables, into a folder."""
    text, starts = adjusted_project(placed, document, source.resolve(), place.folder)
    writers: dict[str, Writer] = {name: table_writer(frame) for name, frame in starts.items()}
    write_folder(place, {**writers, PROJECT: text})


def results_text(solved: Solved, of: Identity) -> str:
    """``results.json`` as text, for programs that read standard output."""
    return to_json(results(solved, {}, of))


def _page(solved: Solved, of: Identity, file: str, language: str) -> str:
    from mor.report.html.page import page
    from mor.report.view import view_of

    return page(view_of(solved, observation_table(solved, SHOWN), file, of), words_of_page(language))


def _page_of_movements(solved: Solved, of: Identity, language: str) -> str:
    from mor.report.epochs.one_adjustment import movements_page

    return movements_page(solved, of, words_of_page(language))


def _failure_page(solved: Solved, of: Identity, language: str) -> str:
    from mor.report.html.failure import failure_page

    notes = note_rows(solved.network.notes, of.folder)
    return failure_page(solved, identity_of(solved.network.project, of), notes, words_of_page(language))


def _made(text: Future[str]) -> Writer:
    return lambda path: write_content(path, text.result())
