"""The kinds of parameter blocks. A position is a point, whatever stands there; an attitude is a rotation."""

from __future__ import annotations

from typing import NamedTuple

from mor.geometry.cameras import CAMERA_MODELS
from mor.units import ANGLE, LENGTH, NUMBER, SPEED, TIME, TURN_RATE, Component


class BlockKind(NamedTuple):
    """A kind of parameter block: its key and its components, in the order of their columns."""

    key: str
    components: tuple[Component, ...]

    @property
    def size(self) -> int:
        """Number of components, and of columns where all are free."""
        return len(self.components)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components."""
        return tuple(component.name for component in self.components)

    @property
    def is_rotation(self) -> bool:
        """True for attitudes, which are stored as matrices and updated by small rotations."""
        return self.key == "rotation"

    @property
    def in_object_axes(self) -> bool:
        """True for positions and movements of points, whose components are along the axes of the object system."""
        return self.key in ("point", "velocity", "sine", "cosine")


POINT = BlockKind("point", (Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)))
ROTATION = BlockKind(
    "rotation", (Component("omega", ANGLE), Component("phi", ANGLE), Component("kappa", ANGLE))
)
ECCENTRICITY = BlockKind(
    "eccentricity", (Component("rx", LENGTH), Component("ry", LENGTH), Component("rz", LENGTH))
)
BASE = BlockKind("base", (Component("bx", LENGTH), Component("by", LENGTH), Component("bz", LENGTH)))
HEIGHT = BlockKind("height", (Component("height", LENGTH),))
READOUT = BlockKind("readout", (Component("readout", TIME),))
"""Time from the first to the last row (or column) of an image."""
IMAGE_VELOCITY = BlockKind("image velocity", tuple(Component(f"v{axis}", SPEED) for axis in "xyz"))
ROTATION_RATE = BlockKind("rotation rate", tuple(Component(f"rate_{axis}", TURN_RATE) for axis in "xyz"))
"""How an image moves while it is read out, in its own axes."""
SCALE = BlockKind("scale", (Component("scale", NUMBER, default=1.0),))
DISTANCE_METER = BlockKind(
    "distance meter", (Component("scale", NUMBER, default=1.0), Component("offset", LENGTH))
)
REFRACTION = BlockKind("refraction", (Component("refraction", NUMBER),))
GNSS_FRAME = BlockKind(
    "gnss frame",
    (
        *(Component(f"shift_{axis}", LENGTH) for axis in "xyz"),
        *(Component(f"turn_{axis}", ANGLE) for axis in "xyz"),
        Component("scale", NUMBER, default=1.0),
    ),
)
"""Where the frame of a GNSS solution lies in that of the points, in geocentric axes."""
POSITION_SHIFT = BlockKind(
    "position shift",
    (
        *(Component(f"shift_{axis}", LENGTH) for axis in "xyz"),
        *(Component(f"drift_{axis}", SPEED) for axis in "xyz"),
    ),
)
"""By what the positions of satellites along a trajectory are off, and how that grows."""
ATTITUDE_SHIFT = BlockKind(
    "attitude shift",
    (
        *(Component(f"turn_{axis}", ANGLE) for axis in "xyz"),
        *(Component(f"turn_drift_{axis}", TURN_RATE) for axis in "xyz"),
    ),
)
"""By what the attitudes of an inertial system are off, about its axes, and how that grows."""
TIME_OFFSET = BlockKind("time offset", (Component("time_offset", TIME),))
"""What is to be added to the times of an instrument."""
VELOCITY = BlockKind("velocity", tuple(Component(f"v{axis}", LENGTH) for axis in "xyz"))
"""Movement of a point in a year."""
SINE = BlockKind("sine", tuple(Component(f"sin_{axis}", LENGTH) for axis in "xyz"))
COSINE = BlockKind("cosine", tuple(Component(f"cos_{axis}", LENGTH) for axis in "xyz"))
"""Annual oscillation of a point: s sin 2πt + c cos 2πt, t in years."""
MOTIONS = (VELOCITY, SINE, COSINE)
"""What moves points in the course of time."""


def interior_key(model: str) -> str:
    """Key of the interior orientation block of a camera model."""
    return f"interior/{model}"


INTERIORS = {
    model.key: BlockKind(interior_key(model.key), model.components) for model in CAMERA_MODELS.values()
}

KINDS = {
    kind.key: kind
    for kind in (
        *INTERIORS.values(),
        DISTANCE_METER,
        REFRACTION,
        GNSS_FRAME,
        POSITION_SHIFT,
        ATTITUDE_SHIFT,
        TIME_OFFSET,
        READOUT,
        SCALE,
        HEIGHT,
        IMAGE_VELOCITY,
        ROTATION_RATE,
        ECCENTRICITY,
        BASE,
        *MOTIONS,
        ROTATION,
        POINT,
    )
}
"""All kinds; the order is the order of their columns."""
