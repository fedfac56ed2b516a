"""Image blocks of a hundred million image points, as project folders of Parquet, written strip by strip.

The block is that of ``scenes.aerial``, and is never in memory as a whole: ground points are drawn band by band, a band
as wide as the strips are apart, and a strip sees the bands around it.

    python benchmarks/large_blocks.py 288 289 /data/block        # strips, images in a strip: 108 million image points
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from folders import images_of_block, names, project_of_block
from polars.io.plugins import register_io_source
from scenes import SIGMA_CENTRE, SIGMA_IMAGE, project

from mor.model.rotations import rotation_from_angles
from mor.types import FloatArray, IntArray

ALONG, ACROSS = 180.0, 280.0
"""m from image to image, and from strip to strip."""
POINTS = 239
"""Ground points for each image."""
SEEN = 0.468
"""Part of its points that an image shows."""
REACH = 2
"""Bands to either side of its own that a strip sees."""
_ROWS = 500_000
"""Of a row group."""
_RAYS = {"image": pl.String, "point": pl.String, "x": pl.Float64, "y": pl.Float64}


class Band(NamedTuple):
    """Ground points between two strips, sorted by x."""

    point: FloatArray
    rays: IntArray
    """(p,) of each point so far."""


class Strip(NamedTuple):
    """Images of a strip, and what they have measured: n image points."""

    centre: FloatArray
    angles: FloatArray
    image: IntArray
    """(n,) places in the strip."""
    band: IntArray
    of_point: IntArray
    """(n,) places in the band."""
    xy: FloatArray


@dataclass(frozen=True)
class LargeBlock:
    """A block to be drawn: strips of so many images, every part of it from a seed of its own."""

    strips: int
    images: int
    seed: int = 1

    @property
    def width(self) -> int:
        """Ground points of a band."""
        return POINTS * self.images

    def band(self, b: int) -> Band:
        """The ground points around strip b."""
        rng = np.random.default_rng([self.seed, 0, b + REACH])
        x = np.sort(rng.uniform(-300.0, self.images * ALONG + 300.0, self.width))
        y = rng.uniform((b - 0.5) * ACROSS, (b + 0.5) * ACROSS, self.width)
        point = np.column_stack([x, y, rng.uniform(0.0, 80.0, self.width)])
        return Band(point, np.zeros(self.width, dtype=np.int64))

    def strip(self, j: int, bands: dict[int, Band]) -> Strip:
        """Strip j, whose rays are counted in the bands."""
        rng = np.random.default_rng([self.seed, 1, j])
        centre = np.array([[i * ALONG, j * ACROSS, 1000.0] for i in range(self.images)])
        centre = centre + rng.normal(0.0, 5.0, centre.shape)
        angles = rng.normal(0.0, 0.02, centre.shape)
        D = rotation_from_angles(angles)
        found = []
        for i, X0 in enumerate(centre):
            for b in range(j - REACH, j + REACH + 1):
                point = bands[b].point
                low, high = np.searchsorted(point[:, 0], [X0[0] - 550.0, X0[0] + 550.0])
                # the polynomial of the distortion folds points far outside the picture back into it
                rows = low + np.flatnonzero(np.abs(point[low:high, 1] - X0[1]) < 450.0)
                xy = project((point[rows] - X0) @ D[i].T)
                inside = (np.abs(xy[:, 0]) < 45.0) & (np.abs(xy[:, 1]) < 35.0) & (rng.random(len(xy)) < SEEN)
                rows = rows[inside]
                bands[b].rays[rows] += 1
                found.append((np.full(len(rows), i), np.full(len(rows), b), rows, xy[inside]))
        image, band, of_point, xy = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Strip(centre, angles, image, band, of_point, xy + rng.normal(0.0, SIGMA_IMAGE, xy.shape))

    def rays(self, j: int, strip: Strip, bands: dict[int, Band]) -> pl.DataFrame:
        """Image points of a strip, of the points that two images have at least."""
        rays = np.zeros(len(strip.band), dtype=np.int64)
        for b in range(j - REACH, j + REACH + 1):
            here = strip.band == b
            rays[here] = bands[b].rays[strip.of_point[here]]
        kept = rays >= 2
        return pl.DataFrame(
            {
                "image": names("I", j * self.images + strip.image[kept]),
                "point": names("P", (strip.band[kept] + REACH) * self.width + strip.of_point[kept]),
                "x": strip.xy[kept, 0],
                "y": strip.xy[kept, 1],
            }
        )

    def points(self, b: int, band: Band) -> pl.DataFrame:
        """Start values of the points of a band that two images have at least."""
        start = band.point + np.random.default_rng([self.seed, 2, b + REACH]).normal(0.0, 0.1, band.point.shape)
        kept = np.flatnonzero(band.rays >= 2)
        columns = {axis: start[kept, k] for k, axis in enumerate("xyz")}
        return pl.DataFrame({"id": names("P", (b + REACH) * self.width + kept), **columns})


def write(block: LargeBlock, folder: Path) -> Path:
    """Write the project folder of a block; returns the project file."""
    parts = folder / "points"
    parts.mkdir(parents=True)
    poses: list[tuple[FloatArray, FloatArray]] = []

    def points(b: int, band: Band) -> None:
        block.points(b, band).write_parquet(parts / f"{b + REACH:05d}.parquet")

    def rays() -> Iterator[pl.DataFrame]:
        bands: dict[int, Band] = {}
        strips: dict[int, Strip] = {}
        for j in range(block.strips + 2 * REACH):
            if j < block.strips:
                for b in range(j - REACH, j + REACH + 1):
                    bands[b] = bands.get(b) or block.band(b)
                strips[j] = block.strip(j, bands)
                poses.append((strips[j].centre, strips[j].angles))
            done = j - 2 * REACH  # no later strip sees the bands of this one
            if done >= 0:
                yield block.rays(done, strips.pop(done), bands)
                points(done - REACH, bands.pop(done - REACH))
        for b, band in bands.items():
            points(b, band)

    def source(
        columns: list[str] | None, predicate: pl.Expr | None, rows: int | None, batch: int | None
    ) -> Iterator[pl.DataFrame]:
        return rays_drawn

    rays_drawn = rays()
    register_io_source(source, schema=_RAYS).sink_parquet(folder / "rays.parquet", row_group_size=_ROWS)
    pl.scan_parquet(parts / "*.parquet").sink_parquet(folder / "points.parquet", row_group_size=_ROWS)
    for path in parts.iterdir():
        path.unlink()
    parts.rmdir()
    centre, angles = (np.concatenate(some) for some in zip(*poses, strict=True))
    rng = np.random.default_rng([block.seed, 3])
    images_of_block(
        centre + rng.normal(0.0, SIGMA_CENTRE, centre.shape),
        centre + rng.normal(0.0, 0.1, centre.shape),
        angles + rng.normal(0.0, 1e-4, angles.shape),
    ).write_parquet(folder / "images.parquet")
    return project_of_block(folder, len(centre), "parquet")


if __name__ == "__main__":
    strips, images, folder = sys.argv[1:]
    print(write(LargeBlock(int(strips), int(images)), Path(folder)))
