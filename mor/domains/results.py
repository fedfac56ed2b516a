"""From what became of the domains to the folder of results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.adjustment.domains.adjust import Joined
from mor.domains.assessing import WORST
from mor.domains.prepared import Prepared
from mor.domains.story import Outcomes
from mor.errors import ExitCode
from mor.input_files import inputs_of_run
from mor.output_files import Writer, listed_files, write_content
from mor.project.domains.parts import group_names, names_in_order
from mor.quality.tests.test_statistics import critical_value, global_test
from mor.report.domains.listed import listed
from mor.report.domains.results import Inlined, ended_of, results_of_domains
from mor.report.domains.starts import joined_starts, parts_writer
from mor.report.domains.summary import Solution, Summary, as_json, as_text
from mor.report.domains.tables import Kind, completed, part_files, read_part, read_parts, writers
from mor.report.identity import Identity, identity_of
from mor.report.notes import note_rows
from mor.report.readme import FILE as README
from mor.report.readme import readme
from mor.report.results.adjusted.adjusted_project import adjusted_project, start_names
from mor.report.results.adjusted.start_columns import Placed
from mor.report.results.folder import write_folder
from mor.report.results.json import INLINE, with_interiors
from mor.report.results.json_text import json_in_pieces, to_json
from mor.report.results.reservation import Reservation
from mor.report.tables.files import table_writer
from mor.report.tables.observations import SHOWN
from mor.report.tables.reliability import fixed_point_row
from mor.report.words.language import Words, words_of_page


class Told(NamedTuple):
    """How results are written: kind of the tables, whether all residuals, in which words, with a page or without."""

    kind: Kind
    residuals: bool
    words: Words
    html: bool
    of: Identity
    full: bool = False
    """True for a text report that leaves nothing to the tables beside it."""


class Content(NamedTuple):
    """What ``results.json`` has but the names of the tables beside it, and those that are short enough for it."""

    results: dict[str, Any]
    inlined: Inlined


def content(found: Outcomes, parts: Path, of: Identity) -> Content:
    """The results of all domains together, ``of`` what was read; their parts of the tables are completed first."""
    if found.whole is not None:
        completed(parts, [one.shared for one in found.assessed])
    inlined = _inlined(found, parts) if found.whole is not None else Inlined()
    return Content(_results(found, inlined, of), inlined)


def printed(found: Outcomes, parts: Path, content: Content) -> Iterator[str]:
    """``results.json`` for programs that read standard output, in pieces: all points and images stand in it."""
    interiors = {name: one for part in found.assessed for name, one in part.added.interiors.items()}
    long: dict[str, Iterable[list[dict[str, Any]]]] = {}
    if found.whole is not None and content.inlined.points is None:
        frames = (read_part(file) for file in part_files(parts / "points"))
        long["points"] = (
            frame[first : first + INLINE].to_dicts()
            for frame in frames
            for first in range(0, frame.height, INLINE)
        )
    if found.whole is not None and content.inlined.images is None:
        images = _in_order(found.prepared, parts, "images")
        long["images"] = [with_interiors(images.to_dicts(), interiors)]
    return json_in_pieces({**content.results, "tables": {}}, long)


def write(found: Outcomes, content: Content, parts: Path, place: Reservation, told: Told) -> None:
    """Write tables, reports and the adjusted project into a folder."""
    tables: dict[str, Writer] = {}
    names: dict[str, str] = {}
    if found.whole is not None:
        wanted = ["points", "images", *(["residuals"] if told.residuals else [])]
        tables = writers(parts, wanted, told.kind)
        names = dict(zip(wanted, tables, strict=True))
        if not told.residuals:
            file = f"residuals_worst.{told.kind}"
            tables[file] = table_writer(_worst(found), told.kind)
            names["residuals_worst"] = file
    results = {**content.results, "tables": names}
    short = summary(found, results)
    reports: dict[str, Writer | str] = {
        "domains.json": as_json(short),
        "report.txt": _report(found, content, short, parts, told),
    }
    if found.whole is not None and told.html:
        file = names.get("residuals", names.get("residuals_worst", ""))
        reports["report.html"] = _page(found, parts, results, file, told.words)
    adjusted = _adjusted(found, parts, place.folder) if found.whole is not None else {}
    names_of_all = ["results.json", *reports, *tables, *adjusted, README]
    if not (place.folder / README).exists() or README in listed_files(place.folder):
        reports[README] = readme(names_of_all, told.words)
    files = ["results.json", *reports, *adjusted, *_files_of(tables, parts)]
    reports["results.json"] = to_json({**results, "files": sorted(files)})
    # The parts of the long tables are moved: what reads them comes first.
    with inputs_of_run(file.path for file in told.of.files):
        write_folder(place, {**reports, **adjusted, **tables})


def _files_of(tables: Iterable[str], parts: Path) -> list[str]:
    """Names of the files of tables; a table in parts is a folder of them."""
    found = []
    for name in tables:
        files = [] if "." in name else part_files(parts / name)
        found += [f"{name}/{file.name}" for file in files] or [name]
    return found


def _report(found: Outcomes, content: Content, short: Summary, parts: Path, told: Told) -> Writer:
    """What writes ``report.txt``."""

    def write(path: Path) -> None:
        with path.open("w", encoding="utf-8") as file:
            file.write(as_text(short, told.words, told.full))
            if told.full and found.whole is not None:
                ready = found.prepared
                scales = found.store.load(f"network/{ready.parts.lonely}").network.scales
                file.writelines(
                    listed(parts, content.inlined, ready.project, scales, short.datum, told.words)
                )

    return write


def _results(found: Outcomes, inlined: Inlined, of: Identity) -> dict[str, Any]:
    """Content of ``results.json``."""
    ready, joined = found.prepared, found.joined
    project = ready.project
    sizes = ready.sizes.observations, ready.sizes.unknowns
    movements = joined.null_space.movements
    solution = found.whole is not None
    ended = ended_of(
        project, joined.outcome.value, joined.reason, solution, sizes, movements, joined.iterations
    )
    said = {"identity": identity_of(project, of), "notes": note_rows(ready.notes, of.folder)}
    added = [one.added for one in found.assessed]
    order = names_in_order(project, ready.document, ready.source, "images") if solution else []
    fixed = _fixed(found)
    return results_of_domains(
        project, ended, found.whole, added, inlined, {}, said, order, _loose(joined), fixed
    )


def _fixed(found: Outcomes) -> list[dict[str, Any]]:
    """Rows of the fixed points that several domains observe."""
    axes = found.store.load(f"network/{found.prepared.parts.lonely}").network.edge.matrix
    return [fixed_point_row(name, test, axes) for name, test in found.fixed if test.freedom]


def _loose(joined: Joined) -> tuple[str, ...]:
    return tuple(f"{kind} {name} {component}".strip() for kind, name, component in joined.loose)


def _page(found: Outcomes, parts: Path, results: dict[str, Any], file: str, words: Words) -> str:
    """The page, which shows all observations."""
    from mor.report.html.page import page
    from mor.report.view import view_of_rows

    points, images = (_in_order(found.prepared, parts, name) for name in ("points", "images"))
    residuals = read_parts(parts / "residuals").select(SHOWN)
    view = view_of_rows(results, points, images, residuals, file)
    return page(view, words_of_page(words.language))


def _in_order(ready: Prepared, parts: Path, name: str) -> pl.DataFrame:
    """Points, or images, in the order of the project."""
    names = names_in_order(ready.project, ready.document, ready.source, name)
    ids = pl.DataFrame({"id": names}, {"id": pl.String})
    return ids.join(read_parts(parts / name), on="id", maintain_order="left")


def _inlined(found: Outcomes, parts: Path) -> Inlined:
    """Tables that are short enough: points and images in the order of the project, residuals group by group."""
    short = {
        name: _in_order(found.prepared, parts, name)
        for name in ("points", "images")
        if _height(parts, name) <= INLINE
    }
    return Inlined(**short, residuals=_few_residuals(found))


def _few_residuals(found: Outcomes) -> pl.DataFrame | None:
    """The table of all residuals, checks last; nothing where it is long."""
    parts = [one.few for one in found.assessed if one.few is not None]
    if len(parts) < len(found.assessed) or sum(part.height for part in parts) > INLINE:
        return None
    names = group_names(found.prepared.project)
    groups = pl.Series(names).unique(maintain_order=True)
    place = pl.col("group").replace_strict(groups, list(range(len(groups))), default=len(groups))
    return pl.concat(parts).sort(pl.col("flag") == "check", place, maintain_order=True)


def _height(parts: Path, name: str) -> int:
    return int(pl.scan_parquet(parts / name / "*.parquet").select(pl.len()).collect().item())


def _adjusted(found: Outcomes, parts: Path, folder: Path) -> dict[str, Writer]:
    """Writers of the adjusted project and its tables."""
    ready, store, lonely = found.prepared, found.store, found.prepared.parts.lonely
    values = store.load(f"values/{found.joined.values}/{lonely}")
    placed = Placed(store.load(f"network/{lonely}").network, values, ready.project.settings.snooping)
    starts, of_parts = joined_starts([start for one in found.assessed for start in one.starts], parts)
    text, frames = adjusted_project(placed, ready.document, ready.source, folder, starts)
    writers: dict[str, Writer] = {name: table_writer(frame) for name, frame in frames.items()}
    for section, tables in of_parts.items():
        writers |= zip(start_names(section, len(tables)), tables, strict=True)
    reference = pl.read_parquet_schema(next((parts / "reference").glob("*.parquet")))
    writers["reference.csv"] = parts_writer(parts / "reference", reference)
    return {"adjusted.yaml": lambda path: write_content(path, text), **writers}


def summary(found: Outcomes, results: dict[str, Any]) -> Summary:
    """What is said of the whole."""
    ready, joined = found.prepared, found.joined
    iterations = tuple(
        (step.sigma0 if step.sigma0 is not None else step.objective, step.largest_change)
        for step in joined.iterations
    )
    outer = [len(numbers) for numbers in ready.boundaries.numbers]
    return Summary(
        title=ready.project.title,
        outcome=joined.outcome.value,
        reason=joined.reason,
        loose=_loose(joined),
        observations=ready.sizes.observations,
        unknowns=ready.sizes.unknowns,
        defect=joined.defect,
        redundancy=joined.redundancy,
        datum=results["datum"],
        iterations=iterations,
        domains=tuple(zip(ready.parts.rays, outer, strict=True)),
        root=len(joined.root.numbers),
        tables=results["tables"],
        identity=results["identity"],
        solution=_solution(found, results),
        notes=tuple(str(note) for note in ready.notes),
    )


def _solution(found: Outcomes, results: dict[str, Any]) -> Solution | None:
    whole = found.whole
    if whole is None:
        return None
    return Solution(
        sigma0=whole.sigma0,
        redundancy_sum=found.redundancy_sum,
        test=global_test(whole.omega, whole.redundancy, whole.levels.overall),
        critical=critical_value(whole.levels.snooping),
        flagged=results["flagged"],
        groups=results["groups"],
        cameras=results["cameras"],
        worst=_worst(found),
        verdict=results["verdict"],
        reliability=results["reliability"],
        checks=results["checks"],
        snooping=results["gross_errors"]["snooping"],
        robust=results["gross_errors"]["robust"],
        components=results["variance_components"],
        settings=found.prepared.project.settings,
        length=results["units"]["length"],
    )


def _worst(found: Outcomes) -> pl.DataFrame:
    """The worst residuals of all domains."""
    table = pl.concat([one.worst for one in found.assessed])
    order = np.argsort(-np.abs(table["w"].to_numpy()), kind="stable")
    return table[order[:WORST]]


def exit_code(told: Summary, strict: bool) -> ExitCode:
    """The documented exit code of an outcome."""
    if told.outcome == "singular":
        return ExitCode.SINGULAR
    one = told.solution
    if one is None:
        return ExitCode.NOT_CONVERGED
    rejected = not one.accepted or one.flagged > 0
    return ExitCode.REJECTED if strict and rejected else ExitCode.DONE
