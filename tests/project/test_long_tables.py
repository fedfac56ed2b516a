"""Tables of many rows: lines are right behind comments, whatever the format; of many mistakes the first are told."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document, read_network
from mor.errors import InputError, nearest
from mor.project.axes import Edge
from mor.project.document import Document
from mor.project.network import Network
from mor.project.schema import Axes, TableEntry, Units
from mor.project.tables import Column, TableLocation, _without_comments, number_column, raw_table, read_table
from mor.units import LENGTH
from tests.mistakes import mistakes
from tests.scenarios.small_projects import BLOCK, block, table, write_block


def network(project: Path) -> Network:
    return read_network(read_document(project), project.parent)


def rays() -> str:
    return table("image,point,x,y", block().rays)


def described(text: str) -> str:
    """A table with comments, empty lines and blanks in it."""
    head, *rows = text.splitlines()
    some = [f"  {row}  # remark, with a comma" if k % 3 == 0 else row for k, row in enumerate(rows)]
    return "\n".join(["# what this is", head, "", *some[:2], "   ", "\t# more", *some[2:], "", ""])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_comments_and_empty_lines_change_nothing_but_lines(tmp_path: Path, end: str) -> None:
    plain = network(write_block(tmp_path / "plain", rays=rays())).groups[0]
    text = described(rays())
    commented = network(write_block(tmp_path / "commented", rays=text.replace("\n", end))).groups[0]
    np.testing.assert_array_equal(commented.observed, plain.observed)
    assert [list(names) for names in commented.references] == [list(names) for names in plain.references]
    written = [line.split("#")[0].strip() for line in text.splitlines()]
    expected = [number for number, line in enumerate(written, start=1) if line][1:]
    assert commented.lines.tolist() == expected


def test_the_line_of_a_mistake_behind_comments(tmp_path: Path) -> None:
    text = described(rays()).splitlines()
    assert mistakes(write_block(tmp_path, rays="\n".join([*text, "# end", "010,P0,1,twice"]))) == [
        f"rays.csv:{len(text) + 2}: y: found 'twice', expected a number (give units for the whole column: units: …)"
    ]


def test_a_name_may_have_a_hash(tmp_path: Path) -> None:
    rows = block()
    named = [[f"{row[0]}#1", *row[1:]] for row in rows.points]
    changed = rows._replace(points=named, rays=[[row[0], f"{row[1]}#1", *row[2:]] for row in rows.rays])
    assert network(write_block(tmp_path, rows=changed)).things["point"].ids[0].endswith("#1")


@pytest.mark.parametrize("kind", ["parquet", "csv.gz", "blanks", "quoted", "categories"])
def test_every_format_gives_the_same_rows(tmp_path: Path, kind: str) -> None:
    plain = network(write_block(tmp_path / "plain")).groups[0]
    project = write_block(tmp_path / "other")
    frame = pl.read_csv(tmp_path / "other" / "rays.csv", schema_overrides={"image": pl.String, "point": pl.String})
    text, options, name = (tmp_path / "other" / "rays.csv").read_text(encoding="utf-8"), "", "rays.other"
    if kind in ("parquet", "categories"):
        name = "rays.parquet"
        kinds = pl.Categorical if kind == "categories" else pl.String
        frame.with_columns(pl.col("image", "point").cast(kinds)).write_parquet(tmp_path / "other" / name)
    elif kind == "csv.gz":
        name = "rays.csv.gz"
        (tmp_path / "other" / name).write_bytes(gzip.compress(text.encode()))
    elif kind == "blanks":
        options = "delimiter: ' '\n    "
        (tmp_path / "other" / name).write_text(text.replace(",", "   ").replace("\n", "  \n "), encoding="utf-8")
    else:
        quoted = "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in text.splitlines())
        (tmp_path / "other" / name).write_text(quoted + "\n", encoding="utf-8")
    project.write_text(project.read_text().replace("file: rays.csv", f"{options}file: {name}"), encoding="utf-8")
    other = network(project).groups[0]
    np.testing.assert_array_equal(other.observed, plain.observed)
    assert [list(names) for names in other.references] == [list(names) for names in plain.references]


def test_rows_of_parquet_files_count_from_1(tmp_path: Path) -> None:
    project = write_block(tmp_path)
    frame = pl.read_csv(tmp_path / "rays.csv", infer_schema=False)
    nowhere = pl.when(pl.int_range(pl.len()) == 2).then(pl.lit("nowhere")).otherwise(pl.col("point"))
    frame.with_columns(nowhere.alias("point")).write_parquet(tmp_path / "rays.parquet")
    project.write_text(project.read_text().replace("rays.csv", "rays.parquet"), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        network(project)
    assert "rays.parquet:3: point 'nowhere' does not exist" in str(caught.value)


def test_parquet_tables_that_are_read_in_parts_are_whole(tmp_path: Path) -> None:
    count = 2_000_003
    number = np.arange(count)
    names = pl.Series("id", number % 7).cast(pl.String)
    frame = pl.DataFrame({"id": names, "x": number.astype(float), "y": pl.Series(number % 2).cast(pl.String)})
    columns = [Column("id", required=True), *(number_column(name, LENGTH, Edge(Units(), Axes())) for name in "xyz")]
    entry = TableEntry(file="rows.parquet", values={"z": "3"})
    place = TableLocation(Document({}, {}, "project.yaml"), ("points", 0), tmp_path)
    frame.write_parquet(tmp_path / "rows.parquet")
    rows = read_table(entry, columns, place)
    assert rows is not None
    assert rows.count == count
    assert rows.names("id").known == tuple("0123456")
    np.testing.assert_array_equal(rows.names("id").numbers, number % 7)
    np.testing.assert_array_equal(rows.number("x"), number)
    np.testing.assert_array_equal(rows.lines, number + 1)
    np.testing.assert_array_equal(rows.number("y"), number % 2)
    assert rows.number("z")[-1] == 3.0
    raw = raw_table(entry, place)
    assert raw is not None
    assert raw.columns["x"][-1] == count - 1

    last = pl.int_range(pl.len()) == count - 1
    frame.with_columns(pl.when(last).then(pl.lit("")).otherwise("id").alias("id")).write_parquet(
        tmp_path / "rows.parquet"
    )
    assert read_table(entry, columns, place) is None
    assert [str(problem).split("rows.parquet:")[1] for problem in place.problems] == [f"{count}: id is empty"]


def test_an_unknown_column_of_a_file_is_refused(tmp_path: Path) -> None:
    rays = write_block(tmp_path).parent / "rays.csv"
    lines = rays.read_text(encoding="utf-8").splitlines()
    with pytest.raises(InputError) as caught:
        network(write_block(tmp_path, rays="\n".join([f"{lines[0]},colour", *(f"{line},red" for line in lines[1:])])))
    (problem,) = caught.value.problems
    assert "rays.csv:1: unknown column 'colour'" in str(problem)


def test_separators_in_quotes(tmp_path: Path) -> None:
    rows = block()
    changed = rows._replace(points=[[f'"{row[0]}, old"', *row[1:]] for row in rows.points])
    changed = changed._replace(rays=[[row[0], f'"{row[1]}, old"', *row[2:]] for row in rows.rays])
    assert network(write_block(tmp_path, rows=changed)).things["point"].ids[0].endswith(", old")


def test_of_very_many_mistakes_the_first_are_told_and_the_rest_counted(tmp_path: Path) -> None:
    many = "image,point,x,y\n" + "".join(f"010,P0,{k},none\n" for k in range(5000))
    with pytest.raises(InputError) as caught:
        network(write_block(tmp_path, rays=many))
    found = [str(problem) for problem in caught.value.problems]
    assert len(found) == 101
    assert found[0].endswith(
        "rays.csv:2: y: found 'none', expected a number (give units for the whole column: units: …)"
    )
    assert "rays.csv:102: 4900 more rows like these" in found[-1]


def test_unknown_names_are_told_once_each_and_counted(tmp_path: Path) -> None:
    many = "image,point,x,y\n" + "".join(f"010,Q{k % 500},1,2\n" for k in range(2000))
    with pytest.raises(InputError) as caught:
        network(write_block(tmp_path, rays=many))
    found = [str(problem) for problem in caught.value.problems]
    assert len(found) == 101
    assert "rays.csv:2: point 'Q0' does not exist" in found[0]
    assert "400 more rows like these" in found[-1]


def test_rows_of_the_wrong_length_are_counted(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        network(write_block(tmp_path, rays="image,point,x,y\n" + "010,P0,1\n" * 300 + "010,P0,1,2,3\n" * 300))
    assert len(caught.value.problems) == 101
    assert "found 3 columns, expected 4" in str(caught.value.problems[0])


def test_nearest_name_among_very_many() -> None:
    letters = np.random.default_rng(1).choice(list("abcdefghijklmnop0123456789"), (50_000, 9))
    known = ["".join(row) for row in letters]
    name = known[31_415]
    for wrong in (
        name[1:],
        name[:-1],
        f"x{name}",
        f"{name}x",
        name[:4] + "_" + name[5:],
        name.upper()[:2] + name[2:],
    ):
        assert nearest(wrong, known) == f"; did you mean {name!r}?"
    assert nearest("something else", known) == ""


def test_numbers_with_units_among_plain_ones(tmp_path: Path) -> None:
    text = BLOCK.replace("points:", "points:", 1)
    rows = block()
    metres = rows._replace(points=[[row[0], f"{float(row[1]) * 1000!r} mm", *row[2:]] for row in rows.points])
    plain = network(write_block(tmp_path / "plain", text)).start["point"]
    found = network(write_block(tmp_path / "units", text, rows=metres)).start["point"]
    np.testing.assert_allclose(found, plain, rtol=1e-12, equal_nan=True)


@pytest.mark.parametrize("seed", range(20))
def test_comments_and_quotes_as_one_reads_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    signs = [b"a", b'"', b"#", b" ", b"\n", b",", b" #", b'"x"']
    text = b"".join(signs[k] for k in rng.integers(len(signs), size=200))
    assert _without_comments(text, quotes=True) == b"\n".join(map(uncommented, text.split(b"\n")))


def uncommented(line: bytes) -> bytes:
    """A line up to the first # that stands first or after a blank, with an even number of quotes before it."""
    for k, sign in enumerate(line):
        if sign == ord("#") and (k == 0 or line[k - 1 : k].isspace()) and line[:k].count(b'"') % 2 == 0:
            return line[:k]
    return line
