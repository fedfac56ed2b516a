"""Hypotheses about mistakes: the right one is offered first, none where nothing is wrong, and its numbers are true."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mor.api import pipeline
from mor.api.pipeline import make_problem
from mor.diagnose.angles import _given_unit, _is_on_circle
from mor.diagnose.heights import _hypothesis, _reductions, height_sights
from mor.diagnose.hypothesis import Situation
from mor.quality.group_tests import Rejection, rejection
from mor.quality.outliers import (
    cost_of_choice,
    cost_of_residuals,
    price_of_gross_error,
    reintersected,
    sizes_of,
    slots_of_ends,
)
from mor.quality.solution import Solved
from mor.solve.iterate import SolverSettings, adjust
from tests.scenarios.planted_mistakes.survey import survey
from tests.scenarios.planted_mistakes.trial import trial
from tests.scenarios.small_projects import LEVELLING, write
from tests.selection import slow_but

CASES = [
    ("exchanged_in_image", 2),  # left alone, a point stays where the wrong ray and another one meet
    ("misnumbered_at_station", 1),
    ("offset", 1),
    ("wrong_station", 1),  # one of the few distances that give the scale
    ("instrument_height", 2400),  # it won its point against four others, which the robust way leaves out
    ("wrong_station", 2401),  # two scale bars that drew a point away from 17 rays
    ("levelling_sign", 701),  # a line that is not controlled fully
    ("elevation", 700),  # a station that gets no start values
    ("counterclockwise", 2300),  # two stations among many images, which all fit without them
    ("turned", 700),  # an image whose attitude is known
    ("image_unit", 702),  # a camera that everything else can be bent to fit
    ("control_unit", 2606),  # control in millimetres that images from one place hardly control
    ("counterclockwise", 2802),  # a station whose sights then have a solution of no use
    ("sigma_unit", 2706),  # of images, a thousand times too large
    ("slope_for_horizontal", 7000),  # a factor of all σ, which the score tests name too, explains nothing
    ("control_unit", 7002),  # the same
    ("control_moved", 7001),  # one coordinate of a point
    ("two_levelling_signs", 8200),  # two lines together
    ("images_exchanged", 7000),  # images whose places are observed
    ("axes_exchanged", 7001),  # three control points that moved are no rival
    ("misnumbered_in_image", 8101),  # a ray that fits where the distortion turns back
    ("control_moved", 8200),  # what the worst single observation says, too
    ("set_ups_exchanged", 8200),  # start values that the mistake has spoilt for every hypothesis
    ("station_exchanged_in_directions", 8200),  # in one of several tables
]
"""A few that are quick; ``python -m tests.scenarios.planted_mistakes`` has all kinds."""


def _solved(path: Path) -> Solved:
    document = pipeline.read_document(path)
    return pipeline.solve_network(pipeline.read_network(document, path.parent))


@pytest.mark.parametrize("many", [1, 16])
def test_points_of_many_rays_take_longer(tmp_path: Path, many: int) -> None:
    """Every ray of the facade written many times: Σ k² / (8 Σ k) over the numbers of rays k of its points."""
    survey("facade").write(tmp_path)
    table = tmp_path / "image_points.csv"
    _, *rows = table.read_text(encoding="utf-8").splitlines()
    counts = np.array(list(Counter(row.split(",")[1] for row in rows).values())) * many
    document = pipeline.read_document(tmp_path / "project.yaml")
    network = pipeline.read_network(document, tmp_path)
    groups = [g for g in network.groups for _ in range(many if g.type.key.startswith("image") else 1)]
    found = pipeline.times_as_long(replace(network, groups=tuple(groups)))
    assert found == max(1, int((counts**2).sum() / (8 * counts.sum())))
    assert (found > 4) == (many > 1)


def test_exchanged_start_poses_are_computed_anew(tmp_path: Path) -> None:
    """Two images with each other's start pose; nothing else tells their names."""
    found = trial("images_exchanged", 8201, tmp_path)
    assert (found.code, found.outcome, found.offered) == (0, "converged", ())


@pytest.mark.parametrize(("kind", "seed"), slow_but([("offset", 1)], CASES))
def test_a_planted_mistake_is_the_first_hypothesis(kind: str, seed: int) -> None:
    found = trial(kind, seed)
    assert found.rejected
    assert found.place == 0, found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bridge", "aerial_strip"])
def test_nothing_is_offered_where_nothing_is_wrong(name: str, tmp_path: Path) -> None:
    solved = _solved(survey(name).write(tmp_path))
    assert solved.quality is not None
    assert rejection(solved.quality, solved.network) is Rejection.NOTHING
    assert solved.possible_causes == ()


def test_a_rejected_network_with_checks(tmp_path: Path) -> None:
    check = "checks:\n  - {type: height_difference, columns: [from, to, dz, sigma], rows: [[A, B, 1, 0.001]]}\n"
    solved = _solved(write(tmp_path, LEVELLING.replace("1.002", "1.102") + check))
    assert solved.quality is not None
    assert rejection(solved.quality, solved.network) is Rejection.LARGER


def test_the_reduction_by_a_height_is_that_of_an_adjustment_with_it(tmp_path: Path) -> None:
    solved = _solved(survey("bridge").write(tmp_path))
    network, plain = solved.network, solved.adjustment
    sights = [one for one in height_sights(network) if one.things[0] in ("P4", "NE1")]
    begin = lambda changed: changed.start  # noqa: E731
    situation = Situation(network, plain.start, plain.values, plain, make_problem, begin)
    promised = _reductions(adjust(plain.problem, plain.values, SolverSettings(0)), sights)
    off = np.random.default_rng(1).normal(0.0, 1e-3, plain.values["point"].shape)
    free = plain.problem.index.blocks["point"].free
    beside = {**plain.values, "point": plain.values["point"] + np.where(free, off, 0.0)}
    not_there = adjust(plain.problem, beside, SolverSettings(0))
    np.testing.assert_allclose(_reductions(not_there, sights), promised, rtol=0, atol=0.02)
    for one, reduction in zip(sights, promised, strict=True):
        changed = _hypothesis(situation, one, 1).change(network)
        values = {**plain.values, "height": changed.start["height"]}
        again = adjust(make_problem(changed, plain.start, values), values)
        if not again.outcome.is_solution:
            assert reduction == 0.0, "a height that nothing else controls promises nothing"
            continue
        fallen = plain.normals.objective - again.normals.objective
        assert fallen == pytest.approx(reduction, abs=1e-4)
    assert max(promised) > 1.0


def test_a_point_is_intersected_where_most_of_its_sights_have_it(tmp_path: Path) -> None:
    solved = _solved(survey("stereo_rig").write(tmp_path))
    problem, values = solved.adjustment.problem, solved.adjustment.values
    point = solved.network.blocks["point"].ids.index("T0704")
    slots = [slots_of_ends(group)[0] for group in problem.groups[:2]]
    pairs = zip(problem.groups, slots, strict=False)
    rows = [np.flatnonzero(group.blocks[slot] == point) for group, slot in pairs]
    assert sum(map(len, rows)) >= 4, "a wrong one among four"
    observed = problem.groups[0].observed.copy()
    observed[rows[0][0]] += 3.0
    wrong = replace(problem, groups=(replace(problem.groups[0], observed=observed), *problem.groups[1:]))
    moved = {**values, "point": values["point"].copy()}
    moved["point"][point] += 0.4
    found = reintersected(wrong, moved, sizes_of(wrong.groups, moved))["point"]
    assert np.abs(found[point] - values["point"][point]).max() < 2e-3
    others = np.arange(len(found)) != point
    assert np.array_equal(found[others], moved["point"][others])


def test_angles_are_not_read_in_a_unit_whose_circle_they_leave(tmp_path: Path) -> None:
    solved = _solved(survey("bridge").write(tmp_path))
    network, group = solved.network, solved.network.groups[0]
    assert _given_unit(network, group) == "gon"
    rows = np.arange(group.count)
    assert _is_on_circle(group, rows, 0.9)
    assert not _is_on_circle(group, rows, 200.0 / np.pi), "191 gon are no radians"


def test_sigmas_that_are_all_too_small_are_told_by_one_factor() -> None:
    sizes = [np.abs(np.random.default_rng(0).standard_normal((5000, 1)))]
    tenfold = cost_of_residuals([10.0 * sizes[0]], 5000) - cost_of_residuals(sizes, 5000)
    assert tenfold == pytest.approx(2.0 * 5000 * np.log(10.0), rel=0.02)


def test_residuals_cost_their_square_and_gross_errors_their_name_and_size() -> None:
    sizes = [np.array([[0.5, 0.6]]), np.array([[1e6]])]
    assert cost_of_residuals(sizes, 100) == pytest.approx(0.61 + 2.0 * np.log(100) + 2.0 * np.log(1e6))
    limit = price_of_gross_error(100)
    assert limit**2 == pytest.approx(2.0 * np.log(100) + 2.0 * np.log(limit))
    assert cost_of_choice(100, 5, 2, 0.5) == pytest.approx(2.0 * np.log(100) + 2.0 * np.log(5) - 1.0)
