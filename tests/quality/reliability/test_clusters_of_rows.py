"""Vectors with a covariance of their own, all at once, against the same as clusters one by one."""

from __future__ import annotations

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.quality.solution import Solved
from mor.solve.normals import Plan, build_normals, objective
from mor.solve.problem import alike_clusters


def network(seed=3, points=12):
    draw = np.random.default_rng(seed)
    places = draw.uniform(0.0, 100.0, (points, 3))
    rows = []
    for a in range(points):
        for b in (a + 1, a + 3):
            root = 0.003 * draw.standard_normal((3, 5))
            covariance = root @ root.T
            difference = places[b % points] - places[a] + root @ draw.standard_normal(5)
            upper = covariance[np.triu_indices(3)]
            rows.append([f"P{a}", f"P{b % points}", *difference.tolist(), *upper.tolist()])
    rows[4][2] = rows[4][5] = rows[4][6] = rows[4][7] = ""  # of this one dy and dz only
    return places, rows


def solved(folder, datum) -> Solved:
    places, rows = network()
    names = ["dx_dx", "dx_dy", "dx_dz", "dy_dy", "dy_dz", "dz_dz"]
    table = [",".join(["from", "to", "dx", "dy", "dz", *(f"cov_{name}" for name in names)])]
    table += [",".join(str(cell) for cell in row) for row in rows]
    (folder / "vectors.csv").write_text("\n".join(table) + "\n")
    held = "fixed: [x, y, z], " if datum == "fixed" else ""
    x, y, z = places[0]
    (folder / "project.yaml").write_text(f"""\
mor: 1
units: {{length: m}}
axes: {{xy: ne}}
datum: {datum}
points:
  - {{{held}columns: [id, x, y, z], rows: [[P0, {y}, {x}, {z}]]}}
  - {{columns: [id], rows: {[[f"P{k}"] for k in range(1, len(places))]}}}
observations:
  - {{type: vector, file: vectors.csv}}
""")
    document = read_document(folder / "project.yaml")
    return solve_network(read_network(document, folder))


@pytest.mark.parametrize("datum", ["fixed", "free"])
def test_clusters_of_single_rows_are_those_clusters(tmp_path, monkeypatch, datum):
    together = solved(tmp_path, datum)
    (of_rows,), wide = together.adjustment.plan.sorted_clusters
    assert len(of_rows.rows) == len(together.adjustment.plan.clusters) == 24
    assert not wide
    monkeypatch.setattr(
        Plan, "sorted_clusters", property(lambda plan: ((), alike_clusters(plan.problem, plan.clusters)))
    )
    one_by_one = solved(tmp_path, datum)
    pairs = zip(together.quality.groups, one_by_one.quality.groups, strict=True)
    for group, expected in pairs:
        np.testing.assert_allclose(group.v, expected.v, atol=1e-12)
        np.testing.assert_allclose(group.carried, expected.carried, atol=1e-10)
        order, other = (np.lexsort((one.correlated.components, one.correlated.rows)) for one in (group, expected))
        for name in group.correlated._fields:
            found, wanted = (getattr(one.correlated, name) for one in (group, expected))
            np.testing.assert_allclose(found[order], wanted[other], rtol=1e-9, atol=1e-12, err_msg=name)
    assert together.quality.redundancy_sum == pytest.approx(together.quality.redundancy)
    plan, values = one_by_one.adjustment.plan, one_by_one.adjustment.values
    one = objective(plan, values), build_normals(plan, values).diagonal
    monkeypatch.undo()
    assert objective(plan, values) == pytest.approx(one[0], rel=1e-12)
    np.testing.assert_allclose(build_normals(plan, values).diagonal, one[1], rtol=1e-12)
