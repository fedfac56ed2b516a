"""The Jacobian of every observation type against differences, at ordinary and at awkward places.

One test for all types: it fills the slots of a type with random blocks, puts the target where the place wants it,
and moves block after block, component after component; rotations by D ← exp(−[δ]×) D.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS
from mor.model.contract import wrap
from mor.model.images import phases
from mor.model.observation_types import ALL_TYPES
from mor.model.parameters import KINDS
from mor.model.rotations import exponential, rotate, rotation_from_angles
from tests.selection import slow

EPSILON = np.finfo(float).eps


@dataclass(frozen=True)
class Place:
    """Where the target stands, as a factor and a direction in the axes of the instrument, and how that is held."""

    direction: tuple[float, float, float] = (0.6, 0.5, -0.9)
    distance: float = 6.0
    narrow: float = 1.0
    """Smallest length that matters, as a part of the distance: steps stay far below it."""
    phi: float | None = None
    face: float = 1.0
    radius: float = 6_371_000.0


PLACES = {
    "ordinary": Place(),
    "phi just below 100 gon": Place(phi=np.pi / 2 - 1e-6),
    "phi 100 gon": Place(phi=np.pi / 2),
    "phi -100 gon": Place(phi=-np.pi / 2),
    "nearly straight down": Place((2e-3, -1e-3, -1.0), narrow=2e-3),
    "nearly straight up": Place((2e-3, 1e-3, 1.0), narrow=2e-3),
    "direction 0 gon": Place((1e-13, 1.0, -0.8)),
    "direction 200 gon": Place((1e-13, -1.0, -0.8)),
    "direction -200 gon": Place((-1e-13, -1.0, -0.8)),
    "direction 300 gon": Place((-1.0, 1e-13, -0.8)),
    "horizontal sight": Place((0.7, 0.7, -1e-13)),
    "face two": Place(face=2.0),
    "face two, steep": Place((0.01, 0.005, -1.0), narrow=0.01, face=2.0),
    "strong refraction": Place(radius=40.0),
    "strong refraction, face two": Place(radius=40.0, face=2.0),
    "near the station": Place(distance=2e-3),
    "far away": Place(distance=5e3),
}
ONLY_IN_FRONT = ("image", "follower", "moving")
IN_HUNDREDTHS = {"image velocity": 1e2, "rotation rate": 2e1, "readout": 1e-1}
"""Steps in the second, while images are read out in hundredths of one."""
ROWS = 4


def _interior(kind, random):
    """Interior orientations of moderate size by the dimension of the component; none is zero."""
    sizes = {1: 0.1, 0: 1e-2, -1: 1e-5, -2: 1e-4, -4: 1e-7, -6: 1e-9}
    values = np.array([sizes[component.quantity.image] for component in kind.components])
    values[[component.quantity.length == 1 for component in kind.components]] = 1e-4
    for number, component in enumerate(kind.components):
        if component.name in ("c", "fx", "fy"):
            values[number] = 20.0 + number / 7.0
        if component.name.startswith("n_"):
            return _behind_port(kind, values, number, random)
    return values * random.uniform(0.8, 1.2, (ROWS, kind.size))


def _behind_port(kind, values, first, random):
    """The same behind a port of 0.1 mm, ``first`` the index of the air; 51° from the axis are still seen."""
    values[[name.startswith("centre_") for name in kind.names]] = 1e-5
    values = values * random.uniform(0.8, 1.2, (ROWS, kind.size))
    values[:, first:] = (1.01, 1.1, 1.03)
    return values


def _block(kind, place, random):
    if kind.is_rotation:
        angles = random.uniform(-1.2, 1.2, (ROWS, 3))
        if place.phi is not None:
            angles[:, 1] = place.phi
        return rotation_from_angles(angles)
    if kind.key.startswith("interior/"):
        return _interior(kind, random)
    near = {"height": (0.5, 2.0), "scale": (0.8, 1.2), "refraction": (-0.8, 0.9), "readout": (0.005, 0.02)}
    near |= {"rotation rate": (-0.5, 0.5)}
    if kind.key in near:
        return random.uniform(*near[kind.key], (ROWS, kind.size))
    if kind.key == "image velocity":
        return random.uniform(-3.0, 3.0, (ROWS, 3)) * min(1.0, place.distance / 6.0)
    if kind.key == "distance meter":
        return np.stack([random.uniform(0.9, 1.1, ROWS), random.uniform(-0.4, 0.4, ROWS)], axis=1)
    return random.uniform(-3.0, 3.0, (ROWS, kind.size))


def _admissible(type_key, place):
    """A camera sees only what is in front; three angles have no derivatives at φ = 100 gon (tested close by).

    What moves on by much more than the distance while it is read out does not meet the shutter once.
    """
    if type_key.startswith("moving") and place.distance < 0.1:
        return False
    if type_key in ("observed/rotation", "difference/rotation"):
        return place.phi is None
    return not type_key.startswith(ONLY_IN_FRONT) or place.direction[2] < -0.2


USUAL = ("ordinary", "phi 100 gon", "nearly straight up", "direction 200 gon", "face two")
"""Places of the default run; behind a port only the first."""
CASES = [
    (key, name) if name in (USUAL[:1] if "+" in key else USUAL) else slow((key, name))
    for key in ALL_TYPES
    for name, place in PLACES.items()
    if _admissible(key, place) and ("+" not in key or "/mor+" in key)  # a port is the same with every lens
]


def _put_target(kind, blocks, sight, constants=None):
    """Move all positions but the first so that the last is seen at ``sight`` in the axes of the (last) frame."""
    part = {(slot.of, slot.part): block for slot, block in zip(kind.slots, blocks, strict=True)}
    if kind.key.startswith(("observed/", "difference/", "level")):
        return
    if kind.key.endswith("/projection centre"):
        _put_at_centres(kind, blocks, sight)
        return
    owner = kind.slots[0].of
    ends = [slot.of for slot in kind.slots if slot.part == "position" and slot.of != owner]
    for turn, end in enumerate(reversed(ends)):  # further ones, as of an angle, are seen beside it
        vector = np.broadcast_to(np.roll(sight, turn), (ROWS, 3)).copy()
        if (owner, "relative rotation") in part:
            vector = np.einsum("nji,nj->ni", part[owner, "relative rotation"], vector) + part[owner, "base"]
        if (owner, "eccentricity") in part:
            vector = vector - part[owner, "eccentricity"]
        if (owner, "image velocity") in part:
            time = part[owner, "readout"] * phases(_imaged(kind, part, sight, constants), constants[:, -3:])[:, None]
            turn = exponential(part[owner, "rotation rate"] * time)
            vector = np.einsum("nij,nj->ni", turn, vector) + part[owner, "image velocity"] * time
        if (owner, "rotation") in part:
            vector = np.einsum("nji,nj->ni", part[owner, "rotation"], vector)
        vector[:, 2] += part.get((owner, "height"), np.zeros((ROWS, 1)))[:, 0]
        vector[:, 2] -= part.get((end, "height"), np.zeros((ROWS, 1)))[:, 0]
        part[end, "position"][:] = part[owner, "position"] + vector


def _imaged(kind, part, sight, constants):
    """Where a camera sees a target: the row says when."""
    star = np.broadcast_to(sight, (ROWS, 3))
    model = CAMERA_MODELS[kind.key.partition("/")[2]]
    return model.project(star, part["image", "interior"], constants[:, 2:-3], constants[:, :2]).xy


def _put_at_centres(kind, blocks, sight):
    """Move the positions of a type so that its projection centres stand where its twin without them has its ends."""
    plain = ALL_TYPES[kind.key.partition("/")[0]]
    own = blocks[: len(plain.slots)]
    _put_target(plain, own, sight)
    part = {(slot.of, slot.part): block for slot, block in zip(kind.slots, blocks, strict=True)}
    low = {slot.of for slot in kind.slots[len(plain.slots) :] if slot.part == "height"}
    for slot, block in zip(plain.slots, own, strict=True):
        if slot.part == "position" and (slot.of, "base") in part:
            arm = part[slot.of, "base"] - part[slot.of, "eccentricity"]
            block -= np.einsum("nji,nj->ni", part[slot.of, "rotation"], arm)
            if slot.of in low:
                block[:, 2] -= part[slot.of, "height"][:, 0]


def _constants(kind, place, random):
    known = {"face": place.face, "earth radius": place.radius, "r0": 5.0}
    known |= {"phase by x": 0.05, "phase by y": -0.04, "phase at 0": 0.1}
    columns = [
        np.full(ROWS, known[c.name]) if c.name in known else random.uniform(-6.0, 6.0, ROWS) for c in kind.constants
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((ROWS, 0))


def _step(slot, component, block, place):
    small = 5e-4 * place.narrow
    if slot.kind == "rotation":
        return np.full(ROWS, small * min(1.0, 0.1 * place.distance))  # eccentricities and bases are the levers
    if slot.kind in ("point", "height", "eccentricity", "base"):
        return np.full(ROWS, small * place.distance)
    if slot.kind in IN_HUNDREDTHS:
        return np.full(ROWS, small * min(1.0, 0.1 * place.distance) * IN_HUNDREDTHS[slot.kind])
    return 1e-3 * np.abs(block[:, component])


def _moved(slot, block, component, step):
    direction = step[:, None] * np.eye(KINDS[slot.kind].size)[component]
    return rotate(block, direction) if slot.kind == "rotation" else block + direction


def _difference_quotient(kind, blocks, constants, number, component, step):
    """Fourth-order central differences (n, m), angles wrapped; and what round-off can have done to them."""
    slot = kind.slots[number]
    here = kind.equation(blocks, constants).values
    change = {}
    for factor in (-2, -1, 1, 2):
        others = list(blocks)
        others[number] = _moved(slot, blocks[number], component, factor * step)
        difference = kind.equation(others, constants).values - here
        change[factor] = np.where(kind.wraps, wrap(difference), difference)
    numeric = (8.0 * (change[1] - change[-1]) - (change[2] - change[-2])) / (12.0 * step[:, None])
    return numeric, 8.0 * EPSILON * np.maximum(np.abs(here), 1.0) / step[:, None]


@pytest.mark.parametrize(("type_key", "place"), CASES)
def test_jacobian_against_differences(type_key, place):
    kind, where = ALL_TYPES[type_key], PLACES[place]
    random = np.random.default_rng(list(PLACES).index(place))
    blocks = [_block(KINDS[slot.kind], where, random) for slot in kind.slots]
    constants = _constants(kind, where, random)
    _put_target(kind, blocks, where.distance * np.array(where.direction), constants)
    computed = kind.equation(blocks, constants)
    assert computed.values.shape == (ROWS, len(kind.components))
    assert len(computed.jacobians) == len(kind.slots)
    for number, (slot, jacobian) in enumerate(zip(kind.slots, computed.jacobians, strict=True)):
        assert jacobian.shape == (ROWS, len(kind.components), KINDS[slot.kind].size)
        for component in range(KINDS[slot.kind].size):
            step = _step(slot, component, blocks[number], where)
            numeric, rounding = _difference_quotient(kind, blocks, constants, number, component, step)
            # the target is put there by sums of numbers of size 10: its sight is only so well known
            rounding = rounding * (4.0 if type_key.startswith("moving") else 1.0)  # they are met in rounds
            rounding = rounding + 40.0 * EPSILON / (where.narrow * where.distance) * np.abs(numeric).max()
            size = np.abs(jacobian).max(axis=2)
            error = np.abs(jacobian[:, :, component] - numeric)
            allowed = 1e-8 * size + 1e-9 * size.max(axis=1, keepdims=True) + rounding
            assert (error <= allowed).all(), (slot, component, jacobian[:, :, component], numeric, allowed)


@pytest.mark.parametrize("type_key", ["observed/rotation", "difference/rotation"])
@pytest.mark.parametrize("phi", [np.pi / 2 - 5e-3, -np.pi / 2 + 5e-3])
def test_observed_angles_close_to_100_gon(type_key, phi):
    kind = ALL_TYPES[type_key]
    random = np.random.default_rng(6)
    blocks = [_block(KINDS["rotation"], Place(phi=phi), random) for _ in kind.slots]
    computed = kind.equation(blocks, np.zeros((ROWS, 0)))
    for number, jacobian in enumerate(computed.jacobians):
        for component in range(3):
            numeric, _ = _difference_quotient(kind, blocks, np.zeros((ROWS, 0)), number, component, np.full(ROWS, 2e-5))
            np.testing.assert_allclose(jacobian[:, :, component], numeric, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(
    "type_key", ["directions", "zenith_directions", "bearing", "angle", "spatial_angle", "zenith_angle"]
)
@pytest.mark.parametrize("height", [5.0, -5.0, 0.0])
def test_vertical_sights_and_coinciding_points_stay_finite(type_key, height):
    kind = ALL_TYPES[type_key]
    blocks = []
    for slot in kind.slots:
        size = KINDS[slot.kind].size
        blocks.append(np.eye(3)[None] if slot.kind == "rotation" else np.zeros((1, size)))
    last = max(n for n, slot in enumerate(kind.slots) if slot.part == "position")
    blocks[last][0, 2] = height
    constants = np.array([[c.default for c in kind.constants]])
    computed = kind.equation(blocks, constants)
    assert np.isfinite(computed.values).all()
    if height:
        assert all(np.isfinite(jacobian).all() for jacobian in computed.jacobians)
