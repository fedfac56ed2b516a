"""Times of plans: candidates of a large block ranked, and a greedy plan of many steps.

python benchmarks/planning.py                    both
python benchmarks/planning.py block --candidates 100000
python benchmarks/planning.py greedy --steps 100
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import polars as pl

sys.path.insert(0, str(Path(__file__).parents[1]))

from folders import write_block
from scenes import SIGMA_IMAGE, Block, aerial, project

from mor.api.design import ranking
from mor.api.pipeline import read_document
from mor.api.plan import at_its_place, read_plan, solve_plan
from mor.model.rotations import rotation_from_angles
from mor.plan.requirements import requirements

Result = TypeVar("Result")
_STRIPS, _IN_STRIP = 20, 25
_STATIONS, _TARGETS = 60, 30


def timed(what: str, work: Callable[[], Result]) -> Result:
    """The result of some work, whose wall and CPU time are printed."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = work()
    print(f"{what:<44} {time.perf_counter() - wall:8.2f} s   CPU {time.process_time() - cpu:8.2f} s", flush=True)
    return found


def unseen(block: Block, count: int, seed: int) -> pl.DataFrame:
    """Rays that the block does not have, of points on the format of an image: names, ``count`` of them."""
    rng = np.random.default_rng(seed)
    D = rotation_from_angles(block.angles)
    seen = set(zip(block.image.tolist(), block.of_point.tolist(), strict=True))
    used = np.unique(block.of_point)
    pairs: list[tuple[int, int]] = []
    for k in rng.permutation(len(block.centre)).tolist():
        near = used[(np.abs(block.point[used] - block.centre[k])[:, :2] < (550.0, 450.0)).all(axis=1)]
        xy = np.abs(project((block.point[near] - block.centre[k]) @ D[k].T))
        inside = near[(xy[:, 0] < 45.0) & (xy[:, 1] < 35.0)]
        pairs += [(k, p) for p in inside.tolist() if (k, p) not in seen]
    chosen = rng.permutation(len(pairs))[:count]
    return pl.DataFrame({"image": [f"I{pairs[c][0]}" for c in chosen], "point": [f"P{pairs[c][1]}" for c in chosen]})


def rank_block(folder: Path, count: int) -> None:
    """Rank candidates of an aerial block of 500 images."""
    block = aerial(_STRIPS, _IN_STRIP)
    path = write_block(block, folder)
    unseen(block, count, 1).write_csv(folder / "candidates.csv")
    wanted = ", ".join(f"P{k}" for k in np.unique(block.of_point)[:: len(block.point) // 20][:20])
    with path.open("a", encoding="utf-8") as file:
        file.write(
            f"candidates: [{{type: image, file: candidates.csv, values: {{sigma: '{SIGMA_IMAGE}'}}}}]\n"
            f"require: {{sigma: {{points: [{wanted}], xyz: 10 mm}}}}\n"
            "settings: {undetermined: leave_out}\n"
        )
    _report(path, 0)


def greedy_network(folder: Path, steps: int) -> None:
    """A greedy plan in a network of 60 stations."""
    rng = np.random.default_rng(1)
    count = _STATIONS + _TARGETS
    xyz = np.column_stack([rng.uniform(0.0, 3000.0, (count, 2)), rng.uniform(0.0, 150.0, count)])
    distance = np.hypot(*(xyz[:, None, :2] - xyz[None, :, :2]).transpose(2, 0, 1))
    order = np.argsort(distance, axis=1)[:, 1:]
    planned = {(a, int(b)) for a in range(_STATIONS) for b in order[a, :5]}
    further = [(a, int(b)) for a in range(_STATIONS) for b in order[a, 5:20]]
    points = ", ".join(f"[P{k}, {x:.3f}, {y:.3f}, {z:.3f}]" for k, (x, y, z) in enumerate(xyz))
    text = f"""mor: 1
points: [{{columns: [id, x, y, z], rows: [{points}]}}]
observations:
  - {_sights("zenith_directions", "station", sorted(planned), "{sigma_horizontal: 1 mgon, sigma_zenith: 1 mgon}")}
  - {_sights("distance", "from", sorted(planned), "{sigma: 2 mm}")}
candidates:
  - {_sights("distance", "from", further, "{sigma: 2 mm}")}
datum: free
settings: {{undetermined: leave_out}}
require: {{sigma: {{xyz: 0.1 mm}}, reliability: {{r: 0.2}}}}
"""
    path = folder / "project.yaml"
    path.write_text(text, encoding="utf-8")
    _report(path, steps)


def _sights(kind: str, first: str, pairs: list[tuple[int, int]], sigma: str) -> str:
    rows = ", ".join(f"[P{a}, P{b}]" for a, b in pairs)
    return f"{{type: {kind}, columns: [{first}, to], values: {sigma}, rows: [{rows}]}}"


def _report(path: Path, steps: int) -> None:
    document = timed("project read", lambda: read_document(path))
    network = timed("tables read, its place", lambda: at_its_place(read_plan(document, path.parent).network))
    required = requirements(network)
    solved = timed("plan adjusted and assessed", lambda: solve_plan(network))
    quality = solved.quality
    assert quality is not None
    print(
        f"{len(network.things['image'].ids)} images, {len(network.things['station'].ids)} stations, "
        f"{solved.adjustment.problem.observations} observations, {quality.adjustment.problem.index.count} unknowns"
    )
    found = timed("candidates ranked", lambda: ranking(solved, required, 0))
    print(f"{len(found.candidates)} candidates, {len(found.planned)} planned rows ranked")
    if steps:
        chosen = timed(f"candidates and {steps} greedy steps", lambda: ranking(solved, required, steps))
        print(f"{len(chosen.steps)} steps")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", choices=["block", "greedy", []], help="both where nothing is named")
    parser.add_argument("--candidates", type=int, default=100_000)
    parser.add_argument("--steps", type=int, default=100)
    given = parser.parse_args()
    for what in given.what or ["block", "greedy"]:
        print(f"\n{what}")
        with tempfile.TemporaryDirectory() as place:
            if what == "block":
                rank_block(Path(place), given.candidates)
            else:
                greedy_network(Path(place), given.steps)


if __name__ == "__main__":
    main()
