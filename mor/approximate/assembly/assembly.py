"""The parts there are, the object system first, and what was tried."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mor.approximate.growth.grow_bundles import ENOUGH
from mor.approximate.growth.seed_bundles import Pairs
from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import Rule
from mor.approximate.parts.scene import Scene
from mor.arrays import BoolArray
from mor.project.network.build import Network


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
    pairs: Pairs | None = None
    reasons: list[Rule] = field(default_factory=list)
    doubtful: int = 0
    """How often a part began with a doubtful pair, or none of the pairs tried led to one."""
    begun: int = 0
    """Parts that have begun so far, the object system aside."""
