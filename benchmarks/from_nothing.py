"""Start values of image blocks beside their adjustment.

    python benchmarks/from_nothing.py aerial 20 25 [--given positions|nothing|all]
    python benchmarks/from_nothing.py convergent 500 20000 30 --given nothing

The block is written as Parquet tables: names of images and points, rays, and the positions of the images as measured (σ
5 cm, the camera free), or nothing at all (the camera fixed, a free network), or positions and start values of
everything. Reading, start values and adjustment are timed in CPU seconds, kernels being loaded.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
from multiprocessing import get_context
from pathlib import Path

from folders import write_block
from measure import now, since
from scenes import Block, make

from mor.api.pipeline import determinable_start, make_problem, read_document, read_network
from mor.linalg.cholesky import one_thread
from mor.linalg.compilation import chosen_by_size
from mor.solve.iterate import adjust

_SMALL = 4, 8
"""Strips and images of a block by which kernels are loaded before anything is timed."""


def write(scene: str, sizes: tuple[int, ...], given: str, folder: Path) -> None:
    """Write a block into a folder."""
    block = make(scene, sizes)
    assert isinstance(block, Block)
    write_block(block, folder, "parquet", started=given == "all", positions=given != "nothing")


def time_block(project: Path) -> str:
    """Figures of a project, as words."""
    begin = now()
    network = read_network(read_document(project), project.parent)
    reading, begin = since(begin).cpu, now()
    with chosen_by_size(network.observations):
        with one_thread():
            network, start = determinable_start(network)
        started, begin = since(begin).cpu, now()
        adjustment = adjust(make_problem(network, start, start), start)
        adjusted = since(begin).cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    return (
        f"{network.observations} observations, {len(start['point'])} points with those of images: "
        f"reading {reading:.2f}, start values {started:.2f}, adjustment {adjusted:.2f} "
        f"({len(adjustment.iterations)} iterations, {adjustment.outcome.value}), ratio {started / adjusted:.2f}, "
        f"v'Pv {adjustment.normals.objective:.12g}, {peak:.2f} GB"
    )


def main() -> None:
    """Print one line for a block."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", choices=("aerial", "convergent"))
    parser.add_argument("sizes", type=int, nargs="+")
    parser.add_argument("--given", choices=("positions", "nothing", "all"), default="positions")
    asked = parser.parse_args()
    sizes = tuple(asked.sizes)
    with tempfile.TemporaryDirectory() as folder:
        small, large = Path(folder) / "small", Path(folder) / "large"
        write("aerial", _SMALL, "positions", small)
        time_block(small / "project.yaml")
        apart = get_context("spawn").Process(target=write, args=(asked.scene, sizes, asked.given, large))
        apart.start()  # in a process of its own, whose memory is not that of the adjustment
        apart.join()
        print(f"{asked.scene} {sizes}, given: {asked.given}; {time_block(large / 'project.yaml')}", flush=True)


if __name__ == "__main__":
    main()
