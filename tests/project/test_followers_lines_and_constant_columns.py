"""Stereo followers have no pose of their own, lines leave a free network free, one wrong constant is one mistake."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.errors import InputError
from mor.project.network import Network
from tests.scenarios.small_projects import write

STEREO = """\
mor: 1
cameras:
  C: {interior: {c: 10}}
pairs:
  - {columns: [id, bx, by, bz, omega, phi, kappa], rows: [[bar, 1, 0, 0, 0, 0, 0]]}
images:
  - {columns: [id, camera, x, y, z, omega, phi, kappa], rows: [[L, C, 0, 0, 5, 0, 0, 0]]}
  - columns: [id, camera, leader, pair, x, omega]
    rows: [[R, C, L, bar, FOLLOWER]]
points:
  - {columns: [id, x, y, z], rows: [[P, 0, 0, 0]]}
observations:
  - {type: image, columns: [image, point, x, y], values: {sigma: SIGMA},
     rows: [[L, P, 0, 0], [R, P, -2, 0]]}
"""

LINE = """\
mor: 1
points:
  - columns: [id, x, y, z]
    rows: [[A, 0, 0, 0], [B, 1, 0.01, 0], [C, 2, -0.01, 0.01], [D, 3, 0, -0.01], [E, 1, 2, 0], [F, 2, 1, 2]]
features:
  - {type: line, id: edge, points: [A, B, C, D], sigma: 0.01}
observations:
  - type: distance
    values: {sigma: 0.001}
    columns: [from, to, distance]
    rows: [[A, B, 1.001], [A, C, 2.002], [A, D, 2.999], [B, C, 1.002], [B, D, 1.998], [C, D, 1.001], [A, E, 2.236],
           [B, E, 1.991], [C, E, 2.247], [D, E, 2.829], [A, F, 3.001], [B, F, 2.442], [C, F, 2.235], [D, F, 2.456],
           [E, F, 2.450]]
datum: free
"""


def read(folder: Path, text: str) -> Network:
    project = write(folder, text)
    return read_network(read_document(project), folder)


def test_a_follower_has_the_blocks_of_its_leader_and_none_of_its_own(tmp_path: Path) -> None:
    network = read(tmp_path, STEREO.replace("FOLLOWER", '"", ""').replace("SIGMA", "0.001"))
    images = network.things["image"]
    for part in ("position", "rotation", "height"):
        assert images.part("R", part) == images.part("L", part)
    assert not any("R" in block for kind in ("point", "rotation") for block in network.blocks[kind].ids)


def test_a_follower_with_a_pose_is_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'R' follows another one"):
        read(tmp_path, STEREO.replace("FOLLOWER", '1, ""').replace("SIGMA", "0.001"))


def test_a_wrong_constant_is_one_mistake_where_it_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, STEREO.replace("FOLLOWER", '"", ""').replace("SIGMA", "small"))
    (problem,) = caught.value.problems
    assert problem.line == STEREO.splitlines().index(next(x for x in STEREO.splitlines() if "SIGMA" in x)) + 1


def test_a_line_leaves_a_free_network_all_its_six_movements(tmp_path: Path) -> None:
    solved = solve_network(read(tmp_path, LINE))
    assert solved.adjustment.outcome.is_solution
    assert len(solved.adjustment.defect.movements) == 6
    assert solved.quality is not None
    # 15 distances and 4 × 2 offsets from the line, less 18 coordinates and 4 parameters of a line, plus 6 of the datum
    assert solved.quality.redundancy == 15 + 8 - 18 - 4 + 6
    assert solved.quality.redundancy_sum == pytest.approx(solved.quality.redundancy, abs=1e-6)


def test_a_line_of_points_without_coordinates_is_the_same_line(tmp_path: Path) -> None:
    start, end = LINE.index("  - columns: [id, x"), LINE.index("features:")
    known, unknown = (
        solve_network(read(tmp_path / name, text))
        for name, text in (
            ("known", LINE),
            (
                "unknown",
                LINE[:start] + "  - {columns: [id], rows: [[A], [B], [C], [D], [E], [F]]}\n" + LINE[end:],
            ),
        )
    )
    assert known.quality is not None
    assert unknown.quality is not None
    assert len(unknown.adjustment.defect.movements) == 6
    assert unknown.quality.redundancy == known.quality.redundancy
    objectives = [solved.adjustment.normals.objective for solved in (known, unknown)]
    np.testing.assert_allclose(*objectives, rtol=1e-9)
    distances = [solved.quality.groups[0] for solved in (known, unknown)]
    np.testing.assert_allclose(distances[0].r, distances[1].r, atol=1e-3)  # to σ of the line, in parts of its length
