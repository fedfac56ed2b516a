"""The quality of a domain once the whole is solved, and its part of the tables."""

from __future__ import annotations

import gc
import secrets
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import polars as pl

from mor.adjustment.domains.store import Store
from mor.domains.reweighting import InWeights
from mor.domains.robust import Light
from mor.domains.settling import Solution, quality_of
from mor.domains.snooping import kept_out
from mor.machine import give_back_freed_memory, largest_resident
from mor.project.domains.part_network import PartNetwork
from mor.quality.assess import Quality
from mor.quality.diagnosis.self_check import beyond_use
from mor.quality.gross_errors.data_snooping import Snooped, Snooping
from mor.quality.solved import Solved
from mor.quality.treatment import Treatment
from mor.quality.variance_components.simplified import components
from mor.report.domains.contribution import Contribution, contribution
from mor.report.domains.starts import Start, place_of, start_parts
from mor.report.results.adjusted.start_columns import Placed
from mor.report.results.folder import Writer
from mor.report.results.json import INLINE, entries
from mor.report.tables.control import sums_of_control
from mor.report.tables.estimates import image_table, point_table, reference_table
from mor.report.tables.files import residual_writer, table_writer
from mor.report.tables.observations import observation_table
from mor.report.tables.shared import forget
from mor.report.tables.worst import worst_residuals

Kind = Literal["csv", "parquet"]
WORST = 10_000


class Rounds(NamedTuple):
    """What data snooping did, in all domains."""

    sigma0_before: float
    steps: tuple[Snooped, ...]
    clean: bool


class Order(NamedTuple):
    """What is wanted of every domain."""

    solution: Solution
    folder: Path
    """Where the parts of the tables are written."""
    kind: Kind
    residuals: bool
    """True where parts of the table of all residuals are written."""
    few: bool
    """True where these may be few enough to stand in ``results.json``."""
    images: int
    """Number of images of the whole."""
    rounds: Rounds | None = None
    components: InWeights | None = None
    light: Light | None = None


class Assessed(NamedTuple):
    """What a domain adds to the summary."""

    redundancy: float
    """Σ r."""
    flagged: int
    added: Contribution
    """To ``results.json``."""
    starts: tuple[Start, ...]
    """Tables of the adjusted project that it has written its part of."""
    worst: pl.DataFrame
    few: pl.DataFrame | None
    """All residuals, where they are few."""
    shared: dict[str, pl.DataFrame]
    """Sums over the observations of points and images that several domains have, by ``points``, ``images``."""
    useless: tuple[tuple[str, str, int], ...]
    """Unknowns whose σ is larger than the domain they live in."""
    resident: float
    """Largest resident size of the process so far."""


def assess_domain(store: Store, d: int, order: Order) -> Assessed:
    """Quality of a domain, cofactors of its outer unknowns being in the store; its parts of the tables are written."""
    gc.collect()  # what is left of the domain before goes first
    give_back_freed_memory()  # tables are not made with it
    part: PartNetwork = store.load(f"network/{d}")
    quality = quality_of(store, d, order.solution)
    snooping, numbers = _snooping(store, d, quality, order.rounds)
    iterated, light = order.components, order.light
    found = iterated.of(quality.adjustment.problem) if iterated is not None else components(quality)
    robust = light.of(quality, d) if light is not None else None
    solved = Solved(part.network, quality.adjustment, quality, Treatment(found, snooping, robust))
    tables = {
        "points": point_table(solved),
        "images": image_table(solved),
        "reference": reference_table(solved),
    }
    foreign = {"images": part.foreign["image"]}
    for name, frame in tables.items():
        names = pl.Series("id", sorted(foreign.get(name, part.foreign["point"])), dtype=pl.String)
        _write_part(order.folder / name, d, frame.filter(~pl.col("id").is_in(names.implode())))
    starts = start_parts(Placed(part.network, solved.adjustment.values), part.tables, part.foreign)
    for start, frame in starts:
        _write_part(order.folder / place_of(start.section, start.table), d, frame)
    shared = {"points": part.shared["point"], "images": part.shared["image"]}
    assessed = Assessed(
        quality.redundancy_sum,
        int(sum(int(np.count_nonzero(flags)) for flags in quality.flagged)),
        contribution(solved, dict(part.shared), part.foreign["point"], d, order.images)._replace(
            steps=numbers
        ),
        tuple(start for start, _ in starts),
        worst_residuals(solved, WORST),
        observation_table(solved) if order.few and entries(solved) <= INLINE else None,
        {name: sums_of_control(solved, name[:-1], sorted(some)) for name, some in shared.items()},
        tuple((kind, name, 0) for one in beyond_use(quality) for kind, name, _ in one.unknowns),
        0.0,
    )
    forget(solved)  # the long table has the room of all others
    if order.residuals:
        place = order.folder / "residuals"
        place.mkdir(parents=True, exist_ok=True)
        _written(residual_writer(solved, order.kind, lambda rows: None), place / f"{d:05d}.{order.kind}")
    return assessed._replace(resident=largest_resident())


def _write_part(folder: Path, d: int, frame: pl.DataFrame) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    _written(table_writer(frame, "parquet"), folder / f"{d:05d}.parquet")


def _written(write: Writer, path: Path) -> None:
    """Write a file beside its place first: it is there as a whole, whoever else writes it."""
    beside = path.with_name(f".{secrets.token_hex(4)}.part")
    write(beside)
    beside.replace(path)


def _snooping(
    store: Store, d: int, quality: Quality, rounds: Rounds | None
) -> tuple[Snooping | None, tuple[int, ...]]:
    """What data snooping did in a domain, and the numbers of these steps among those of all."""
    if rounds is None:
        return None, ()
    numbers = tuple(k for k, step in enumerate(rounds.steps) if step.part == d)
    steps = tuple(rounds.steps[k] for k in numbers)
    return Snooping(rounds.sigma0_before, kept_out(store, d), quality, steps, rounds.clean), numbers
