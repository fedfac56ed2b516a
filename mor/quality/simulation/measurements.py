"""What would be measured at a known place of everything: values without errors, and errors as the σ say.

Observations y = f(x) + e, with e normally distributed, of the covariance matrix that the project gives: σ with all that
its models add at this place (parts per million, centring), correlations where there are some. Prior knowledge (control
coordinates, interior orientations from a laboratory) is observed as well and gets its error like any other observation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.adjustment.problem import Problem
from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.cameras import CAMERA_MODELS
from mor.geometry.rotations import angles_from_rotation
from mor.observations import FOLLOWER_TYPES, IMAGE_TYPES, MOVING_TYPES, ObservationGroup
from mor.observations.time.shutter_on_trajectory import is_read_out_along, shutter_on_trajectory
from mor.observations.time.trajectory import CUBIC, LINEAR, on_trajectory
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.project.trajectories.planned import is_scanned, rescanned
from mor.project.trajectories.poses import with_image_poses
from mor.project.trajectories.read_out import read_out_at

_CORRECTED = [
    types[key]
    for types in (IMAGE_TYPES, FOLLOWER_TYPES)
    for key, model in CAMERA_MODELS.items()
    if model.corrects_measured and key in types
]
_CORRECTING = {
    kind.key
    for kind in (
        *_CORRECTED,
        *(on_trajectory(kind, knots) for kind in _CORRECTED for knots in (LINEAR, CUBIC)),
        *MOVING_TYPES.values(),
        *(shutter_on_trajectory(key, knots) for key in CAMERA_MODELS for knots in (LINEAR, CUBIC)),
    )
}
"""Image coordinates whose distortion, or time, is taken at the measured coordinates."""
_ROUNDS = 60


def computed_values(group: ObservationGroup, place: Values) -> FloatArray:
    """(n, m) what would be observed without errors; NaN where nothing is."""
    return group.observed - misclosures(group, place)


def errors(problem: Problem, generator: np.random.Generator) -> tuple[FloatArray, ...]:
    """Random errors (n, m) of each group, drawn from the covariances of the problem; 0 where nothing is observed.

    As many numbers are drawn as there are entries, whatever is observed: a seed gives the same errors to the same rows.
    """
    drawn = [generator.standard_normal(group.observed.shape) for group in problem.groups]
    found = [
        np.where(group.mask, unit * np.where(group.mask, group.given_sigma, 0.0), 0.0)
        for group, unit in zip(problem.groups, drawn, strict=True)
    ]
    flat, unit = np.concatenate([e.ravel() for e in found]), np.concatenate([u.ravel() for u in drawn])
    for cluster in problem.clusters:
        flat[cluster.entries] = tolerant.cholesky(cluster.covariance) @ unit[cluster.entries]
    offsets = problem.offsets
    return tuple(
        flat[first : first + group.observed.size].reshape(group.observed.shape)
        for first, group in zip(offsets, problem.groups, strict=False)
    )


def with_observed(problem: Problem, observed: Sequence[FloatArray]) -> Problem:
    """The problem with other observed values (n, m) of each group."""
    pairs = zip(problem.groups, observed, strict=True)
    return replace(problem, groups=tuple(replace(group, observed=values) for group, values in pairs))


def measured_at(network: Network, place: Values) -> Network:
    """The network at a place where all of its observations, prior knowledge too, are free of errors.

    Images on trajectories have the poses of their times. Raises :class:`InputError` for points that do not come before
    the line of a scanner.
    """
    place = with_image_poses(network, place)
    groups, checks, candidates = (
        tuple(_measured(_at_its_time(network, group, place), place) for group in some)
        for some in (network.groups, network.checks, network.candidates)
    )
    observed = {
        kind: np.where(np.isfinite(network.sigma[kind]), _said(place[kind]), network.observed[kind])
        for kind in network.observed
    }
    return replace(
        network,
        start=place,
        observed=observed,
        groups=groups,
        checks=checks,
        candidates=candidates,
        datum=network.datum._replace(given=place["point"]),
    )


def _at_its_time(network: Network, group: ObservationGroup, place: Values) -> ObservationGroup:
    """The group with the time of every row; where a row is scanned or read out depends on where things are."""
    if is_read_out_along(group.type):
        return read_out_at(network, _measured(group, place), place)
    return rescanned(network, group, place) if is_scanned(group) else group


def _measured(group: ObservationGroup, place: Values) -> ObservationGroup:
    """The group with what would be observed; camera models that correct what is measured look at just that."""
    scanned = is_scanned(group)
    if group.type.key not in _CORRECTING and not scanned:
        return replace(group, observed=computed_values(group, place))
    looked_at = 1 if scanned else 2
    observed = np.where(group.mask, 0.0, np.nan)
    for _ in range(_ROUNDS):
        constants = group.constants.copy()
        constants[:, :looked_at] = np.nan_to_num(observed[:, :looked_at])
        group = replace(group, constants=constants)
        before, observed = observed, computed_values(group, place)
        if np.nanmax(np.abs(observed - before), initial=0.0) == 0.0:
            break
    return replace(group, observed=observed)


def _said(values: FloatArray) -> FloatArray:
    """Values (n, size) as they are observed; rotations as ω, φ, κ."""
    return angles_from_rotation(values) if values.ndim == 3 else values
