"""σ of a thing with all else held, against the full normal matrix by differences and a closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.api.pipeline import make_problem, read_document, read_network, solve_network
from mor.model.rotations import rotate
from mor.solve.inverse import local_precision
from mor.solve.problem import misclosures
from tests.scenarios.small_projects import BLOCK, write, write_block

CROSS = """\
mor: 1
units: {length: m}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 0, 100, 0], [C, 100, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[P, 100, 100.003, 0]], fixed: [z]}
observations:
  - type: distance
    columns: [from, to, distance, sigma]
    rows: [[B, P, 100, 0.002], [C, P, 100, 0.001]]
"""


def test_a_point_of_two_distances_at_right_angles(tmp_path: Path) -> None:
    """Each distance gives one coordinate its own σ; one of them is off by three σ, so the rms is 3/√2."""
    path = write(tmp_path, CROSS)
    network = read_network(read_document(path), tmp_path)
    problem = make_problem(network, network.start, network.start)
    local = local_precision(problem, network.start, problem.index.columns["point"])
    point = network.blocks["point"].ids.index("P")
    np.testing.assert_allclose(local.sigma[point, :2], [0.002, 0.001], rtol=1e-4)
    assert np.isnan(local.sigma[point, 2])  # held
    assert local.observations[point] == 2
    np.testing.assert_allclose(local.misfit[point], 3.0 / np.sqrt(2.0), rtol=1e-4)


def test_poses_as_by_differences(tmp_path: Path) -> None:
    """N of every pose from numeric derivatives of what is computed; the rest of N does not enter."""
    path = write_block(tmp_path, BLOCK)
    network = solve_network(read_network(read_document(path), tmp_path)).network
    solved = solve_network(network)
    values, problem = solved.adjustment.values, make_problem(network, network.start, network.start)
    parts = network.things["image"].parts
    columns = np.concatenate(
        [
            problem.index.columns["rotation"][parts["rotation"]],
            problem.index.columns["point"][parts["position"]],
        ],
        axis=1,
    )
    local = local_precision(problem, values, columns)
    for image in (0, len(columns) - 1):
        turn, place = int(parts["rotation"][image]), int(parts["position"][image])
        jacobian = []
        for k in range(6):
            sides = []
            for sign in (1.0, -1.0):
                moved = {kind: array.copy() for kind, array in values.items()}
                step = np.zeros(6)
                step[k] = sign * 1e-6
                moved["rotation"][turn] = rotate(moved["rotation"][turn][None], step[None, :3])[0]
                moved["point"][place] += step[3:]
                rows = [misclosures(g, moved) / g.sigma for g in problem.groups]
                sides.append(np.concatenate([np.nan_to_num(row).ravel() for row in rows]))
            jacobian.append((sides[1] - sides[0]) / 2e-6)
        A = np.array(jacobian).T
        expected = np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
        np.testing.assert_allclose(local.sigma[image], expected, rtol=1e-4)
        assert local.observations[image] == np.count_nonzero(np.abs(A).sum(axis=1))
