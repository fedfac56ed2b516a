"""Parts of a network with a coordinate system of their own, and the images to be oriented."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mor.errors import Placeholder, UndeterminedObject
from mor.model.cameras import CAMERA_MODELS, CameraModel
from mor.model.contract import ObservationGroup, names_of
from mor.model.images import is_image_point
from mor.project.network import Network
from mor.project.prior_knowledge import farthest_from_line, feature_label, turned_towards
from mor.start.bundle import Similarity, ideal_rays
from mor.start.sights import DirectionSet, Terrestrial, direction_sets, frame_verticals, polar_rays
from mor.types import BoolArray, FloatArray, IntArray

# ---- How a value was obtained, as a sentence with its names and numbers, which a report may say in another language.


class Phrase(NamedTuple):
    """An English sentence with places, and what stands in them: names of things ("image I1") and numbers."""

    words: str
    values: Mapping[str, str | int | float]

    def __str__(self) -> str:
        return self.words.format(**{name: Placeholder(value) for name, value in self.values.items()})


def rule(words: str, /, **values: str | int | float) -> Phrase:
    """A rule, its values by the names of their places."""
    return Phrase(words, values)


# ---- What a part was when it joined another one: what was in it, what it knew of its place, and what tied the two.


class Tie(NamedTuple):
    """The movement that carried a part into another one."""

    open: int
    """Movements that nothing determined; they stayed as they were."""
    redundancy: int
    misfit: float
    """Root mean square of the residuals, in parts of the size of what the two had in common."""
    alternatives: int
    """Other movements that fitted as well."""


class Join(NamedTuple):
    """A part, as it was when it became a part of another one."""

    number: int
    began: Phrase
    into: int
    """Number of the part it joined; 0 is the object system."""
    points: IntArray
    """Blocks of the points it knew in any coordinate."""
    frames: tuple[int, ...]
    sights: tuple[int, ...]
    levelled: bool
    oriented: bool
    scaled: bool
    tie: Tie | None
    """``None`` where nothing tied the two: it stayed where it was."""


# ---- What the strategy works with: frames with their rays, horizontal sets, distances and height differences.
#
# Images and full theodolite bundles are the same thing here: a frame with unit rays towards points.

SLACKS = (0.0, 5e-4, 2e-3, 8e-3)
"""Radians by which rays may be off beside their own σ, tried in this order: distortion not yet known, a rough c."""


class Frame(NamedTuple):
    """A frame whose pose is wanted: blocks that hold it, and its rays."""

    name: str
    position: int
    rotation: int
    height: int
    eccentricity: int
    relative: tuple[int, int] | None
    """Blocks (rotation, base) of the relative orientation of a stereo follower."""
    points: IntArray
    """(n,) point blocks its rays go to."""
    heights: FloatArray
    """(n,) heights of the targets above their points."""
    rays: FloatArray
    """(n, 3) unit vectors in the axes of the frame."""
    sigma: FloatArray
    """(n,) radians."""
    offset: FloatArray
    """(4,) height of the rotation centre and eccentricity r0*, 0 where not known."""
    up: FloatArray
    """(3,) the vertical in the axes of the frame, NaN where it is not known."""

    @property
    def stands(self) -> bool:
        """True where ``position`` is its own; that of a stereo follower is the position of its leader."""
        return self.relative is None


def given_pose(network: Network, frame: Frame) -> tuple[FloatArray, FloatArray] | None:
    """Projection centre O = X0 + h e_Z − Dᵀ r0* and D that the project gives; of a follower those of its leader."""
    start = network.start
    D, position = start["rotation"][frame.rotation], start["point"][frame.position]
    if not (np.isfinite(D).all() and np.isfinite(position).all()):
        return None
    lift = np.array([0.0, 0.0, float(start["height"][frame.height, 0])])
    return position + lift - D.T @ start["eccentricity"][frame.eccentricity], D


def loosened(sigma: FloatArray, slack: float) -> FloatArray:
    """σ of rays that may be off by a slack besides."""
    return np.hypot(sigma, slack)


class _ImageRays(NamedTuple):
    """Rays of images, image after image."""

    image: IntArray
    point: IntArray
    rays: FloatArray
    sigma: FloatArray

    def take(self, chosen: IntArray | BoolArray | slice) -> _ImageRays:
        return _ImageRays._make(array[chosen] for array in self)


def image_frames(network: Network) -> list[Frame]:
    """Frames of all images that have measured points; their arrays are parts of common ones."""
    groups = [group for group in network.groups if is_image_point(group.type)]
    if not groups:
        return []
    keys, owners = np.unique(_pose_key(network, network.things["image"].parts), return_index=True)
    found = [_measured_rays(network, group, owners, keys) for group in groups]
    together = _ImageRays(*(np.concatenate(columns) for columns in zip(*found, strict=True)))
    if (np.diff(together.image) < 0).any():
        together = together.take(np.argsort(together.image, kind="stable"))
    cuts = np.flatnonzero(np.diff(together.image)) + 1
    edges = np.concatenate([[0], cuts, [len(together.image)]])
    up = frame_verticals(network)
    return [
        _image_frame(network, together.take(slice(start, end)), up)
        for start, end in pairwise(edges.tolist())
        if end > start
    ]


def _pose_key(network: Network, blocks: Mapping[str, IntArray]) -> IntArray:
    """One number (n,) for the blocks that hold a pose: images of one pose are one frame."""
    rotations = len(network.blocks["rotation"].ids) + 1
    relative = blocks.get("relative rotation", np.full(len(blocks["rotation"]), -1))
    key: IntArray = (blocks["position"] * rotations + blocks["rotation"]) * rotations + relative + 1
    return key


def _measured_rays(network: Network, group: ObservationGroup, owners: IntArray, keys: IntArray) -> _ImageRays:
    slots = zip(group.type.slots, group.blocks, strict=True)
    blocks = {slot.part: numbers.astype(np.int64) for slot, numbers in slots if slot.of == "image"}
    rays, sigma = _image_rays(network, group, CAMERA_MODELS[group.type.key.partition("/")[2]])
    image = owners[np.searchsorted(keys, _pose_key(network, blocks))]
    point = group.blocks[-1].astype(np.int64)
    found, whole = _ImageRays(image, point, rays, sigma), np.asarray(group.mask.all(axis=1))
    return found if whole.all() else found.take(whole)


def _image_frame(network: Network, rays: _ImageRays, up: FloatArray) -> Frame:
    images = network.things["image"]
    number = int(rays.image[0])
    blocks = {part: int(numbers[number]) for part, numbers in images.parts.items()}
    return Frame(
        name=f"image {images.ids[number]}",
        position=blocks["position"],
        rotation=blocks["rotation"],
        height=blocks["height"],
        eccentricity=blocks["eccentricity"],
        relative=None if blocks["base"] < 0 else (blocks["relative rotation"], blocks["base"]),
        points=rays.point,
        heights=np.zeros(len(rays.point)),
        rays=rays.rays,
        sigma=rays.sigma,
        offset=_offset(network, blocks["height"], blocks["eccentricity"]),
        up=up[blocks["rotation"]] if blocks["base"] < 0 else np.full(3, np.nan),
    )


def _offset(network: Network, height: int, eccentricity: int) -> FloatArray:
    start = network.start
    offset: FloatArray = np.nan_to_num(np.concatenate([start["height"][height], start["eccentricity"][eccentricity]]))
    return offset


def _image_rays(network: Network, group: ObservationGroup, model: CameraModel) -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) of measured image coordinates, distortion taken off as far as it is known, and σ in radians."""
    slot = next(k for k, slot in enumerate(group.type.slots) if slot.part == "interior")
    interior, of = network.start[group.type.slots[slot].kind], group.blocks[slot]
    rays = ideal_rays(model, interior, of, group.constants[:, 2:], group.observed)
    sigma = np.fmax(*group.sigma.T) / np.maximum(np.abs(interior[of, 0]), 1e-300)
    return rays, 3.0 * sigma


def theodolite_frames(network: Network) -> list[Frame]:
    """Frames of theodolite sets, of the targets with both directions."""
    frames = []
    up = frame_verticals(network)
    for one in direction_sets(network):
        both = np.isfinite(one.directions) & np.isfinite(one.verticals)
        if both.any():
            frames.append(
                Frame(
                    name=one.name,
                    position=one.position,
                    rotation=one.rotation,
                    height=one.height_block,
                    eccentricity=0,
                    relative=None,
                    points=one.points[both],
                    heights=one.heights[both],
                    rays=polar_rays(one.directions[both], one.verticals[both]),
                    sigma=np.hypot(3.0 * one.sigma[both], 1e-5),
                    offset=_offset(network, one.height_block, 0),
                    up=up[one.rotation],
                )
            )
    return frames


# ---- All rays of all frames in flat arrays, findable by frame and by point; targets above their points.
#
# Heights act along the vertical and in the length unit. A part without either uses the rays to one height
# above every point, the one that most rays go to: there a point stands for its target. As soon as it has
# both, its points come down.


class Sightings(NamedTuple):
    """Rays, point after point, those of a point in the order of their frames."""

    frame: IntArray
    """(n,)"""
    point: IntArray
    """(n,)"""
    rays: FloatArray
    """(n, 3) in the axes of the frame."""
    sigma: FloatArray
    height: FloatArray
    pointers: IntArray
    """(points+1,) the rays of point p are those from ``pointers[p]`` to ``pointers[p+1]``."""
    frames: int

    def of_points(self, points: IntArray) -> IntArray:
        """Numbers of all rays to some points."""
        starts, lengths = self.pointers[points], self.pointers[points + 1] - self.pointers[points]
        total = int(lengths.sum())
        offsets = np.repeat(starts - np.concatenate([[0], np.cumsum(lengths)[:-1]]), lengths)
        return np.asarray(offsets + np.arange(total))


def sightings(frames: Sequence[Frame], points: int) -> Sightings:
    """Flat arrays of the rays of frames to ``points`` point blocks."""
    none = np.zeros(0, dtype=np.int64)
    point = np.concatenate([none, *(frame.points for frame in frames)])
    order = np.argsort(point, kind="stable")
    counts = np.bincount(point, minlength=points)
    return Sightings(
        np.repeat(np.arange(len(frames)), [len(frame.points) for frame in frames])[order],
        point[order],
        np.concatenate([np.zeros((0, 3)), *(frame.rays for frame in frames)])[order],
        np.concatenate([np.zeros(0), *(frame.sigma for frame in frames)])[order],
        np.concatenate([np.zeros(0), *(frame.heights for frame in frames)])[order],
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        len(frames),
    )


def target_heights(frames: Sequence[Frame], points: int, marks: IntArray) -> FloatArray:
    """(points,) height above each point that most rays go to; 0 for ``marks``, which are measured themselves."""
    point = np.concatenate([np.zeros(0, dtype=np.int64), *(frame.points for frame in frames)])
    height = np.concatenate([np.zeros(0), *(frame.heights for frame in frames)])
    found = np.zeros(points)
    if not height.any():
        return found
    order = np.lexsort((height, point))
    point, height = point[order], height[order]
    fresh = np.append(True, (np.diff(point) != 0) | (np.diff(height) != 0.0))
    first = np.flatnonzero(fresh)
    count = np.diff(np.append(first, len(point)))
    for k in np.argsort(count, kind="stable").tolist():
        found[point[first[k]]] = height[first[k]]
    found[marks] = 0.0
    return found


def bare_frames(frames: Sequence[Frame], heights: FloatArray) -> tuple[Frame, ...]:
    """The frames with the rays to the targets at ``heights`` (points,) alone, as if these were the points."""
    bare = []
    for frame in frames:
        kept = frame.heights == heights[frame.points]
        none = np.zeros(int(kept.sum()))
        bare.append(
            frame._replace(points=frame.points[kept], heights=none, rays=frame.rays[kept], sigma=frame.sigma[kept])
        )
    return tuple(bare)


# ---- A part of the network in one coordinate system: what is known of points and frames so far.


@dataclass(eq=False)
class Part:
    """Known coordinates and poses in one system, and how each came about."""

    points: FloatArray
    """(point blocks, 3) coordinates, NaN where not known."""
    poses: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    """Frame number → (projection centre, rotation D)."""
    kappas: dict[int, float] = field(default_factory=dict)
    """Sight number → κ of a levelled set."""
    how: dict[str, Phrase] = field(default_factory=dict)
    """Name → how it was obtained."""
    posed_again: dict[int, int] = field(default_factory=dict)
    """Frame number → how many of its points were known when its pose was last tested."""
    levelled: bool = False
    """True where the Z axis is the vertical."""
    oriented: bool = False
    """True where the Y axis is north, so that bearings orient."""
    scaled: bool = False
    """True where lengths are in the length unit."""
    slack: float = 0.0
    """Radians that rays are allowed beside their σ."""
    seen_by: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(point blocks,) a posed frame that sees the point, −1 where there is none."""
    fixed: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """(point blocks,) true where coordinates were given: they are not worked out again."""
    sigma: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """(point blocks, 3) σ of given coordinates that were observed, NaN elsewhere."""
    given: bool = False
    """True for the object system: it is where the project says, and what joins it comes to it."""
    handed: bool = True
    """False where it may be mirrored: distances alone do not tell."""
    number: int = 0
    """0 is the object system, others count as they begin."""
    began: Phrase = field(default_factory=lambda: rule("what is given"))
    """What it began with."""
    joined: list[Join] = field(default_factory=list)
    """The parts it took up, in the order in which they joined it or one another."""
    placed: set[int] = field(default_factory=set)
    """Points placed one at a time: what takes such a place away again does not have it placed again."""
    asked_for_ties: dict[tuple[int, int], int] = field(default_factory=dict)
    """Part and redundancy with which all observations were asked for the movement to it → observations there were."""
    place_sigma: float = 0.0
    """σ with which given positions of frames were found to agree with the rays; counts where they have none."""

    @property
    def lifts(self) -> bool:
        """True where heights of instruments and targets count: they act along the vertical, in the length unit."""
        return self.levelled and self.scaled

    @property
    def rank(self) -> tuple[bool, bool, bool, bool, int]:
        """Rank of a part by its knowledge of its place."""
        return self.given, self.oriented, self.levelled, self.scaled, self.size

    @property
    def size(self) -> int:
        """Number of poses, orientations and coordinates in it."""
        return len(self.poses) + len(self.kappas) + int(np.isfinite(self.points).sum())

    def known(self, points: IntArray) -> BoolArray:
        """(n,) true where all three coordinates are known."""
        # Whatever is not finite shows in the sum, and that is twice as fast.
        return np.asarray(np.isfinite(self.points.take(points, axis=0) @ np.ones(3)))

    def lower_to_marks(self, heights: FloatArray, which: BoolArray | None = None) -> None:
        """Bring points (all, or ``which``) from their targets down to the marks, by ``heights`` (point blocks,)."""
        loose = ~self.fixed if which is None else which & ~self.fixed
        self.points[loose, 2] -= heights[loose]

    def transform(self, similarity: Similarity) -> None:
        """Carry everything over into another system."""
        s, R, t = similarity.scale, similarity.rotation, similarity.translation
        if R[2, 2] == 1.0:
            # Apart from each other: where the height is not known, the plan still is, and the other way round.
            plan, height = self.points[:, :2] @ R[:2, :2].T, self.points[:, 2:]
            self.points = s * np.concatenate([plan, height], axis=1) + t
        else:
            self.points = s * self.points @ R.T + t
        self.poses = {number: (s * R @ centre + t, D @ R.T) for number, (centre, D) in self.poses.items()}
        turn = np.arctan2(R[0, 1], R[0, 0])
        self.kappas = {number: kappa - turn for number, kappa in self.kappas.items()}


def misses(part: Part, frame: Frame, centre: FloatArray, D: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Rays (n,) of a frame to known points, and how far (k,) at a pose their unit vectors are off these points."""
    known = part.known(frame.points)
    star = (part.points[frame.points[known]] + np.outer(frame.heights[known], [0.0, 0.0, 1.0]) - centre) @ D.T
    star /= np.maximum(np.linalg.norm(star, axis=1, keepdims=True), 1e-300)
    return known, np.linalg.norm(star - frame.rays[known], axis=1)


def empty_part(points: int) -> Part:
    """A part of which nothing is known."""
    return Part(
        np.full((points, 3), np.nan),
        seen_by=np.full(points, -1, dtype=np.int64),
        fixed=np.zeros(points, dtype=bool),
        sigma=np.full((points, 3), np.nan),
    )


# ---- Horizontal distances and vertical directions between positions, ready for look-ups.


class Distances:
    """Horizontal distances between two positions, as far as they are measured or follow from slope and vertical.

    Where the part is not ``scaled`` there are none, and heights of instruments and targets do not count.
    """

    def __init__(self, measured: Terrestrial, scaled: bool):
        self.horizontal: dict[tuple[int, int], float] = {}
        self.slope: dict[tuple[int, int], tuple[float, float]] = {}
        self.neighbours: dict[int, set[int]] = {}
        self.sigma: dict[tuple[int, int], float] = {}
        """By the two ends, the smaller number first."""
        v = measured.verticals
        rows = [*zip(v.start, v.end, v.value[:, 0], v.start_height - v.end_height, strict=True)]
        for sight in measured.sights:
            for b, hb, value in zip(sight.points, sight.heights, sight.verticals, strict=True):
                rows += [(sight.position, b, value, sight.height - hb)] if np.isfinite(value) else []
        # Heights of instrument and target count only in the length unit.
        self.vertical = {(int(a), int(b)): (float(value), float(rise) * scaled) for a, b, value, rise in rows}
        self.ends = np.array(list(self.vertical), dtype=np.int64).reshape(-1, 2)
        steep = np.array(list(self.vertical.values())).reshape(-1, 2)
        self.tangents, self.rises = np.tan(steep[:, 0]), steep[:, 1]
        for lengths in (measured.horizontals, measured.slopes) if scaled else ():
            rises = lengths.start_height - lengths.end_height
            for a, b, s, rise, sigma in zip(
                *(one.tolist() for one in (lengths.start, lengths.end, lengths.value[:, 0], rises, lengths.sigma)),
                strict=True,
            ):
                self.sigma[min(a, b), max(a, b)] = sigma
                self.neighbours.setdefault(a, set()).add(b)
                self.neighbours.setdefault(b, set()).add(a)
                if lengths is measured.slopes:
                    self.slope[a, b], self.slope[b, a] = (s, rise), (s, -rise)
                else:
                    self.horizontal[a, b] = self.horizontal[b, a] = s

    def verticals_at(self, point: int) -> list[tuple[int, bool, float, float]]:
        """Other end, whether it was measured there, vertical direction and rise, of all sights from and to a point."""
        found = []
        for row in np.flatnonzero((self.ends == point).any(axis=1)).tolist():
            a, b = self.ends[row].tolist()
            found.append((a if b == point else b, b == point, *self.vertical[a, b]))
        return found

    def between(self, part: Part, a: int, b: int) -> float:
        """Horizontal distance from a to b, NaN where it is not known."""
        if (a, b) in self.horizontal:
            return self.horizontal[a, b]
        if (a, b) not in self.slope:
            return float("nan")
        slope, rise = self.slope[a, b]
        for one, other in ((a, b), (b, a)):
            if (one, other) in self.vertical:
                return slope * float(np.cos(self.vertical[one, other][0]))
        dz = part.points[b, 2] - part.points[a, 2] - rise
        if np.isfinite(dz):
            return float(np.sqrt(max(slope**2 - dz**2, 0.0)))
        return float("nan")


# ---- Lines whose points had no coordinates on reading: which point beside them carries their turn.


def with_lines_turned(network: Network, start: Mapping[str, FloatArray]) -> tuple[Network, Mapping[str, FloatArray]]:
    """Lines whose points had no coordinates on reading get the farthest point to carry their turn, and turn to it."""
    if not any(feature.type == "line" for feature in network.project.features):
        return network, start
    rotations = start["rotation"].copy()
    positions = network.things["point"].parts["position"]
    groups = list(network.groups)
    for number, group in enumerate(groups):
        if not _has_carrier(group, network) or np.isfinite(network.start["point"][group.blocks[4]]).all():
            continue
        members = start["point"][group.blocks[4][:-1]]
        known = np.isfinite(members).all(axis=1)
        centre = members[known].mean(axis=0) if known.any() else np.zeros(3)
        D = rotations[rotation := int(group.blocks[1][0])]
        farthest = farthest_from_line(start["point"][positions], D, centre)
        if farthest >= 0:
            beside = np.append(group.blocks[4][:-1], positions[farthest])
            names = names_of([*list(group.references[1])[:-1], network.things["point"].ids[farthest]])
            groups[number] = replace(group, blocks=(*group.blocks[:4], beside), references=(group.references[0], names))
            rotations[rotation] = turned_towards(start["point"][positions[farthest]] - centre, D)
    return replace(network, groups=tuple(groups)), {**start, "rotation": rotations}


def _has_carrier(group: ObservationGroup, network: Network) -> bool:
    """True for the group of a line with a point beside it that carries its turn."""
    lines = {feature_label(feature) for feature in network.project.features if feature.type == "line"}
    return group.name in lines and group.type.key == "local" and bool(np.isnan(group.observed[-1, 0]))


# ---- What the start values of a network are, and how they came about.


class Approximation(NamedTuple):
    """Start values, how each was obtained, and what is still missing."""

    start: Mapping[str, FloatArray]
    how: Mapping[str, Phrase]
    """Name of a point, image or station → how its start value was obtained."""
    missing: tuple[UndeterminedObject, ...]
    """What has no start value yet, and why."""
    remarks: tuple[Phrase, ...] = ()
    """Why frames could not begin a part of their own, where something is missing."""
    replaced: tuple[str, ...] = ()
    """Given start values that the observations contradict, which others took the place of."""
    parts: tuple[Join, ...] = ()
    """The parts that began beside the object system, in the order in which they joined another one."""
    frames: tuple[Frame, ...] = ()
    """Images and theodolite sets by the numbers they have in ``parts``."""
    sights: tuple[DirectionSet, ...] = ()
    """Levelled sets by the numbers they have in ``parts``."""
    untied: tuple[Join, ...] = ()
    """Parts that lie where they do because nothing was found that ties them, or not in all movements."""


def untied(parts: tuple[Join, ...], given: bool) -> tuple[Join, ...]:
    """Parts that joined the object system without a tie; the first one became it if nothing was ``given``."""
    into = [join for join in parts if join.into == 0]
    return tuple(join for join in into[0 if given else 1 :] if join.tie is None or join.tie.open)
