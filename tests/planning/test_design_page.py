"""The page of a plan: what its script makes of observations that are switched, against the plan adjusted anew."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from mor.api.design import judgements
from mor.api.plan import solve_plan
from mor.plan.requirements import requirements
from mor.project.network import Correlation
from mor.report.design import design_page
from mor.report.identity import RunIdentity
from mor.report.language import words_of
from mor.report.page import asset
from tests.scenarios.planned_networks import BRIDGE, grid, sample
from tests.scenarios.small_projects import mor

_PAGE = """
const thing = () => ({
  classList: { toggle() {} }, closest: thing, querySelector: thing, setAttribute() {}, getAttribute: () => "",
  addEventListener() {}, set textContent(text) {}, get textContent() { return DATA; },
});
globalThis.document = {
  getElementById: thing, querySelector: thing, querySelectorAll: () => [], addEventListener() {},
};
"""
"""As much of a browser as the script needs; the numbers are looked at, not the page."""


def switched(page: str, switches: list[tuple[int, bool]]):
    """Return what the script says after these switches: those taken, r of all rows, covariances, verdicts."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node")
    data = re.search(r'<script type="application/json" id="plan">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    script = "\n".join(
        [
            f"const DATA = {json.dumps(data[1])};",
            _PAGE,
            asset("design.js"),
            f"const done = {json.dumps(switches)}.map(([unit, on]) => plan.set(unit, on));",
            "const given = JSON.parse(DATA);",
            "const points = given.points.map((_, k) => plan.covariance(k));",
            "console.log(JSON.stringify([done, plan.redundancies(), points, plan.judgements()]));",
        ]
    )
    done = subprocess.run([node], input=script, capture_output=True, text=True, timeout=100, check=True)
    return json.loads(data[1]), *json.loads(done.stdout)


def page_of(network, language="en"):
    solved = solve_plan(network)
    found = judgements(solved, requirements(network))
    return design_page(solved, found, (), [], words_of(language, "planning"), RunIdentity())


def adjusted_anew(network, units, on):
    """The plan with these units on: planned rows without value where off, chosen candidates as further groups."""
    lost = {(u["group"], u["row"]) for u, there in zip(units, on, strict=True) if not there and not u["candidate"]}
    more = {(u["group"], u["row"]) for u, there in zip(units, on, strict=True) if there and u["candidate"]}
    groups = [_kept(g, [(k, row) not in lost for row in range(g.count)]) for k, g in enumerate(network.groups)]
    further = [_kept(g, [(k, row) in more for row in range(g.count)]) for k, g in enumerate(network.candidates)]
    further = [g for g in further if g.mask.any()]
    return solve_plan(replace(network, groups=(*groups, *further), candidates=())).quality


def _kept(group, rows):
    return replace(group, observed=np.where(np.array(rows)[:, None], group.observed, np.nan))


def _units(network):
    """Group and row of the units, in the order of the page."""
    from mor.plan.requirements import switching

    quality = solve_plan(network).quality
    found = switching(quality, network.candidates)
    return [{"group": u.group, "row": u.row, "candidate": u.is_candidate} for u in found.units]


def check(network, seed, count):
    """Random switches, one after the other; r, covariances and verdicts at the end."""
    rng = np.random.default_rng(seed)
    units = _units(network)
    switches = [(int(k), bool(rng.random() < 0.4)) for k in rng.integers(0, len(units), count)]
    _, done, r, covariances, verdicts = switched(page_of(network), switches)
    on = [not unit["candidate"] for unit in units]
    for (unit, wanted), taken in zip(switches, done, strict=True):
        on[unit] = wanted if taken else on[unit]
    quality = adjusted_anew(network, units, on)
    assert quality is not None
    expected = np.sort(np.concatenate([one.r[np.isfinite(one.r)] for one in quality.groups]))
    found = np.sort([value for value in r if value is not None])
    assert found == pytest.approx(expected, abs=1e-9)
    M = network.edge.matrix
    blocks = network.things["point"].parts["position"]
    anew = M.T @ np.nan_to_num(quality.cofactors["point"][blocks]) @ M
    assert np.array(covariances) == pytest.approx(anew, rel=1e-9, abs=1e-9 * float(np.abs(anew).max()))
    solved = replace(solve_plan(network), quality=quality)
    for wanted, verdict in zip(judgements(solved, requirements(network)), verdicts, strict=True):
        if wanted.requirement.of != "external":
            assert verdict["met"] == wanted.met
            assert verdict["worst"] == pytest.approx(wanted.worst, rel=1e-6, abs=1e-9)
    return sum(taken for taken in done)


REQUIRE = {
    "sigma": [{"points": ["N*"], "xyz": "0.3 mm"}, {"points": ["S*"], "ellipsoid": "0.5 mm"}],
    "reliability": {"r": 0.1},
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_switched_bridge(seed):
    assert check(sample("bridge", **{**BRIDGE, "require": REQUIRE}), seed, 8) > 2


@pytest.mark.parametrize("seed", range(6))
def test_switched_weak_networks(seed):
    assert check(grid(seed, require={"sigma": {"xy": "2 mm"}, "reliability": {"r": 0.2}}), seed, 12) > 2


def test_switched_images():
    """Image points, points on planes and lines, scale bars; 251 unknowns."""
    assert check(sample("machine_part"), 1, 6) > 2


def test_correlated_observations_go_together():
    network = sample("bridge", **BRIDGE)
    k = next(k for k, group in enumerate(network.groups) if group.name == "distances.csv")
    count = network.groups[k].count
    tied = Correlation(
        np.full(count, k),
        np.arange(count),
        np.zeros(count, dtype=np.int64),
        1e-6 * (0.4 * np.eye(count) + 0.3),
    )
    network = replace(network, correlations=(tied,))
    units = _units(network)
    _, done, r, *_ = switched(page_of(network), [(3, False)])
    quality = solve_plan(
        replace(
            network,
            groups=tuple(
                _kept(g, [(n, row) != (units[3]["group"], units[3]["row"]) for row in range(g.count)])
                for n, g in enumerate(network.groups)
            ),
        )
    ).quality
    expected = np.sort(np.concatenate([one.r[np.isfinite(one.r)] for one in quality.groups]))
    assert done == [True]
    assert np.sort([value for value in r if value is not None]) == pytest.approx(expected, abs=1e-9)


def test_what_cannot_be_spared_stays(tmp_path):
    """A levelling line without a loop: r is 0, and nothing can be taken out."""
    (tmp_path / "plan.yaml").write_text(
        "mor: 1\npoints:\n- {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}\n"
        "- {columns: [id, x, y, z], rows: [[B, 5, 0, 11], [C, 9, 1, 12]], fixed: [x, y]}\n"
        "observations:\n- type: height_difference\n  columns: [from, to]\n  values: {sigma: 1 mm}\n"
        "  rows: [[A, B], [B, C]]\ncandidates:\n- type: height_difference\n  columns: [from, to]\n"
        "  values: {sigma: 1 mm}\n  rows: [[A, C]]\n"
    )
    assert mor("design", tmp_path / "plan.yaml", "--lang", "de").code == 0
    page = (tmp_path / "plan.design" / "design.html").read_text(encoding="utf-8")
    assert "Was wäre, wenn: Beobachtungen aus- und einschalten" in page
    _, done, r, points, _ = switched(page, [(0, False), (2, True), (0, False), (2, False)])
    assert done == [False, True, True, False]
    assert r[0] is None
    assert r[1:] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert points[1][2][2] == pytest.approx(2e-6)  # B by C: A-C and C-B, 1 mm each


def test_a_name_is_no_tag(tmp_path):
    """Names of points are texts, whatever stands in them."""
    (tmp_path / "plan.yaml").write_text(
        "mor: 1\ntitle: a </script><b>bold</b> plan\npoints:\n"
        "- {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}\n"
        "- {columns: [id, x, y, z], rows: [['</script><i>', 5, 0, 11]], fixed: [x, y]}\n"
        "observations:\n- type: height_difference\n  columns: [from, to]\n  values: {sigma: 1 mm}\n"
        "  rows: [[A, '</script><i>'], [A, '</script><i>']]\n"
    )
    assert mor("design", tmp_path / "plan.yaml").code == 0
    page = (tmp_path / "plan.design" / "design.html").read_text(encoding="utf-8")
    assert "</script><" not in page.replace("</script>\n<", "")
    assert "<b>bold" not in page


def test_names_do_not_overlap_and_columns_have_their_decimals():
    page = page_of(sample("bridge", **BRIDGE))
    found = re.findall(r'<text x="([\d.]+)" y="([\d.]+)" text-anchor="middle">(\w+)</text>', page)
    boxes = np.array([(float(x) - 3.6 * len(n), float(x) + 3.6 * len(n), float(y)) for x, y, n in found])
    assert len(boxes) >= 8
    for k, (left, right, y) in enumerate(boxes):
        others = np.delete(boxes, k, axis=0)
        beside = (others[:, 0] >= right - 0.2) | (others[:, 1] <= left + 0.2)
        assert (beside | (np.abs(others[:, 2] - y) >= 12.8)).all(), found[k]
    rows = re.findall(r'<tr data-point="\d+"><td class="text">\w+</td>((?:<td>[\d.]+</td>)+)</tr>', page)
    cells = [cell for row in rows for cell in re.findall(r"<td>([\d.]+)</td>", row)]
    assert len(cells) == 3 * 17
    assert len({len(cell.partition(".")[2]) for cell in cells}) == 1
    assert all(float(cell) > 0.0 for cell in cells)
