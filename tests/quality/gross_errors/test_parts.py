"""Medians of what alone tells of a part of a network."""

import numpy as np

from mor.quality.robust_estimation import exclude, parts_of, whole
from tests.scenarios.gross_error_scenes import spoiled


def test_rows_have_the_larger_median_of_their_image_and_of_rays_to_given_points():
    problem = spoiled(0, "aerial", 0.0).problem
    group = problem.groups[0]
    random = np.random.default_rng(0)
    sizes = np.abs(random.standard_normal(group.observed.shape))
    image, point = group.blocks[1], group.blocks[-1]
    given = ~(problem.index.columns["point"] >= 0).any(axis=1)
    own = np.array([np.median(sizes[image == one]) for one in image])
    tied = np.median(sizes[given[point]])
    expected = np.where(given[point], np.maximum(own, tied), own) / 0.6745
    np.testing.assert_allclose(parts_of(problem)[0].sigmas(sizes)[:, 0], expected, rtol=1e-12)


def test_what_is_left_out_has_no_say_and_undivided_groups_have_no_parts():
    problem = spoiled(0, "aerial", 0.0).problem
    group = problem.groups[0]
    out = np.zeros(group.observed.shape, dtype=bool)
    out[::3] = True
    sizes = np.where(out, 1e6, 1.0)
    found = parts_of(exclude(problem, [out]))[0].sigmas(sizes)
    np.testing.assert_allclose(found, 1.0 / 0.6745)
    assert not whole(problem)[0].sigmas(sizes).any()
