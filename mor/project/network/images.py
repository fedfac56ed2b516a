"""Images of a project: frames with a camera; followers refer to their leading image and their pair."""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, IntArray
from mor.errors import Problem
from mor.parameters.kinds import ECCENTRICITY, HEIGHT, IMAGE_VELOCITY, POINT, ROTATION, ROTATION_RATE
from mor.project.file.model import Images
from mor.project.motion.epochs import EPOCH, remember_epochs
from mor.project.network.cameras import interiors, variant_columns
from mor.project.network.entities import entities, unknown_name
from mor.project.network.poses import Seen, check_unique, position_columns, positions, rotations
from mor.project.network.reading import Reading
from mor.project.network.set_ups import eccentricities, heights, motions, set_up_columns, shared_column
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import component_columns
from mor.project.tables.tables import Column, Place, Rows, read_table
from mor.project.trajectories.images import TRAJECTORY, pose_blocks, put_on_trajectories, trajectory_columns
from mor.project.trajectories.scanners import check_line_times, read_line_times


def read_images(reading: Reading) -> None:
    """Images: positions, rotations, heights, cameras; followers refer to their leading image and their pair."""
    collected: dict[str, list[IntArray]] = {}
    ids: list[str] = []
    seen: list[Seen] = []
    leaders: list[tuple[int, str, str, str, int]] = []
    read_line_times(reading)
    for k, table in enumerate(reading.project.images):
        reading.begin("images", k, table)
        _read_images_table(reading, table, reading.at("images", k), ids, collected, seen, leaders)
        reading.watch(table.file)
    parts = {part: np.concatenate(arrays) for part, arrays in collected.items()}
    if not parts:
        parts = {part: np.zeros(0, dtype=np.int64) for part in _IMAGE_PARTS}
    reading.shop.things["image"] = entities(ids, parts)
    _follow(reading, leaders)
    check_line_times(reading, tuple(ids))


_MOTION = (IMAGE_VELOCITY, ROTATION_RATE)
_POSE = (
    *POINT.names,
    *ROTATION.names,
    *HEIGHT.names,
    *ECCENTRICITY.names,
    *IMAGE_VELOCITY.names,
    *ROTATION_RATE.names,
)
_SHARED = ("position", *(shared_column(kind) for kind in (HEIGHT, ECCENTRICITY, *_MOTION)))
_IMAGE_PARTS = (
    "position",
    "rotation",
    "height",
    "eccentricity",
    "interior",
    "model",
    "camera",
    "relative rotation",
    "base",
    "image velocity",
    "rotation rate",
    "readout",
    TRAJECTORY,
)


def _read_images_table(
    reading: Reading,
    table: Images,
    place: Place,
    ids: list[str],
    collected: dict[str, list[IntArray]],
    seen: list[Seen],
    leaders: list[tuple[int, str, str, str, int]],
) -> None:
    edge, shop = reading.edge, reading.shop
    rows = read_table(table, image_columns(reading), place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    check_unique("image", names, rows, seen, reading.problems)
    remember_epochs(reading, "image", names, rows)
    if not edge.right_handed:
        reading.problems.append(
            place.problem(f"images need right-handed axes; {edge.axes.xy} is left-handed")
        )
        return
    cameras = _camera_numbers(reading, rows)
    if cameras is None:
        reading.broken.add("image")
        return
    camera = shop.things["camera"]
    own = camera.parts["eccentricity"][cameras]
    trajectory = put_on_trajectories(reading, rows, names, table.free)
    position, rotation, height, eccentricity = _own_poses(reading, rows, trajectory >= 0, table, own)
    none = np.full(len(names), -1, dtype=np.int64)
    readout = camera.parts["readout"][cameras]
    velocity, rate = _motions(reading, rows, names, table, readout, trajectory >= 0)
    found = {
        "position": position,
        "rotation": rotation,
        "height": height,
        "eccentricity": eccentricity,
        "interior": interiors(reading, rows, cameras),
        "model": camera.parts["model"][cameras],
        "camera": cameras,
        "relative rotation": none,
        "base": none.copy(),
        "image velocity": velocity,
        "rotation rate": rate,
        "readout": readout,
        TRAJECTORY: trajectory,
    }
    for i, (leader, pair) in enumerate(zip(rows.text("leader"), rows.text("pair"), strict=True)):
        if leader or pair:
            leaders.append((len(ids) + i, leader, pair, rows.file, int(rows.lines[i])))
    for part, array in found.items():
        collected.setdefault(part, []).append(array)
    ids += names
    reading.end("image", len(names))


def image_columns(reading: Reading) -> list[Column]:
    """Return the columns that a table of images may have."""
    edge = reading.edge
    return [
        Column("id", required=True),
        Column("camera", required=True),
        *(Column(name) for name in ("position", "leader", "pair")),
        EPOCH,
        *trajectory_columns(reading),
        *component_columns((*POINT.components, *ROTATION.components), edge),
        *position_columns(reading),
        *set_up_columns(reading, HEIGHT),
        *set_up_columns(reading, ECCENTRICITY),
        *(column for kind in _MOTION for column in set_up_columns(reading, kind)),
        *variant_columns(reading),
    ]


def _own_poses(
    reading: Reading, rows: Rows, on_trajectory: BoolArray, table: Images, eccentricity: IntArray
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Position, rotation, height and eccentricity blocks; those of followers come from their leading images.

    ``eccentricity`` (n,) are the blocks of the cameras. Images ``on_trajectory`` (n,) have the pose of a time.
    """
    names = rows.text("id")
    follows = np.array([bool(a or b) for a, b in zip(rows.text("leader"), rows.text("pair"), strict=True)])
    for i in np.flatnonzero(follows):
        given = any(np.isfinite(rows.number(name)[i]) for name in _POSE)
        if given or any(rows.text(name)[i] for name in _SHARED):
            words = f"image {names[i]!r} follows another one: it has no position or attitude of its own"
            reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))
    position, rotation, height = (np.full(len(names), -1, dtype=np.int64) for _ in range(3))
    eccentricity = eccentricity.copy()
    labels = [f"image {name}" for name in names]
    fixed, free = table.fixed, table.free
    own = np.flatnonzero(~follows & ~on_trajectory)
    if len(own):
        mine, called = rows.take(own), [labels[i] for i in own]
        position[own] = positions(reading, mine, called, fixed)
        rotation[own] = rotations(reading, mine, called, fixed)
    timed = np.flatnonzero(on_trajectory & ~follows)
    if len(timed):
        position[timed], rotation[timed] = pose_blocks(reading, [labels[i] for i in timed])
    set_up = np.flatnonzero(~follows)
    if len(set_up):
        mine, called = rows.take(set_up), [labels[i] for i in set_up]
        height[set_up] = heights(reading, mine, called, fixed, free)
        eccentricity[set_up] = eccentricities(reading, mine, called, fixed, free, eccentricity[set_up])
    return position, rotation, height, eccentricity


def _motions(
    reading: Reading,
    rows: Rows,
    names: list[str],
    table: Images,
    readout: IntArray,
    on_trajectory: BoolArray,
) -> tuple[IntArray, IntArray]:
    """Velocity and rotation rate of images whose cameras have a readout time (n,); a motion without one is noted.

    Images ``on_trajectory`` (n,) move as that does.
    """
    labels = [f"image {name}" for name in names]
    follows = np.array([bool(a or b) for a, b in zip(rows.text("leader"), rows.text("pair"), strict=True)])
    moving = (readout >= 0) & ~follows & ~on_trajectory
    words = "image {0!r} follows another one; a stereo follower with a readout time is not provided for"
    tell_rows(reading.problems, (readout >= 0) & follows, rows, lambda row: words.format(names[row]))
    still = np.flatnonzero(readout < 0)
    given = [c for kind in _MOTION for c in kind.names if np.isfinite(rows.number(c)[still]).any()]
    if given or (len(still) and any(c in table.free for kind in _MOTION for c in kind.names)):
        camera = rows.text("camera")[int(still[0])]
        said = f"camera {camera} has no readout time: the motion of its images has no effect and is left out"
        reading.notes.append(Problem(said, rows.file, int(rows.lines[int(still[0])])))
    return motions(reading, rows, labels, table.fixed, table.free, moving)


def _camera_numbers(reading: Reading, rows: Rows) -> IntArray | None:
    known = reading.shop.things["camera"].numbers
    result = np.array([known.get(name, -1) for name in rows.text("camera")], dtype=np.int64)
    names = rows.text("camera")
    for name in dict.fromkeys(names[i] for i in np.flatnonzero(result < 0)):
        if name in reading.project.cameras or "camera" in reading.broken:
            continue  # its own mistake is told already
        line = int(rows.lines[names.index(name)])
        reading.problems.append(Problem(unknown_name("camera", name, known), rows.file, line))
    return None if (result < 0).any() else result


def _follow(reading: Reading, leaders: list[tuple[int, str, str, str, int]]) -> None:
    """Tie followers to their leading image: its frame, and the relative orientation of their pair."""
    images, pairs = reading.shop.things["image"], reading.shop.things["pair"]
    followers = {number for number, *_ in leaders}
    for number, leader, pair, file, line in leaders:
        if not leader or not pair:
            have, lack = ("pair", "leader") if pair else ("leader", "pair")
            words = f"image {images.ids[number]!r} has a {have} but no {lack}; a stereo follower needs both"
            reading.problems.append(Problem(words, file, line))
        elif leader not in images.numbers:
            reading.problems.append(Problem(unknown_name("leader: image", leader, images.ids), file, line))
        elif pair not in pairs.numbers and "pair" in reading.broken:
            continue
        elif pair not in pairs.numbers:
            reading.problems.append(Problem(unknown_name("pair", pair, pairs.ids), file, line))
        elif images.numbers[leader] == number:
            reading.problems.append(
                Problem(
                    f"image {leader!r} is its own leader; a stereo follower follows another image", file, line
                )
            )
        elif images.numbers[leader] in followers:
            words = f"leader {leader!r} is itself a follower; a leader must be an image of its own"
            reading.problems.append(Problem(words, file, line))
        else:
            if leader in reading.image_times:
                reading.image_times[images.ids[number]] = reading.image_times[leader]
            for part in ("position", "rotation", "height", "eccentricity", TRAJECTORY):
                images.parts[part][number] = images.part(leader, part)
            images.parts["relative rotation"][number] = pairs.part(pair, "rotation")
            images.parts["base"][number] = pairs.part(pair, "base")
