"""Image coordinates of a central projection, of a single image and of a stereo follower (MOR 1.1)."""

from __future__ import annotations

from collections.abc import Sequence

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.geometry.frames import InFrame, by_point, by_rotation, follow, into_frame
from mor.observations._contract import Computed, ObservationType, Reference, Slot
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
WRITTEN = "image"
MEASURED = (Component("measured x", IMAGE), Component("measured y", IMAGE))


def image_coordinates(model: CameraModel, pair: tuple[Slot, ...] = ()) -> ObservationType:
    """x, y of a point in an image taken with a camera of this model (MOR eqs. 1, 2, 5).

    Slots: position, rotation, height, eccentricity, interior orientation, point. With the slots of a ``pair``, relative
    rotation and base before the interior orientation, the frame is that of a leading image (MOR eqs. 3, 4).
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        position, rotation, height, eccentricity, *relative, interior, point = blocks
        frame = into_frame(position, rotation, height, point, eccentricity=eccentricity)
        own = follow(frame.star, *relative) if relative else frame
        projection = model.project(own.star, interior, constants[:, 2:], constants[:, :2])
        by_star, by_pair = projection.by_star, list[FloatArray]()
        if relative:
            by_star = projection.by_star @ relative[0]
            by_pair = [by_rotation(projection.by_star, own.lever), -by_star]
        return Computed(
            projection.xy,
            (*_by_frame(by_star, frame), *by_pair, projection.by_interior, by_point(by_star, frame)),
        )

    interior = Slot(interior_key(model.key), "image", "interior")
    return ObservationType(
        key=f"{'follower' if pair else 'image'}/{model.key}",
        written=WRITTEN,
        components=COMPONENTS,
        references=REFERENCES,
        slots=(*FRAME_SLOTS, *pair, interior, POINT_SLOT),
        equation=equation,
        constants=(*MEASURED, *model.constants),
    )


def is_image_point(type_: ObservationType) -> bool:
    """True for image coordinates, of single images and of stereo followers, at infinity too."""
    return type_.written == WRITTEN


def _by_frame(by_star: FloatArray, frame: InFrame) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    by_position = -by_point(by_star, frame)
    return by_position, by_rotation(by_star, frame.lever), by_position[:, :, 2:], by_star


IMAGE_TYPES = {model.key: image_coordinates(model) for model in CAMERA_MODELS.values()}
FOLLOWER_TYPES = {model.key: image_coordinates(model, FOLLOWER_SLOTS) for model in CAMERA_MODELS.values()}
