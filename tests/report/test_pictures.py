"""Pictures of networks: names that do not overlap, paths of instruments, rays that start where they start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.report.layout import placed
from mor.report.observations import observation_table
from mor.report.page_data import page_data
from mor.report.plots import network, style
from mor.report.view import View, scanned_images, view_of, view_of_folder
from tests.scenarios.small_projects import mor

STRIPS = Path(__file__).parents[2] / "sample_projects" / "three_line_strip"


@pytest.fixture(scope="module")
def strips() -> View:
    solved = solve_network(read_network(read_document(STRIPS / "project.yaml"), STRIPS))
    return view_of(solved, observation_table(solved))


@pytest.mark.parametrize("seed", range(20))
def test_names_meet_neither_each_other_nor_points_nor_the_edge(seed: int) -> None:
    draw = np.random.default_rng(seed)
    count = int(draw.integers(2, 120))
    marks = draw.uniform(0.0, 300.0, (count, 2))
    size = np.column_stack([draw.uniform(5.0, 60.0, count), np.full(count, 8.0)])
    found = placed(marks, size, np.array([0.0, 0.0, 300.0, 300.0]))
    boxes = np.array([[*(marks[k] + offset - size[k] / 2), *(marks[k] + offset + size[k] / 2)] for k, offset in found])
    assert (boxes >= 0.0).all()
    assert (boxes <= 300.0).all()
    assert found[0][0] == 0, "the first has the first choice"
    for n, box in enumerate(boxes):
        others = np.delete(boxes, n, axis=0)
        assert not ((box[:2] < others[:, 2:]) & (others[:, :2] < box[2:])).all(axis=1).any()
        assert not ((box[:2] < marks) & (marks < box[2:])).all(axis=1).any()


def test_drawn_names_do_not_overlap(strips: View) -> None:
    """As matplotlib measures them, at another resolution than the one they were placed for."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with style():
        figure = network(strips)
        figure.set_dpi(220)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert len(boxes) > 60
    assert sum(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k]) == 0


def test_paths_of_instruments_are_drawn(strips: View) -> None:
    with style():
        drawn = [line for line in network(strips).axes[0].lines if line.get_color() == "#e69f00"]
    paths = [line for line in drawn if line.get_linestyle() == "-"]
    assert sum(len(line.get_xdata()) for line in paths) == strips.trajectories.height
    assert len(paths) == strips.trajectories.select("trajectory", "stretch").n_unique()


def test_scanned_images_have_no_one_place(strips: View) -> None:
    """Rays of one scanner do not meet in the place of its first line."""
    assert scanned_images(strips) == strips.images["id"].to_list()
    assert page_data(strips).points["angle"].null_count() == strips.points.height


def test_knots_come_back_from_disk(strips: View, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    assert mor("adjust", STRIPS / "project.yaml", "-o", folder, "--no-html", "--quiet").code == 0
    read = view_of_folder(folder).trajectories
    assert read["trajectory"].to_list() == strips.trajectories["trajectory"].to_list()
    np.testing.assert_allclose(read["x"].to_numpy(), strips.trajectories["x"].to_numpy(), rtol=1e-12)
