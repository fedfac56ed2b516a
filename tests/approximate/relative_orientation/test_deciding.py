"""A further image decides between the orientations of an ambiguous pair."""

from __future__ import annotations

import numpy as np
import pytest

from mor.start.bundle import image_bundle
from mor.start.image_pair import robust_relative_orientation
from mor.start.relative_orientation import RelativeOutcome
from mor.start.stereo_model import joined

NOISE = 0.002


def chain_of(scenes, seed):
    """Three images of a plane, the pairs of neighbours, and the true base of the first one in its axes."""
    made = scenes.plane_scene(seed, NOISE, n=12, images=3)
    images = [image_bundle(rays, NOISE) for rays in made.rays]
    pairs = [robust_relative_orientation(images[k], images[k + 1]) for k in (0, 1)]
    base = (made.cameras[1][0] - made.cameras[0][0]) @ made.cameras[0][1].T
    return images, pairs, base / np.linalg.norm(base)


@pytest.mark.parametrize("seed", [0, 29, 32])
def test_the_orientation_that_fits_the_third_image_is_taken(scenes, seed):
    images, pairs, base = chain_of(scenes, seed)
    first = pairs[0].orientation
    assert first.outcome is RelativeOutcome.AMBIGUOUS
    assert np.linalg.norm(first.base - base) > 0.3
    found = joined(pairs, images, np.ones((3, 12), dtype=bool))
    assert found.model is not None
    assert found.rivals == 0
    assert 0.5 < found.model.sigma0 < 1.5
    one = found.pairs[0].orientation
    assert one.outcome is RelativeOutcome.AMBIGUOUS
    for away, sigma in (
        (found.model.positions[1] - base, np.sqrt(np.diag(found.model.frame_covariance[1])[:3])),
        (one.base - base, one.sigma_base),
    ):
        assert np.all(np.abs(away) < 5.0 * sigma + 1e-5)
    assert [np.allclose(other.base, first.base) for other in one.alternatives] == [True]
    np.testing.assert_allclose(found.pairs[0].residuals, one.residuals)
