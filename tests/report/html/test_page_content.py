"""The page without a browser: same bytes, safe texts, numbers that arrive, a verdict that says what is the case."""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest

from mor.report.figures import camera_figures
from mor.report.page import headline, page, statements
from mor.report.page_data import MOST_ROWS, Packer, drawn_axes, page_data, worst_first
from mor.report.view import View

LIMIT = 5_000_000
"""Bytes a page of some hundred images may have."""


def unpacked(text: str) -> tuple[dict[str, Any], bytes]:
    data = zlib.decompress(base64.b64decode(text))
    length = int.from_bytes(data[:4], "little")
    return json.loads(data[4 : 4 + length]), data[4 + length :]


def column(head: dict[str, Any], buffers: bytes, name: str) -> list[Any]:
    place = head["columns"][name]
    values = np.frombuffer(buffers, f"<{place['k']}", place["n"], place["o"])
    return [place["t"][k] for k in values] if "t" in place else values.tolist()


def test_columns_come_back_as_they_were() -> None:
    frame = pl.DataFrame(
        {
            "id": ["a", 'ü"<', "a", None],
            "n": [1, -200, 70_000, 0],
            "x": [1.0 / 3.0, 1e-9, None, -12345.678],
            "exact": [0.1, 4_567_890.12345, -1e-300, float("nan")],
        }
    )
    packer = Packer()
    head, buffers = unpacked(packer.text(packer.table(frame, ("exact",))))
    assert column(head, buffers, "id") == ["a", 'ü"<', "a", ""]
    assert column(head, buffers, "n") == frame["n"].to_list()
    assert column(head, buffers, "exact")[:3] == frame["exact"].to_list()[:3]
    assert column(head, buffers, "x") == pytest.approx([1.0 / 3.0, 1e-9, np.nan, -12345.678], rel=1e-5, nan_ok=True)
    assert head["rows"] == 4


def test_same_input_same_bytes(building_view: View) -> None:
    assert page(building_view) == page(building_view)


def test_page_is_small_and_needs_nothing_from_outside(facade_view: View) -> None:
    text = page(facade_view)
    assert len(text.encode()) < LIMIT
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", text)
    assert "@import" not in text


def test_names_cannot_break_the_page(facade_view: View) -> None:
    evil = "</script><img src=x onerror=alert(1)>"
    summary = {**facade_view.summary, "title": evil}
    groups = facade_view.groups.with_columns(pl.lit(evil).alias("name"))
    text = page(replace(facade_view, summary=summary, groups=groups))
    assert evil not in text
    assert "&lt;img src=x" in text


def test_every_sigma_stands_with_its_datum(building_view: View) -> None:
    text = page(building_view)
    for section in ("network", "images", "cameras", "control", "points"):
        part = text.split(f'<section id="{section}">')[1].split("</section>")[0]
        assert f"datum: {building_view.summary['datum']}" in part, section


def test_verdict_names_the_worst_observation(facade_view: View) -> None:
    data = page_data(facade_view)
    words = {statement.title: statement for statement in statements(data)}
    worst = facade_view.residuals.sort(pl.col("w").abs(), descending=True, nulls_last=True).row(0, named=True)
    assert f"{worst['from']} – {worst['to']}, {worst['component']}" in words["Single observations"].words
    assert headline(data).title == "Accepted, with observations to look at"


@pytest.mark.parametrize(("statistic", "state"), [(1e6, "bad"), (1.0, "doubt")])
def test_verdict_of_a_rejected_adjustment(facade_view: View, statistic: float, state: str) -> None:
    test = {**facade_view.summary["global_test"], "statistic": statistic, "accepted": False}
    data = page_data(replace(facade_view, summary={**facade_view.summary, "global_test": test}))
    assert headline(data).title == "Not accepted"
    assert headline(data).state == state


def test_very_many_residuals_are_those_with_the_largest_tests(facade_view: View) -> None:
    some = facade_view.residuals
    many = pl.concat([some] * (MOST_ROWS // some.height + 2))
    shown = worst_first(replace(facade_view, residuals=many))
    assert shown.height == MOST_ROWS
    left_out = many.height - MOST_ROWS
    smallest = many["w"].abs().sort(nulls_last=True).head(left_out)
    assert smallest[-1] <= shown["w"].abs().drop_nulls().min()  # type: ignore[operator]


def test_ellipses_of_confidence_have_a_scale(facade_view: View) -> None:
    """The bar is at the scale of the vectors; for the ellipses it stands for as much less as they are enlarged more."""
    field = camera_figures(page_data(facade_view))[0]["field"]
    scales = [float(trace["name"].split("× ")[1]) for trace in field["data"] if "×" in trace.get("name", "")]
    assert scales == [20.0, 200.0]
    bar = next(shape for shape in field["layout"]["shapes"] if shape["type"] == "line")
    assert field["layout"]["annotations"][0]["text"] == "0.1 mm; 10 µm in the ellipses"
    assert bar["x1"] - bar["x0"] == pytest.approx(0.1 * scales[0])
    assert bar["x1"] - bar["x0"] == pytest.approx(0.010 * scales[1])


def test_fixed_cameras_have_no_confidence(stereo_view: View) -> None:
    figures = camera_figures(page_data(stereo_view))[0]
    assert [t["name"] for t in figures["curve"]["data"]] == ["radial distortion"]
    assert not any("confidence" in t.get("name", "") for t in figures["field"]["data"])
    assert "ellipses" not in figures["field"]["layout"]["annotations"][0]["text"]


@pytest.mark.parametrize(
    ("xy", "right", "backwards"),
    [("en", "x", (False, False)), ("ne", "y", (False, False)), ("ws", "x", (True, True))],
)
def test_east_is_drawn_to_the_right(xy: str, right: str, backwards: tuple[bool, bool]) -> None:
    axes = drawn_axes(xy)
    assert axes["right"] == right
    assert (axes["right_reversed"], axes["up_reversed"]) == backwards
