"""From what became of the domains to the folder of results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from mor.domains.assessing import WORST
from mor.domains.story import Outcomes
from mor.errors import ExitCode
from mor.project.file.model import Datum
from mor.quality.tests.test_statistics import critical_value, global_test
from mor.report.domains.summary import Solution, Summary, as_json, as_text
from mor.report.domains.tables import Kind, completed, writers
from mor.report.readme import readme
from mor.report.results.folder import Writer, write_folder
from mor.report.results.reservation import Reservation
from mor.report.tables.files import table_writer
from mor.report.words.language import Words


def write(
    found: Outcomes,
    parts: Path,
    place: Reservation,
    kind: Kind,
    residuals: bool,
    identity: dict[str, Any],
    words: Words,
) -> Summary:
    """Write tables, ``domains.json`` and ``report.txt`` into a folder; the summary, to be told."""
    tables: dict[str, Writer] = {}
    names: dict[str, str] = {}
    if found.whole is not None:
        completed(parts, [one.shared for one in found.assessed])
        wanted = ["points", "images", *(["residuals"] if residuals else [])]
        tables = writers(parts, wanted, kind)
        names = dict(zip(wanted, tables, strict=True))
        if not residuals:
            file = f"residuals_worst.{kind}"
            tables[file] = table_writer(_worst(found), kind)
            names["residuals_worst"] = file
    told = summary(found, names, identity)
    tables["domains.json"] = _text(as_json(told))
    tables["report.txt"] = _text(as_text(told, words))
    write_folder(place, {**tables, "README.txt": _text(readme([*tables, "README.txt"], words))})
    return told


def summary(found: Outcomes, tables: dict[str, str], identity: dict[str, Any]) -> Summary:
    """What is said of the whole."""
    ready, joined = found.prepared, found.joined
    iterations = tuple(
        (step.sigma0 if step.sigma0 is not None else step.objective, step.largest_change)
        for step in joined.iterations
    )
    loose = tuple(f"{kind} {name} {component}".strip() for kind, name, component in joined.loose)
    outer = [len(numbers) for numbers in ready.boundaries.numbers]
    return Summary(
        title=ready.project.title,
        outcome=joined.outcome.value,
        reason=joined.reason,
        loose=loose,
        observations=ready.sizes.observations,
        unknowns=ready.sizes.unknowns,
        defect=joined.defect,
        redundancy=joined.redundancy,
        datum=_datum(ready.project.datum),
        iterations=iterations,
        domains=tuple(zip(ready.parts.rays, outer, strict=True)),
        root=len(joined.root.numbers),
        tables=tables,
        identity=identity,
        solution=_solution(found),
        notes=tuple(str(note) for note in ready.notes),
    )


def _datum(datum: str | Datum) -> str:
    if datum == "fixed":
        return "fixed"
    if datum == "free" or (isinstance(datum, Datum) and datum.free == "all"):
        return "free, inner constraints over all points"
    return "free, inner constraints over named points"


def _solution(found: Outcomes) -> Solution | None:
    whole = found.whole
    if whole is None:
        return None
    cameras = [camera for one in found.assessed for camera in one.cameras]
    return Solution(
        sigma0=whole.sigma0,
        redundancy_sum=found.redundancy_sum,
        test=global_test(whole.omega, whole.redundancy, whole.levels.overall),
        critical=critical_value(whole.levels.snooping),
        flagged=sum(one.flagged for one in found.assessed),
        groups=_groups([one.groups for one in found.assessed]),
        cameras=cameras,
        worst=_worst(found),
    )


def _groups(tables: list[pl.DataFrame]) -> pl.DataFrame:
    """Sums of the groups over all domains, in the order of the project."""
    sums = pl.concat([table.select(_SUMMED) for table in tables if table.height], how="vertical_relaxed")
    both = sums.group_by("name", "type", maintain_order=True).agg(
        pl.col("observations", "redundancy", "vtpv", "excluded", "flagged").sum(), pl.col("largest_w").max()
    )
    redundant = pl.col("redundancy") > 1e-6
    sigma0 = pl.when(redundant & (pl.col("vtpv") >= 0.0)).then((pl.col("vtpv") / pl.col("redundancy")).sqrt())
    mean = pl.when(pl.col("observations") > 0).then(pl.col("redundancy") / pl.col("observations"))
    return both.with_columns(sigma0=sigma0, mean_r=mean)


_SUMMED = ("name", "type", "observations", "redundancy", "vtpv", "excluded", "flagged", "largest_w")


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
    rejected = not one.test.accepted or one.flagged > 0
    return ExitCode.REJECTED if strict and rejected else ExitCode.DONE


def _text(text: str) -> Writer:
    def made(path: Path) -> None:
        path.write_text(text, encoding="utf-8")

    return made
