"""Start values of image blocks beside their adjustment, for docs/start-values.md.

    python benchmarks/from_nothing.py aerial 20 25 [--given positions|nothing]
    python benchmarks/from_nothing.py convergent 500 20000 30 --given nothing

The block is written as tables without start values: names of images and points, rays, and the positions of the images
as measured (σ 5 cm, the camera free) or nothing at all (the camera fixed, a free network). Reading, start values,
adjustment and the whole assessment are timed in CPU seconds, kernels being loaded.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
from pathlib import Path

from folders import write_block
from measure import now, since
from scenes import Block, make

from mor.adjustment.solve import adjust
from mor.compilation import chosen_by_size
from mor.pipeline import levels, read_document, read_network
from mor.preparation import determinable_start, make_problem
from mor.quality.assess import assess
from mor.sparse.blas_threads import one_thread

_SMALL = 4, 8
"""Strips and images of a block by which kernels are loaded before anything is timed."""


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
        adjusted, begin = since(begin).cpu, now()
        quality = assess(adjustment, levels(network.project.settings), False)
        assessed = since(begin).cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    return (
        f"reading {reading:.2f}, start values {started:.2f}, adjustment {adjusted:.2f} "
        f"({len(adjustment.iterations)} iterations, {adjustment.outcome.value}), assessment {assessed:.2f}, "
        f"ratio {started / adjusted:.2f}, v'Pv {quality.omega:.10g}, peak {peak:.2f} GB"
    )


def main() -> None:
    """Print one line for a block."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", choices=("aerial", "convergent"))
    parser.add_argument("sizes", type=int, nargs="+")
    parser.add_argument("--given", choices=("positions", "nothing"), default="positions")
    asked = parser.parse_args()
    positions = asked.given == "positions"
    with tempfile.TemporaryDirectory() as folder:
        small, large = Path(folder) / "small", Path(folder) / "large"
        for where, name, sizes in ((small, "aerial", _SMALL), (large, asked.scene, tuple(asked.sizes))):
            block = make(name, sizes)
            assert isinstance(block, Block)
            write_block(block, where, "parquet", started=False, positions=positions)
            rays = len(block.image)
            words = f"{name} {sizes}, {len(block.centre)} images, {len(block.point)} points, {rays} rays"
            del block
            line = time_block(where / "project.yaml")
        print(f"{words}, given: {asked.given}: {line}")


if __name__ == "__main__":
    main()
