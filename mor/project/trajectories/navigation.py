"""Tables of satellites and inertial systems: positions and attitudes of trajectories at any times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationGroup, ObservationType
from mor.observations.names import coded, names_of
from mor.observations.time.navigation import ATTITUDE, POSITION, trajectory_attitude, trajectory_position
from mor.observations.time.trajectory import CUBIC, LINEAR
from mor.parameters.kinds import ATTITUDE_SHIFT, POSITION_SHIFT, BlockKind
from mor.project.axes import external
from mor.project.edge import Edge
from mor.project.file.model import Observations
from mor.project.network.entities import unknown_name
from mor.project.network.reading import Reading
from mor.project.observations.observation_rows import Group, group_name, own_or_common, sigma_is_good
from mor.project.observations.planned_rows import planned_rows
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import number_column, settings
from mor.project.tables.tables import Column, Place, Rows
from mor.project.trajectories.model import Clock, knot_name
from mor.units import TIME

NAVIGATION = {POSITION: trajectory_position, ATTITUDE: trajectory_attitude}
"""Types a project names, and what makes one for a number of knots."""
_SHIFTS = {POSITION: (POSITION_SHIFT, "position"), ATTITUDE: (ATTITUDE_SHIFT, "attitude")}


def navigation_columns(key: str, edge: Edge) -> list[Column]:
    """Columns of a table of this type."""
    components = NAVIGATION[key](LINEAR).components
    return [
        Column("trajectory", required=True),
        number_column("time", TIME, edge, required=True),
        Column("strip"),
        *(number_column(c.name, c.quantity, edge) for c in components),
        *(number_column(f"sigma_{c.name}", c.quantity, edge) for c in components),
        number_column("sigma", components[0].quantity, edge),
    ]


def navigation_groups(
    reading: Reading, entry: Observations, number: int, rows: Rows, place: Place
) -> list[Group]:
    """One group for each kind of interpolation that the trajectories of an entry have."""
    if entry.covariance is not None or entry.cluster is not None or entry.ppm or entry.centring:
        words = f"{entry.type} takes no covariance, cluster, ppm or centring"
        reading.problems.append(place.problem(words))
        return []
    if reading.planned:
        measured = [component.name for component in NAVIGATION[entry.type](LINEAR).components]
        rows = planned_rows(rows, measured, reading, group_name(entry, number))
    names = rows.text("trajectory")
    if not known_trajectories(reading, names, rows):
        return []
    shifts = _shifts(reading, entry, rows, place)
    if shifts is None:
        return []
    result = []
    for order in (LINEAR, CUBIC):
        own = np.array([reading.trajectories[name].order == order for name in names])
        if own.any():
            group = _group(reading, entry, number, rows, np.flatnonzero(own), shifts)
            result += [group] if group is not None else []
    return result


def known_trajectories(reading: Reading, names: Sequence[str], rows: Rows) -> bool:
    """False if a row names a trajectory that does not exist; each name is told once."""
    unknown = [name for name in dict.fromkeys(names) if name and name not in reading.trajectories]
    if "trajectory" not in reading.broken:
        for name in unknown:
            words = unknown_name("trajectory", name, reading.trajectories)
            reading.problems.append(Problem(words, rows.file, int(rows.lines[list(names).index(name)])))
    return not unknown


def clocks(
    reading: Reading, names: Sequence[str], times: FloatArray, rows: Rows, later: FloatArray | None = None
) -> tuple[Clock, IntArray, IntArray] | None:
    """Clock of every row (n,) of trajectories of one kind, and the position and rotation blocks (n, k) of its knots.

    ``None`` if a row is outside its trajectory; each such row is told. So much ``later`` (n,) rows are read out.
    """
    order = reading.trajectories[names[0]].order
    n = len(names)
    whole = Clock(np.zeros((n, order), np.int64), np.zeros((n, 1 + order * order)), np.zeros(n, dtype=bool))
    positions, rotations = np.zeros((n, order), dtype=np.int64), np.zeros((n, order), dtype=np.int64)
    named = np.array(names, dtype=object)
    for name in dict.fromkeys(names):
        mine = np.flatnonzero(named == name)
        trajectory = reading.trajectories[name]
        found = trajectory.clock(times[mine], None if later is None else later[mine])
        for part, own in zip(whole, found, strict=True):
            part[mine] = own
        positions[mine], rotations[mine] = (
            trajectory.positions[found.knots],
            trajectory.rotations[found.knots],
        )
    tell_rows(
        reading.problems,
        ~whole.inside,
        rows,
        lambda row: reading.trajectories[names[row]].outside(float(times[row])),
    )
    return (whole, positions, rotations) if whole.inside.all() else None


def _group(
    reading: Reading,
    entry: Observations,
    number: int,
    rows: Rows,
    chosen: IntArray,
    shifts: tuple[IntArray, FloatArray],
) -> Group | None:
    own = rows.take(chosen)
    names, times = own.text("trajectory"), own.number("time")
    found = clocks(reading, names, times, own)
    if found is None:
        return None
    clock, positions, rotations = found
    type_ = NAVIGATION[entry.type](clock.knots.shape[1])
    shift, middle = shifts[0][chosen], shifts[1][chosen]
    common = own.number("sigma")
    observed = np.stack([own.number(c.name) for c in type_.components], axis=1)
    sigma = np.stack([own_or_common(own.number(f"sigma_{c.name}"), common) for c in type_.components], axis=1)
    nothing = np.asarray(~np.isfinite(observed).any(axis=1))
    tell_rows(reading.problems, nothing, own, "nothing is observed in this row")
    group = ObservationGroup(
        name=group_name(entry, number),
        type=type_,
        blocks=(*positions.T, *rotations.T, *_instrument(reading, entry, type_, len(chosen), shift)),
        observed=observed,
        sigma=sigma * entry.factor,
        constants=np.concatenate([(times - middle)[:, None], clock.constants], axis=1),
        references=(names_of([knot_name(name, time) for name, time in zip(names, times, strict=True)]),),
        external=external(type_, reading.edge),
        lines=own.lines,
        file=own.file,
    )
    if not sigma_is_good(group, own, np.arange(len(chosen)), reading.problems):
        return None
    size = len(type_.components)
    return Group(group, number, chosen, np.eye(size), np.ones(size))


def _instrument(
    reading: Reading, entry: Observations, type_: ObservationType, count: int, shift: IntArray
) -> list[IntArray]:
    """Blocks of lever arm or boresight, shift and drift, time offset."""
    arm, _, offset = type_.slots[-3:]
    things, shop = reading.shop.things["instrument"], reading.shop
    blocks = []
    for slot in (arm, offset):
        block = things.part(entry.instrument, slot.part) if entry.instrument else -1
        neutral = 0 if slot.kind == "eccentricity" else -1
        block = neutral if block < 0 else block
        blocks.append(np.full(count, shop.neutral(slot.kind) if block < 0 else block, dtype=np.int64))
    return [blocks[0], shift, blocks[1]]


def _shifts(
    reading: Reading, entry: Observations, rows: Rows, place: Place
) -> tuple[IntArray, FloatArray] | None:
    """Block of shift and drift of every row, and the time they refer to; ``None`` if the instrument is unknown."""
    kind, key = _SHIFTS[entry.type]
    known = reading.project.instruments
    if entry.instrument is not None and entry.instrument not in known:
        words = unknown_name("instrument", entry.instrument, known)
        reading.problems.append(place.problem(words, "instrument"))
        return None
    named = zip(rows.text("strip"), rows.text("trajectory"), strict=True)
    strips, times = coded(pl.Series([own or name for own, name in named])), rows.number("time")
    given = getattr(known[entry.instrument], key) if entry.instrument else {}
    blocks, middles = np.zeros(rows.count, dtype=np.int64), np.zeros(rows.count)
    for k, strip in enumerate(strips.known):
        mine = np.flatnonzero(strips.numbers == k)
        middle = 0.5 * float(times[mine].min() + times[mine].max())
        if not given:
            block = reading.shop.neutral(kind.key)
        else:
            assert entry.instrument is not None
            block, middle = _strip(reading, entry.instrument, strip, kind, key, middle)
        blocks[mine], middles[mine] = block, middle
    return blocks, middles


def _strip(
    reading: Reading, instrument: str, strip: str, kind: BlockKind, key: str, middle: float
) -> tuple[int, float]:
    """Block of shift and drift of a strip, and the time it refers to: the middle of the table that names it first."""
    name = f"{instrument} strip {strip}"
    known = reading.strips
    if (kind.key, name) not in known:
        path = ("instruments", instrument, key)
        given = getattr(reading.project.instruments[instrument], key)
        again = any(other.startswith(f"{instrument} strip ") for _, other in known)
        problems = [] if again else reading.problems  # what is wrong with it is told once
        row = settings(given, kind.components, reading.edge, reading.at(*path), path, problems)
        reading.shop.begin(f"instrument {instrument}")
        known[kind.key, name] = (int(reading.shop.store(kind.key).add([name], *row)[0]), middle)
    return known[kind.key, name]
