"""Points that no image can show where it shows them: in a projection centre, beyond a fold, behind a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.api.pipeline import make_problem, read_document, read_network, solve_network
from mor.model.rotations import rotation_from_angles
from mor.quality.determinability import BEYOND_FOLD, IN_CENTRE, PASSING
from mor.quality.solution import Solved
from mor.solve import iterate
from mor.solve.normals import eliminable_rays, make_plan
from mor.types import FloatArray, IntArray
from tests.formats.blocks import block, written
from tests.reference_data import point_results


def _block() -> dict[str, Any]:
    data = block(7, "OPENCV")
    data["cameras"]["7"]["interior"]["k2"] = {"fixed": "-0.05"}  # r (1 - 0.1 r² - 0.05 r⁴) turns back at r = 1.2
    return {**data, "settings": {"undetermined": "leave_out"}}


def _solved(folder: Path, data: dict[str, Any]) -> Solved:
    folder.mkdir()
    return solve_network(read_network(read_document(written(folder, data)), folder))


def _pose(data: dict[str, Any], image: int) -> tuple[FloatArray, FloatArray]:
    row = np.array(data["images"][0]["rows"][image][2:], dtype=float)
    return row[:3], rotation_from_angles(row[None, 3:])[0]


def _without(data: dict[str, Any], point: str) -> dict[str, Any]:
    points, observed = data["points"][0], data["observations"][0]
    return {
        **data,
        "points": [{**points, "rows": [row for row in points["rows"] if row[0] != point]}],
        "observations": [{**observed, "rows": [row for row in observed["rows"] if row[1] != point]}],
    }


@pytest.mark.parametrize(("ray", "reason"), [((0.0, 0.0, 0.0), IN_CENTRE), ((4.4, 1.0, -2.4), BEYOND_FOLD)])
def test_a_point_that_begins_there_is_left_out_by_name(tmp_path: Path, ray: FloatArray, reason: str) -> None:
    data = _block()
    centre, D = _pose(data, 2)
    data["points"][0]["rows"][4][1:] = [repr(float(x)) for x in centre + np.array(ray) @ D]
    found, others = _solved(tmp_path / "all", data), _solved(tmp_path / "others", _without(data, "5"))
    assert found.adjustment.outcome.is_solution
    assert [(one.name, one.reason) for one in found.network.undeterminable] == [("5", reason)]
    expected = point_results(others)
    for name, (xyz, _) in point_results(found).items():
        if name != "5":
            np.testing.assert_allclose(xyz, expected[name][0], rtol=0, atol=1e-9)


def test_points_that_a_step_leads_past_a_camera_end_an_iteration_that_waits_for_them(tmp_path: Path) -> None:
    network = read_network(read_document(written(tmp_path, block(7, "PINHOLE"))), tmp_path)
    problem = make_problem(network, network.start, network.start)
    state = iterate._begin(make_plan(problem, eliminable_rays(problem, network.start)), network.start)
    points, places = problem.index.columns["point"], network.start["point"]
    one, camera = (network.blocks["point"].ids.index(name) for name in ("5", "image 1"))
    step = np.zeros(problem.index.count)
    step[points[one]] = -1.1 * (places[one] - places[camera])
    damped = iterate.Iteration(1, state.normals.objective, 1.0, 1e-5, 100)
    waiting = state._replace(iterations=(damped,) * 5)
    assert iterate._gone(waiting, step)[1].tolist() == [one]
    assert iterate._gone(waiting, 0.9 * step)[1].tolist() == []
    assert iterate._gone(state._replace(iterations=(damped,) * 4), step)[1].tolist() == []
    gaining = (damped._replace(objective=1.01 * damped.objective), *(damped,) * 4)
    assert iterate._gone(state._replace(iterations=gaining), step)[1].tolist() == []
    astray = damped._replace(redundancy=1)
    assert iterate._gone(state._replace(iterations=(astray,) * 5), step)[1].tolist() == []


@pytest.mark.parametrize("leave_out", [True, False])
def test_such_points_are_left_out_where_undetermined_objects_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, leave_out: bool
) -> None:
    data = {**block(7, "PINHOLE"), "settings": {"undetermined": "leave_out" if leave_out else "refuse"}}

    def gone(state: iterate.Adjustment, step: FloatArray) -> tuple[IntArray, IntArray]:
        one = state.problem.index.blocks["point"].ids.index("5")
        used = state.problem.index.columns["point"][one].max() >= 0
        return np.zeros(0, dtype=np.int64), np.array([one] if used else [], dtype=np.int64)

    others = _solved(tmp_path / "others", _without(data, "5"))
    monkeypatch.setattr(iterate, "_gone", gone)
    found = _solved(tmp_path / "all", data)
    assert found.adjustment.outcome.is_solution == leave_out
    named = [(one.name, one.reason, one.treatment) for one in found.network.undeterminable]
    assert named == [("5", PASSING, "left out" if leave_out else "")]
    if leave_out:
        expected, points = point_results(others), point_results(found)
        for name in expected:
            np.testing.assert_allclose(points[name][0], expected[name][0], rtol=0, atol=1e-7)
