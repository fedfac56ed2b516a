"""Names mixed up: two exchanged in an image or at a station, another one written, a row booked at another station.

A row that does not fit is computed with every other name in its place; names that make it fit are tried. If two rows
of one image fit with each other's names, they were exchanged. Rows of several tables with the same names go together.
A row of a small group, such as scale bars, is judged by an adjustment without it.

Two wrong sights among a few leave a pose at which no row fits, so no row tells the right name. With all other unknowns
held and only its own rows, each exchange at such a station is an adjustment of a few unknowns. The right one is the
one with the smallest cost (``quality/outliers.py``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.diagnose.hypothesis import SMALL, Edit, Hypothesis, Situation, cells, to, with_blocks, without_row
from mor.model import rotations
from mor.model.contract import ObservationGroup, some_rows, wrap
from mor.model.parameters import Values, index_unknowns, move
from mor.project.network import Network
from mor.quality.outliers import by_sights_alone, cost_of_residuals, costs_at_places, sizes_of
from mor.solve.problem import Problem, linearise, rotation_tangents
from mor.types import FloatArray, IntArray

ROWS = 40
"""Rows of a group that are looked at, the worst first."""
_TRIED = 6
"""Exchanges and names that are tried: those that make rows fit that are off most."""


class Match(NamedTuple):
    """A row that would fit with another name in one of its references."""

    group: int
    row: int
    reference: str
    names: tuple[str, ...]
    """All names of the row as they are."""
    right: str
    blocks: dict[int, int]
    """Block numbers by slot with the right name."""
    candidates: int
    drop: float
    """By how much the row fits better, in units of σ."""

    def edits(self, network: Network) -> tuple[Edit, ...]:
        """The edits that write the right name."""
        return cells(network, self.group, [self.row], self.reference, to(self.right))


def name_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Exchanges first, then single names."""
    # In a group of up to ten rows, the four worst are judged by an adjustment without each.
    found = [
        match
        for number, group in enumerate(situation.network.groups)
        if len(group.type.references) > 1
        for place, row in enumerate(situation.worst_rows(number, ROWS).tolist())
        for match in _matches(situation, number, row, group.count <= 10 and place < 4)
    ]
    exchanges = [
        *_by_scores(situation),
        *_exchanges(situation.network, found),
        *_at_spoiled_stations(situation),
        *_between_lost_points(situation),
    ]
    worst = sorted(with_the_same_names(found), key=lambda same: -sum(match.drop for match in same))[:_TRIED]
    return [*exchanges[:_TRIED], *(_wrong_name(situation.network, same) for same in worst)]


def _matches(situation: Situation, number: int, row: int, alone: bool) -> Iterator[Match]:
    """Names that make a row fit; ``alone`` where the others lead without it."""
    values = without_row(situation, number, row) if alone else situation.values
    return matches(situation.network, values, number, row)


def matches(network: Network, values: Values, number: int, row: int) -> Iterator[Match]:
    """Names that make a row of a group fit."""
    group = network.groups[number]
    names = tuple(column[row] for column in group.references)
    (sizes_now,) = sizes_of([some_rows(group, np.array([row]))], values)
    now = float(np.sqrt(np.mean(sizes_now**2)))
    for place, reference in enumerate(group.type.references):
        slots = [k for k, slot in enumerate(group.type.slots) if slot.of == reference.name]
        named: set[int] = set()  # places that a thing of an earlier kind has: a station over a point is named by it
        for space in reference.among:
            things = network.things.get(space)
            if things is None or not len(things.ids):
                continue
            blocks = {
                slot: things.parts[group.type.slots[slot].part]
                for slot in slots
                if group.type.slots[slot].part in things.parts
            }
            if not blocks or (space == "station" and names[place] in network.sets):
                continue
            # A height may belong to the thing of that name, or to the row as it stands.
            places = {k: own for k, own in blocks.items() if group.type.slots[k].kind != "height"}
            variants = [blocks] if len(places) == len(blocks) or not places else [blocks, places]
            each = np.array([_sizes_with(values, group, row, variant) for variant in variants])
            chosen, sizes = each.argmin(axis=0), each.min(axis=0)
            same = np.all([own == group.blocks[slot][row] for slot, own in blocks.items()], axis=0)
            place_of = things.parts.get("position", np.full(len(things.ids), -1))
            sizes[same | np.isin(things.ids, names) | np.isin(place_of, list(named))] = np.inf
            named |= set(place_of[place_of >= 0].tolist())
            for k in np.argsort(sizes, kind="stable")[:2]:
                # Within 6 σ, or a twentieth of what it is now: poses are not known exactly.
                if sizes[k] <= max(6.0, 0.05 * now) and sizes[k] < 0.3 * now:
                    right = {slot: int(own[k]) for slot, own in variants[int(chosen[k])].items()}
                    yield Match(
                        number, row, reference.name, names, things.ids[k], right, len(things.ids), now - sizes[k]
                    )


def _sizes_with(values: Values, group: ObservationGroup, row: int, blocks: dict[int, IntArray]) -> FloatArray:
    """(k,) root mean square of |v|/σ of a row with other blocks in some slots, one after the other."""
    count = len(next(iter(blocks.values())))
    numbers = [blocks.get(k, np.full(count, own[row])) for k, own in enumerate(group.blocks)]
    given = [values[slot.kind][n] for slot, n in zip(group.type.slots, numbers, strict=True)]
    with np.errstate(all="ignore"):
        computed = group.type.equation(given, np.repeat(group.constants[[row]], count, axis=0)).values
    difference = group.observed[row] - computed
    wraps = group.type.wraps
    difference[:, wraps] = wrap(difference[:, wraps])
    seen = group.mask[row]
    with np.errstate(all="ignore"):
        squares = (difference[:, seen] / group.given_sigma[row, seen]) ** 2
        sizes: FloatArray = np.sqrt(np.mean(squares, axis=1))
    return np.nan_to_num(sizes, nan=np.inf, posinf=np.inf)


def _exchanges(network: Network, matches: list[Match]) -> Iterator[Hypothesis]:
    for k, one in enumerate(matches):
        for other in matches[k + 1 :]:
            if (one.group, one.reference) != (other.group, other.reference) or one.row == other.row:
                continue
            place = [r.name for r in network.groups[one.group].type.references].index(one.reference)
            rest = [tuple(n for i, n in enumerate(m.names) if i != place) for m in (one, other)]
            if rest[0] == rest[1] and one.right == other.names[place] and other.right == one.names[place]:
                yield _exchange(network, one, other, rest[0])


def _by_scores(situation: Situation) -> Iterator[Hypothesis]:
    """Exchanges that score tests of the solution name: a pose that one has spoiled need not show it."""
    for one in situation.scored:
        numbers, rows = {number for number, _ in one.rows}, tuple(row for _, row in one.rows)
        if one.cause == "names exchanged" and len(numbers) == 1 and len(rows) == 2:
            number = numbers.pop()
            count = situation.network.groups[number].count
            yield _exchange_of_rows(situation.network, number, rows, count * (count - 1) // 2)


def _at_spoiled_stations(situation: Situation) -> Iterator[Hypothesis]:
    for found in exchanges_at_stations(situation):
        yield _exchange_of_rows(situation.network, found.group, found.rows, found.candidates)


def _exchange_of_rows(network: Network, number: int, rows: Sequence[int], candidates: int) -> Hypothesis:
    """Return the exchange of the targets of two rows of one image or station."""
    group = network.groups[number]
    target = group.type.references[-1].name
    names = [tuple(column[row] for column in group.references) for row in rows]
    one, other = (
        Match(number, row, target, own, right[-1], {}, candidates, 0.0)
        for row, own, right in zip(rows, names, reversed(names), strict=True)
    )
    return _exchange(network, one, other, names[0][:-1])


def _between_lost_points(situation: Situation) -> list[Hypothesis]:
    """Exchanges after which two points are where their sights meet, of which half do not fit now; the best first."""
    network, groups = situation.network, situation.network.groups
    lost = _lost_points(situation)
    if situation.count > SMALL or not lost:
        return []
    problem = situation.make(network, situation.start, situation.values)
    place = dict(zip(network.blocks["point"].ids, range(len(network.blocks["point"].ids)), strict=True))
    rows = [
        (number, row)
        for number in _sighting(groups)
        for row, name in enumerate(groups[number].references[-1])
        if name in lost or situation.misfitting[number][row].any()
    ]
    if len(rows) > ROWS:
        return []
    found = []
    for (number, row), (other_number, other) in combinations(rows, 2):
        names = [tuple(column[k] for column in groups[number].references) for k in sorted((row, other))]
        same = names[0][-1] == names[1][-1] or not {names[0][-1], names[1][-1]} <= place.keys()
        if number != other_number or names[0][0] != names[1][0] or same:
            continue
        points = np.array([place[name[-1]] for name in names])
        costs = []
        for tried in (problem, _exchanged(problem, number, (row, other))):
            places = by_sights_alone(tried, situation.values, points)
            each = zip(points.tolist(), places, strict=True)
            costs.append(sum(float(costs_at_places(tried, situation.values, p, xyz[None])[0]) for p, xyz in each))
        if costs[1] < costs[0]:
            found.append((costs[1] - costs[0], number, sorted((row, other)), points))
    return [
        replace(_exchange_of_rows(network, number, own, len(found)), recomputed={"point": points})
        for _, number, own, points in sorted(found, key=lambda one: one[0])[:_TRIED]
    ]


def _lost_points(situation: Situation) -> set[str]:
    """Points that are sighted twice or more, half of whose sights do not fit."""
    whole, wrong = _sights(situation, -1)
    return {name for name in wrong if whole[name] >= 2 and 2 * wrong[name] >= whole[name]}


def _exchange(network: Network, one: Match, other: Match, frame: tuple[str, ...]) -> Hypothesis:
    group = network.groups[one.group]
    one, other = sorted((one, other), key=lambda match: match.row)
    slots = [k for k, slot in enumerate(group.type.slots) if slot.of == one.reference]
    swapped = {k: [group.blocks[k][other.row], group.blocks[k][one.row]] for k in slots}
    rows = (one.row, other.row)
    return Hypothesis(
        "names exchanged",
        (*frame, one.right, other.right),
        lambda changed: with_blocks(changed, one.group, rows, swapped),
        f"{where(group, one.row)}: {one.right}; {where(group, other.row)}: {other.right}",
        one.candidates,
        rows=tuple((one.group, row) for row in rows),
        edits=sum((match.edits(network) for match in (one, other)), ()),
    )


def with_the_same_names(found: Iterable[Match]) -> list[list[Match]]:
    """Return the matches of rows of several tables with the same names together."""
    together: dict[tuple[str, ...], list[Match]] = {}
    for match in found:
        together.setdefault((match.reference, *match.names, match.right), []).append(match)
    return list(together.values())


def wrong_name(network: Network, same: list[Match]) -> tuple[str, tuple[str, ...], str]:
    """Cause, things and line of a name that is another one."""
    first = same[0]
    lines = "; ".join(where(network.groups[match.group], match.row) for match in same)
    cause = "wrong station" if first.reference in ("station", "from", "image") else "wrong name"
    return cause, (*first.names, first.right), f"{lines}: {first.reference} {first.right}"


def _wrong_name(network: Network, same: list[Match]) -> Hypothesis:
    cause, things, line = wrong_name(network, same)

    def change(changed: Network) -> Network:
        for match in same:
            changed = with_blocks(changed, match.group, [match.row], {k: [b] for k, b in match.blocks.items()})
        return changed

    return Hypothesis(
        cause,
        things,
        change,
        line,
        same[0].candidates,
        rows=tuple((match.group, match.row) for match in same),
        edits=sum((match.edits(network) for match in same), ()),
    )


def where(group: ObservationGroup, row: int) -> str:
    """File and line of a row, or its table and its names."""
    if len(group.lines) > row:
        return f"{group.file}:{group.line(row)}"
    return f"{group.name}, {', '.join(group.names_of(row).values())}"


class Exchange(NamedTuple):
    """Two rows of a group that fit with each other's targets."""

    group: int
    rows: tuple[int, int]
    candidates: int


class _Alone(NamedTuple):
    """The problem of nothing but the rows of a station, with the blocks that are its own as the only unknowns."""

    problem: Problem
    numbers: tuple[int, ...]
    """Groups of the network that its groups are of."""
    rows: tuple[IntArray, ...]
    """(n,) rows of these that its rows are."""


def exchanges_at_stations(situation: Situation) -> list[Exchange]:
    """The best exchange at each station of which many sights do not fit."""
    if situation.count > SMALL:
        return []
    problem = situation.make(situation.network, situation.start, situation.values)
    found = [_best(situation, _alone(problem, situation, name)) for name in _spoiled(situation)]
    return [one for one in found if one is not None]


def _sighting(groups: Sequence[ObservationGroup]) -> list[int]:
    return [k for k, g in enumerate(groups) if len(g.type.components) == 2 and len(g.references) == 2]


def _sights(situation: Situation, reference: int) -> tuple[Counter[str], Counter[str]]:
    """Number of sights by the name in a reference, and of those that do not fit."""
    whole, wrong = Counter[str](), Counter[str]()
    for number in _sighting(situation.network.groups):
        names = list(situation.network.groups[number].references[reference])
        whole.update(names)
        wrong.update(names[row] for row in np.flatnonzero(situation.misfitting[number].any(axis=1)))
    return whole, wrong


def _spoiled(situation: Situation) -> list[str]:
    whole, wrong = _sights(situation, 0)
    squares: dict[str, float] = {}
    for number in _sighting(situation.network.groups):
        names = situation.network.groups[number].references[0]
        for name, size in zip(names, np.sum(situation.sizes[number] ** 2, axis=1).tolist(), strict=False):
            squares[name] = squares.get(name, 0.0) + size
    # With fewer sights of a station any exchange fits; with more the others keep its pose right.
    shares = {n: wrong[n] / whole[n] for n in whole if 4 <= whole[n] <= 40}
    # Sights that do not fit: an exchange makes two.
    spoiled = [n for n in shares if wrong[n] >= 2]
    return sorted(spoiled, key=lambda n: (-shares[n], -squares[n] / whole[n]))[:2]


def _alone(problem: Problem, situation: Situation, name: str) -> _Alone:
    groups, numbers, rows = [], [], []
    free = {kind: np.zeros(len(blocks.ids), dtype=bool) for kind, blocks in problem.index.blocks.items()}
    for number in _sighting(situation.network.groups):
        group = problem.groups[number]
        own = np.flatnonzero(np.array([station == name for station in group.references[0]]))
        if not len(own):
            continue
        groups.append(some_rows(group, own))
        numbers.append(number)
        rows.append(own)
        for slot, blocks in group.blocks_by_slot:
            if slot.of == group.type.references[0].name and slot.part in ("position", "rotation"):
                free[slot.kind][blocks[own]] = True
    held = {
        kind: blocks._replace(free=blocks.free & free[kind][:, None]) for kind, blocks in problem.index.blocks.items()
    }
    alone = replace(problem, groups=tuple(groups), clusters=(), index=index_unknowns(held))
    return _Alone(alone, tuple(numbers), tuple(rows))


def _best(situation: Situation, alone: _Alone) -> Exchange | None:
    pairs = [(k, pair) for k, rows in enumerate(alone.rows) for pair in combinations(range(len(rows)), 2)]
    costs = [_cost(situation, _exchanged(alone.problem, k, pair)) for k, pair in pairs]
    best = int(np.argmin(costs))
    if not costs[best] < _cost(situation, alone.problem):
        return None
    k, (one, other) = pairs[best]
    return Exchange(alone.numbers[k], (int(alone.rows[k][one]), int(alone.rows[k][other])), len(pairs))


def _exchanged(problem: Problem, number: int, pair: tuple[int, int]) -> Problem:
    group = problem.groups[number]
    target = group.type.references[1].name
    order = np.arange(group.count)
    order[list(pair)] = order[list(reversed(pair))]
    slots = group.blocks_by_slot
    blocks = tuple(own[order] if slot.of == target else own for slot, own in slots)
    groups = list(problem.groups)
    groups[number] = replace(group, blocks=blocks)
    return replace(problem, groups=tuple(groups))


def _cost(situation: Situation, problem: Problem) -> float:
    with np.errstate(all="ignore"):
        values = _adjusted(problem, situation.values)
        sizes = sizes_of(problem.groups, values)
    used = [np.where(group.left_out, 0.0, size) for group, size in zip(problem.groups, sizes, strict=True)]
    cost = cost_of_residuals(used, situation.count)
    return cost if np.isfinite(cost) else np.inf


def _adjusted(problem: Problem, values: Values) -> Values:
    """Least squares of a few unknowns (Gauss–Newton, steps halved where they go too far)."""
    now, derivatives = _system(problem, values)
    for _ in range(12):
        if not (np.isfinite(now).all() and np.isfinite(derivatives).all()):
            break
        step = np.asarray(rotations.lstsq(derivatives, now, rcond=None), dtype=np.float64)
        for _ in range(6):
            there = move(problem.index, values, step)
            residuals, further = _system(problem, there)
            if residuals @ residuals < now @ now:
                break
            step = 0.5 * step
        else:
            break
        settled = residuals @ residuals > (1.0 - 1e-3) * (now @ now)
        values, now, derivatives = there, residuals, further
        if settled:
            break
    return values


def _system(problem: Problem, values: Values) -> tuple[FloatArray, FloatArray]:
    """(observed − computed)/σ (k,) of all rows, and the derivatives (k, u) of what is computed."""
    tangent = rotation_tangents(problem.index, values)
    misclosures, derivatives = [], []
    for group in problem.groups:
        part = linearise(group, problem.index, values, tangent, slice(None))
        weight = np.where(group.used, 1.0 / group.sigma, 0.0)
        dense = np.zeros((*part.misclosure.shape, problem.index.count + 1))  # fixed ones go to the last column
        rows = np.arange(group.count)[:, None]
        for component in range(part.misclosure.shape[1]):
            np.add.at(dense[:, component], (rows, part.columns), part.jacobian[:, component])
        derivatives.append((dense[..., :-1] * weight[:, :, None]).reshape(part.misclosure.size, problem.index.count))
        misclosures.append((part.misclosure * weight).ravel())
    return np.concatenate(misclosures), np.concatenate(derivatives)
