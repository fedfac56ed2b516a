"""A network in domains has the coordinates, σ, r, w and σ0 of one adjustment of everything."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import polars as pl
import pytest

from mor.adjustment.domains.store import FileStore, MemoryStore
from mor.adjustment.domains.tree import Here
from mor.compilation import chosen_by_size
from mor.domains.prepared import prepared
from mor.domains.story import Outcomes, divided, solved
from mor.pipeline import read_document, read_network, solve_network
from mor.quality.solved import Solved
from mor.report.domains.tables import completed
from mor.report.tables.estimates import image_table, point_table
from mor.report.tables.observations import observation_table
from tests.scenarios.domains_blocks import Kind, write_block
from tests.selection import slow_but

BLOCKS = {
    "aerial": Kind(),
    "aerial, control, CSV": Kind(control=8, table="csv"),
    "aerial, many domains": Kind(strips=4, images=8, points=900),
    "convergent": Kind(convergent=True, points=150),
    "sights, some across the block": Kind(sights=60),
    "free": Kind(convergent=True, points=150, gnss=False, datum="free"),
    "free, over named points": Kind(
        convergent=True, points=150, gnss=False, datum="{free: [P1, P2, P3, P5, P7, P11, P40]}"
    ),
    "eccentric, with control": Kind(control=6, eccentric=True),
    "free, with sights": Kind(gnss=False, sights=60, datum="free"),
}


def both(
    path: Path, work: Path, rays: int, store: MemoryStore | FileStore | None = None
) -> tuple[Solved, Outcomes]:
    """One adjustment of everything, and one in domains of so many rays; parts of the tables are in ``work/parts``."""
    document = read_document(path)
    one = solve_network(read_network(document, path.parent))
    engine = Here(store or MemoryStore())
    with chosen_by_size(one.network.observations), np.errstate(all="ignore"):
        found = divided(document, path.parent, work / "scratch", rays)
        several = solved(engine, prepared(engine, found), work / "parts", "parquet", True)
    completed(work / "parts", [part.shared for part in several.assessed])
    return one, several


def table(work: Path, name: str) -> pl.DataFrame:
    return pl.concat([pl.read_parquet(file) for file in sorted((work / "parts" / name).glob("*.parquet"))])


def largest_difference(ours: pl.DataFrame, theirs: pl.DataFrame, keys: list[str]) -> dict[str, float]:
    """Largest differences of all columns of numbers, in parts of the largest number there; rows by their keys."""
    assert ours.height == theirs.height
    joined = ours.join(theirs, on=keys, how="inner", suffix=" there", nulls_equal=True)
    assert joined.height == ours.height
    found = {}
    for name in (name for name in ours.columns if name not in keys):
        here, there = joined[name], joined[f"{name} there"]
        assert (here.is_null() == there.is_null()).all(), name
        if here.dtype.is_float():
            a, b = here.drop_nulls().to_numpy(), there.drop_nulls().to_numpy()
            found[name] = float(np.abs(a - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), 1e-300))
        else:
            assert here.equals(there, check_names=False), name
    return found


KEYS = ["type", "group", "at", "from", "to", "component"]


@pytest.mark.parametrize("name", slow_but(["aerial"], BLOCKS))
def test_tables_are_the_same(name: str, tmp_path: Path) -> None:
    path = write_block(tmp_path / "project", BLOCKS[name])
    one, several = both(path, tmp_path, 250 if BLOCKS[name].convergent else 700)
    assert len(several.prepared.heads) >= 3
    assert one.quality is not None
    assert several.joined.outcome is one.adjustment.outcome
    assert several.joined.redundancy == one.quality.redundancy
    assert several.whole is not None
    assert several.whole.sigma0 == pytest.approx(one.quality.sigma0, rel=1e-12)
    assert several.redundancy_sum == pytest.approx(several.joined.redundancy, abs=1e-6)
    assert several.joined.null_space.movements == one.adjustment.defect.movements
    # Weakly held free blocks are known to some 1e-9 on one machine, too, whatever the order of its rows.
    close = 1e-8 if name == "free, with sights" else 1e-9
    for what, whole in (("points", point_table(one)), ("images", image_table(one))):
        found = largest_difference(table(tmp_path, what), whole, ["id"])
        found.pop("ellipse_azimuth", None)  # of a round ellipse it is anything
        largest = found.pop("largest_w")
        assert max(found.values()) < close, (what, found)
        assert largest < 1e-6
    ours, theirs = table(tmp_path, "residuals"), observation_table(one)
    controlled = pl.col("r").fill_null(1.0) > 0.01
    found = largest_difference(ours.filter(controlled), theirs.filter(controlled), [*KEYS, "unit", "flag"])
    for column in ("observed", "adjusted", "v", "sigma", "sigma_adjusted", "r"):
        assert found[column] < close, found
    for column in ("w", "nabla", "external", "influence"):
        assert found[column] < 100.0 * close, found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sights", "datum", "full"),
    [(0, "{xyz: [P1, P40], z: P7}", ["P1", "P40"]), (20, "{xyz: P1, x: P40}", ["P1"])],
)
def test_a_minimal_datum(sights: int, datum: str, full: list[str], tmp_path: Path) -> None:
    """What is held has a variance that is zero but for round-off, whose root is no number to compare."""
    held_by = f"{{minimal: {datum}}}"
    kind = Kind(convergent=True, points=150, gnss=False, sights=sights, datum=held_by)
    path = write_block(tmp_path / "project", kind)
    one, several = both(path, tmp_path, 250)
    assert len(several.prepared.heads) >= 2
    held = pl.col("id").is_in(["P1", "P40", "P7"])
    ours, theirs = table(tmp_path, "points"), point_table(one)
    found = largest_difference(ours.filter(~held), theirs.filter(~held), ["id"])
    assert max(found[name] for name in ("x", "y", "z", "sx", "sy", "sz", "ellipse_a", "mean_r")) < 1e-9
    found = largest_difference(ours.filter(held), theirs.filter(held), ["id"])
    assert max(found[name] for name in ("x", "y", "z")) < 1e-12
    largest = ours.select(pl.max_horizontal("sx", "sy", "sz").max()).item()
    both_held = ours.filter(pl.col("id").is_in(full)).select("sx", "sy", "sz").to_numpy()
    assert np.abs(both_held).max() < 1e-6 * largest
    found = largest_difference(table(tmp_path, "images"), image_table(one), ["id"])
    assert max(value for name, value in found.items() if name != "largest_w") < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_random_blocks_with_state_in_files(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(seed)
    kind = Kind(
        strips=int(random.integers(2, 5)),
        images=int(random.integers(3, 8)),
        points=int(random.integers(200, 700)),
        control=int(random.integers(0, 6)),
        sights=int(random.integers(0, 40)),
    )
    path = write_block(tmp_path / "project", kind, seed)
    one, several = both(path, tmp_path, int(random.integers(200, 900)), FileStore(tmp_path / "state"))
    assert one.quality is not None
    assert several.whole is not None
    assert several.whole.sigma0 == pytest.approx(one.quality.sigma0, rel=1e-11)
    found = largest_difference(table(tmp_path, "points"), point_table(one), ["id"])
    assert max(found[name] for name in ("x", "y", "z", "sx", "sy", "sz")) < 1e-9


class Counting(Here):
    """Tells the names of the tasks it has done."""

    done: ClassVar[list[str]] = []

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Do the task."""
        self.done.append(task.__name__)
        return super().submit(task, *arguments)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "fewer"), [("aerial", True), ("free", False)])
def test_small_steps_have_the_matrix_before_and_the_solution_its_own(
    name: str, fewer: bool, tmp_path: Path
) -> None:
    path = write_block(tmp_path / "project", BLOCKS[name])
    engine = Counting(FileStore(tmp_path / "state"))
    engine.done.clear()
    with np.errstate(all="ignore"):
        found = divided(read_document(path), path.parent, tmp_path / "scratch", 250)
        several = solved(engine, prepared(engine, found), tmp_path / "parts", "parquet", True)
    joined, domains = several.joined, len(several.prepared.heads)
    turned = engine.done.count("turn")
    assert (turned > 0) == fewer  # a free network moves into its datum, which its changes do not tell
    factorised = engine.done.count("linearise") + engine.done.count("advance")
    assert factorised + turned == (len(joined.iterations) + (not joined.moved)) * domains
    assert joined.factored == joined.stage


@pytest.mark.slow
def test_an_undetermined_point_is_named(tmp_path: Path) -> None:
    path = write_block(tmp_path / "project", Kind())
    rays = pl.read_parquet(path.parent / "rays.parquet")
    first = rays["point"][0]
    alone = rays.filter(pl.col("point") == first)[:1]
    pl.concat([rays.filter(pl.col("point") != first), alone]).write_parquet(path.parent / "rays.parquet")
    document = read_document(path)
    engine = Here(MemoryStore())
    with np.errstate(all="ignore"):
        ready = prepared(engine, divided(document, path.parent, tmp_path / "scratch", 700))
        found = solved(engine, ready, tmp_path / "parts", "parquet", True)
    assert found.joined.outcome.value == "singular"
    assert {name for _, name, _ in found.joined.loose} == {first}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Kind(), Kind(control=6, sights=20)])
def test_state_goes_as_domains_are_assessed(kind: Kind, tmp_path: Path) -> None:
    path = write_block(tmp_path / "project", kind)
    store = FileStore(tmp_path / "state")
    _, several = both(path, tmp_path, 700, store)
    assert several.whole is not None
    lonely = several.prepared.parts.lonely
    for name in ("domain", "stage", "outer"):
        assert not list((tmp_path / "state").glob(f"{name}/**/*.pickle"))
    assert [file.stem for file in (tmp_path / "state" / "network").iterdir()] == [str(lonely)]
    assert not (tmp_path / "scratch" / "tables").exists()
