"""Distortion of a camera with its standard deviation, from the interior orientation as it stands in ``results.json``.

The distortion is what the model makes of an ideal image point beyond central projection with the camera constant and
the principal point alone. Its σ follows from the covariance of the distortion components, those of the camera constant
and the principal point left aside.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS

_NOT_DISTORTION = {"c", "f", "xh", "yh", "fx", "fy", "cx", "cy"}
_AZIMUTHS = 16


class Distortion(NamedTuple):
    """Distortion at n ideal image points (n, 2), with covariances (n, 2, 2); image unit of the camera."""

    shift: FloatArray
    covariance: FloatArray


class RadialCurve(NamedTuple):
    """Radial distortion (mean over all directions) by radius, with σ; all (n,)."""

    radius: FloatArray
    shift: FloatArray
    sigma: FloatArray


def distortion(camera: dict[str, Any], ideal: FloatArray) -> Distortion:
    """Distortion of a camera (an entry of ``cameras``) at ideal points (n, 2) counted from the principal point."""
    shift, by_terms, covariance = _linearised(camera, ideal)
    return Distortion(shift, by_terms @ covariance @ np.swapaxes(by_terms, 1, 2))


def radial_curve(camera: dict[str, Any], largest: float, count: int = 61) -> RadialCurve:
    """Radial distortion of a camera from the principal point to the radius ``largest``."""
    radius = np.linspace(0.0, largest, count)[1:]
    azimuth = np.arange(_AZIMUTHS) * 2.0 * np.pi / _AZIMUTHS
    direction = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    ideal = (radius[:, None, None] * direction).reshape(-1, 2)
    shift, by_terms, covariance = _linearised(camera, ideal)
    along = np.tile(direction, (len(radius), 1))
    mean = np.einsum("nk,nk->n", shift, along).reshape(-1, _AZIMUTHS).mean(axis=1)
    form = np.einsum("nk,nkp->np", along, by_terms).reshape(len(radius), _AZIMUTHS, -1).mean(axis=1)
    sigma = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", form, covariance, form), 0.0))
    zero = np.zeros(1)
    return RadialCurve(np.append(zero, radius), np.append(zero, mean), np.append(zero, sigma))


def _linearised(camera: dict[str, Any], ideal: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distortion (n, 2), its derivatives (n, 2, k) by the estimated terms, their covariance (k, k)."""
    model = CAMERA_MODELS[camera["model"]]
    names = [component.name for component in model.components]
    values = np.array([camera["components"][name]["value"] for name in names])
    plain = np.where([name in _NOT_DISTORTION for name in names], values, 0.0)
    constants = np.full((len(ideal), len(model.constants)), float(camera["r0"] or 0.0))
    focal = values[0]
    scale = np.array([1.0, focal / values[names.index("fy")] if "fy" in names else 1.0])
    star = np.column_stack([ideal * scale, np.full(len(ideal), -focal)])
    centre = model.project(star, np.tile(plain, (len(ideal), 1)), constants, ideal)
    seen = model.project(star, np.tile(values, (len(ideal), 1)), constants, centre.xy)
    base = model.project(star, np.tile(plain, (len(ideal), 1)), constants, centre.xy)
    terms = [k for k, name in enumerate(camera["correlations"]["components"]) if name not in _NOT_DISTORTION]
    free = [camera["correlations"]["components"][k] for k in terms]
    by_terms = seen.by_interior[:, :, [names.index(name) for name in free]]
    return seen.xy - base.xy, by_terms, _covariance(camera, terms, free)


def _covariance(camera: dict[str, Any], terms: list[int], free: list[str]) -> FloatArray:
    matrix = camera["correlations"]["matrix"]
    if matrix is None or not free:
        return np.zeros((len(free), len(free)))
    sigma = np.array([camera["components"][name]["sigma"] for name in free])
    correlation = np.array(matrix)[np.ix_(terms, terms)]
    covariance: FloatArray = correlation * np.outer(sigma, sigma)
    return covariance
