"""No line of the text report is wider than a page, and nothing is lost in the narrowing."""

from __future__ import annotations

import random

import pytest

from mor.report.layout import WIDTH, drawn, paragraphs


def rows_of(seed: int) -> tuple[list[str], list[list[str]], set[int]]:
    """Headers, cells and columns of texts of a random table; every word is told apart from all others."""
    random_ = random.Random(seed)
    number = iter(range(10**6))

    def words(count: int, length: int) -> str:
        return " ".join(f"w{next(number):x}".ljust(random_.randint(2, length), "x") for _ in range(count))

    columns, lines = random_.randint(1, 18), random_.randint(0, 6)
    left = {0, *(k for k in range(columns) if random_.random() < 0.2)}
    headers = [words(random_.randint(1, 3), 12) for _ in range(columns)]
    rows = [[words(random_.randint(1, 4) if k in left else 1, 12) for k in range(columns)] for _ in range(lines)]
    return headers, rows, left


@pytest.mark.parametrize("seed", range(60))
def test_tables_fit_the_page_and_lose_no_word(seed: int) -> None:
    headers, rows, left = rows_of(seed)
    text = drawn(headers, rows, left)
    assert max(map(len, text.split("\n"))) <= WIDTH
    found = set(text.split())
    assert {word for row in (headers, *rows) for cell in row for word in cell.split()} <= found


@pytest.mark.parametrize("seed", range(20))
def test_cells_stand_below_their_headers(seed: int) -> None:
    """In each block the numbers of a column end where its header and the line below it end."""
    headers, rows, left = rows_of(seed)
    for block in drawn(headers, [row for row in rows if row], left).split("\n\n"):
        lines = block.split("\n")
        ruled = next(k for k, line in enumerate(lines) if set(line) <= {"-", " "} and "-" in line)
        ends = {k for k in range(len(lines[ruled])) if lines[ruled][k : k + 2] in ("- ", "-")}
        starts = {k for k in range(len(lines[ruled])) if lines[ruled][k] == "-" and lines[ruled][k - 1 : k] != "-"}
        for line in (*lines[:ruled], *lines[ruled + 1 :]):
            for k in range(1, len(line)):
                if line[k] == " " and line[k - 1] != " " and line[k + 1 : k + 2] == " ":
                    between = any(s <= k - 1 <= min(e for e in ends if e >= s) for s in starts)
                    assert between


def test_paragraphs_keep_what_belongs_together() -> None:
    line = "  image IMG_4711, point W50, x: w = -3.46, r = 0.71, estimated error 1.44 px, smallest detectable r = 1.72"
    broken = paragraphs(line).split("\n")
    assert all(len(part) <= WIDTH for part in broken)
    assert broken[1].startswith("    ")
    assert broken[1].strip() == "r = 1.72"
    pair = "datum    " + "free " * 30
    assert paragraphs(pair).split("\n")[1].startswith(" " * 9 + "free")
    assert paragraphs("x" * 150) == "x" * 150
