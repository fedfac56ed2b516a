"""Small networks put together by hand, with known truth.

A :class:`Scene` collects blocks with their true values and observations between them; the observed values are
the equations at the truth, plus noise where a generator is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mor.model.contract import ObservationGroup, one_name
from mor.model.images import IMAGE_TYPES, line_scanner, shutter_on_trajectory
from mor.model.observation_types import ALL_TYPES
from mor.model.parameters import KINDS, Blocks, index_unknowns, moves_by_angles
from mor.model.rotations import angles_from_rotation, rotate, rotation_from_angles
from mor.model.trajectory import CUBIC, LINEAR, on_trajectory
from mor.solve.iterate import Adjustment, Outcome, adjust
from mor.solve.problem import CorrelatedObservations, DatumDefinition, Problem
from mor.types import FloatArray

GON = np.pi / 200.0
TYPES = ALL_TYPES | {
    twin.key: twin
    for key, type_ in IMAGE_TYPES.items()
    for knots in (LINEAR, CUBIC)
    for twin in (
        on_trajectory(type_, knots),
        line_scanner(key, knots),
        shutter_on_trajectory(key, knots),
    )
}


@dataclass
class Rows:
    """Observations of one group."""

    type: str
    names: list[tuple[str, ...]] = field(default_factory=list)
    sigma: list[FloatArray] = field(default_factory=list)
    seen: list[FloatArray] = field(default_factory=list)
    constants: list[FloatArray] = field(default_factory=list)
    given: dict[int, FloatArray] = field(default_factory=dict)


@dataclass
class Scene:
    """Blocks with true values, observations, correlations."""

    truth: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    free: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    shares: dict[tuple[str, str], dict[int, str]] = field(default_factory=dict)
    by_axes: set[str] = field(default_factory=set)
    groups: dict[str, Rows] = field(default_factory=dict)
    clusters: list[tuple[list[tuple[str, int, int]], FloatArray]] = field(default_factory=list)

    def add(
        self,
        kind: str,
        name: str,
        value: Sequence[float] | FloatArray,
        free: bool | Sequence[bool] = True,
        shares: dict[int, str] | None = None,
        about_axes: bool = False,
    ) -> str:
        """Add a block; rotations as three angles or as a matrix. ``shares``: component → the block it is of."""
        true = np.asarray(value, dtype=float)
        if kind == "rotation" and true.ndim == 1:
            true = rotation_from_angles(true)
        self.truth.setdefault(kind, {})[name] = true
        self.free.setdefault(kind, {})[name] = np.broadcast_to(np.asarray(free, dtype=bool), KINDS[kind].size)
        self.shares[kind, name] = shares or {}
        if about_axes:
            self.by_axes.add(name)
        return name

    def observe(
        self,
        type_key: str,
        *names: str | None,
        sigma: float | Sequence[float],
        constants: Sequence[float] | None = None,
        only: Sequence[int] | None = None,
        group: str | None = None,
        observed: float | Sequence[float] | None = None,
    ) -> tuple[str, int]:
        """Observe; ``None`` names a fixed block with default values. Returns group and row."""
        kind = TYPES[type_key]
        rows = self.groups.setdefault(group or type_key, Rows(type_key))
        filled = (*names, *([None] * (len(kind.slots) - len(names))))
        rows.names.append(
            tuple(self._or_default(slot.kind, name) for slot, name in zip(kind.slots, filled, strict=True))
        )
        m = len(kind.components)
        rows.sigma.append(np.broadcast_to(np.asarray(sigma, dtype=float), m))
        seen = np.ones(m, dtype=bool) if only is None else np.isin(np.arange(m), only)
        rows.seen.append(seen)
        defaults = [component.default for component in kind.constants]
        rows.constants.append(np.asarray(defaults if constants is None else constants, dtype=float))
        if observed is not None:
            rows.given[len(rows.names) - 1] = np.broadcast_to(np.asarray(observed, dtype=float), m)
        return group or type_key, len(rows.names) - 1

    def correlate(self, entries: list[tuple[str, int, int]], covariance: FloatArray) -> None:
        """Give observations (group, row, component) a full covariance matrix."""
        self.clusters.append((entries, np.asarray(covariance)))

    def _or_default(self, kind: str, name: str | None) -> str:
        if name is not None:
            return name
        if "none" not in self.truth.get(kind, {}):
            values = [component.default for component in KINDS[kind].components]
            self.add(kind, "none", np.array(values), free=False)
        return "none"

    def values(self) -> dict[str, FloatArray]:
        """True values of all blocks."""
        return {kind: np.stack(list(self.truth[kind].values())) for kind in KINDS if kind in self.truth}

    def blocks(self) -> dict[str, Blocks]:
        """Blocks of every kind."""
        result = {}
        for kind, named in self.truth.items():
            ids = tuple(named)
            owner = np.repeat(np.arange(len(ids))[:, None], KINDS[kind].size, axis=1)
            for name in ids:
                for component, other in self.shares[kind, name].items():
                    owner[ids.index(name), component] = ids.index(other)
            by_axes = np.array([name in self.by_axes for name in ids]) if kind == "rotation" else None
            result[kind] = Blocks(KINDS[kind], ids, np.stack([self.free[kind][name] for name in ids]), owner, by_axes)
        return result

    def problem(
        self,
        noise: np.random.Generator | None = None,
        datum: Sequence[str] | None = None,
        axes: Sequence[bool] = (True, True, True),
        reference: FloatArray | None = None,
    ) -> Problem:
        """The adjustment problem; ``datum`` names the points that carry a free datum, ``None`` means fixed."""
        index = index_unknowns(self.blocks())
        groups = tuple(self._group(name, rows) for name, rows in self.groups.items())
        starts = np.concatenate([[0], np.cumsum([group.observed.size for group in groups])])
        names = list(self.groups)
        clusters = []
        for entries, covariance in self.clusters:
            numbers = [
                starts[names.index(g)] + row * groups[names.index(g)].observed.shape[1] + component
                for g, row, component in entries
            ]
            clusters.append(CorrelatedObservations(np.array(numbers, dtype=np.int64), covariance))
        if noise is not None:
            _make_noisy(groups, clusters, noise)
        ids = list(self.truth.get("point", {}))
        mask = np.array([[name in (datum or ()) and axis for axis in axes] for name in ids], dtype=bool)
        coordinates = self.values().get("point", np.zeros((0, 3))) if reference is None else reference
        return Problem(
            index,
            groups,
            tuple(clusters),
            DatumDefinition("by hand", datum is not None, {"point": mask.reshape(-1, 3)}, {"point": coordinates}),
        )

    def _group(self, name: str, rows: Rows) -> ObservationGroup:
        kind = TYPES[rows.type]
        ids = {key: list(self.truth[key]) for key in self.truth}
        numbers = tuple(
            np.array([ids[slot.kind].index(row[k]) for row in rows.names], dtype=np.int64)
            for k, slot in enumerate(kind.slots)
        )
        values = self.values()
        constants = np.stack(rows.constants)
        blocks = [values[slot.kind][number] for slot, number in zip(kind.slots, numbers, strict=True)]
        observed = kind.equation(blocks, constants).values.copy()
        for row, given in rows.given.items():
            observed[row] = given
        observed[~np.stack(rows.seen)] = np.nan
        references = tuple(one_name("?", len(observed)) for _ in kind.references)
        return ObservationGroup(name, kind, numbers, observed, np.stack(rows.sigma), constants, references)

    def start(self, amount: float, seed: int = 0) -> dict[str, FloatArray]:
        """True values with every free component disturbed by about ``amount``."""
        random = np.random.default_rng(seed)
        values = self.values()
        for kind, blocks in self.blocks().items():
            shift = amount * random.standard_normal(blocks.free.shape) * blocks.free
            own = np.take_along_axis(shift, blocks.owner, axis=0)
            if kind == "rotation":
                partly = moves_by_angles(blocks)
                whole = rotate(values[kind], own)
                by_angles = rotation_from_angles(angles_from_rotation(values[kind]) + own)
                values[kind] = np.where(partly[:, None, None], by_angles, whole)
            else:
                values[kind] = values[kind] + own
        return values

    def number(self, kind: str, name: str) -> int:
        """Number of a block among its kind."""
        return list(self.truth[kind]).index(name)


def _make_noisy(
    groups: Sequence[ObservationGroup], clusters: Sequence[CorrelatedObservations], noise: np.random.Generator
) -> None:
    starts = np.concatenate([[0], np.cumsum([group.observed.size for group in groups])])
    flat = np.concatenate([(group.sigma * noise.standard_normal(group.sigma.shape)).ravel() for group in groups])
    for cluster in clusters:
        lower = np.linalg.cholesky(cluster.covariance)
        flat[cluster.entries] = lower @ noise.standard_normal(len(lower))
    for group, first in zip(groups, starts, strict=False):
        group.observed[...] += flat[first : first + group.observed.size].reshape(group.observed.shape)


def solve(
    scene: Scene,
    noise: np.random.Generator | None = None,
    datum: Sequence[str] | None = None,
    disturbed: float = 1e-2,
    **options: object,
) -> Adjustment:
    """Adjust from disturbed truth and insist on convergence."""
    problem = scene.problem(noise, datum, **options)  # type: ignore[arg-type]
    adjustment = adjust(problem, scene.start(disturbed))
    assert adjustment.outcome is Outcome.CONVERGED, (adjustment.outcome, adjustment.reason, adjustment.defect)
    return adjustment


def coordinates(adjustment: Adjustment, names: Sequence[str]) -> FloatArray:
    """Adjusted coordinates (n, 3) of points by name."""
    ids = adjustment.problem.index.blocks["point"].ids
    return adjustment.values["point"][[ids.index(name) for name in names]]


def looking_at(position: Sequence[float], target: Sequence[float], roll: float = 0.0) -> FloatArray:
    """Rotation of a camera at ``position`` that looks at ``target`` (along its −z)."""
    backwards = np.asarray(position, float) - np.asarray(target, float)
    backwards /= np.linalg.norm(backwards)
    right = np.cross([0.0, 0.0, 1.0], backwards)
    right /= np.linalg.norm(right)
    up = np.cross(backwards, right)
    turn = np.array([[np.cos(roll), np.sin(roll), 0.0], [-np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    return turn @ np.stack([right, up, backwards])


OBJECT_POINTS = np.array(
    [[x, y, z] for x in (0.0, 2.0, 4.1) for y in (0.3, 3.2) for z in (-0.4, 1.9)]
) + 0.2 * np.random.default_rng(17).standard_normal((12, 3))

CAMERA_STATIONS = np.array([[-4.0, -6.0, 1.2], [2.0, -8.5, 3.0], [8.5, -5.0, 0.4], [9.0, 8.0, 2.5], [1.0, 10.0, 1.0]])


def add_object_points(scene: Scene, free: bool = True) -> list[str]:
    """Twelve points of an object some metres in size."""
    return [scene.add("point", f"P{i}", xyz, free=free) for i, xyz in enumerate(OBJECT_POINTS)]


def add_image(scene: Scene, name: str, position: Sequence[float], points: Sequence[str], **extra: object) -> None:
    """An image of a camera without distortion, c = 20, position ``name`` and rotation ``name``."""
    scene.add("point", name, position)
    scene.add("rotation", name, looking_at(position, OBJECT_POINTS.mean(axis=0), roll=0.3 * len(name)))
    if "camera" not in scene.truth.get("interior/mor", {}):
        scene.add("interior/mor", "camera", [20.0, *[0.0] * 9], free=False)
    for point in points:
        scene.observe("image/mor", name, name, None, None, "camera", point, sigma=1e-3, **extra)  # type: ignore[arg-type]


def photo_block(scale_bar: bool = False) -> tuple[Scene, list[str]]:
    """Five images of twelve points, nothing else known; with or without a scale bar."""
    scene = Scene()
    points = add_object_points(scene)
    for number, position in enumerate(CAMERA_STATIONS):
        add_image(scene, f"I{number}", position, points)
    if scale_bar:
        scene.observe("distance", "P0", None, "P10", None, sigma=1e-4)
    return scene, points


PLANE_POINTS = np.array([[0.0, 0.0], [60.0, 5.0], [110.0, 70.0], [20.0, 90.0], [55.0, 45.0]])


def plane_network(
    distances: bool = True, directions: bool = False, fixed: Sequence[str] = ()
) -> tuple[Scene, list[str]]:
    """Five points in the plane (z fixed), every pair measured from both ends."""
    scene = Scene()
    names = [
        scene.add("point", f"N{i}", [x, y, 0.0], free=(f"N{i}" not in fixed,) * 2 + (False,))
        for i, (x, y) in enumerate(PLANE_POINTS)
    ]
    for i, start in enumerate(names):
        if directions:
            scene.add("rotation", start, [0.0, 0.0, 0.4 * i], free=(False, False, True))
        for end in names:
            if end == start:
                continue
            if distances and start < end:
                scene.observe("horizontal_distance", start, None, end, None, sigma=2e-3)
            if directions:
                scene.observe("directions", start, start, None, end, sigma=1e-5, only=(0,))
    return scene, names


def levelling_network() -> tuple[Scene, list[str]]:
    """Four bench marks (x, y fixed) in five height differences."""
    scene = Scene()
    heights = [10.0, 12.5, 11.1, 14.2]
    places = [[0.0, 0.0], [40.0, 3.0], [35.0, 50.0], [-4.0, 44.0]]
    names = [scene.add("point", f"B{i}", [*places[i], heights[i]], free=(False, False, True)) for i in range(4)]
    for one, other in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2)):
        scene.observe("height_difference", names[one], None, names[other], None, sigma=1e-3)
    return scene, names


def mixed_network() -> tuple[Scene, list[str]]:
    """Images, two levelled theodolites, distances, levelling and a vector with covariance; two fixed points."""
    scene = Scene()
    points = add_object_points(scene)
    scene.free["point"]["P0"] = np.zeros(3, dtype=bool)
    scene.free["point"]["P9"] = np.array([False, False, True])
    for number in (0, 1, 2, 4):
        add_image(scene, f"I{number}", CAMERA_STATIONS[number], points[:10])
    scene.add("refraction", "air", [0.13], free=False)
    scene.add("distance meter", "meter", [1.0, 0.012], free=(False, True))
    for station, xyz in (("S1", [-3.0, -5.0, 0.1]), ("S2", [8.0, -4.0, -0.2])):
        scene.add("point", station, xyz)
        scene.add("rotation", station, [0.0, 0.0, 1.7], free=(False, False, True))
        scene.add("height", station, [1.55], free=False)
        for number, point in enumerate(points):
            face = 1.0 + number % 2
            scene.observe(
                "zenith_directions",
                *(station, station, station, point, None, "air"),
                sigma=(2e-5, 3e-5),
                constants=(6_371_000.0, face),
            )
            scene.observe("distance", station, station, point, None, "meter", sigma=1e-3)
    scene.observe("height_difference", "P1", None, "P3", None, sigma=5e-4)
    group, row = scene.observe("vector", "P2", None, "P11", None, sigma=1e-3)
    factor = np.array([[1.0, 0.0, 0.0], [0.6, 0.9, 0.0], [-0.4, 0.3, 1.4]]) * 1e-3
    scene.correlate([(group, row, component) for component in range(3)], factor @ factor.T)
    return scene, points
