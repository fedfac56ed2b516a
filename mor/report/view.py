"""Tables for pictures and pages of an adjustment, from an outcome or from its results folder."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.input_files import note_input
from mor.project.tables.guarded import plain_column
from mor.quality.solved import Solved
from mor.report.edge import points
from mor.report.identity import Identity, identity_of
from mor.report.notes import note_rows
from mor.report.results.summary import SCHEMA_VERSION, summary
from mor.report.tables.checks import check_rows
from mor.report.tables.ellipses import chosen_pairs, relative_rows
from mor.report.tables.estimates import (
    group_table,
    image_table,
    interior_rows,
    point_table,
    station_table,
)
from mor.report.tables.gross_errors.hypotheses import possible_causes
from mor.report.tables.gross_errors.suspects import suspects
from mor.report.tables.observations import SCHEMA
from mor.report.tables.reliability import gross_errors
from mor.report.trajectories.table import knot_table
from mor.report.verdict.external_reliability import FILE as EXTERNAL_FILE
from mor.report.verdict.external_reliability import SCHEMA as EXTERNAL
from mor.report.verdict.external_reliability import external_reliability
from mor.report.verdict.group_tests import verdict_rows
from mor.report.verdict.reliability_map import reliability_rows


@dataclass(frozen=True)
class View:
    """Tables of one adjustment, in project axes and units, as they stand in ``results.json``."""

    summary: dict[str, Any]
    identity: dict[str, Any]
    notes: list[dict[str, Any]]
    points: pl.DataFrame
    images: pl.DataFrame
    stations: pl.DataFrame
    groups: pl.DataFrame
    cameras: list[dict[str, Any]]
    relative: list[dict[str, Any]]
    checks: list[dict[str, Any]]
    gross_errors: dict[str, Any]
    suspects: dict[str, Any] | None
    verdict: dict[str, Any] | None
    reliability: dict[str, Any] | None
    possible_causes: list[dict[str, Any]]
    residuals: pl.DataFrame
    residuals_file: str = "residuals.csv"
    """Where the residuals stand as a table."""
    external: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=EXTERNAL))
    """External reliability of points, see :func:`mor.report.verdict.external_reliability.external_reliability`."""
    trajectories: pl.DataFrame = field(default_factory=pl.DataFrame)
    """Knots of trajectories, see :func:`mor.report.trajectories.table.knot_table`; none is written by itself."""

    @property
    def length(self) -> str:
        """Unit of lengths."""
        return str(self.summary["units"]["length"])

    @property
    def critical(self) -> float:
        """Critical value of |w|."""
        return float(self.summary["critical_w"])

    @cached_property
    def rays(self) -> pl.DataFrame:
        """Image coordinates among the residuals."""
        rays = is_ray(self.residuals)
        return self.residuals if rays.all() else self.residuals.filter(rays)

    @cached_property
    def used(self) -> pl.DataFrame:
        """Residuals of the observations that took part."""
        flag = self.residuals["flag"]
        out = (flag == "excluded") | (flag == "check")
        return self.residuals.filter(~out) if out.any() else self.residuals


def is_ray(residuals: pl.DataFrame) -> pl.Series:
    """True for image coordinates."""
    return residuals["type"] == "image"


def view_of(
    solved: Solved,
    residuals: pl.DataFrame,
    file: str = "residuals.csv",
    of: Identity = Identity(),  # noqa: B008 - frozen
) -> View:
    """The view of an adjustment that converged, with its table of residuals, the file that has it, what was read."""
    images = image_table(solved)
    centres = projection_centres(solved)
    images = images.with_columns(*(pl.Series(name, centres[:, k]) for k, name in enumerate("xyz")))
    return View(
        summary=summary(solved),
        identity=identity_of(solved.network.project, of),
        notes=note_rows(solved.network.notes, of.folder),
        points=_placed(point_table(solved)),
        images=_placed(images.with_columns(pl.col("x", "y", "z").fill_nan(None))),
        stations=station_table(solved),
        groups=group_table(solved),
        cameras=interior_rows(solved),
        relative=relative_rows(solved, chosen_pairs(solved)),
        checks=check_rows(solved),
        gross_errors=gross_errors(solved),
        suspects=suspects(solved),
        verdict=verdict_rows(solved),
        reliability=reliability_rows(solved),
        possible_causes=possible_causes(solved),
        residuals=residuals,
        residuals_file=file,
        external=external_reliability(solved),
        trajectories=knot_table(solved),
    )


def view_of_folder(folder: Path) -> View:
    """The view of results on disk. Raises :class:`InputError` if they are missing or tell of no solution."""
    path = folder / "results.json"
    note_input(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError([Problem("there is no results.json in this folder", str(folder))]) from None
    except (ValueError, RecursionError):
        raise InputError([Problem("this is no results.json of mor", str(path))]) from None
    if isinstance(data, dict) and (version := data.get("schema_version")) != SCHEMA_VERSION:
        words = (
            f"these results are of version {version}, this program reads version {SCHEMA_VERSION}; "
            "mor adjust --force writes them anew"
        )
        raise InputError([Problem(words, str(path))])
    if not isinstance(data, dict) or data.get("global_test") is None:
        raise InputError([Problem("these results tell of no solution: there is nothing to draw", str(path))])
    try:
        return _view(data, folder)
    except (KeyError, TypeError, pl.exceptions.PolarsError):
        words = "these results are not complete"
        raise InputError([Problem(words, str(path))]) from None


def _view(data: dict[str, Any], folder: Path) -> View:
    points, images = (_table(data, name, folder) for name in ("points", "images"))
    view = view_of_rows(data, points, images, _residuals(data, folder))
    if (folder / EXTERNAL_FILE).is_file():
        view = replace(view, external=_read(folder / EXTERNAL_FILE, "external reliability", EXTERNAL))
    if "trajectories" not in data["tables"]:
        return view
    knots = _read(folder / data["tables"]["trajectories"], "trajectories", {"trajectory": pl.String})
    return replace(view, trajectories=knots)


def view_of_rows(
    data: dict[str, Any],
    points: pl.DataFrame,
    images: pl.DataFrame,
    residuals: pl.DataFrame,
    file: str = "residuals.csv",
) -> View:
    """The view of what stands in ``results.json`` and in the tables beside it, ``file`` that of the residuals."""
    return View(
        summary=data,
        identity=data["identity"],
        notes=data.get("notes", []),
        points=_placed(points),
        images=_placed(images),
        stations=_frame(data["stations"]),
        groups=_frame(data["groups"]),
        cameras=data["cameras"],
        relative=data["relative"],
        checks=data["checks"],
        gross_errors=data["gross_errors"],
        suspects=data.get("suspects"),
        verdict=data.get("verdict"),
        reliability=data.get("reliability"),
        possible_causes=data.get("possible_causes", []),
        residuals=residuals,
        residuals_file=file,
    )


def _placed(frame: pl.DataFrame) -> pl.DataFrame:
    """Rows with coordinates: what was left out or is at infinity has no place in a picture."""
    if "x" not in frame.columns or not frame["x"].null_count():
        return frame
    return frame.filter(pl.col("x").is_not_null())


def _residuals(data: dict[str, Any], folder: Path) -> pl.DataFrame:
    if data["residuals"] is not None:
        return pl.DataFrame(data["residuals"], schema_overrides=SCHEMA, infer_schema_length=None)
    if "residuals_worst" in data["tables"] or "residuals" not in data["tables"]:
        words = "these results have no table of all residuals: mor adjust --tables all writes it"
        raise InputError([Problem(words, str(folder / "results.json"))])
    return _read(folder / data["tables"]["residuals"], "residuals", SCHEMA)


def _table(data: dict[str, Any], key: str, folder: Path) -> pl.DataFrame:
    """Points or images, which stand in ``results.json`` or, where they are many, beside it."""
    if data[key] is not None:
        return _frame(data[key])
    return _read(folder / data["tables"].get(key, f"{key}.csv"), key, dict.fromkeys(_TEXTS, pl.String))


_TEXTS = ("id", "camera", "status")


def _read(path: Path, what: str, kinds: dict[str, type[pl.DataType]]) -> pl.DataFrame:
    if not path.exists():
        raise InputError([Problem(f"the table of {what} is missing beside results.json", str(path))])
    note_input(path)
    if path.is_dir():  # a table in parts
        for part in path.glob("*.parquet"):
            note_input(part)
        return pl.read_parquet(path / "*.parquet")
    if path.suffix == ".parquet":
        return pl.read_parquet(path)
    frame = pl.read_csv(path, schema_overrides=kinds, infer_schema_length=None)
    texts = frame.select(pl.col(pl.String).fill_null(""))
    return frame.with_columns(*map(plain_column, texts))


def _frame(rows: list[dict[str, Any]]) -> pl.DataFrame:
    return (
        pl.DataFrame(rows, infer_schema_length=None)
        if rows
        else pl.DataFrame(schema=dict.fromkeys(("id", "camera"), pl.String))
    )


def projection_centres(solved: Solved) -> FloatArray:
    """(n, 3) projection centres in project axes; a follower's is that of its leader and the base."""
    parts = solved.network.things["image"].parts
    centres = points(solved, parts["position"]).values.copy()
    follows = parts["base"] >= 0
    if follows.any():
        values = solved.adjustment.values
        D = values["rotation"][parts["rotation"][follows]]
        base = np.einsum("nji,nj->ni", D, values["base"][parts["base"][follows]])
        centres[follows] += base @ solved.network.edge.matrix
    return centres
