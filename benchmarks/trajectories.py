"""Iterations of a block of three-line strips beside those of frame images.

    python benchmarks/trajectories.py

Strips of a three-line scanner with a knot a second, positions and attitudes of the knots observed, their interpolation
linear and cubic: once with their rays linearised by the compiled kernels, once by the numpy equation they are tested
against. Times are CPU seconds, the rounds of all one after the other, for 100 000 image points; the ratio is the median
of its rounds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from problems import Posed, problem_of_block
from rolling_shutters import iteration
from scenes import INTERIOR, SIGMA_IMAGE, aerial

from mor.model.contract import ObservationGroup
from mor.model.coordinates import OBSERVED_PARAMETERS
from mor.model.images import line_scanner
from mor.model.parameters import (
    ECCENTRICITY,
    HEIGHT,
    INTERIORS,
    POINT,
    ROTATION,
    BlockKind,
    Blocks,
    index_unknowns,
)
from mor.model.rotations import rotation_from_angles
from mor.project.entities import Trajectory
from mor.solve.iterate import adjust
from mor.solve.problem import DatumDefinition, Problem
from mor.types import FloatArray, IntArray

LINES = np.array([45.0, 0.0, -28.0])
"""y of the lines in mm, at c = 100 mm."""
SPEED, FLYING_HEIGHT, SECONDS, STRIPS, APART = 70.0, 1000.0, 120, 4, 280.0
"""m/s and m, of strips and how far they are apart."""
POINTS, LEAST_RAYS = 31_000, 3
RATE = -1.0 / 7.0
"""Seconds for a mm of rows."""
SIGMA_KNOT = {"point": 0.05, "rotation": 1e-4}
ROUNDS = 5


def problem_of_strips(cubic: bool, compiled: bool) -> Posed:
    """Three-line strips side by side; ``compiled`` or left to the equation in numpy."""
    random = np.random.default_rng(5)
    flights, centre, angles = _flights(cubic, random)
    point = np.column_stack(
        [
            random.uniform(0.0, SPEED * SECONDS, POINTS),
            random.uniform(-250.0, STRIPS * APART, POINTS),
            random.uniform(0.0, 80.0, POINTS),
        ]
    )
    type_ = line_scanner("mor", flights[0].order)
    seen = [_seen(type_, flight, k, centre, angles, point) for k, flight in enumerate(flights)]
    numbers = np.concatenate([np.stack(own[0]) for own in seen], axis=1)
    often = np.bincount(numbers[-1], minlength=POINTS) >= LEAST_RAYS
    kept, point = often[numbers[-1]], point[often]
    numbers[-1] = (np.cumsum(often) - 1)[numbers[-1]]
    blocks = list(numbers[:, kept])
    constants, xy = (np.concatenate([own[k] for own in seen])[kept] for k in (1, 2))
    xy += random.normal(0.0, SIGMA_IMAGE, xy.shape)
    blocks[-1] = blocks[-1] + len(centre)
    nothing = np.broadcast_to(np.int64(0), (len(xy),))
    rays = ObservationGroup(
        "lines",
        type_ if compiled else type_._replace(written="in numpy"),
        (*blocks[:-1], nothing, nothing, nothing, blocks[-1]),
        xy,
        np.full(xy.shape, SIGMA_IMAGE),
        np.column_stack([np.zeros(len(xy)), constants]),
        ((), ()),
    )
    return _posed(rays, centre, angles, point, random)


def _posed(
    rays: ObservationGroup,
    centre: FloatArray,
    angles: FloatArray,
    point: FloatArray,
    random: np.random.Generator,
) -> Posed:
    interior = INTERIORS["mor"]
    knots = len(centre)
    blocks = {
        interior.key: _blocks(interior, 1),
        "height": _blocks(HEIGHT, 1, False),
        "eccentricity": _blocks(ECCENTRICITY, 1, False),
        "rotation": _blocks(ROTATION, knots),
        "point": _blocks(POINT, knots + len(point)),
    }
    values = {
        interior.key: INTERIOR[None, :],
        "height": np.zeros((1, 1)),
        "eccentricity": np.zeros((1, 3)),
        "rotation": rotation_from_angles(angles + random.normal(0.0, SIGMA_KNOT["rotation"], angles.shape)),
        "point": np.vstack([centre, point + random.normal(0.0, 0.1, point.shape)]),
    }
    observed = [
        ObservationGroup(
            kind,
            OBSERVED_PARAMETERS[kind],
            (np.arange(knots),),
            truth + random.normal(0.0, sigma, truth.shape),
            np.full(truth.shape, sigma),
            np.zeros((knots, 0)),
            ((),),
        )
        for (kind, sigma), truth in zip(SIGMA_KNOT.items(), (centre, angles), strict=True)
    ]
    held = DatumDefinition("fixed", False, {"point": np.zeros(values["point"].shape, bool)}, {"point": values["point"]})
    return Problem(index_unknowns(blocks), (rays, *observed), (), held), values


def _flights(cubic: bool, random: np.random.Generator) -> tuple[list[Trajectory], FloatArray, FloatArray]:
    """Strips, positions and angles of all knots."""
    times = np.arange(SECONDS + 1.0)
    flights, centres = [], []
    for k in range(STRIPS):
        blocks = np.arange(len(times)) + k * len(times)
        flights.append(Trajectory(str(k), times, np.zeros(len(times), dtype=np.int64), blocks, blocks, cubic))
        centres.append(np.stack([SPEED * times, np.full(len(times), APART * k), 0.0 * times], axis=1))
    centre = np.concatenate(centres) + np.array([0.0, 0.0, FLYING_HEIGHT])
    angles = np.array([0.0, 0.0, -0.5 * np.pi]) + random.normal(0.0, 0.003, centre.shape)
    return flights, centre + random.normal(0.0, 0.3, centre.shape), angles


def _seen(
    type_: object, flight: Trajectory, number: int, centre: FloatArray, angles: FloatArray, point: FloatArray
) -> tuple[Sequence[IntArray], FloatArray, FloatArray]:
    """Blocks of knots and points, constants behind the measured x, and what is seen by one strip."""
    near = np.flatnonzero(np.abs(point[:, 1] - APART * number) < 450.0)
    of_point, line = np.repeat(near, len(LINES)), np.tile(LINES, len(near))
    time = (point[of_point, 0] - line * (FLYING_HEIGHT - point[of_point, 2]) / 100.0) / SPEED
    rotation = rotation_from_angles(angles)
    for _ in range(4):  # until the interval is the one in which the point is seen
        inside = (time > 0.5) & (time < SECONDS - 0.5)
        of_point, line, time = of_point[inside], line[inside], time[inside]
        knots, clock, _ = flight.clock(time)
        row, rate = np.zeros(len(time)), np.full(len(time), RATE)
        interior, zero = np.repeat(INTERIOR[None], len(time), axis=0), np.zeros((len(time), 1))
        at = flight.positions[knots]
        values = [
            *centre[at].swapaxes(0, 1),
            *rotation[at].swapaxes(0, 1),
            zero,
            np.zeros((len(time), 3)),
            interior,
            point[of_point],
        ]
        constants = np.column_stack([line, zero, row, rate, clock])
        xy = type_.equation(values, np.column_stack([zero, constants])).values  # type: ignore[attr-defined]
        found = time + RATE * xy[:, 1]
        if np.array_equal(flight.clock(found).knots, knots):
            break
        time = found
    inside = np.abs(xy[:, 0]) < 45.0
    at, of_point = at[inside], of_point[inside]
    return (*at.T, *at.T, of_point), constants[inside], xy[inside]


def _blocks(kind: BlockKind, count: int, free: bool = True) -> Blocks:
    owner = np.repeat(np.arange(count)[:, None], kind.size, axis=1)
    return Blocks(kind, tuple(map(str, range(count))), np.full((count, kind.size), free), owner)


def main() -> None:
    """Print a line for each block."""
    cases = {"frames": problem_of_block(aerial(20, 25))}
    for cubic in (False, True):
        for compiled in (True, False):
            name = f"{'cubic' if cubic else 'linear'}, {'compiled' if compiled else 'numpy'}"
            cases[name] = problem_of_strips(cubic, compiled)
    adjusted = [adjust(*posed) for posed in cases.values()]
    rays = np.array([len(problem.groups[0].observed) for problem, _ in cases.values()])
    seconds = np.array([[iteration(one) for one in adjusted] for _ in range(ROUNDS)]) / rays * 1e5
    ratios = np.median(seconds / seconds[:, :1], axis=0)
    for name, one, n, least, ratio in zip(cases, adjusted, rays, seconds.min(axis=0), ratios, strict=True):
        print(
            f"{name:18s} {one.outcome.value}, {n} image points, {one.problem.index.count} unknowns: "
            f"{least:.3f} s for 100 000, {ratio:.2f} times frames"
        )


if __name__ == "__main__":
    main()
