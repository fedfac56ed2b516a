"""Rigs of COLMAP as stereo pairs: the images a rig took at one time follow that of its reference camera."""

from __future__ import annotations

from typing import NamedTuple

from mor.formats.colmap.model import ColmapModel, Pose
from mor.formats.colmap.poses import relative
from mor.formats.draft import Draft, Row
from mor.geometry.rotations import angles_from_rotation


class Follower(NamedTuple):
    """The image that another one follows, and the pair that says how."""

    leader: str
    pair: str


def followers(model: ColmapModel, draft: Draft) -> tuple[list[Row], dict[int, Follower]]:
    """Rows of pairs, and the images by their numbers that follow another one."""
    images = {image.id: image for image in model.images}
    rigs = {rig.id: rig for rig in model.rigs if len(rig.sensors) > 1}
    poses: dict[str, Pose] = {}
    result: dict[int, Follower] = {}
    for frame in model.frames:
        rig = rigs.get(frame.rig)
        if rig is None:
            continue
        mine = {images[number].camera: images[number] for number in frame.images if number in images}
        leader = mine.get(rig.sensors[0].camera)
        if leader is None:
            draft.note(
                f"frame {frame.id}: no image of the reference camera of its rig; its images are single"
            )
            continue
        for sensor in rig.sensors[1:]:
            if sensor.camera in mine and sensor.pose is not None:
                pair = f"rig {rig.id} camera {sensor.camera}"
                poses[pair] = sensor.pose
                result[mine[sensor.camera].id] = Follower(leader.name, pair)
    return [_pair(name, pose) for name, pose in poses.items()], result


def _pair(name: str, pose: Pose) -> Row:
    D, base = relative(pose)
    return Row([name, *(repr(float(v)) for v in (*base, *angles_from_rotation(D)))], 0)
