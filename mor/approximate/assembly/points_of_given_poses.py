"""Start values of points alone, where frames have theirs: every point by the rays that see it, and by nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.approximate.growth.grow_bundles import intersect_again, intersect_the_rest
from mor.approximate.growth.single_points import grow_single_points
from mor.approximate.parts.scene import scene_of
from mor.approximate.parts.transfer import starting_part, with_observed
from mor.arrays import FloatArray
from mor.project.network.build import Network


def with_points_of_given_poses(network: Network) -> dict[str, FloatArray]:
    """Start values of a network, those of points worked out that images of given pose see.

    As the growth of parts (:mod:`mor.approximate.growth.grow_bundles`) intersects them where all frames are posed.
    What is given stays, coordinate by coordinate.
    """
    start = with_observed(network)
    network = replace(network, start=start)
    scene = scene_of(network)
    part = starting_part(network, scene.frames)
    intersect_again(part, scene.frames, scene.seen, sorted(part.poses))
    grow_single_points(part, scene)
    intersect_the_rest(part, scene.seen)
    while grow_single_points(part, scene, ambiguous=True, contradicting=True):
        pass
    return {**start, "point": np.where(np.isnan(start["point"]), part.points, start["point"])}
