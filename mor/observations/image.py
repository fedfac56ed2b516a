"""Image coordinates of a central projection, of a single image and of a stereo follower (MOR 1.1)."""

from __future__ import annotations

from collections.abc import Sequence

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.geometry.frames import InFrame, by_point, by_rotation, follow, into_frame
from mor.observations._contract import Computed, Equation, ObservationType, Reference, Slot
from mor.parameters.kinds import interior_key
from mor.units import IMAGE, Component

FRAME_SLOTS = (
    Slot("point", "image", "position"),
    Slot("rotation", "image", "rotation"),
    Slot("height", "image", "height"),
    Slot("eccentricity", "image", "eccentricity"),
)
FOLLOWER_SLOTS = (
    Slot("rotation", "image", "relative rotation"),
    Slot("base", "image", "base"),
)
POINT_SLOT = Slot("point", "point", "position")
REFERENCES = (Reference("image", ("image",)), Reference("point", ("point",)))
COMPONENTS = (Component("x", IMAGE), Component("y", IMAGE))
MEASURED = (Component("measured x", IMAGE), Component("measured y", IMAGE))


def image_coordinates(model: CameraModel) -> ObservationType:
    """x, y of a point in an image taken with a camera of this model (MOR eqs. 1, 2, 5).

    Slots: position, rotation, height, eccentricity, interior orientation, point.
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, rotation, height, eccentricity, interior, point = blocks
        frame = into_frame(position, rotation, height, point, eccentricity=eccentricity)
        projection = model.project(frame.star, interior, constants[:, 2:], constants[:, :2])
        return Computed(
            projection.xy,
            (
                *_by_frame(projection.by_star, frame),
                projection.by_interior,
                by_point(projection.by_star, frame),
            ),
        )

    return _image_type("image", model, (), equation)


def follower_coordinates(model: CameraModel) -> ObservationType:
    """x, y in an image that is tied to a leading image by a relative orientation (MOR eqs. 3, 4).

    Slots: the frame of the leading image, relative rotation, base, interior orientation, point.
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, rotation, height, eccentricity, relative, base, interior, point = blocks
        leader = into_frame(position, rotation, height, point, eccentricity=eccentricity)
        follower = follow(leader.star, relative, base)
        projection = model.project(follower.star, interior, constants[:, 2:], constants[:, :2])
        by_leader = projection.by_star @ relative
        return Computed(
            projection.xy,
            (
                *_by_frame(by_leader, leader),
                by_rotation(projection.by_star, follower.lever),
                -by_leader,
                projection.by_interior,
                by_point(by_leader, leader),
            ),
        )

    return _image_type("follower", model, FOLLOWER_SLOTS, equation)


def _by_frame(by_star: FloatArray, frame: InFrame) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    by_position = -by_point(by_star, frame)
    return by_position, by_rotation(by_star, frame.lever), by_position[:, :, 2:], by_star


def _image_type(
    prefix: str, model: CameraModel, extra: tuple[Slot, ...], equation: Equation
) -> ObservationType:
    interior = Slot(interior_key(model.key), "image", "interior")
    return ObservationType(
        key=f"{prefix}/{model.key}",
        written="image",
        components=COMPONENTS,
        references=REFERENCES,
        slots=(*FRAME_SLOTS, *extra, interior, POINT_SLOT),
        equation=equation,
        constants=(*MEASURED, *model.constants),
    )


IMAGE_TYPES = {model.key: image_coordinates(model) for model in CAMERA_MODELS.values()}
FOLLOWER_TYPES = {model.key: follower_coordinates(model) for model in CAMERA_MODELS.values()}
