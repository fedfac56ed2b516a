"""CPU time to read a large image block as a binary COLMAP model and as our own tables; for docs/formats/colmap.md.

python benchmarks/reading.py                     a million image points
python benchmarks/reading.py --rays 10000000     ten million: some 3 GB of files, up to 10 GB of memory

The same block four times: binary and text of COLMAP, our tables as CSV and as Parquet. Every one is read, and its
network built, in a process of its own. Coordinates are random: nothing is adjusted.
"""

from __future__ import annotations

import argparse
import json
import resource
import struct
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
from measure import now, run, since

from mor.types import FloatArray, IntArray

_ROOT = Path(__file__).resolve().parent.parent
_PER_POINT, _PER_IMAGE = 10, 5000
_CAMERA = "model: mor, unit: px, coordinates: corner, image: {width: 6000, height: 4000}"
_INTERIOR = "c: {free: 4500}, xh: {fixed: 0}, yh: {fixed: 0}, A1: {free: 5e-10}"
FORMS = ("binary", "text", "csv", "parquet")


class Block:
    """A block by its sizes: image of each ray, in the order of images, its point, place among the image's, pixel."""

    def __init__(self, rays: int) -> None:
        random = np.random.default_rng(1)
        self.points = rays // _PER_POINT
        self.images = max(rays // _PER_IMAGE, _PER_POINT)
        of_point = np.repeat(np.arange(self.points), _PER_POINT)
        step = np.tile(np.arange(_PER_POINT) * (self.images // _PER_POINT), self.points)
        image = (of_point + step) % self.images
        order = np.argsort(image, kind="stable")
        self.image: IntArray = image[order]
        self.point: IntArray = of_point[order]
        self.xy: FloatArray = random.uniform([0, 0], [6000, 4000], (len(image), 2)).round(3)
        self.starts: IntArray = np.searchsorted(self.image, np.arange(self.images + 1))
        place = np.empty(len(image), dtype=np.int64)
        place[order] = np.arange(len(image)) - self.starts[self.image]
        self.tracks: IntArray = np.stack([image + 1, place], axis=1).reshape(self.points, -1)
        self.xyz: FloatArray = random.uniform(0, 100, (self.points, 3)).round(4)

    def of_images(self) -> Iterator[tuple[int, slice]]:
        """Images with their rays."""
        for k in range(self.images):
            yield k, slice(int(self.starts[k]), int(self.starts[k + 1]))


def write_binary(block: Block, folder: Path) -> Path:
    """A COLMAP model in its binary form."""
    (folder / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 1, 2, 6000, 4000, 4500, 3000, 2000, 0.01))
    form = np.dtype([("xy", "<f8", (2,)), ("point", "<i8")])
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", block.images))
        for k, own in block.of_images():
            file.write(struct.pack("<I7dI", k + 1, 0, 1, 0, 0, -k, 0, 50, 1) + f"I{k}.jpg\0".encode())
            file.write(struct.pack("<Q", own.stop - own.start))
            rays = np.zeros(own.stop - own.start, form)
            rays["xy"], rays["point"] = block.xy[own], block.point[own] + 1
            file.write(rays.tobytes())
    form = np.dtype(
        [
            ("id", "<u8"),
            ("xyz", "<f8", (3,)),
            ("rgb", "u1", (3,)),
            ("error", "<f8"),
            ("length", "<u8"),
            ("track", "<u4", (2 * _PER_POINT,)),
        ]
    )
    found = np.zeros(block.points, form)
    found["id"], found["xyz"] = np.arange(block.points) + 1, block.xyz
    found["length"], found["track"] = _PER_POINT, block.tracks
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", block.points) + found.tobytes())
    return folder


def write_text(block: Block, folder: Path) -> Path:
    """A COLMAP model as text."""
    (folder / "cameras.txt").write_text("1 SIMPLE_RADIAL 6000 4000 4500 3000 2000 0.01\n")
    with (folder / "images.txt").open("w") as file:
        for k, own in block.of_images():
            numbers = zip(block.xy[own].tolist(), (block.point[own] + 1).tolist(), strict=True)
            rays = " ".join(f"{x} {y} {p}" for (x, y), p in numbers)
            file.write(f"{k + 1} 0 1 0 0 {-k} 0 50 1 I{k}.jpg\n{rays}\n")
    with (folder / "points3D.txt").open("w") as file:
        for k, (xyz, track) in enumerate(zip(block.xyz.tolist(), block.tracks.tolist(), strict=True)):
            file.write(f"{k + 1} {' '.join(map(str, xyz))} 9 9 9 0.5 {' '.join(map(str, track))}\n")
    return folder


def write_tables(block: Block, folder: Path, end: str) -> Path:
    """A project file of ours with its tables as CSV or Parquet."""
    names = [f"I{k}.jpg" for k in range(block.images)]
    images = {"id": names, "camera": ["1"] * block.images, "x": np.arange(block.images), "y": 0.0, "z": 50.0}
    points = {"id": np.arange(block.points) + 1, **dict(zip("xyz", block.xyz.T, strict=True))}
    rays = {
        "image": pl.Series(names).gather(block.image),
        "point": block.point + 1,
        "x": block.xy[:, 0],
        "y": block.xy[:, 1],
    }
    tables = {"images": {**images, "omega": 0.0, "phi": 0.0, "kappa": 0.0}, "points": points, "rays": rays}
    for name, columns in tables.items():
        frame = pl.DataFrame(columns).with_columns(pl.col(r"^(id|image|point)$").cast(pl.String))
        path = folder / f"{name}.{end}"
        frame.write_csv(path) if end == "csv" else frame.write_parquet(path)
    path = folder / "project.yaml"
    path.write_text(
        f"mor: 1\nunits: {{length: m, angle: rad}}\ncameras: {{'1': {{{_CAMERA}, interior: {{{_INTERIOR}}}}}}}\n"
        f"images: [{{file: images.{end}}}]\npoints: [{{file: points.{end}}}]\ndatum: free\n"
        f"observations: [{{type: image, file: rays.{end}, units: px, values: {{sigma: 1}}}}]\n"
    )
    return path


def read_here(path: Path) -> dict[str, float]:
    """CPU seconds to the document and to the network of a block, and the largest memory (GB), of this process."""
    from mor.api.pipeline import read_document
    from mor.project.network import build_network
    from mor.project.schema import validate

    start = now()
    document = read_document(path)
    read = since(start).cpu
    network = build_network(validate(document), document, path.parent)
    built = since(start).cpu
    rays = sum(len(group.lines) for group in network.groups)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    return {"document_s": read, "network_s": built, "peak_gb": peak, "rays": rays}


def main() -> None:
    """Write, read, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("forms", nargs="*", help=", ".join(FORMS))
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.read is not None:
        print(json.dumps(read_here(given.read)))
        return
    block: Block | None = Block(given.rays)
    with tempfile.TemporaryDirectory() as place:
        paths = {}
        for form in given.forms or FORMS:
            folder = Path(place) / form
            folder.mkdir()
            write = {"binary": write_binary, "text": write_text}.get(form)
            paths[form] = write(block, folder) if write else write_tables(block, folder, form)
        block = None
        for _ in range(given.times):
            for form, path in paths.items():
                command = [sys.executable, __file__, "--read", path]
                done = run(command, Path(place), {"PYTHONPATH": str(_ROOT), "MOR_MAX_FILE_MB": "8000"})
                if done.code:
                    raise SystemExit(done.errors)
                found = json.loads(done.output)
                print(form, {key: round(value, 3) for key, value in found.items()}, flush=True)


if __name__ == "__main__":
    main()
