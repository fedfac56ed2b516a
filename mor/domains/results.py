"""From what became of the domains to the folder of results."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.adjustment.domains.adjust import Joined
from mor.domains.assessing import WORST
from mor.domains.prepared import Prepared
from mor.domains.story import Outcomes
from mor.errors import ExitCode
from mor.project.domains.parts import names_in_order
from mor.quality.tests.test_statistics import critical_value, global_test
from mor.report.domains.results import Inlined, ended_of, results_of_domains
from mor.report.domains.starts import joined_starts, parts_writer
from mor.report.domains.summary import Solution, Summary, as_json, as_text
from mor.report.domains.tables import Kind, completed, read_parts, writers
from mor.report.identity import Identity, identity_of
from mor.report.notes import note_rows
from mor.report.readme import readme
from mor.report.results.adjusted.adjusted_project import adjusted_project, start_names
from mor.report.results.adjusted.start_columns import Placed
from mor.report.results.folder import Writer, write_folder
from mor.report.results.json import INLINE
from mor.report.results.json_text import to_json
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


def write(found: Outcomes, parts: Path, place: Reservation, told: Told) -> Summary:
    """Write tables, reports and the adjusted project into a folder; the summary, to be told."""
    tables: dict[str, Writer] = {}
    names: dict[str, str] = {}
    if found.whole is not None:
        completed(parts, [one.shared for one in found.assessed])
        wanted = ["points", "images", *(["residuals"] if told.residuals else [])]
        tables = writers(parts, wanted, told.kind)
        names = dict(zip(wanted, tables, strict=True))
        if not told.residuals:
            file = f"residuals_worst.{told.kind}"
            tables[file] = table_writer(_worst(found), told.kind)
            names["residuals_worst"] = file
    results = _results(found, parts, names, told)
    short = summary(found, names, results)
    reports = {
        "results.json": _text(to_json(results)),
        "domains.json": _text(as_json(short)),
        "report.txt": _text(as_text(short, told.words)),
    }
    if found.whole is not None and told.html:
        file = names.get("residuals", names.get("residuals_worst", ""))
        reports["report.html"] = _text(_page(found, parts, results, file, told.words))
    adjusted = _adjusted(found, parts, place.folder) if found.whole is not None else {}
    listed = [*reports, *tables, *adjusted, "README.txt"]
    # The parts of the long tables are moved: what reads them comes first.
    write_folder(place, {**reports, **adjusted, **tables, "README.txt": _text(readme(listed, told.words))})
    return short


def _results(found: Outcomes, parts: Path, names: dict[str, str], told: Told) -> dict[str, Any]:
    """Content of ``results.json``."""
    ready, joined = found.prepared, found.joined
    project, of = ready.project, told.of
    sizes = ready.sizes.observations, ready.sizes.unknowns
    movements = joined.null_space.movements
    solution = found.whole is not None
    ended = ended_of(
        project, joined.outcome.value, joined.reason, solution, sizes, movements, joined.iterations
    )
    said = {"identity": identity_of(project, of), "notes": note_rows(ready.notes, of.folder)}
    added = [one.added for one in found.assessed]
    inlined = _inlined(ready, parts) if solution else Inlined()
    order = names_in_order(project, ready.document, ready.source, "images") if solution else []
    fixed = _fixed(found)
    return results_of_domains(
        project, ended, found.whole, added, inlined, names, said, order, _loose(joined), fixed
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


def _inlined(ready: Prepared, parts: Path) -> Inlined:
    """Tables that are short enough, in the order of the project."""
    found = {}
    for name in ("points", "images"):
        if _height(parts, name) <= INLINE:
            found[name] = _in_order(ready, parts, name)
    return Inlined(**found)


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
    return {"adjusted.yaml": _text(text), **writers}


def summary(found: Outcomes, tables: dict[str, str], results: dict[str, Any]) -> Summary:
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
        tables=tables,
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


def _text(text: str) -> Writer:
    def made(path: Path) -> None:
        path.write_text(text, encoding="utf-8")

    return made
