"""Covariances of an image block by pycolmap; runs in an environment of its own, which has pycolmap.

    python colmap.py BLOCK

The block is that of the program of Ceres. The camera is OPENCV (c twice, principal point, K1, K2, P1, P2: 8 unknowns
in place of 10), there are no observed projection centres; two images hold the datum. So this is a system of the same
size and structure, not the same least-squares problem. Prints one JSON object; seconds.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
import pycolmap


def main(path: str) -> None:
    """Build the reconstruction and time the covariances of all poses, points and the camera."""
    reconstruction = reconstruct(path)
    config = pycolmap.BundleAdjustmentConfig()
    for number in reconstruction.images:
        config.add_image(number)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions(refine_principal_point=True)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, reconstruction)
    found: dict[str, Any] = {"version": pycolmap.__version__}
    wanted = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.ALL)
    cpu, wall = time.process_time(), time.perf_counter()
    covariance = pycolmap.estimate_ba_covariance(wanted, reconstruction, adjuster)
    found["covariance_cpu"] = time.process_time() - cpu
    found["covariance_wall"] = time.perf_counter() - wall
    if covariance is None or covariance.get_point_cov(1) is None:
        sys.exit("pycolmap found no covariance")
    found["points"] = reconstruction.num_points3D()
    print(json.dumps(found))


def reconstruct(path: str) -> pycolmap.Reconstruction:
    """The block as a reconstruction: camera axes x right, y down, z forward; pixels are millimetres."""
    with open(path, "rb") as file:
        images, points, rays = np.fromfile(file, np.int64, 3)
        np.fromfile(file, float, 2)
        pose = np.fromfile(file, float, 6 * images).reshape(-1, 6)
        np.fromfile(file, float, 10)
        xyz = np.fromfile(file, float, 3 * points).reshape(-1, 3)
        np.fromfile(file, float, 3 * images)
        xy = np.fromfile(file, float, 2 * rays).reshape(-1, 2)
        image = np.fromfile(file, np.int64, rays)
        of_point = np.fromfile(file, np.int64, rays)
    result = pycolmap.Reconstruction()
    # origin and size of the picture only matter for pycolmap's checks
    camera = pycolmap.Camera(
        camera_id=1, model="OPENCV", width=90, height=70, params=[100.0, 100.0, 45.0, 35.0, 0, 0, 0, 0]
    )
    result.add_camera_with_trivial_rig(camera)
    place = np.zeros(rays, np.int64)
    for k in range(images):
        own = np.flatnonzero(image == k)
        place[own] = np.arange(len(own))
        pixels = xy[own] * [1.0, -1.0] + [45.0, 35.0]
        picture = pycolmap.Image(name=f"I{k}", keypoints=pixels, camera_id=1, image_id=k + 1)
        D = np.diag([1.0, -1.0, -1.0]) @ rotation(pose[k, 3:])
        turned = pycolmap.Rigid3d(pycolmap.Rotation3d(D), -D @ pose[k, :3])
        result.add_image_with_trivial_frame(picture, turned)
    starts = np.searchsorted(of_point, np.arange(points + 1))  # rays come in the order of their points
    for p in range(points):
        track = pycolmap.Track()
        for n in range(starts[p], starts[p + 1]):
            track.add_element(int(image[n]) + 1, int(place[n]))
        result.add_point3D(xyz[p], track)
    return result


def rotation(angles: np.ndarray) -> np.ndarray:
    """D = (Rx(ω) Ry(φ) Rz(κ))ᵀ."""
    (so, sp, sk), (co, cp, ck) = np.sin(angles), np.cos(angles)
    return np.array(
        [
            [cp * ck, co * sk + so * sp * ck, so * sk - co * sp * ck],
            [-cp * sk, co * ck - so * sp * sk, so * ck + co * sp * sk],
            [sp, -so * cp, co * cp],
        ]
    )


if __name__ == "__main__":
    main(sys.argv[1])
