"""Find approximate values of a whole network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from mor.model import rotations as tolerant
from mor.model.contract import ObservationGroup, ObservationType, some_rows
from mor.model.coordinates import OBSERVED_PARAMETERS
from mor.model.earth import Horizon
from mor.model.geodetic import in_object_axes
from mor.model.observation_types import PLAIN_TYPES, PROJECTION_CENTRE_TYPES
from mor.model.parameters import all_known
from mor.model.rotations import exponential, rotation_from_angles
from mor.project.network import Network
from mor.start.along_trajectories import at_all_times, seen_along_trajectories, standing_still, without_trajectories
from mor.start.bundle import unit
from mor.start.join import (
    Contradiction,
    carry,
    contradicting_frames,
    contradicting_points,
    fill_in,
    free_movements,
    join,
    lay_upon,
    open_movements,
    put_back,
    put_rotation,
    spread_positions,
    starting_part,
    tie,
    tied_by_positions,
    with_observed,
    without,
)
from mor.start.join_by_observations import tie_by_observations
from mor.start.levelled import (
    begin_heights,
    grow_arcs,
    grow_levelled,
    grow_single_points,
    place_as_if_level,
    seed_distances,
    stand_level_with_sights,
)
from mor.start.local_adjustment import (
    ENOUGH,
    FEWEST,
    grow_bundles,
    grow_polar,
    intersect_the_rest,
    pose_the_rest,
    rigid_seeds,
    seed_polar,
)
from mor.start.movement import FreeRotation, Movement
from mor.start.part import Approximation, Frame, Part, Phrase, rule, untied
from mor.start.points_at_infinity import nearly_parallel
from mor.start.pose_again import pose_again
from mor.start.scene import (
    Scene,
    direct_roughly,
    grow_relative,
    level_and_scale,
    level_roughly,
    scene_of,
)
from mor.start.seeds import FramePairs, common_pairs, seed_bundles, seed_doubtful, seed_levelled, seed_plan
from mor.start.sights import ROWS, SMALLER, SOUND, TRIES, Choices, Judgement, disagreement, likeliest
from mor.types import BoolArray, FloatArray

SettleNetwork = Callable[[Mapping[str, FloatArray]], tuple[Mapping[str, FloatArray], float] | None]
"""Adjusts start values: the values they lead to and v'Pv (infinite: singular), or ``None`` where they lead nowhere."""


# ---- The parts there are, the object system first, and what was tried.


@dataclass
class Assembly:
    """Parts on their way to one system, the object system first, and what was tried."""

    network: Network
    scene: Scene
    parts: list[Part]
    fewest: int = ENOUGH
    tried_stations: set[int] = field(default_factory=set)
    tried_shapes: set[tuple[int, ...]] = field(default_factory=set)
    tried_frames: set[frozenset[int]] = field(default_factory=set)
    """Frames that parts began with: what joined and lost its poses again would begin for ever."""
    given_up: BoolArray = field(default_factory=lambda: np.zeros((3, 0), dtype=bool))
    """(3, frames) of which no two, or none with a neighbour in a part, can be oriented relative to each other; those
    that a doubtful orientation was tried of."""
    pairs: FramePairs | None = None
    reasons: list[Phrase] = field(default_factory=list)
    doubtful: int = 0
    """How often a part began with a doubtful pair, or none of the pairs tried led to one."""
    begun: int = 0
    """Parts that have begun so far, the object system aside."""


# ---- A part grows by everything it can, in turns.


def grow(part: Part, scene: Scene, fewest: int, most: int | None = None) -> bool:
    """Growth of every kind in turns, until none adds anything; false where ``most`` frames made it pause."""
    before = len(part.poses)
    # By distances alone: directions would accept a mirrored shape.
    while not part.handed and (
        grow_arcs(part, scene.distances[1]) if part.levelled else grow_single_points(part, scene)
    ):
        pass
    while part.handed:
        grown = level_and_scale(part, scene)
        grown |= part.levelled and grow_levelled(part, scene.terrestrial, scene.distances[int(part.scaled)])
        _sets_and_poses(part, scene)
        grown |= grow_polar(part, scene)
        grown |= grow_relative(part, scene)
        grown |= grow_bundles(part, *scene.rays_for(part), fewest, most)
        grown = grown or grow_single_points(part, scene)
        grown = grown or pose_again(part, scene)
        spread_positions(part, scene.frames)
        if not grown:
            return True
        if most is not None and len(part.poses) - before >= most:
            return False
    return True


def _sets_and_poses(part: Part, scene: Scene) -> None:
    """Oriented levelled sets are frames too, and frames that stand upright are oriented sets."""
    if not part.levelled:
        return
    by_rotation = {frame.rotation: n for n, frame in enumerate(scene.frames) if n >= scene.image_count}
    for number, sight in enumerate(scene.terrestrial.sights):
        frame = by_rotation.get(sight.rotation)
        if frame is None or (number in part.kappas) == (frame in part.poses):
            continue
        if frame in part.poses:
            D = part.poses[frame][1]
            part.kappas[number] = float(np.arctan2(D[0, 1], D[0, 0]))
        elif np.isfinite(part.points[sight.position]).all():
            lift = sight.height if part.scaled else 0.0
            turn = rotation_from_angles(np.array([[0.0, 0.0, part.kappas[number]]]))[0]
            part.poses[frame] = (part.points[sight.position] + [0.0, 0.0, lift], turn)


# ---- What a part begins with, of what no part knows yet.


def next_seed(assembly: Assembly) -> Part | None:
    """A part of its own for something that no part knows yet."""
    scene, measured = assembly.scene, assembly.scene.terrestrial
    unknown, tried = _unknown_stations(assembly), assembly.tried_stations
    part = seed_levelled(measured, unknown, scene.points, tried, with_distances=True)
    if part is not None:
        return part
    posed = [number for one in assembly.parts for number in one.poses]
    free = ~np.isin(np.arange(len(scene.frames)), posed)
    for chained in (False, True):
        part = _seed_of_frames(assembly, free, chained)
        if part is not None:
            return part
    fresh = [n for n in range(scene.image_count, len(free)) if free[n]]
    part = seed_polar(scene, [n for n in fresh if frozenset([n]) not in assembly.tried_frames])
    assembly.tried_frames |= {frozenset(part.poses)} if part else set()
    part = part or seed_levelled(measured, unknown, scene.points, tried, with_distances=False)
    if part is None:
        part, reason = seed_plan(measured, unknown, scene.points, tried)
        assembly.reasons += [reason] if reason else []
    part = part or seed_distances(scene, assembly.parts[0], _known_points(assembly), assembly.tried_shapes)
    return part or _doubtful_seed(assembly, free)


def _doubtful_seed(assembly: Assembly, free: BoolArray) -> Part | None:
    """A part of two frames whose orientation is in doubt, where nothing else is left."""
    scene = assembly.scene
    open_ = free & ~assembly.given_up[2]
    # Searches for a doubtful pair: each grows a part from every orientation of up to eight pairs.
    if assembly.fewest > FEWEST or np.count_nonzero(open_) < 2 or assembly.doubtful == 4:
        return None
    assembly.doubtful += 1
    assembly.pairs = pairs = common_pairs(scene.bare[1]) if assembly.pairs is None else assembly.pairs
    among = np.flatnonzero(open_[pairs.first] & open_[pairs.second])
    part = seed_doubtful(scene, among, pairs, lambda part, most: grow(part, scene, FEWEST, most))
    assembly.given_up[2] |= open_ if part is None else np.isin(np.arange(len(open_)), list(part.poses))
    return part


def _seed_of_frames(assembly: Assembly, free: BoolArray, chained: bool) -> Part | None:
    scene, given_up = assembly.scene, assembly.given_up[int(chained)]
    open_ = free & ~given_up
    if np.count_nonzero(open_) < (1 if chained else 2):
        return None
    assembly.pairs = pairs = common_pairs(scene.bare[1]) if assembly.pairs is None else assembly.pairs
    if chained:
        among = (open_[pairs.first] & ~free[pairs.second]) | (open_[pairs.second] & ~free[pairs.first])
    else:
        among = open_[pairs.first] & open_[pairs.second]
    bare, rows = scene.bare[0], np.flatnonzero(among)
    part, reason = seed_bundles(bare, rows, pairs, scene.points)
    asks = part is not None and assembly.network.observations <= ROWS
    # Pairs that a part may begin with, where what it leads to does not agree.
    passed = scene.choices.take(min(len(rows), 4), alike=False) if asks else 0
    if passed:
        part, reason = seed_bundles(bare, rows, pairs, scene.points, passed)
    given_up |= open_ if part is None else False
    assembly.reasons += [reason] if reason and not chained else []
    if part is not None:
        frames = frozenset(part.poses)
        if frames in assembly.tried_frames:
            given_up[list(frames)] = True
            return _seed_of_frames(assembly, free, chained)
        assembly.tried_frames.add(frames)
    return part


def _unknown_stations(assembly: Assembly) -> set[int]:
    """Positions of the sets that no part has oriented; a known position alone does not orient a set."""
    sights = assembly.scene.terrestrial.sights
    places = np.array([sight.position for sight in sights], dtype=np.int64)
    numbers = np.arange(len(sights))
    known = np.zeros(len(places), dtype=bool)
    for part in assembly.parts:
        oriented = np.isin(numbers, list(part.kappas)) | np.array([s.oriented for s in sights], dtype=bool)
        known |= np.isfinite(part.points[places, :2]).all(axis=1) & oriented
    return set(places[~known].tolist())


def _known_points(assembly: Assembly) -> BoolArray:
    """Points (n,) that some part knows, in plan at least."""
    known = np.zeros(assembly.scene.points, dtype=bool)
    for part in assembly.parts:
        known |= np.isfinite(part.points[:, :2]).all(axis=1)
    return known


# ---- Parts begin, grow and join until everything is in the object system; what nothing ties comes last.


def assembled(network: Network, scene: Scene) -> Assembly:
    """All parts in the object system."""
    parts = [starting_part(network, scene.frames), *rigid_seeds(scene)]
    assembly = Assembly(network, scene, parts, begun=len(parts) - 1)
    for number, part in enumerate(parts):
        part.number = number
    waits = _known_ones_wait(assembly)
    for fewest in (ENOUGH, FEWEST):
        assembly.fewest, assembly.reasons = fewest, []
        assembly.given_up, assembly.tried_stations = np.zeros((3, len(scene.frames)), dtype=bool), set()
        assembly.tried_frames = set()
        for part in [] if waits and fewest == ENOUGH else parts:
            grow(part, scene, fewest)
        _assemble(assembly)
    _place_the_rest(assembly)
    intersect_the_rest(parts[0], scene.seen)
    if pose_the_rest(parts[0], scene.frames):
        grow(parts[0], scene, FEWEST)
        while grow_single_points(parts[0], scene, ambiguous=True):
            grow(parts[0], scene, FEWEST)
    while grow_single_points(parts[0], scene, ambiguous=True, contradicting=True):
        grow(parts[0], scene, FEWEST)
    if stand_level_with_sights(parts[0], scene.terrestrial):
        grow(parts[0], scene, FEWEST)
    return assembly


def _known_ones_wait(assembly: Assembly) -> bool:
    """Do the object system, and parts of measured coordinates, wait for others that are laid upon all their points?

    What grows from few points is hung on each of them: one wrong name, and all that follows is wrong.
    """
    given, *others = assembly.parts
    known = [int(np.count_nonzero(np.isfinite(part.points).all(axis=1))) for part in others]
    if not given.poses:
        known.append(int(np.count_nonzero(np.isfinite(given.points).any(axis=1))))
    # Points that a part must know to grow by itself.
    asks = max(known, default=0) >= 3 and assembly.network.observations <= ROWS
    return asks and bool(assembly.scene.choices.take(2, alike=False))


def _assemble(assembly: Assembly) -> None:
    """Begin parts, grow them and join them until nothing more can be begun or joined."""
    scene, parts = assembly.scene, assembly.parts
    while True:
        _join_all(assembly)
        part = next_seed(assembly)
        if part is not None:
            assembly.begun += 1
            part.number = assembly.begun
            system = parts[0]
            # Frames a part is grown by before given positions are asked whether they tie it.
            most = 20
            while not grow(part, scene, assembly.fewest, most) and not tied_by_positions(system, part, scene.frames):
                most *= 2
            parts.append(part)
        elif not _join_all(assembly, ambiguous=True) and not _join_by_observations(assembly):
            return


def _join_all(assembly: Assembly, ambiguous: bool = False) -> bool:
    """Join what can be joined, again and again: a part may tie another one to the system; true where any was."""
    parts, scene = assembly.parts, assembly.scene
    joined_any = False
    while True:
        ordered = sorted(parts, key=lambda part: part.rank, reverse=True)
        pairs = combinations(ordered, 2)
        pair = next((pair for pair in pairs if join(*pair, scene, ambiguous)), None)
        if pair is None:
            return joined_any
        joined_any = True
        parts[:] = [part for part in parts if part is not pair[1]]
        grow(pair[0], scene, assembly.fewest)


def _join_by_observations(assembly: Assembly) -> bool:
    """Join two parts by whatever was observed between them, where nothing simpler is left; true where any was."""
    parts, scene = assembly.parts, assembly.scene
    if assembly.fewest > FEWEST:
        return False
    ordered = sorted(parts, key=lambda part: part.rank, reverse=True)
    for target, source in combinations(ordered, 2):
        found = tie_by_observations(assembly.network, target, source, scene)
        if found is not None and not found.open:
            carry(target, source, scene, found)
            parts[:] = [part for part in parts if part is not source]
            grow(target, scene, assembly.fewest)
            return True
    return False


def _place_the_rest(assembly: Assembly) -> None:
    """Parts that nothing ties to the object system well enough: those that leave least open first.

    Where nothing is given it becomes the object system, wherever it is.
    """
    parts, scene = assembly.parts, assembly.scene
    while len(parts) > 1:
        source = min(parts[1:], key=lambda part: (open_movements(parts[0], part, scene), -part.size))
        parts.remove(source)
        carry(parts[0], source, scene, _last_tie(assembly, source))
        grow(parts[0], scene, assembly.fewest)
        _join_all(assembly)
    if begin_heights(parts[0], scene.terrestrial):
        grow(parts[0], scene, assembly.fewest)
    while grow_single_points(parts[0], scene, ambiguous=True):
        grow(parts[0], scene, assembly.fewest)
    if place_as_if_level(parts[0], scene.terrestrial, scene.distances[1], scene.choices):
        grow(parts[0], scene, assembly.fewest)


def _last_tie(assembly: Assembly, source: Part) -> Movement | None:
    """Return the last tie of a part to the object system, controlled or not; by all observations if they say more.

    What nothing tells of the vertical and the direction it finds as well as it can.
    """
    system, scene = assembly.parts[0], assembly.scene
    by_all = tie_by_observations(assembly.network, system, source, scene, 0)
    if by_all is not None and by_all.open < open_movements(system, source, scene):
        settles = by_all.open < free_movements(system, source) or source.levelled
        if settles or not level_roughly(source, scene):
            return by_all
    level_roughly(source, scene)
    direct_roughly(source, scene)
    return tie(system, source, scene)


# ---- Start values of what nothing simpler tells, in small networks: at random, until two adjustments end alike.
#
# Where single closed solutions find no hold the observations of all together may still have one solution, and
# its basin is wide: of random places of two tilted instruments and a local system one in five leads to it.
# Frames look at what they see, from anywhere around what is known; points lie where their rays pass by each
# other. What is given or was found stays. An end counts where all groups of observations agree with it, and
# is taken where it is the lowest and was reached twice.


def from_random_places(
    network: Network, scene: Scene, found: Approximation, settle: SettleNetwork
) -> Approximation | None:
    """Start values by the solution that two tries lead to and none lies below; ``None`` where there is none.

    The same network has the same tries.
    """
    kinds = {kind for kind, values in found.start.items() if not np.isfinite(values).all()}
    # Observations of a network up to which it is tried.
    if (
        network.observations > 1_000
        or not kinds <= {"point", "rotation", "scale"}
        or any(feature.type == "line" for feature in network.project.features)
        or not _is_missing_more_than_far_points(network, found)
    ):
        return None
    words = (
        "random positions: {ends} of {tries} adjustments from such positions led to a solution, two of them to this one"
    )
    random = np.random.default_rng(network.observations)
    ends: list[tuple[Mapping[str, FloatArray], float]] = []
    with np.errstate(all="ignore"):  # from some places numbers grow beyond all bounds
        # If one in five starts leads to the solution, two of 20 do with a probability of 93 %.
        for tries in range(1, 21):
            settled = settle(_drawn(network, scene, found.start, random))
            if settled is None:
                continue
            if np.isinf(settled[1]):  # what is singular anywhere is so everywhere
                return None
            if disagreement(network.groups, settled[0])[1] > SOUND:
                continue
            squares = settled[1]
            same = [abs(squares - other) <= SMALLER * max(squares, other) for _, other in ends]
            if any(same) and not any(other < squares and not one for (_, other), one in zip(ends, same, strict=True)):
                return _with(network, found, settled[0], rule(words, ends=len(ends) + 1, tries=tries))
            ends.append(settled)
    return None


def _is_missing_more_than_far_points(network: Network, found: Approximation) -> bool:
    """False where all that is missing are points whose rays are nearly parallel: these have places of their own."""
    apart = nearly_parallel(network, found.start).points
    names = {network.blocks["point"].ids[p] for p in apart.tolist()}
    return any(thing.kind != "point" or thing.name not in names for thing in found.missing)


def _with(network: Network, found: Approximation, end: Mapping[str, FloatArray], how: Phrase) -> Approximation:
    """Everything that is not given as the solution has it: what was found may have been rough."""
    given = network.start
    start = {kind: np.where(np.isfinite(given[kind]), given[kind], end[kind]) for kind in found.start}
    named = {f"{one.kind} {one.name}": how for one in found.missing}
    return found._replace(start=start, how={**found.how, **named}, missing=(), remarks=())


def _drawn(
    network: Network, scene: Scene, start: Mapping[str, FloatArray], random: np.random.Generator
) -> dict[str, FloatArray]:
    """Start values of all blocks, those that are missing at random."""
    drawn = {kind: values.copy() for kind, values in start.items()}
    points, rotations = drawn["point"], drawn.get("rotation", np.zeros((0, 3, 3)))
    middle, size = _extent(start["point"])
    known = np.asarray(np.isfinite(start["point"]).all(axis=1))
    for frame in scene.frames:
        if np.isnan(rotations[frame.rotation]).any():
            here = points[frame.position]
            anywhere = middle + size * random.normal(size=3)
            here[:] = np.where(np.isfinite(here), here, anywhere)
            seen = start["point"][frame.points[known[frame.points]]]
            towards = (seen.mean(axis=0) if len(seen) else middle) - here
            put_rotation(network, rotations, frame.rotation, _looking(frame, unit(towards), random))
    for block in np.flatnonzero(np.isnan(rotations).any(axis=(1, 2))).tolist():
        put_rotation(network, rotations, block, _any_attitude(random))
    anywhere = middle + 0.5 * size * random.normal(size=points.shape)
    nearest = _nearest_to_rays(scene, points, rotations, anywhere)
    points[:] = np.where(np.isfinite(points), points, nearest)
    if "scale" in drawn:
        drawn["scale"] = np.where(np.isfinite(drawn["scale"]), drawn["scale"], 1.0)
    return drawn


def _extent(points: FloatArray) -> tuple[FloatArray, float]:
    told = np.isfinite(points)
    low = np.where(told, points, np.inf).min(axis=0, initial=np.inf)
    high = np.where(told, points, -np.inf).max(axis=0, initial=-np.inf)
    low, high = np.where(low <= high, low, 0.0), np.where(low <= high, high, 0.0)
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0


def _looking(frame: Frame, towards: FloatArray, random: np.random.Generator) -> FloatArray:
    """A rotation D by which a frame looks somewhere, turned about that at random; any one, if it looks all around."""
    mean = frame.rays.mean(axis=0)
    length = float(np.linalg.norm(mean))
    # Length of the mean of all unit rays from which on a frame looks one way.
    if length < 0.3:
        return _any_attitude(random)
    roll: FloatArray = exponential((random.uniform(-np.pi, np.pi) * towards)[None])[0]
    return (roll @ _turned(mean / length, towards)).T


def _turned(one: FloatArray, other: FloatArray) -> FloatArray:
    axis = np.cross(one, other)
    sine = float(np.linalg.norm(axis))
    across = axis / sine if sine > 0.0 else tolerant.svd(one[None])[2][1]
    turned: FloatArray = exponential((np.arctan2(sine, one @ other) * across)[None])[0]
    return turned


def _any_attitude(random: np.random.Generator) -> FloatArray:
    w, *axis = unit(random.normal(size=4))
    half = np.arccos(np.clip(w, -1.0, 1.0))
    attitude: FloatArray = exponential((2.0 * half * unit(np.array(axis)))[None])[0]
    return attitude


def _nearest_to_rays(scene: Scene, points: FloatArray, rotations: FloatArray, anywhere: FloatArray) -> FloatArray:
    """Places (n, 3) nearest to the rays of all frames, and a little to ``anywhere``, where no ray goes altogether."""
    little = 0.05
    normal = little * np.tile(np.eye(3), (len(points), 1, 1))
    side = little * anywhere
    for frame in scene.frames:
        along = frame.rays @ rotations[frame.rotation]
        across = np.eye(3) - along[:, :, None] * along[:, None, :]
        np.add.at(normal, frame.points, across)
        np.add.at(side, frame.points, across @ points[frame.position])
    return np.asarray(tolerant.solve(normal, side[:, :, None])[:, :, 0])


# ---- Observations on the earth, as start values take them: in the object system, as if verticals were parallel.
#
# Over 10 km heights are wrong by some metres then, over 100 km by a few hundred: near enough to begin from.


def to_plane(network: Network) -> Network:
    """Return the network with plain observations instead of those that need the ellipsoid or the sphere."""
    if network.sphere is not None:
        return replace(
            network,
            groups=tuple(
                group if group.type.flat is None else replace(group, type=group.type.flat) for group in network.groups
            ),
        )
    if network.world is None:
        return network
    horizon, rotations = network.world.horizon, network.start.get("rotation", np.zeros((0, 3, 3)))
    return replace(network, groups=tuple(_in_plane(group, horizon, rotations) for group in network.groups))


def _in_plane(group: ObservationGroup, horizon: Horizon, rotations: FloatArray) -> ObservationGroup:
    """Return a group on the earth as plain observations; of vectors, positions and attitudes the complete rows."""
    key, constants = group.type.key, group.constants
    coordinates, flat = PLAIN_TYPES["coordinates"], np.zeros(group.count, dtype=np.int64)
    match key:
        case "gnss_vector":
            kept = _complete(group)
            observed = kept.observed @ horizon.axes.T
            return replace(kept, type=PLAIN_TYPES["vector"], observed=observed, blocks=kept.blocks[:-1])
        case "gnss_position":
            kept = _complete(group)
            observed = horizon.from_geocentric(kept.observed)
            return replace(kept, type=coordinates, observed=observed, blocks=kept.blocks[:-1])
        case "geodetic_position":
            kept = _complete(group)
            sigma = np.where(kept.type.wraps, kept.sigma * horizon.ellipsoid.a, kept.sigma)
            return replace(kept, type=coordinates, observed=horizon.from_geodetic(kept.observed), sigma=sigma)
        case "projected_attitude" | "navigation_attitude":
            kept = _complete(group)
            _, image, boresight = kept.blocks
            observed = in_object_axes(kept.type, kept.observed, kept.constants, rotations[boresight])
            return replace(kept, type=OBSERVED_PARAMETERS["rotation"], observed=observed, blocks=(image,))
        case "projected_position" | "control":  # their first constants are coordinates of the object system
            return replace(group, type=coordinates, observed=np.where(group.mask, constants[:, :3], np.nan))
        case "ellipsoidal_height" | "orthometric_height":
            height = group.observed + (constants[:, :1] if group.type.constants else 0.0)
            nothing = np.full((group.count, 2), np.nan)
            observed, sigma = np.hstack([nothing, height]), np.hstack([nothing, group.sigma])
            return replace(group, type=coordinates, observed=observed, sigma=sigma)
        case "height_difference" | "ellipsoidal_height_difference":
            rise = constants[:, 1:] - constants[:, :1] if group.type.constants else 0.0
            return replace(group, type=PLAIN_TYPES["height_difference"], observed=group.observed + rise)
        case "azimuth" | "astronomic_azimuth":
            return replace(group, type=PLAIN_TYPES["bearing"])
        case "projected_bearing":  # block 0 is the height that nothing has
            start, end = group.blocks
            return replace(group, type=PLAIN_TYPES["bearing"], blocks=(start, flat, end, flat))
        case "ellipsoid_arc" | "ellipsoid_chord" | "mean_sea_level_distance" | "height_reduced_distance":
            start, end, meter = group.blocks
            return replace(group, type=PLAIN_TYPES["horizontal_distance"], blocks=(start, flat, end, flat, meter))
    return group


def _complete(group: ObservationGroup) -> ObservationGroup:
    return some_rows(group, np.flatnonzero(group.mask.all(axis=1)))


# ---- Observations to projection centres, as start values take them: as to the places of the images.


def to_places(network: Network) -> Network:
    """Return the network with plain observations instead of those of projection centres.

    An eccentricity is left to the adjustment; of a stereo follower the place is that of its leader, so its rows go.
    """
    plain = {twin.key: PLAIN_TYPES[key] for key, twin in PROJECTION_CENTRE_TYPES.items()}
    if not any(group.type.key in plain for group in network.groups):
        return network
    groups = tuple(
        _plain(network, group, plain[group.type.key]) if group.type.key in plain else group for group in network.groups
    )
    return replace(network, groups=groups)


def _plain(network: Network, group: ObservationGroup, plain: ObservationType) -> ObservationGroup:
    stands = np.ones(group.count, dtype=bool)
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.kind == "base":
            stands &= (network.start["base"][blocks] == 0.0).all(axis=1) & ~network.blocks["base"].free[blocks].any(
                axis=1
            )
    kept = some_rows(group, np.flatnonzero(stands))
    return replace(kept, type=plain, blocks=kept.blocks[: len(plain.slots)])


# ---- Start values for everything that has none: parts grow, join, and become the object system.
#
# A part is a set of things in one system with the movements it is still free to make. The object system, with
# what the project gives, is one of them; others begin at systems with measured coordinates, GNSS vectors,
# stations with distances, pairs of bundles. Every part grows as far as it can, finds the vertical and the
# scale from what was measured inside it, and joins another one as soon as what ties them determines the
# movement between them. What nothing ties comes last.
#
# Where the start values do not agree with the observations, other answers to what was in doubt on the way are tried.


def approximate(network: Network, settle: SettleNetwork | None = None, others: bool = True) -> Approximation:
    """Start values of a network; nothing is done where all are given.

    Given poses and points that are start values and no more are tested against the rays; those that contradict are
    replaced where the rest can be worked out without them. With ``settle`` doubtful ones are judged by what an
    adjustment makes of them. ``others``: other answers are tried where the likeliest ones do not agree, and what was
    given may be replaced.
    """
    if all_known(network.start):
        return Approximation(network.start, {}, ())
    moving = network
    network = to_plane(standing_still(without_trajectories(network)))
    network = to_places(replace(network, start=with_observed(network)))
    scene, assembly = _likeliest(network, scene_of(network), moving, settle, others)
    found = _contradicting(network, assembly.parts[0], scene) if others else []
    better = _with_others(network, scene, found) if found else None
    result = _approximation(assembly) if better is None else better
    if result.missing and settle is not None and others:
        result = from_random_places(network, scene, result, settle) or result
    missing = seen_along_trajectories(moving, result.missing)
    return result._replace(start=at_all_times(moving, result.start), missing=missing)


def _likeliest(
    network: Network, scene: Scene, moving: Network, settle: SettleNetwork | None, others: bool
) -> tuple[Scene, Assembly]:
    """The parts in the object system; where several answers were possible on the way, with those that agree best."""

    def attempt(choices: Choices) -> Assembly:
        return assembled(network, replace(scene, choices=choices))

    def judged(assembly: Assembly) -> Judgement:
        found = _approximation(assembly)
        missing = sum(thing.observations > 1 for thing in found.missing)
        return Judgement(missing, *disagreement(assembly.network.groups, found.start))

    def adjusted(assembly: Assembly, judgement: Judgement) -> Judgement:
        return _adjusted(assembly, _approximation(assembly), judgement, moving, settle)

    # With more than 1000 observations fewer answers are tried, in inverse proportion, one at least.
    most = max(TRIES * 1_000 // max(network.observations, 1_000), 1) if others else 0
    assembly, choices = likeliest(attempt, judged, adjusted, most)
    return replace(scene, choices=Choices(choices.wanted)), assembly


def _assembled_near_given(network: Network, reduced: Network, scene: Scene) -> Assembly:
    """Return the parts of a network ``reduced`` by given start values, laid upon these if it has no others."""
    assembly = assembled(reduced, scene)
    if not np.isfinite(reduced.start["point"]).any():
        lay_upon(assembly.parts[0], network.start["point"], *_left_free(network))
    return assembly


def _left_free(network: Network) -> tuple[FreeRotation, bool]:
    """Return the turns that the observations leave free, and whether they determine the size."""
    types = [group.type for group in network.groups]
    keys = {type_.key for type_ in types}
    if keys & {"vector", "bearing", "gnss_vector", "azimuth", "astronomic_azimuth", "projected_bearing"}:
        turn = FreeRotation.NONE
    else:
        # These stay the same in any turn of the network; an image type is ``image/…``.
        turning = {"image", "distance", "distance_ratio", "spatial_angle", "local"}
        turn = FreeRotation.ANY if {key.split("/")[0] for key in keys} <= turning else FreeRotation.VERTICAL
    scaled = any(component.quantity.length for type_ in types for component in type_.components)
    return turn, scaled


def _adjusted(
    assembly: Assembly, found: Approximation, judgement: Judgement, moving: Network, settle: SettleNetwork | None
) -> Judgement:
    """The judgement after an adjustment, where one can be made and may tell more."""
    # Observations up to which start values are adjusted before they are judged.
    small, sound = assembly.network.observations <= 5_000, judgement.worst <= SOUND
    if settle is None or not small or found.missing or (sound and not assembly.scene.choices.open):
        return judgement
    judgement = judgement._replace(before=judgement.fit)
    settled = settle(at_all_times(moving, found.start))
    if settled is None:
        return judgement._replace(worst=np.inf)
    values, squares = settled
    if np.isinf(squares):  # other start values seldom help, and none of them may take the place of given ones
        return judgement._replace(fit=np.inf, worst=np.inf)
    fit, worst = disagreement(moving.groups, values)
    return judgement._replace(fit=fit, worst=worst if fit <= judgement.fit else judgement.worst, squares=squares)


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
