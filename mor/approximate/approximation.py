"""What the start values of a network are, and how they came about."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mor.approximate.parts.frames import Frame
from mor.approximate.parts.history import Join
from mor.approximate.parts.rule import Rule
from mor.approximate.terrestrial.sights import Sight
from mor.arrays import FloatArray
from mor.errors import Undeterminable


class Approximation(NamedTuple):
    """Start values, how each was obtained, and what is still missing."""

    start: Mapping[str, FloatArray]
    how: Mapping[str, Rule]
    """Name of a point, image or station → how its start value was obtained."""
    missing: tuple[Undeterminable, ...]
    """What has no start value yet, and why."""
    remarks: tuple[Rule, ...] = ()
    """Why frames could not begin a part of their own, where something is missing."""
    replaced: tuple[str, ...] = ()
    """Given start values that the observations contradict, which others took the place of."""
    parts: tuple[Join, ...] = ()
    """The parts that began beside the object system, in the order in which they joined another one."""
    frames: tuple[Frame, ...] = ()
    """Images and theodolite sets by the numbers they have in ``parts``."""
    sights: tuple[Sight, ...] = ()
    """Levelled sets by the numbers they have in ``parts``."""
    untied: tuple[Join, ...] = ()
    """Parts that lie where they do because nothing was found that ties them, or not in all movements."""


def untied(parts: tuple[Join, ...], given: bool) -> tuple[Join, ...]:
    """Those that joined the object system as they lay; where nothing was ``given`` the first one became it."""
    into = [join for join in parts if join.into == 0]
    return tuple(join for join in into[0 if given else 1 :] if join.tie is None or join.tie.open)
