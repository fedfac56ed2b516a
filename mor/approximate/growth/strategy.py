"""Start values for everything that has none: parts grow, join, and become the object system.

A part is a set of things in one system with the movements it is still free to make. The object system, with what the
project gives, is one of them; others begin at systems with measured coordinates, GNSS vectors, stations with distances,
pairs of bundles. Every part grows as far as it can, finds the vertical and the scale from what was measured inside it,
and joins another one as soon as what ties them determines the movement between them. What nothing ties comes last.

Where the start values do not agree with the observations, other answers to what was in doubt on the way are tried.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mor.approximate.along_trajectories import seen_along_trajectories, without_trajectories
from mor.approximate.approximation import Approximation, untied
from mor.approximate.assembly.assembly import Assembly
from mor.approximate.assembly.joined import assembled
from mor.approximate.choices import ROWS, SOUND, Choices, Judgement, disagreement, likeliest
from mor.approximate.parts.contradictions import (
    Contradiction,
    agreeing_points,
    contradicting_frames,
    contradicting_points,
    put_back,
    started_only,
    without,
)
from mor.approximate.parts.joining import lay_upon
from mor.approximate.parts.movement import Turn
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene, scene_of
from mor.approximate.parts.transfer import fill_in, with_observed
from mor.approximate.random_places import from_random_places
from mor.approximate.standing_still import at_all_times, standing_still
from mor.approximate.terrestrial.on_the_earth import to_plane
from mor.approximate.terrestrial.projection_centres import to_places
from mor.arrays import FloatArray
from mor.parameters.index import all_known
from mor.project.network.build import Network

Settle = Callable[[Mapping[str, FloatArray]], tuple[Mapping[str, FloatArray], float] | None]
"""Adjusts start values: the values they lead to and v'Pv (infinite: singular), or ``None`` where they lead nowhere."""
OTHERS_TRIED = 12
"""Other answers that are tried where start values do not agree, in networks of up to ``FEW`` observations."""
FEW = 1_000
"""Observations from which fewer are tried, in inverse proportion, one at least."""
_ORIENTING = {"vector", "bearing", "gnss_vector", "azimuth", "astronomic_azimuth", "projected_bearing"}
"""Types of observations that determine how the network is turned."""
_TURNING = {"image", "distance", "distance_ratio", "spatial_angle", "local"}
"""Types of observations that stay the same in any turn of the network; an image type is ``image/…``."""
SMALL = 5_000
"""Observations up to which start values are adjusted before they are judged."""


def approximate(network: Network, settle: Settle | None = None, others: int = OTHERS_TRIED) -> Approximation:
    """Start values of a network; nothing is done where all are given.

    Given poses and points that are start values and no more are tested against the rays; those that contradict are
    replaced where the rest can be worked out without them. With ``settle`` doubtful ones are judged by what an
    adjustment makes of them. ``others``: possible answers that are tried where the likeliest ones do not agree; with
    none nothing that was given is replaced, either.
    """
    if all_known(network.start):
        return Approximation(network.start, {}, ())
    moving = network
    network = to_plane(standing_still(without_trajectories(network)))
    network = to_places(replace(network, start=with_observed(network)))
    scene, assembly = _likeliest(network, scene_of(network), moving, settle, others)
    if assembly.network is not network:
        result = _with_what_agrees(network, assembly, moving, settle)
    else:
        found = _contradicting(network, assembly.parts[0], scene) if others else []
        better = _with_others(network, scene, found) if found else None
        result = _approximation(assembly) if better is None else better
    if result.missing and settle is not None and others:
        result = from_random_places(network, scene, result, settle) or result
    missing = seen_along_trajectories(moving, result.missing)
    return result._replace(start=at_all_times(moving, result.start), missing=missing)


def _likeliest(
    network: Network, scene: Scene, moving: Network, settle: Settle | None, others: int
) -> tuple[Scene, Assembly]:
    """The parts in the object system; where several answers were possible on the way, with those that agree best."""

    loose = started_only(network, scene)

    def attempt(choices: Choices) -> Assembly:
        return _without_some(network, replace(scene, choices=choices), *loose)

    def judged(assembly: Assembly) -> Judgement:
        return _judged(assembly, _approximation(assembly), moving, settle)

    assembly, choices = likeliest(
        attempt,
        judged,
        lambda: max(others * FEW // max(network.observations, FEW), min(others, 1)),
    )
    return replace(scene, choices=Choices(choices.wanted)), assembly


def _without_some(
    network: Network, scene: Scene, points: list[Contradiction], frames: list[Contradiction]
) -> Assembly:
    """The parts in the object system, with all start values that are given, or without those of points or frames.

    Rough ones carry what is worked out from them astray. What is found without them is laid upon them, where nothing
    else says where it is.
    """
    some = [points, frames, [*points, *frames]] if points and frames else [points or frames]
    asks = bool(some[0]) and network.observations <= ROWS
    answer = scene.choices.take(len(some) + 1, alike=False) if asks else 0
    if not answer:
        return assembled(network, scene)
    reduced = replace(network, start=without(network, scene, some[answer - 1]))
    return _assembled_near_given(network, reduced, scene)


def _assembled_near_given(network: Network, reduced: Network, scene: Scene) -> Assembly:
    """Return the parts of a network ``reduced`` by given start values, laid upon these if it has no others."""
    assembly = assembled(reduced, scene)
    if not np.isfinite(reduced.start["point"]).any():
        lay_upon(assembly.parts[0], network.start["point"], *_left_free(network))
    return assembly


def _left_free(network: Network) -> tuple[Turn, bool]:
    """Return the turns that the observations leave free, and whether they determine the size."""
    types = [group.type for group in network.groups]
    keys = {type_.key for type_ in types}
    if keys & _ORIENTING:
        turn = Turn.NONE
    else:
        turn = Turn.ANY if all(key.split("/")[0] in _TURNING for key in keys) else Turn.VERTICAL
    scaled = any(component.quantity.length for type_ in types for component in type_.components)
    return turn, scaled


def _with_what_agrees(
    network: Network, assembly: Assembly, moving: Network, settle: Settle | None
) -> Approximation:
    """Start values of parts from which given ones were left out; those that agree come back, where that does no harm.

    Of the others it is said that another one takes their place.
    """
    system, scene, left = assembly.parts[0], assembly.scene, assembly.network.start
    points, frames = started_only(network, scene)
    gone = [one for one in points if np.isnan(left["point"][one.number]).any()]
    gone += [one for one in frames if np.isnan(left["rotation"][scene.frames[one.number].rotation]).any()]
    wrong = {one.name: str(one) for one in _contradicting(network, system, scene)}
    agreeing = set(agreeing_points(network, system, scene).tolist())
    agree = [
        one
        for one in gone
        if one.name not in wrong and one.number in (agreeing if one.is_point else system.poses)
    ]
    words = tuple(
        wrong.get(one.name, f"{one.name}: without it and others the observations agree better")
        for one in gone
        if one not in agree
    )
    found = _approximation(assembly)._replace(replaced=words)
    start = {kind: values.copy() for kind, values in found.start.items()}
    put_back(network, scene, start, agree)
    kept = found._replace(start=start)
    return (
        found
        if _judged(assembly, found, moving, settle).beats(_judged(assembly, kept, moving, settle))
        else kept
    )


def _judged(assembly: Assembly, found: Approximation, moving: Network, settle: Settle | None) -> Judgement:
    """How many things have no start values, and how well the others agree, before or after an adjustment."""
    network = assembly.network
    missing = sum(thing.observations > 1 for thing in found.missing)
    judgement = Judgement(missing, *disagreement(network.groups, found.start))
    small, sound = network.observations <= SMALL, judgement.worst <= SOUND
    if settle is None or not small or found.missing or (sound and not assembly.scene.choices.open):
        return judgement
    settled = settle(at_all_times(moving, found.start))
    if settled is None:
        return judgement._replace(worst=np.inf)
    values, squares = settled
    if np.isinf(squares):  # other start values seldom help, and none of them may take the place of given ones
        return judgement._replace(fit=np.inf, worst=np.inf)
    return Judgement(0, *disagreement(moving.groups, values), squares, judgement.fit)


def _contradicting(network: Network, system: Part, scene: Scene) -> list[Contradiction]:
    return contradicting_frames(network, system, scene) + contradicting_points(network, system, scene)


def _with_others(network: Network, scene: Scene, found: list[Contradiction]) -> Approximation | None:
    """Start values without the poses and points that contradict; ``None`` where not everything starts without them.

    One that contradicts only because another one had spoiled what it is tied to stays as it was given.
    """
    reduced = replace(network, start=without(network, scene, found))
    assembly = _assembled_near_given(network, reduced, scene)
    approximation = _approximation(assembly)
    if approximation.missing:
        return None
    wrong = _contradicting(network, assembly.parts[0], scene)
    names = {one.name for one in wrong}
    start = {kind: values.copy() for kind, values in approximation.start.items()}
    put_back(network, scene, start, [one for one in found if one.name not in names])
    return approximation._replace(start=start, replaced=tuple(str(one) for one in wrong))


def _approximation(assembly: Assembly) -> Approximation:
    network, scene = assembly.network, assembly.scene
    start, how, missing = fill_in(network, assembly.parts[0], scene.frames, scene.terrestrial)
    reasons, parts = tuple(assembly.reasons) if missing else (), tuple(assembly.parts[0].joined)
    given = bool(np.isfinite(network.start["point"]).any())
    sights = scene.terrestrial.sights
    return Approximation(start, how, missing, reasons, (), parts, scene.frames, sights, untied(parts, given))
