"""Lines of the long table: the compiled ones are those that polars writes, whatever is in them."""

from __future__ import annotations

from decimal import Decimal
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from small_projects import BLOCK, block, write_block

from mor.compilation import available
from mor.observations.names import among
from mor.pipeline import read_document, read_network, solve_network
from mor.quality.solved import Solved
from mor.report.tables.files import residual_writer
from mor.report.tables.lines import residual_lines
from mor.report.tables.lines.compiled.lines import write_lines
from mor.report.tables.lines.compiled.numbers import BEYOND
from mor.report.tables.observations import SCHEMA, Cells

pytestmark = pytest.mark.skipif(not available, reason="there is no compiler")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Solved:
    folder = tmp_path_factory.mktemp("block")
    write_block(folder, rows=block(noise=0.002))
    return solve_network(read_network(read_document(folder / "project.yaml"), folder))


def doubles() -> NDArray[np.float64]:
    """Numbers of every size and kind, and those beside which the rules change."""
    rng = np.random.default_rng(4)
    bits = rng.integers(0, 2**64, 20_000, dtype=np.uint64)
    powers = 2.0 ** np.arange(-1074, 1024)
    tens = np.array([float(f"1e{k}") for k in range(-323, 309)])
    return np.concatenate(
        [
            bits.view(np.float64),
            (bits >> np.uint64(12)).view(np.float64),  # subnormal
            np.arange(300, dtype=np.uint64).view(np.float64),
            *(np.nextafter(edge, towards) for edge in (powers, tens) for towards in (0.0, np.inf)),
            *(powers, tens, -tens, np.arange(1000.0), np.arange(1000) / 1000.0),
            rng.integers(0, 2**62, 2000).astype(float),
            np.round(rng.normal(size=2000), 3),
            10.0 ** rng.uniform(-8.0, 20.0, 20_000),
            np.array([0.0, -0.0, np.inf, -np.inf, np.nan, -np.nan, np.finfo(float).max]),
        ]
    )


def written(numbers: NDArray[Any]) -> list[str]:
    """The numbers as kernels write them, a line each."""
    single = numbers.dtype == np.float32
    text = np.empty(26 * len(numbers) + BEYOND, dtype=np.uint8)
    no_text = np.zeros(0, dtype=np.uint8), np.zeros(1, dtype=np.int64)
    size = write_lines(
        text,
        (no_text[0],),
        (no_text[1],),
        np.zeros((0, len(numbers)), dtype=np.int32),
        0,
        np.zeros((0, len(numbers)), dtype=np.uint64) if single else numbers.view(np.uint64)[None],
        numbers.view(np.uint32)[None] if single else np.zeros((0, len(numbers)), dtype=np.uint32),
        np.array([single]),
    )
    return text[:size].tobytes().decode().split("\n")[:-1]


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_numbers_are_the_shortest_that_are_read_as_they_are(kind: type) -> None:
    with np.errstate(all="ignore"):
        numbers = doubles().astype(kind)
    for number, text in zip(numbers, written(numbers), strict=True):
        if not np.isfinite(number):
            assert text == ("" if np.isnan(number) else str(number))
        else:  # numpy looks for the shortest, too, by another algorithm
            shortest = np.format_float_scientific(number, unique=True)
            assert Decimal(text) == Decimal(shortest)
            assert text.startswith("-") == bool(np.signbit(number))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_numbers_are_written_as_polars_writes_them(kind: type) -> None:
    with np.errstate(all="ignore"):
        numbers = doubles().astype(kind)
    lines = BytesIO()
    pl.DataFrame({"number": numbers}, nan_to_null=True).write_csv(lines, include_header=False)
    assert written(numbers) == lines.getvalue().decode().replace('""', "").split("\n")[:-1]


def test_lines_are_those_of_polars(solved: Solved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    residual_writer(solved, "csv", lambda rows: None)(tmp_path / "by polars.csv")
    monkeypatch.setattr(residual_lines, "WORTH_COMPILING", 0)
    monkeypatch.setattr(residual_lines, "plain_lines", None)
    residual_writer(solved, "csv", lambda rows: None)(tmp_path / "compiled.csv")
    assert (tmp_path / "compiled.csv").read_bytes() == (tmp_path / "by polars.csv").read_bytes()


def test_texts_of_every_kind_and_numbers_that_are_not_there() -> None:
    texts = ("", "P 1", 'a "b"', "c,d", "é", "a name that is longer than a word of a machine", "1.0")
    places = np.arange(len(texts), dtype=np.int32)
    numbers = np.array([0.5, np.nan, -1e-30, 1.0, 0.1234567890123, np.nan, 2e20])
    cells = Cells(
        {name: among(texts).at(np.roll(places, k)) for k, name in enumerate(SCHEMA)},
        {name: np.roll(numbers, k) for k, name in enumerate(SCHEMA)},
    )
    table = pl.DataFrame(
        {
            name: cells.texts[name].texts() if kind == pl.String else cells.numbers[name]
            for name, kind in SCHEMA.items()
        },
        nan_to_null=True,
    )
    compiled, plain = residual_lines.compiled_lines(cells), residual_lines.plain_lines(table, unsafe=False)
    assert (compiled[0], bytes(compiled[1])) == (plain[0], bytes(plain[1]))


def test_names_that_need_a_guard_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_block(tmp_path, BLOCK.replace("type: image", 'type: image\n    name: "=A1"'))
    solved = solve_network(read_network(read_document(path), tmp_path))
    monkeypatch.setattr(residual_lines, "WORTH_COMPILING", 0)
    residual_writer(solved, "csv", lambda rows: None)(tmp_path / "r.csv")
    assert set(pl.read_csv(tmp_path / "r.csv")["group"]) == {"'=A1"}
