"""The domain of each point: the last one that it has rays from, or that of most of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from mor.arrays import IntArray, SmallIntArray
from mor.project.domains.division import Halves
from mor.project.domains.tables import ROWS_AT_A_TIME, Rows, hashed


class OfPoints(NamedTuple):
    """Domain of each point, by a hash of its name: of a hundred million rows a join would look at all names each time.

    Two names with the same hash are in the same domain, which is as good as any other.
    """

    hashes: NDArray[np.uint64]
    """(p,) ascending."""
    domains: SmallIntArray
    rays: NDArray[np.uint32]
    """(p,) how many there are of each."""

    def of(self, names: pl.Series, otherwise: int) -> pl.Series:
        """(n,) domains of names; ``otherwise`` where no ray has one."""
        wanted = hashed(names).to_numpy()
        if len(self.hashes) == 0:
            return pl.repeat(otherwise, len(wanted), dtype=pl.Int32, eager=True)
        # In ascending order what is looked at next is near in memory: of twenty million points an eighth of the time.
        order = np.argsort(wanted)
        at = np.empty(len(wanted), dtype=np.int64)
        at[order] = np.searchsorted(self.hashes, wanted[order])
        at = np.minimum(at, len(self.hashes) - 1)
        return pl.Series(np.where(self.hashes[at] == wanted, self.domains[at], np.int32(otherwise)))


class Cut(NamedTuple):
    """Images divided, and what their points are then."""

    domain: IntArray
    """(n,) of the images."""
    tree: Halves
    points: pl.DataFrame
    """By ascending ``hash`` of the name: ``last`` and ``most``, the last domain with rays of it, and that of most of
    them, the first one of several; number of its ``rays``."""

    @property
    def largest(self) -> float:
        """Rays of the largest domain where all points are in the last one."""
        weights = self.points["rays"].to_numpy().astype(float)
        return float(np.bincount(self.points["last"].to_numpy(), weights=weights).max(initial=0.0))

    def of_points(self, rule: str) -> OfPoints:
        """Domains of the points."""
        return OfPoints(*(self.points[name].to_numpy() for name in ("hash", rule, "rays")))


def divide_points(
    cut: Callable[[int], Cut], count: int, rays_of_domain: int
) -> tuple[IntArray, Halves, OfPoints]:
    """Domain (n,) of the images, the tree of about ``count`` domains, and domains of the points.

    With a point in the last domain that it has rays from, none before it has images of that one: borders are half as
    wide as where a point goes where most of its rays come from, and their dense matrices take an eighth of the time.
    The last domains are larger then, for which a few more of them make up; not where domains are as small as images.
    """
    found = cut(count)
    if found.largest <= rays_of_domain:
        return found.domain, found.tree, found.of_points("last")
    more = cut(int(np.ceil(count * found.largest / rays_of_domain)))
    if more.largest <= rays_of_domain:
        return more.domain, more.tree, more.of_points("last")
    return found.domain, found.tree, found.of_points("most")


def rays_of_points(rows: Rows, divided: list[int], of_images: pl.DataFrame) -> pl.DataFrame:
    """Domains that points have rays from, as :class:`Cut` has them."""
    counts = pl.DataFrame(schema={"hash": pl.UInt64, "domain": pl.Int32, "len": pl.UInt32})
    waiting: list[pl.DataFrame] = []

    def together() -> pl.DataFrame:
        return pl.concat([counts, *waiting]).group_by("hash", "domain").agg(pl.col("len").sum())

    for k in divided:
        for frame in rows("observations", k):
            found = frame.select("image", hash=hashed(frame["point"]))
            found = found.join(of_images, left_on="image", right_on="id", how="left")
            found = found.with_columns(pl.col("domain").fill_null(0))
            waiting.append(found.group_by("hash", "domain").len())
            if sum(part.height for part in waiting) > max(counts.height, ROWS_AT_A_TIME):
                counts, waiting = together(), []
    # Most rays first, then the first domain: the largest of these numbers.
    order = (pl.col("len").cast(pl.Int64) * (_LAST + 1)) + (_LAST - pl.col("domain").cast(pl.Int64))
    first = (_LAST - pl.col("most") % (_LAST + 1)).cast(pl.Int32).alias("most")
    points = (
        together()
        .group_by("hash")
        .agg(
            pl.col("domain").max().alias("last"), order.max().alias("most"), pl.col("len").sum().alias("rays")
        )
    )
    return points.with_columns(first).sort("hash")


_LAST = 2**31 - 1
"""No domain has a larger number."""
