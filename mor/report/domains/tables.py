"""Tables of points, images and residuals whose parts the domains have written, put together.

Parquet stays in parts, a folder for each table, as every reader of Parquet takes it; CSV becomes one file.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import polars as pl

from mor.project.tables.guarded import csv_lines, plain_column
from mor.report.results.folder import Writer
from mor.report.tables.files import table_writer
from mor.report.tables.observations import SCHEMA

Kind = Literal["csv", "parquet"]


def completed(folder: Path, sums: Sequence[Mapping[str, pl.DataFrame]]) -> None:
    """Complete the rows of points and images that several domains have, in the parts their owners have written."""
    for name in ("points", "images"):
        parts = [one[name] for one in sums if one[name].height]
        if not parts:
            continue
        both = (
            pl.concat(parts)
            .group_by("id")
            .agg(pl.col("r", "active", "rays", "others", "squares").sum(), pl.col("largest").max())
        )
        for path in sorted((folder / name).glob("*.parquet")):
            frame = pl.read_parquet(path)
            if frame["id"].is_in(both["id"].implode()).any():
                table_writer(_with_sums(frame, both, name), "parquet")(path)


def _with_sums(frame: pl.DataFrame, sums: pl.DataFrame, name: str) -> pl.DataFrame:
    joined = frame.join(sums, on="id", how="left", maintain_order="left")
    known = pl.col("active").is_not_null()
    seen = pl.when(pl.col("active") > 0)
    mean = seen.then(pl.col("r") / pl.col("active"))
    new: dict[str, pl.Expr] = {"mean_r": mean, "largest_w": seen.then(pl.col("largest"))}
    if name == "points":
        new |= {key: pl.col(f"{key}_right").cast(frame.schema[key]) for key in ("rays", "others")}
    else:
        rays = pl.col("rays")
        new |= {
            "points": rays.cast(frame.schema["points"]),
            "rms": pl.when(rays > 0).then((pl.col("squares") / (2 * rays)).sqrt()),
        }
    columns = [pl.when(known).then(value).otherwise(pl.col(key)).alias(key) for key, value in new.items()]
    return joined.with_columns(columns).select(frame.columns)


def read_parts(folder: Path) -> pl.DataFrame:
    """All rows of a table in parts."""
    return pl.concat([read_part(file) for file in part_files(folder)])


def part_files(folder: Path) -> list[Path]:
    """Files of a table in parts, domain by domain."""
    return sorted(file for file in folder.iterdir() if file.suffix in (".csv", ".parquet"))


def read_part(file: Path) -> pl.DataFrame:
    """The rows of a part."""
    return pl.read_parquet(file) if file.suffix == ".parquet" else read_residuals(file)


def read_residuals(path: Path) -> pl.DataFrame:
    """A part of the table of residuals as CSV."""
    frame = pl.read_csv(path, schema_overrides=SCHEMA, infer_schema_length=None)
    texts = frame.select(pl.col(pl.String).fill_null(""))
    return frame.with_columns(*map(plain_column, texts))


def writers(folder: Path, names: Sequence[str], kind: Kind) -> dict[str, Writer]:
    """What puts the parts in a folder together as the tables of results, by the names of these."""
    return {_called(name, kind): _writer(folder / name, kind) for name in names}


def _called(name: str, kind: Kind) -> str:
    return f"{name}.csv" if kind == "csv" else name


def _writer(parts: Path, kind: Kind) -> Writer:
    def write(path: Path) -> None:
        files = part_files(parts)
        if kind == "parquet":
            path.mkdir()
            for file in files:
                shutil.move(file, path / file.name)
            return
        with path.open("wb") as whole:
            for number, file in enumerate(files):
                _append(file, whole, number == 0)
                file.unlink()

    return write


def _append(file: Path, whole, first: bool) -> None:  # type: ignore[no-untyped-def]
    """Append a part to an open file; only the first one brings its heading."""
    if file.suffix == ".parquet":
        lines = bytes(csv_lines(pl.read_parquet(file)))
        whole.write(lines if first else lines.partition(b"\n")[2])
        return
    with file.open("rb") as part:
        heading = part.readline()
        if first:
            whole.write(heading)
        shutil.copyfileobj(part, whole, 1 << 22)
