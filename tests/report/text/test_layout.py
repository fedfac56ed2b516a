"""Tables of the text report: columns, alignment, what stands beside what."""

from __future__ import annotations

from mor.report.language import words_of
from mor.report.layout import correlation_table, fixed, table


def test_columns_are_as_wide_as_their_widest_cell_and_two_wider_than_their_header() -> None:
    rows = [["P1", "12.5", "free"], ["a longer name", "-3", ""]]
    assert table(["point", "X [m]", "status"], rows).splitlines() == [
        "point            X [m]    status",
        "-------------  -------  --------",
        "P1                12.5      free",
        "a longer name       -3",
    ]


def test_several_columns_of_names_stand_to_the_left() -> None:
    assert table(["group", "type", "n"], [["g", "image/mor", "1008006"]], left=2).splitlines() == [
        "group    type             n",
        "-------  ---------  -------",
        "g        image/mor  1008006",
    ]


def test_no_number_is_a_dash() -> None:
    assert [fixed(value, 2) for value in (None, float("nan"), float("inf"), -0.001)] == [
        "-",
        "-",
        "-",
        "0.00",
    ]


def test_components_in_a_correlation_matrix_have_their_names_in_every_language() -> None:
    matrix = [[1.0, 0.5], [0.5, 1.0]]
    assert correlation_table(["c", "distance"], matrix, words_of("de")).splitlines() == [
        "              c    distance",
        "--------  -----  ----------",
        "c         1,000",
        "distance  0,500       1,000",
    ]
