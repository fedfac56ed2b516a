"""A trajectory: times and blocks of its knots, and which of them a pose at a time depends on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.trajectory import cubic_weights, linear_weights
from mor.observations.time.trajectory import CUBIC, LINEAR


class Clock(NamedTuple):
    """n times on a trajectory, each from its k knots."""

    knots: IntArray
    """(n, k) numbers of the knots in the trajectory, first the one before the time."""
    constants: FloatArray
    """(n, 1 + k²) time since that knot, and the weights as polynomials of it."""
    inside: BoolArray
    """(n,) false where the trajectory is not known: before, behind, in a gap."""


class Scanner(NamedTuple):
    """A camera that is a line scanner."""

    line_time: float
    """Seconds from one line to the next; NaN if its images have tables of their times."""
    line: float
    """y of the line in the axes of the camera, image unit."""


class Lines(NamedTuple):
    """Times of rows of an image of a line scanner, counted from its upper edge; linear in between."""

    rows: FloatArray
    times: FloatArray
    steady: bool = False
    """True if they say a rate that goes on before and behind."""


class Trajectory(NamedTuple):
    """Knots of a trajectory, in the order of their times."""

    name: str
    times: FloatArray
    """(k,) ascending."""
    stretch: IntArray
    """(k,) number of the stretch a knot belongs to; between stretches there is nothing."""
    positions: IntArray
    """(k,) point blocks."""
    rotations: IntArray
    """(k,) rotation blocks."""
    cubic: bool

    @property
    def order(self) -> int:
        """Knots that a pose depends on."""
        return CUBIC if self.cubic else LINEAR

    def clock(self, times: FloatArray, later: FloatArray | None = None) -> Clock:
        """Where times (n,) are; outside the trajectory anything finite.

        Where something is seen so much ``later`` (n,), or before, the knots are those about then, within the stretch.
        """
        before = self._before(times)
        whole = self.stretch[before] == self.stretch[before + 1]
        inside = whole & (times >= self.times[before]) & (times <= self.times[before + 1])
        if later is not None:
            here = self.stretch[before]
            first, last = (np.searchsorted(self.stretch, here, side=side) for side in ("left", "right"))
            before = np.clip(self._before(times + later), first, np.maximum(last - LINEAR, first))
        if not self.cubic:
            knots = before[:, None] + np.arange(LINEAR)
            weights = linear_weights(self.times[before + 1] - self.times[before])
        else:
            knots, weights = self._four(before)
        since = (times - self.times[before])[:, None]
        return Clock(
            knots, np.concatenate([since, weights.reshape(len(times), -1)], axis=1), np.asarray(inside)
        )

    def _before(self, times: FloatArray) -> IntArray:
        """(n,) the knots before times; the last of a stretch belongs to the interval that it ends."""
        before = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        ends = (self.stretch[before] != self.stretch[before + 1]) & (times == self.times[before])
        return np.asarray(np.maximum(before - ends, 0))

    def _four(self, before: IntArray) -> tuple[IntArray, FloatArray]:
        """The knots about intervals that begin at ``before`` (n,), that knot first, and their weights."""
        count = np.bincount(self.stretch)
        first = (np.cumsum(count) - count)[self.stretch[before]]
        last = first + count[self.stretch[before]] - CUBIC
        begin = np.clip(before - 1, first, np.maximum(last, first))
        place = np.minimum(before - begin, CUBIC - 2)
        four = np.minimum(begin[:, None] + np.arange(CUBIC), len(self.times) - 1)
        order = np.stack([(place + k) % CUBIC for k in range(CUBIC)], axis=1)
        weights = np.take_along_axis(cubic_weights(self.times[four], place), order[:, :, None], axis=1)
        return np.take_along_axis(four, order, axis=1), weights

    def blocks(self, clock: Clock) -> IntArray:
        """(2k, n) blocks of the knots, positions first."""
        return np.concatenate([self.positions[clock.knots].T, self.rotations[clock.knots].T])

    def outside(self, time: float) -> str:
        """Words for a time at which the trajectory is not known."""
        known = f"it is known from {said_time(self.times[0])} to {said_time(self.times[-1])}"
        gaps = np.flatnonzero(np.diff(self.stretch))
        here = gaps[(self.times[gaps] < time) & (time < self.times[gaps + 1])]
        if len(here):
            a, b = (said_time(self.times[here[0] + k]) for k in (0, 1))
            known = f"it has a gap from {a} to {b}"
        return f"the time {said_time(time)} is outside the trajectory {self.name!r}: {known}"


def said_time(time: float) -> str:
    """A time in words, seconds."""
    return f"{time:.12g} s"


def knot_name(trajectory: str, time: float) -> str:
    """What a knot is called in reports."""
    return f"{trajectory}@{time:.12g}"
