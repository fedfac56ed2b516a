"""A part of the network in one coordinate system: what is known of points and frames so far."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mor.approximate.parts.history import Join
from mor.approximate.parts.rule import Rule, rule
from mor.approximate.similarity import Similarity
from mor.arrays import BoolArray, FloatArray, IntArray

_SUM = np.ones(3)


@dataclass(eq=False)
class Part:
    """Known coordinates and poses in one system, and how each came about."""

    points: FloatArray
    """(point blocks, 3) coordinates, NaN where not known."""
    poses: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    """Frame number → (projection centre, rotation D)."""
    kappas: dict[int, float] = field(default_factory=dict)
    """Sight number → κ of a levelled set."""
    how: dict[str, Rule] = field(default_factory=dict)
    """Name → how it was obtained."""
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
    began: Rule = field(default_factory=lambda: rule("what is given"))
    """What it began with."""
    joined: list[Join] = field(default_factory=list)
    """The parts it took up, in the order in which they joined it or one another."""
    placed: set[int] = field(default_factory=set)
    """Points placed one at a time: what takes such a place away again does not have it placed anew."""
    asked_for_vertical: dict[int, int] = field(default_factory=dict)
    """Redundancy with which directions were asked for the vertical → directions there were."""
    asked_for_ties: dict[tuple[int, int], int] = field(default_factory=dict)
    """Part and redundancy with which all observations were asked for the movement to it → observations there were."""
    asked_for_poses: dict[tuple[int, int, bool], int] = field(default_factory=dict)
    """Frame, redundancy and whether one of several will do → conditions there were when it was asked for its pose."""
    place_sigma: float = 0.0
    """σ with which given positions of frames were found to agree with the rays; counts where they have none."""

    @property
    def lifts(self) -> bool:
        """True where heights of instruments and targets count: they act along the vertical, in the length unit."""
        return self.levelled and self.scaled

    @property
    def rank(self) -> tuple[bool, bool, bool, bool, int]:
        """How much it knows of its place, for comparison."""
        return self.given, self.oriented, self.levelled, self.scaled, self.size

    @property
    def size(self) -> int:
        """Number of poses, orientations and coordinates in it."""
        return len(self.poses) + len(self.kappas) + int(np.isfinite(self.points).sum())

    def known(self, points: IntArray) -> BoolArray:
        """(n,) true where all three coordinates are known."""
        # Whatever is not finite shows in the sum, and that is twice as fast.
        return np.asarray(np.isfinite(self.points.take(points, axis=0) @ _SUM))

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


def empty_part(points: int) -> Part:
    """A part of which nothing is known."""
    return Part(
        np.full((points, 3), np.nan),
        seen_by=np.full(points, -1, dtype=np.int64),
        fixed=np.zeros(points, dtype=bool),
        sigma=np.full((points, 3), np.nan),
    )
