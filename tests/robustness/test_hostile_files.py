"""Input that would take all memory, all time or the process itself is refused with its place; limits can be raised."""

from __future__ import annotations

import gzip
import os
import time
from pathlib import Path

import pytest

from tests.scenarios.small_projects import LEVELLING, mor, write

POINTS = "columns: [id, x, y, z], rows: [[A, 0, 0, 10]]"
WITH_TABLE = LEVELLING.replace(POINTS, "file: points.csv")


def refused(project: Path) -> str:
    """What the first line says of a project that is refused."""
    run = mor("adjust", project)
    assert run.code == 2, run.err
    assert not (project.parent / "project.results").exists()
    return run.err.splitlines()[0]


def table(folder: Path, content: bytes, name: str = "points.csv") -> Path:
    project = write(folder, WITH_TABLE.replace("points.csv", name))
    (folder / name).write_bytes(content)
    return project


def test_aliases_that_unfold(tmp_path: Path) -> None:
    levels = "".join(  # 10⁹ texts
        f"{name}: &{name} [{', '.join([f'*{inner}'] * 10)}]\n"
        for inner, name in zip("abcdefgh", "bcdefghi", strict=True)
    )
    said = refused(write(tmp_path, f"mor: 1\na: &a [x, x, x, x, x, x, x, x, x, x]\n{levels}"))
    assert "project.yaml:7: aliases (*name) repeat more than 100000 values" in said
    assert "MOR_MAX_VALUES" in said


@pytest.mark.parametrize(
    "repeated",
    [
        "{" + ", ".join("k: 1" for _ in range(20_000)) + "}",  # a key twice: its values are skipped
        "{" + ", ".join("[a]: 1" for _ in range(50)) + "}",  # a key that is none
        "[[], [], [], [], [], []]",
        "'" + "y" * 50_000 + "'",
    ],
)
def test_many_aliases_of_something_large(tmp_path: Path, repeated: str) -> None:
    """What is small in the file, and would be 20 000 times as large."""
    begun = time.process_time()
    said = refused(write(tmp_path, f"mor: 1\na: &x {repeated}\nb: [{', '.join(['*x'] * 20_000)}]\n"))
    assert "project.yaml:3: aliases (*name) repeat more than 100000 values, or 10000000 letters" in said
    assert time.process_time() - begun < 10.0


@pytest.mark.parametrize("text", ["[" * 100_000, "{a: " * 100_000, "- " * 100_000, "mor: 1\ntitle: " + "[" * 100_000])
def test_very_many_levels(tmp_path: Path, text: str) -> None:
    assert "project.yaml:" in refused(write(tmp_path, text))


@pytest.mark.parametrize("text", ["a: &a [*a]", "a: &a {b: *a}", "a: &a [&b [*a, *b]]"])
def test_what_refers_to_itself(tmp_path: Path, text: str) -> None:
    assert refused(write(tmp_path, f"mor: 1\n{text}\n")).endswith("this is nested too deeply, or refers to itself")


def test_aliases_are_what_they_stand_for(tmp_path: Path) -> None:
    text = LEVELLING.replace("columns: [id, x, y, z]", "columns: &c [id, x, y, z]", 1)
    text = text.replace("{columns: [id, x, y, z], rows: [[B", "{columns: *c, rows: [[B")
    assert mor("adjust", write(tmp_path, text), "--no-html").code == 0


@pytest.mark.parametrize("name", ["points.csv", "points.parquet", "points.csv.gz"])
def test_a_pipe_is_no_table(tmp_path: Path, name: str) -> None:
    project = write(tmp_path, WITH_TABLE.replace("points.csv", name))
    os.mkfifo(tmp_path / name)
    assert refused(project) == f"{project}:4: file '{name}' is a pipe or a device, expected a file"


@pytest.mark.parametrize("name", ["p.yaml", "p.gkf", "p.dat", "p.txt", "p.ior"])
def test_a_pipe_is_no_project(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    run = mor("check", tmp_path / name)
    assert run.code == 2
    assert f"{tmp_path / 'p'}" in run.err


def test_a_device_is_no_file(tmp_path: Path) -> None:
    assert "pipe or a device" in mor("check", "/dev/zero").err
    project = write(tmp_path, WITH_TABLE.replace("points.csv", "/dev/zero"))
    assert "is a pipe or a device" in refused(project)


@pytest.mark.parametrize("name", ["points.csv", "points.csv.gz"])
def test_more_than_the_limit_of_a_file(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content = b"id,x,y,z\nA,0,0,10\n" + b"\n" * 1_500_000
    project = table(tmp_path, gzip.compress(content) if name.endswith("gz") else content, name)
    monkeypatch.setenv("MOR_MAX_FILE_MB", "1")
    said = refused(project)
    assert said.endswith(f"{name}: found more than 1 MB; a larger MOR_MAX_FILE_MB in the environment allows more")
    monkeypatch.setenv("MOR_MAX_FILE_MB", "2")
    assert mor("adjust", project, "--no-html").code == 0


def test_more_values_than_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MOR_MAX_VALUES", "20")
    assert "found more than 20 values" in refused(write(tmp_path, LEVELLING))
    monkeypatch.setenv("MOR_MAX_VALUES", "200")
    assert mor("check", tmp_path / "project.yaml").code == 0


@pytest.mark.parametrize("given", ["many", "0", "-1", "1.5"])
def test_a_limit_is_a_number(tmp_path: Path, given: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MOR_MAX_VALUES", given)
    assert refused(write(tmp_path, LEVELLING)).startswith(f"MOR_MAX_VALUES: found '{given}'")


def test_very_many_columns(tmp_path: Path) -> None:
    header = b",".join(b"c%d" % k for k in range(1_000_000))
    said = refused(table(tmp_path, header + b"\n" + b"1," * 999_999 + b"1\n"))
    assert "points.csv:1: found 1000000 columns, expected 1000 at most" in said


@pytest.mark.parametrize("rows", [1, 1000, 100_000])
def test_a_quote_that_never_closes(tmp_path: Path, rows: int) -> None:
    content = b'id,x,y,z\n"A,0,0,10\n' + b"B,0,0,10\n" * rows
    said = refused(table(tmp_path, content))
    assert said.endswith("points.csv:2: a quote that opens in this line is not closed in it")


@pytest.mark.parametrize(
    "cell",
    [
        "1" + " " * 100_000 + "x",
        " " * 100_000 + "!",
        "1-" + "1" * 100_000 + "-x",
        "1" * 100_000 + "e",
        "9" * 100_000,
    ],
)
@pytest.mark.parametrize("unit", ["gon", "dms"])
def test_numbers_that_are_very_long(tmp_path: Path, cell: str, unit: str) -> None:
    rows = f'[[A, B, "{cell}", 0.001]]'
    text = LEVELLING.replace("units: {length: m}", f"units: {{angle: {unit}}}").replace(
        "height_difference", "zenith_angle"
    )
    text = text.replace("dz, sigma", "zenith_angle, sigma")
    start = text.index("rows: [[A, B, 1.001")
    said = refused(write(tmp_path, f"{text[:start]}rows: {rows}\n"))
    assert "project.yaml:9: zenith_angle: " in said
    assert len(said) < 1000 + len(str(tmp_path))


def test_a_screenful_of_mistakes_and_all_of_them(tmp_path: Path) -> None:
    rows = "".join(f"P{k},0,0,x{k}\n" for k in range(80))
    project = table(tmp_path, f"id,x,y,z\n{rows}".encode())
    told = mor("adjust", project).err.splitlines()
    assert len(told) == 21
    assert told[-2] == "… and 60 more mistakes; mor check --all lists all of them"
    everything = mor("check", project, "--all")
    assert (everything.code, len(everything.err.splitlines())) == (2, 80)


def test_a_screenful_of_notes_and_all_of_them(tmp_path: Path) -> None:
    unused = "\n".join('<distance to="X" val="1" stdev="1"/>' for _ in range(30))
    project = tmp_path / "network.gkf"
    project.write_text(
        '<?xml version="1.0"?>\n<gama-local><network><parameters sigma-act="apriori"/><points-observations>\n'
        '<point id="A" x="0" y="0" fix="xy"/><point id="B" x="10" y="0" fix="xy"/><point id="C" adj="xy"/>\n'
        f'<point id="X" x="1" y="1"/>\n<obs from="A">\n<distance to="C" val="8" stdev="1"/>\n{unused}\n</obs>\n'
        '<obs from="B"><distance to="C" val="7" stdev="1"/></obs>\n'
        "</points-observations></network></gama-local>\n",
    )
    few = mor("check", project).err.splitlines()
    everything = mor("check", project, "--all").err.splitlines()
    assert len(few) == 21
    assert len(everything) >= 30
    assert few[:20] == everything[:20]
    assert few[-1] == f"note: … and {len(everything) - 20} more notes; mor check --all lists all of them"


@pytest.mark.parametrize("delimiter", ['"', "\n", "#", "5", ".", "-", "ä", ""])
def test_what_is_no_delimiter(tmp_path: Path, delimiter: str) -> None:
    import json

    said = refused(
        write(
            tmp_path,
            WITH_TABLE.replace("{file: points.csv", f"{{file: points.csv, delimiter: {json.dumps(delimiter)}"),
        )
    )
    assert "delimiter" in said
