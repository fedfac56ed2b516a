"""Residual vectors of many images side by side: which, at what scale, in equal axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
import pytest

from mor.report.page import page
from mor.report.page_data import image_points
from mor.report.view import View
from tests.page_in_browser import wait_until

pytestmark = pytest.mark.browser

PANELS = """
const plot = document.querySelector('#chart-multiples .plot'), full = plot._fullLayout;
return plot.data.filter((t) => t.meta === 'frame').map((t, k) => {
  const of = (meta) => plot.data.find((d) => d.meta === meta && d.xaxis === t.xaxis);
  const x = full[t.xaxis.replace('x', 'xaxis')], y = full[t.yaxis.replace('y', 'yaxis')];
  const title = plot.layout.annotations[2 * k], bar = plot.layout.annotations[2 * k + 1];
  return { name: title.name, title: title.text, bar: bar.text, length: of('bar').x[1] - of('bar').x[0],
    x: of('vectors').x, y: of('vectors').y, flagged: of('flagged').x.length / 3,
    perX: Math.abs(x.l2p(1) - x.l2p(0)), perY: Math.abs(y.l2p(1) - y.l2p(0)) };
});
"""


def shown(browser: Any, view: View, folder: Any) -> Any:
    path = folder / "report.html"
    path.write_text(page(view), encoding="utf-8")
    browser.get(path.as_uri())
    wait_until(browser, "['charts', 'all'].includes(document.documentElement.dataset.ready)")
    return browser.execute_script(PANELS)


def test_all_images_of_a_small_block(opened: Any, facade_view: View) -> None:
    panels = opened.execute_script(PANELS)
    assert [panel["name"] for panel in panels] == facade_view.images["id"].to_list()
    assert "14 images side by side" in opened.find_element("id", "multiples-title").text
    for panel in panels:
        assert panel["perX"] == pytest.approx(panel["perY"], rel=1e-6), "axes are equal"
    flagged = facade_view.rays.filter(pl.col("flag") == "gross").select("from", "to").unique()
    assert sum(panel["flagged"] for panel in panels) == flagged.height > 0


def test_vectors_are_as_long_as_the_bar_says(opened: Any, facade_view: View) -> None:
    panel = opened.execute_script(PANELS)[1]
    rays = image_points(facade_view).filter(pl.col("image") == panel["name"], pl.col("flag") == "")
    x, y = (np.array(panel[name], dtype=float).reshape(-1, 3) for name in "xy")
    scale = panel["length"] / float(panel["bar"].removesuffix(" px"))
    np.testing.assert_allclose(x[:, 1] - x[:, 0], scale * rays["vx"].to_numpy(), rtol=1e-3, atol=0.1)
    np.testing.assert_allclose(y[:, 1] - y[:, 0], scale * rays["vy"].to_numpy(), rtol=1e-3, atol=0.1)
    note = opened.find_element("id", "multiples-note").text
    assert f"6000 × 4000 px, vectors enlarged {scale:.0f} times" in note


def test_of_a_large_block_those_with_the_largest_tests(browser: Any, building_view: View, tmp_path: Any) -> None:
    panels = shown(browser, building_view, tmp_path)
    worst = (
        image_points(building_view)
        .group_by("image")
        .agg(pl.col("w").max())
        .sort("w", descending=True)["image"]
        .to_list()
    )
    assert [panel["name"] for panel in panels] == worst[:24]
    assert browser.find_element("id", "multiples-title").text == ("The 24 images with the largest test values, of 28")


def test_a_click_on_a_name_shows_the_image_large(browser: Any, building_view: View, tmp_path: Any) -> None:
    panels = shown(browser, building_view, tmp_path)
    browser.execute_script(
        "document.querySelector('#chart-multiples .plot')"
        ".emit('plotly_clickannotation', {annotation: {name: arguments[0]}})",
        panels[2]["name"],
    )
    assert browser.execute_script("return document.getElementById('image').value") == panels[2]["name"]
