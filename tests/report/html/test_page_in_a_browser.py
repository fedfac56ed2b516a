"""The page, opened in a real browser from a file, without a network."""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np
import pytest

from tests.page_in_browser import wait_until

pytestmark = pytest.mark.browser


ON_SCREEN = """
const plot = document.querySelector('#chart-space .plot'), scene = plot._fullLayout.scene._scene;
const camera = scene.glplot.cameraParams, trace = plot.data.find((t) => t.name === 'images'), k = arguments[0];
const times = (m, v) => [0, 1, 2, 3].map((i) => [0, 1, 2, 3].reduce((sum, j) => sum + m[4 * j + i] * v[j], 0));
let v = [trace.x[k], trace.y[k], trace.z[k]].map((x, i) => x * scene.dataScale[i]).concat(1);
for (const matrix of [camera.model, camera.view, camera.projection]) v = times(matrix, v);
const inner = scene.container.getBoundingClientRect(), outer = plot.getBoundingClientRect();
return [inner.left - outer.left + (0.5 + 0.5 * v[0] / v[3]) * inner.width - outer.width / 2,
        inner.top - outer.top + (0.5 - 0.5 * v[1] / v[3]) * inner.height - outer.height / 2];
"""
"""Where an image of the network in space stands on the screen, from the middle of the chart."""


def rows_of(browser: Any, table: str, column: int) -> list[str]:
    """Texts of one column of the rows in sight."""
    return browser.execute_script(
        "return [...document.querySelectorAll(`#${arguments[0]} tbody tr`)].filter((row) => row.cells.length)"
        ".map((row) => row.cells[arguments[1]].textContent)",
        table,
        column,
    )


def number(text: str) -> float:
    return float(text.replace("−", "-"))


def headings(browser: Any, table: str) -> list[str]:
    return browser.execute_script(
        "return [...document.querySelectorAll(`#${arguments[0]} thead tr:first-child th`)].map((h) => h.textContent)",
        table,
    )


def test_nothing_is_complained_of_and_nothing_fetched(opened: Any) -> None:
    severe = [entry for entry in opened.get_log("browser") if entry["level"] == "SEVERE"]
    assert severe == []
    messages = [json.loads(entry["message"])["message"] for entry in opened.get_log("performance")]
    asked = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    assert [url for url in asked if url.startswith("http")] == []


def test_every_chart_is_drawn_and_has_a_picture_for_print(opened: Any) -> None:
    outcome = opened.execute_script(
        "return [...document.querySelectorAll('.chart')].map((c) => [c.id || c.dataset.figure,"
        " Boolean(c.querySelector('.plot .main-svg')), c.querySelector('.picture').naturalWidth])"
    )
    assert len(outcome) >= 11
    assert [name for name, drawn, width in outcome if not drawn or width < 500] == []


def test_network_draws_every_point_and_image(opened: Any) -> None:
    counts = opened.execute_script(
        "return document.querySelector('#chart-space .plot').data.map((t) => [t.type, t.name, t.x.length])"
    )
    drawn = {name.split(" ×")[0]: (kind, count) for kind, name, count in counts}
    bar = opened.execute_script(
        "const t = document.querySelector('#chart-space .plot').data.find((t) => t.meta === 'bar');"
        "return [t.name, (t.x[1] - t.x[0]) / network.scale]"
    )
    assert bar[0] == f"{1000 * bar[1]:g} mm in the ellipsoids"
    assert drawn["points"] == ("scatter3d", opened.execute_script("return report.points.rows"))
    assert drawn["images"] == ("scatter3d", 14)
    assert drawn["ellipsoids"][0] == "mesh3d"
    assert drawn["ellipsoids"][1] > 100 * 14
    assert opened.execute_script(
        "const c = document.querySelector('#chart-space canvas'); return c.width > 300 && c.height > 300"
    )


def test_ellipsoid_meshes_have_the_semi_axes_of_the_table(opened: Any) -> None:
    """The longest extent of a drawn ellipsoid from its centre is the longest semi-axis, enlarged."""
    largest, smallest, axis, scale = opened.execute_script(
        "const mesh = document.querySelector('#chart-space .plot').data.find((t) => t.type === 'mesh3d');"
        "const row = withEllipses(400)[0], c = place(report.points, row); let high = 0, low = Infinity;"
        "for (let k = 0; k < 70; k++) { const d = Math.hypot(mesh.x[k]-c[0], mesh.y[k]-c[1], mesh.z[k]-c[2]);"
        " high = Math.max(high, d); low = Math.min(low, d); }"
        "return [high, low, ['a', 'c'].map((n) => value(report.points, `ellipsoid_${n}`, row)), network.scale]"
    )
    assert largest <= axis[0] * scale * 1.0001
    assert largest > 0.9 * axis[0] * scale
    assert smallest >= axis[1] * scale * 0.999


def test_a_point_is_picked_in_plan_with_the_mouse(opened: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    opened.execute_script(
        "pick(null); document.getElementById('chart-plan').scrollIntoView({block: 'center', behavior: 'instant'})"
    )
    x, y = opened.execute_script(
        "const g = document.querySelector('#chart-plan .plot'), t = g.data.find((d) => d.name === 'images');"
        "const a = g._fullLayout, box = g.getBoundingClientRect();"
        "return [a.xaxis.l2p(t.x[3]) + a.xaxis._offset - box.width / 2,"
        " a.yaxis.l2p(t.y[3]) + a.yaxis._offset - box.height / 2]"
    )
    plot = opened.find_element("css selector", "#chart-plan .plot")
    ActionChains(opened).move_to_element_with_offset(plot, round(x), round(y)).pause(0.5).click().perform()
    assert opened.execute_script("return document.documentElement.dataset.picked") == "image 3"
    assert "IMG_4720" in opened.find_element("id", "picked").text
    rays = opened.execute_script(
        "return document.querySelector('#chart-plan .plot').data.find((d) => d.name === 'rays of the picked').x.length"
    )
    assert rays == 3 * 56


def test_a_point_is_picked_in_space_with_the_mouse(opened: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    opened.execute_script(
        "pick(null); document.getElementById('chart-space').scrollIntoView({block: 'center', behavior: 'instant'})"
    )
    x, y = (round(offset) for offset in opened.execute_script(ON_SCREEN, 3))
    plot = opened.find_element("css selector", "#chart-space .plot")
    mouse = ActionChains(opened).move_to_element_with_offset(plot, x - 4, y).pause(0.5)
    mouse.move_to_element_with_offset(plot, x, y).pause(1.0).click_and_hold().pause(0.5).release().perform()
    wait_until(opened, "document.documentElement.dataset.picked")
    assert opened.execute_script("return document.documentElement.dataset.picked") == "image 3"
    names = opened.execute_script("return document.querySelector('#chart-space .plot').data.map((t) => t.name)")
    assert "rays of the picked" in names


SKETCHED = """
const { data, layout } = space(), trace = inPerspective(data, layout.scene).find((t) => t.meta === 'images');
return arguments[0].map((k) => [trace.x[k], trace.y[k]]);
"""


def test_the_sketch_has_the_network_as_the_chart_in_space_shows_it(opened: Any) -> None:
    """Up to the size and the place on the screen, which the chart takes from its window."""
    chosen = list(range(9))
    sketched = np.array(opened.execute_script(SKETCHED, chosen)) @ [1.0, 1j]
    drawn = np.array([opened.execute_script(ON_SCREEN, k) for k in chosen]) @ [1.0, -1j]
    both = np.stack([sketched, np.ones(len(chosen))], axis=1)
    (scale, _), *_ = np.linalg.lstsq(both, drawn, rcond=None)
    off = drawn - both @ np.linalg.lstsq(both, drawn, rcond=None)[0]
    assert np.abs(off).max() < 1.0, "pixels"
    assert abs(scale) > 100.0
    assert abs(scale.imag) < 1e-3 * abs(scale)


def test_a_point_is_picked_by_its_name_and_said_with_its_datum(opened: Any) -> None:
    opened.execute_script(
        "const i = document.getElementById('pick'); i.value = 'W50'; i.dispatchEvent(new Event('change'))"
    )
    words = opened.find_element("id", "picked").text
    assert words.startswith("Point W50")
    assert "datum: fixed" in words


def test_residuals_come_worst_first_and_are_sorted_on_demand(opened: Any) -> None:
    names = headings(opened, "table-residuals")
    w = next(k for k, name in enumerate(names) if name.startswith("w"))
    sizes = [abs(number(text)) for text in rows_of(opened, "table-residuals", w)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == pytest.approx(3.46, abs=0.01)
    image = next(k for k, name in enumerate(names) if name.startswith("from"))
    opened.execute_script("document.querySelectorAll('#table-residuals thead button')[arguments[0]].click()", image)
    shown = [text for text in rows_of(opened, "table-residuals", image) if text]
    assert shown == sorted(shown, key=str.lower)
    opened.execute_script("report.tables.residuals.sorted = {key: 'w', down: true}; report.tables.residuals.choose()")


def test_residuals_are_filtered_by_text_and_by_size(opened: Any, facade_view: Any) -> None:
    opened.execute_script(
        "report.tables.residuals.filterBy('from', 'IMG_4711'); report.tables.residuals.filterBy('w', '|>1.5|')"
    )
    expected = facade_view.residuals.filter(
        facade_view.residuals["from"] == "IMG_4711", facade_view.residuals["w"].abs() > 1.5
    )
    assert opened.execute_script("return report.tables.residuals.rows.length") == expected.height > 3
    opened.execute_script("report.tables.residuals.filterBy('from', ''); report.tables.residuals.filterBy('w', '')")
    assert opened.execute_script("return report.tables.residuals.rows.length") == facade_view.residuals.height


def test_table_bears_a_hundred_thousand_rows(opened: Any) -> None:
    outcome = opened.execute_script(
        "const n = 100000, v = Float32Array.from({length: n}, (_, k) => Math.sin(k));"
        "const box = document.createElement('div'); document.body.append(box);"
        "const t = new LongTable(box, {rows: n, columns: {a: {values: v}}}, [{key: 'a', title: 'a', digits: 7}]);"
        "t.sortBy('a'); t.filterBy('a', '>0'); t.scroller.scrollTop = 1e6; t.show();"
        "const result = [t.rows.length, box.querySelectorAll('tr').length, value(t.table, 'a', t.rows[0])];"
        "box.remove(); return result"
    )
    positive = sum(1 for k in range(100_000) if math.sin(k) > 0)
    assert outcome[0] == positive
    assert outcome[1] < 100
    assert outcome[2] == pytest.approx(1.0, abs=1e-6)


def test_light_and_dark(opened: Any) -> None:
    ground = "return getComputedStyle(document.body).backgroundColor"
    opened.execute_script("setTheme('dark')")
    dark = opened.execute_script(ground)
    opened.execute_script("setTheme('light')")
    assert dark != opened.execute_script(ground) == "rgb(255, 255, 255)"


def test_page_prints(opened: Any) -> None:
    # The driver waits ten seconds at the most, and has the document tagged; mor report --pdf prints all rows.
    opened.execute_script("for (const t of Object.values(report.tables)) t.printed = Math.min(t.printed, 200)")
    pdf = base64.b64decode(opened.print_page())
    assert pdf.startswith(b"%PDF")
    assert len(pdf) > 100_000
    assert opened.execute_script("return getComputedStyle(document.querySelector('nav')).display") != "none"
