"""What became of a relative orientation, as data."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from mor.arrays import BoolArray, FloatArray


class RelativeOutcome(Enum):
    """How far the orientation is known, in words."""

    DETERMINED = "one orientation fits, with all points in front of both bundles"
    AMBIGUOUS = (
        "several orientations fit equally well; a further image, a distance or a known attitude decides"
    )
    WEAK = (
        "the orientation fits, but so loosely that its standard deviations do not hold: more base, or points better "
        "spread"
    )
    TOO_FEW = "fewer than eight homologous points"
    INVALID = "a ray is zero or not a number, or the bundles differ in length"
    COLLINEAR = "the points lie in one line, in one of the bundles or both"
    IDENTICAL = "the two bundles are identical: the same image twice"
    NO_BASE = "no base: the second bundle is the first one turned; its attitude is known, the base is open"
    BEHIND = "no orientation has the points in front of both bundles: wrong pairs, or a camera looking away"
    MIRRORED = "one bundle is mirrored: with its coordinates reversed the points would lie in front of both"
    DOES_NOT_FIT = (
        "the rays do not meet within their precision: wrong pairs, a wrong focal length or a mirrored image"
    )

    @property
    def usable(self) -> bool:
        """True if the orientation can serve as a start value."""
        return self in (RelativeOutcome.DETERMINED, RelativeOutcome.WEAK, RelativeOutcome.AMBIGUOUS)


class SceneGeometry(Enum):
    """What the points are, as far as it bears on the linear system (5)."""

    GENERAL = "points in general position"
    PLANE = "all points in one plane: the linear system loses three ranks; solved as a plane object"
    CRITICAL_SURFACE = (
        "points and both centres on a ruled quadric (critical surface) or nearly so: the linear system loses "
        "rank; solved with the compatibility conditions"
    )
    UNKNOWN = "not examined"


class Candidate(NamedTuple):
    """One of the four orientations that fulfil the coplanarity conditions alike."""

    base: FloatArray
    """(3,) unit vector in A."""
    rotation: FloatArray
    """(3, 3) D*."""
    in_front_of_a: int
    in_front_of_b: int
    in_front_of_both: int


class RelativeOrientation(NamedTuple):
    """Frame B in frame A: X_B = D* (X_A − b), |b| = 1."""

    outcome: RelativeOutcome
    geometry: SceneGeometry
    points: int
    base: FloatArray
    """(3,)"""
    rotation: FloatArray
    """(3, 3) D*."""
    angles: FloatArray
    """(3,) ω*, φ*, κ* in radians."""
    covariance: FloatArray
    """(6, 6) of b and the small rotation δ, for the a-priori σ of the rays; along b of second order."""
    sigma_base: FloatArray
    """(3,)"""
    sigma_angles: FloatArray
    """(3,) of ω*, φ*, κ* in radians; infinite at φ* = ±100 gon."""
    sigma0: float
    """√(Σ (v/σ)² / (n − 5)): 1 where the rays are as good as their σ."""
    residuals: FloatArray
    """(n,) residual coplanarity: signed length of the corrections of a pair, in units of σ."""
    front: BoolArray
    """(n, 2) the point is in front of A, of B."""
    candidates: tuple[Candidate, ...]
    """The four candidates, the chosen one first."""
    alternatives: tuple[Candidate, ...]
    """Other orientations that fit about as well, if the outcome is ambiguous."""
    unknowns: FloatArray
    """(3, 3) Rinner's ik of the adjusted orientation."""
    singular_values: FloatArray
    """(9,) of the linear system in units of σ, descending; the last belongs to the solution."""
    plane_orientations: tuple[Candidate, ...] = ()
    """Of points in one plane: the two orientations that carry it over, the one nearest to the result first."""

    @property
    def words(self) -> str:
        """Outcome in words, with what is special about the points."""
        general = self.geometry in (SceneGeometry.GENERAL, SceneGeometry.UNKNOWN)
        return self.outcome.value if general else f"{self.outcome.value} ({self.geometry.value})"
