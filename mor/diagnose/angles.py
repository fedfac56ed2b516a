"""Hypotheses about circles, angles and reference frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from mor.diagnose.hypothesis import (
    SMALL,
    CellEdit,
    Edit,
    Hypothesis,
    Situation,
    cells,
    computed,
    frames_of,
    key_edit,
    table_key,
    to,
    with_blocks,
    with_group,
    with_observed,
    with_unknown,
)
from mor.model.contract import ObservationGroup, wrap
from mor.model.images import is_image_point
from mor.model.parameters import Values
from mor.project.network import Network
from mor.project.rows import group_name
from mor.quality.outliers import costs_of_sizes
from mor.quality.plausibility import look_like_elevations
from mor.quality.solution import ScoredHypothesis
from mor.quality.test_statistics import log_p_chi2
from mor.solve.problem import misclosures
from mor.start.bundle import direction_bundle, evenly, misfits, samples
from mor.start.part import Frame, image_frames, loosened, theodolite_frames
from mor.start.resection import resect_three_points
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE_UNITS

# ---- Circles of instruments: another unit, the other sense, elevations for zenith angles, the other face.

_BAD = 0.5
"""Part of the rows of a station that do not fit, from which on its circle is looked at."""
_UNITS = ("gon", "deg", "rad")


def circle_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Hypotheses about the circles of every group, and of the stations whose rows do not fit."""
    found = []
    for number, group in enumerate(situation.network.groups):
        if not group.type.wraps.any() or group.type.distances is None:
            continue
        for things, rows in _sets(situation, number, group):
            found += list(_of_rows(situation, number, group, things, rows))
    return found


def implausible_zenith_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return elevations for the zenith angles of tables that look like it."""
    return [
        hypothesis
        for number, group in enumerate(situation.network.groups)
        if look_like_elevations(group)
        for hypothesis in _of_rows(situation, number, group, (group.name,), np.arange(group.count))
        if hypothesis.cause == "elevation for zenith"
    ]


def face_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Rows whose horizontal circle is that of the other face."""
    groups = enumerate(situation.network.groups)
    return [h for number, group in groups if group.count for h in _faces(situation, number, group)]


def turned_circle_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the sets that score tests say were turned between two of their rows."""
    found = []
    for one in situation.scored:
        rows: dict[int, list[int]] = {}
        for number, row in one.rows if one.cause == "orientation changed" else ():
            rows.setdefault(number, []).append(row)
        for number, own in rows.items():
            group = situation.network.groups[number]
            slot = next((k for k, s in enumerate(group.type.slots) if s.kind == "rotation"), -1)
            if slot >= 0:
                found.append(
                    Hypothesis(
                        one.cause,
                        one.things,
                        partial(_turned_on, number=number, rows=own, slot=slot, values=situation.values),
                        one.line,
                        group.count,
                        parameters=1,
                    )
                )
    return found


def _turned_on(network: Network, number: int, rows: list[int], slot: int, values: Values) -> Network:
    block = int(network.groups[number].blocks[slot][rows[0]])
    free = network.blocks["rotation"].free[block]
    network, own = with_unknown(network, "rotation", values["rotation"][block], free, block)
    return with_blocks(network, number, rows, {slot: [own] * len(rows)})


def _sets(situation: Situation, number: int, group: ObservationGroup) -> Iterator[tuple[tuple[str, ...], IntArray]]:
    """The whole group, which may fit a mirrored place of its stations, and the rows of each station that fit badly."""
    bad: BoolArray = np.asarray(situation.misfitting[number].any(axis=1))
    yield (group.name,), np.arange(group.count)
    rows_of = group.references[0].rows_of_each()
    shares = {name: float(bad[rows].mean()) for name, rows in rows_of.items() if len(rows) > 1}
    worst = sorted((name for name in shares if shares[name] >= _BAD), key=lambda name: -shares[name])
    causes = ("circle sense", "circle unit", "elevation for zenith")
    scored = [name for one in situation.scored if one.cause in causes for name in one.things if name in shares]
    # Stations of a group that are looked at, the worst first.
    for name in dict.fromkeys([*scored, *worst[:3]]) if len(rows_of) > 1 else []:
        yield (name, group.name), rows_of[name]


def _of_rows(
    situation: Situation, number: int, group: ObservationGroup, things: tuple[str, ...], rows: IntArray
) -> Iterator[Hypothesis]:
    edge, seen = situation.network.edge, int(np.count_nonzero(group.mask[rows]))
    given = _given_unit(situation.network, group)
    bad = situation.misfitting[number][rows].any(axis=1)
    spoiled = bad.any() and bad.mean() >= _BAD
    recomputed = frames_of([(group, rows)]) if spoiled else {}  # else they stand where they should
    network, full = situation.network, 2.0 * np.pi / ANGLE_UNITS[given]
    angles = [c.name for c, wraps in zip(group.type.components, group.type.wraps, strict=True) if wraps]
    for other in _UNITS:
        factor = ANGLE_UNITS[other] / ANGLE_UNITS[given]
        if factor != 1.0 and _is_on_circle(group, rows, factor):
            yield _hypothesis(
                "circle unit",
                (*things, other),
                recomputed,
                number,
                rows,
                _on_circle(lambda angles, factor=factor: factor * angles),  # type: ignore[misc]
                f"observations, {things[0]}: units: {other}",
                seen * float(np.log(factor)),
                table_key(network, number, "units", f"{{{', '.join(f'{a}: {other}' for a in angles)}}}")
                if len(rows) == group.count
                else _in_cells(network, number, rows, angles, partial(float.__mul__, factor)),
            )
    if group.type.turns:
        columns = list(group.type.turns)
        yield _hypothesis(
            "circle sense",
            things,
            recomputed,
            number,
            rows,
            _on_circle(np.negative, columns),
            f"axes: {{angles: {'counterclockwise' if edge.sense > 0 else 'clockwise'}}} ({things[0]})",
            0.0,
            (key_edit(("axes", "angles"), "counterclockwise" if edge.sense > 0 else "clockwise"),)
            if len(rows) == group.count and sum(bool(g.type.turns) for g in network.groups) == 1
            else _in_cells(
                network,
                number,
                rows,
                [group.type.components[group.type.turns[0]].name],
                lambda angle: (full - angle) % full,
            ),
        )
    names = [component.name for component in group.type.components]
    columns = [k for k, name in enumerate(names) if name in ("zenith", "zenith_angle")]
    if columns:
        yield _hypothesis(
            "elevation for zenith",
            things,
            recomputed,
            number,
            rows,
            _on_circle(lambda angles: 0.5 * np.pi - angles, columns),
            f"observations, {things[0]}: type: directions",
            0.0,
            _in_cells(network, number, rows, [names[k] for k in columns], lambda angle: (0.25 * full - angle) % full),
        )


def _in_cells(
    network: Network, number: int, rows: IntArray, names: list[str], change: Callable[[float], float]
) -> tuple[Edit, ...]:
    return sum((cells(network, number, rows.tolist(), name, computed(change)) for name in names), ())


def _is_on_circle(group: ObservationGroup, rows: IntArray, factor: float) -> bool:
    """True where the angles (n, m) of some rows, times a factor, do not go beyond a full circle."""
    angles = np.abs(group.observed[rows][:, group.type.wraps])
    return bool(factor * np.nanmax(angles, initial=0.0) <= 2.0 * np.pi)


def _given_unit(network: Network, group: ObservationGroup) -> str:
    unit: str = network.edge.units.angle
    angles = [c.name for c, wraps in zip(group.type.components, group.type.wraps, strict=True) if wraps]
    for number, entry in enumerate(network.project.observations):
        if group_name(entry, number) == group.name:
            own = entry.units if isinstance(entry.units, dict) else dict.fromkeys(angles, entry.units)
            unit = next((own[name] for name in angles if own.get(name)), unit)
    return unit if unit in _UNITS else "deg"


def _hypothesis(
    cause: str,
    things: tuple[str, ...],
    recomputed: dict[str, IntArray],
    number: int,
    rows: IntArray,
    change: Callable[[FloatArray], FloatArray],
    line: str,
    stretch: float,
    edits: tuple[Edit, ...],
) -> Hypothesis:
    return Hypothesis(
        cause,
        things,
        lambda network: with_observed(network, number, rows, change),
        line,
        len(_UNITS),
        stretch=stretch,
        recomputed=recomputed,
        afresh=True,
        edits=edits,
    )


def _on_circle(
    change: Callable[[FloatArray], FloatArray], columns: list[int] | slice = slice(None)
) -> Callable[[FloatArray], FloatArray]:
    """The change of some columns of angles (k, m) that stay within a full circle."""

    def changed(angles: FloatArray) -> FloatArray:
        result = angles.copy()
        result[:, columns] = np.remainder(change(angles[:, columns]), 2.0 * np.pi)
        return result

    return changed


def _faces(situation: Situation, number: int, group: ObservationGroup) -> Iterator[Hypothesis]:
    """Rows of a station whose horizontal directions are off by half a circle."""
    if not group.type.turns or group.type.tell_face is None:
        return
    column = group.type.turns[0]
    full = 2.0 * np.pi / ANGLE_UNITS[_given_unit(situation.network, group)]
    misclosure = np.nan_to_num(misclosures(group, situation.values)[:, column])
    for name, here in group.references[0].rows_of_each().items():
        off = here[np.abs(wrap(misclosure[here] - middle_of(misclosure[here]))) > 0.75 * np.pi]
        if 0 < len(off) < len(here):
            yield Hypothesis(
                "face",
                (name, *dict.fromkeys(group.references[1][int(row)] for row in off)),
                partial(with_observed, number=number, rows=off, change=_on_circle(lambda hz: hz + np.pi, [column])),
                f"{group.name}, {name}: horizontal + 200 gon",
                len(here),
                rows=tuple((number, int(row)) for row in off) if len(off) < 4 else (),
                edits=_in_cells(
                    situation.network,
                    number,
                    off,
                    [group.type.components[column].name],
                    lambda angle: (angle + 0.5 * full) % full,
                ),
            )


def middle_of(angles: FloatArray) -> float:
    """The one of some angles (k,) that is nearest to all others; of many it is looked for among 500 to 1000."""
    some = angles[:: max(len(angles) // 500, 1)]
    near = np.abs(wrap(some[:, None] - some[None, :])).sum(axis=1)
    return float(some[int(np.argmin(near))])


# ---- Whole set-ups and images mixed up: two instruments whose places were exchanged, two images whose names were.
#
# All rows of one frame get the blocks of the other one. With the unknowns as they are, and the orientation of
# each set of directions taken from its own rows, the pairs whose rows then cost least are tried. A pair of
# stations is also judged with the two points exchanged in all other rows: if few sights go to them, the
# points follow their instruments.

ALL = -1
"""Stands for all tables."""


def frame_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the exchanges of two stations, and of two images, that promise most."""
    if not situation.begun or situation.count > SMALL:
        return []
    network = situation.network
    names = list(network.things["image"].ids) if "image" in network.things else []
    worst = _worst(situation, "image", names)
    pairs = [pair for pair in combinations(worst, 2) if _alike(network, pair)]
    best = _best(situation, [(pair, ALL) for pair in pairs], "image")
    return [*_stations_of_frame(situation), *(_exchanged_images(situation, pair, len(pairs)) for pair, _ in best)]


def scored_frame_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the exchanges of two stations, and of two images with observed places, that score tests name."""
    of = {"images exchanged": _exchanged_images, "set-ups exchanged": _exchanged_stations}
    return [
        of[one.cause](situation, (one.things[0], one.things[1]), len(situation.scored))
        for one in situation.scored
        if one.cause in of
    ]


def _exchanged_images(situation: Situation, pair: tuple[str, str], candidates: int) -> Hypothesis:
    network, edits = situation.network, tuple[Edit, ...]()
    for number, group in enumerate(network.groups):
        if is_image_point(group.type):
            edits += _renamed(network, number, pair)
    return _hypothesis_of_frame("images exchanged", pair, "image", candidates, edits, situation)


def _renamed(network: Network, number: int, pair: tuple[str, str]) -> tuple[Edit, ...]:
    """Edits that exchange two images or stations in the rows of a table."""
    group, edits = network.groups[number], tuple[Edit, ...]()
    names = np.asarray(group.references[0])
    for name, other in (pair, pair[::-1]):
        rows = np.flatnonzero(names == name).tolist()
        edits += cells(network, number, rows, group.type.references[0].name, to(other))
    return edits


def exchanged_frames(network: Network, pair: tuple[str, str], of: str, only: int) -> Network:
    """Return the network with the blocks of two frames exchanged in all their rows, or in those of one table.

    ``of`` is ``station``, whose positions are exchanged (and rotations and heights where it is the names in one table),
    or ``image``, whose positions, rotations and interiors are.
    """
    for number, group in enumerate(network.groups):
        if only not in (ALL, number):
            continue
        blocks, changed = list(group.blocks), False
        for slot in _slots(group, of, only != ALL):
            column = group.column(group.type.slots[slot].of)
            names = np.asarray(column)
            rows = [np.flatnonzero(names == name) for name in pair]
            known = _blocks_of(network, pair, of, group.type.slots[slot].part)
            if known is None:
                continue
            own = np.array(blocks[slot])
            own[rows[0]], own[rows[1]] = known[1], known[0]
            changed |= bool(len(rows[0]) + len(rows[1]))
            blocks[slot] = own
        if changed:
            network = with_group(network, number, replace(group, blocks=tuple(blocks)))
    return network


def _slots(group: ObservationGroup, of: str, by_name: bool = False) -> list[int]:
    if of == "image":
        parts = ("position", "rotation", "interior")
        return [k for k, s in enumerate(group.type.slots) if s.of == "image" and s.part in parts]
    if not group.type.distances or group.type.between_marks:
        return []
    begin, further = group.type.distances[0], ("rotation", "height") if by_name else ()
    return [k for k, s in enumerate(group.type.slots) if s.of == begin and s.part in ("position", *further)]


def _blocks_of(network: Network, pair: tuple[str, str], of: str, part: str) -> tuple[int, int] | None:
    things = network.things[of]
    if part not in things.parts:
        return None
    one, other = (int(things.parts[part][things.numbers[name]]) for name in pair)
    return one, other


def _stations_of_frame(situation: Situation) -> list[Hypothesis]:
    network = situation.network
    if "station" not in network.things:
        return []
    declared = [name for name in network.things["station"].ids if name not in network.sets]
    worst = _worst(situation, "station", declared)
    pairs = [
        pair
        for pair in combinations(declared, 2)
        if set(pair) & set(worst) and len(set(_blocks_of(network, pair, "station", "position") or ())) == 2
    ]
    tables = [k for k, group in enumerate(network.groups) if group.count and _slots(group, "station")]
    variants = [ALL, *tables] if len(tables) > 1 else [ALL]
    best = _best(situation, [(pair, only) for pair in pairs for only in variants], "station")
    found = []
    for pair, only in best:
        if only == ALL:
            found.append(_exchanged_stations(situation, pair, len(pairs)))
        else:
            edits = _renamed(network, only, pair)
            found.append(_hypothesis_of_frame("set-ups exchanged", pair, "station", len(pairs), edits, situation, only))
    return found


def _exchanged_stations(situation: Situation, pair: tuple[str, str], candidates: int) -> Hypothesis:
    ids = situation.network.blocks["point"].ids
    points = [ids[k] for k in _blocks_of(situation.network, pair, "station", "position") or ()]
    edits: tuple[Edit, ...] = tuple(
        CellEdit(("stations",), "point", to(point), cells={"id": name})
        for name, point in zip(pair, reversed(points), strict=False)
    )
    return _hypothesis_of_frame("set-ups exchanged", pair, "station", candidates, edits, situation)


def _alike(network: Network, pair: tuple[str, str]) -> bool:
    cameras = network.things["image"].parts["camera"]
    numbers = network.things["image"].numbers
    models = {network.project.cameras[network.things["camera"].ids[cameras[numbers[name]]]].model for name in pair}
    return len(models) == 1


def _worst(situation: Situation, of: str, names: list[str]) -> list[str]:
    count = dict.fromkeys(names, 0)
    for group, bad in zip(situation.network.groups, situation.misfitting, strict=False):
        for slot in _slots(group, of)[:1]:
            column = group.column(group.type.slots[slot].of)
            for row in np.flatnonzero(bad.any(axis=1)).tolist():
                if column[row] in count:
                    count[column[row]] += 1
    # Stations or images that are looked at, those first of which most rows do not fit.
    return sorted((name for name in names if count[name]), key=lambda name: -count[name])[:12]


_Pair = tuple[tuple[str, str], int]
"""Two frames, and the table in which they are exchanged."""


def _best(situation: Situation, pairs: list[_Pair], of: str) -> list[_Pair]:
    network = situation.network
    now = _cost(situation, network, situation.values)
    gains = {}
    for pair, only in pairs:
        places = [situation.values]
        blocks = _blocks_of(network, pair, of, "position")
        if blocks is not None:  # the points, or images, are where the others have them, or have been exchanged
            places.append(_exchanged_values(situation.values, _kind(network, of), blocks))
        changed = exchanged_frames(network, pair, of, only)
        gains[pair, only] = now - min(_cost(situation, changed, values) for values in places)
    # Decrease of the cost that is worth an adjustment.
    order = sorted((p for p in pairs if gains[p] > 20.0), key=lambda p: -gains[p])
    return order[:4]


def _kind(network: Network, of: str) -> str:
    return next(
        group.type.slots[slot].kind
        for group in network.groups
        for slot in _slots(group, of)
        if group.type.slots[slot].part == "position"
    )


def _exchanged_values(values: Values, kind: str, blocks: tuple[int, int]) -> Values:
    moved: FloatArray = values[kind].copy()
    moved[list(blocks)] = moved[list(reversed(blocks))]
    return {**values, kind: moved}


def _cost(situation: Situation, network: Network, values: Values) -> float:
    cost = 0.0
    for group in network.groups:
        if not group.count or any(slot.kind not in values for slot in group.type.slots):
            continue
        with np.errstate(all="ignore"):
            misclosure = misclosures(group, values)
        if group.type.turns and group.type.references[0].name == "station":
            column = group.type.turns[0]
            for own in group.references[0].rows_of_each().values():
                angles = np.nan_to_num(misclosure[own, column])
                misclosure[own, column] = wrap(angles - middle_of(angles))
        sizes = np.abs(misclosure / group.given_sigma)[group.mask]
        cost += float(np.sum(costs_of_sizes(np.nan_to_num(sizes, nan=1e30, posinf=1e30), situation.count)))
    return cost


def _hypothesis_of_frame(
    cause: str,
    pair: tuple[str, str],
    of: str,
    candidates: int,
    edits: tuple[Edit, ...],
    situation: Situation,
    only: int = ALL,
) -> Hypothesis:
    blocks = _blocks_of(situation.network, pair, of, "position")
    kind = _kind(situation.network, of)
    recomputed = {kind: np.array(blocks)} if blocks is not None and kind == "point" else {}
    return Hypothesis(
        cause,
        pair if only == ALL else (*pair, situation.network.groups[only].name),
        lambda network: exchanged_frames(network, pair, of, only),
        f"{of}s: {pair[0]} ↔ {pair[1]}"
        if only == ALL
        else f"{situation.network.groups[only].name}: {pair[0]} ↔ {pair[1]}",
        candidates,
        edits=edits,
        recomputed=recomputed,
        afresh=True,
    )


# ---- Other readings of all sights of a frame, judged by whether it can be placed among the points at all.


def scored_readings(network: Network, states: Sequence[Values]) -> tuple[ScoredHypothesis, ...]:
    """Return up to two other readings of circles and images with which their sights meet the points far better.

    An adjustment bends a network whose directions or images are read wrongly, but start values or graduated weights
    often keep the shape of its points, or its mirror image. Stations and images are resected from the points of each of
    the ``states`` with their sights as they were read and otherwise. That needs no pose, no scale and no adjustment.
    """
    found: dict[tuple[str, tuple[str, ...]], tuple[tuple[bool, float], ScoredHypothesis]] = {}
    readings = list(_readings(network))
    frames = {frame.name: frame for *_, pairs in readings for frame, _ in pairs}
    for values in states:
        plain = {name: _misfit_among(frame, frame.rays, values["point"])[0] for name, frame in frames.items()}
        if not any(cost > 1.0 for cost in plain.values()):  # all sights fit as they were read
            return ()
        for cause, table, line, pairs in readings:
            better: list[tuple[tuple[str, ...], bool, float, float]] = []
            for frame, rays in pairs:
                before = plain[frame.name]
                after, upright = _misfit_among(frame, rays, values["point"]) if before > 1.0 else (np.inf, True)
                if after < before:
                    squares = len(frame.points) * float(np.exp(before) - np.exp(after))
                    better.append(((frame.name.partition(" ")[2], table), not upright, after - before, squares))
            if len(better) == len(pairs) > 0:
                turned, by, squares = np.array([one[1:] for one in better]).T
                better = [((table,), bool(turned.any()), float(by.mean()), float(squares.sum()))]
            elif cause == "image flipped":
                continue
            for things, upside_down, by_all, gain in better:
                log10_p = float(log_p_chi2(gain, 1) / np.log(10.0))
                scored = ScoredHypothesis(cause, things, line.format(things[0]), gain, 0, log10_p, None)
                # Mean ln by which squared misfits of sights have to be smaller.
                if by_all < -1.0 and (upside_down, by_all) < found.get((cause, things), ((True, 0.0), scored))[0]:
                    found[cause, things] = (upside_down, by_all), scored
    # If images and circles contradict each other as mirror images do, either may be read wrongly.
    opposite = {"circle sense": "image flipped", "image flipped": "circle sense"}
    for (cause, things), (rank, scored) in list(found.items()):
        for other, table, line, pairs in readings if len(things) == 1 else ():
            if pairs and other == opposite.get(cause):
                rival = scored._replace(cause=other, things=(table,), line=line.format(table))
                found.setdefault((other, (table,)), ((rank[0], 0.5 * rank[1]), rival))
    return tuple(scored for _, scored in sorted(found.values(), key=lambda pair: pair[0])[:2])


_Reading = tuple[str, str, str, list[tuple[Frame, FloatArray]]]
"""Cause, table or camera, line to try it, and some frames with their rays (n, 3) in the other reading."""


def _readings(network: Network) -> Iterator[_Reading]:
    changed, images, mirror = network, network.things["image"], np.array([-1.0, 1.0, 1.0])
    for number, group in enumerate(network.groups):
        if group.type.key == "zenith_directions":
            change = _on_circle(lambda angles: 0.5 * np.pi - angles, [1])
            changed = with_observed(changed, number, np.arange(group.count), change)
    both = list(zip(theodolite_frames(network), theodolite_frames(changed), strict=True))
    for group in network.groups:
        if group.type.key in ("directions", "zenith_directions"):
            names = {f"station {name}" for name in group.references[0].rows_of_each()}
            pairs = sorted((p for p in both if p[0].name in names), key=lambda pair: -len(pair[0].points))[:6]
            sense = [(one, one.rays * mirror) for one, _ in pairs]
            yield "circle sense", group.name, "observations, {}: axes: {{angles: …}}", sense
            elevations = [(one, other.rays) for one, other in pairs]
            yield "elevation for zenith", group.name, "observations, {}: type: directions", elevations
    frames = sorted(image_frames(network), key=lambda frame: -len(frame.points))
    for k, camera in enumerate(network.things["camera"].ids if frames else ()):
        mine = {f"image {images.ids[i]}" for i in np.flatnonzero(images.parts["camera"] == k)}
        few = [(frame, frame.rays * mirror) for frame in frames if frame.name in mine][:3]
        yield "image flipped", camera, "cameras, {}: coordinates: … (y)", few


def _misfit_among(frame: Frame, rays: FloatArray, points: FloatArray) -> tuple[float, bool]:
    """Mean ln(1 + (v/σ)²) of up to 20 sights of a frame, posed by the best three of their points.

    The second is False if the frame is upside down. Of fewer than 6 sights to known points nothing is told: NaN.
    """
    targets = points[frame.points] + np.outer(frame.heights, [0.0, 0.0, 1.0])
    known = evenly(np.flatnonzero(np.isfinite(targets).all(axis=1)), 20)
    if len(known) < 6:
        return np.nan, True
    targets = targets[known] - targets[known].mean(axis=0)
    # Radians by which points may be off beside the σ of the rays.
    bundle = direction_bundle(rays[known], loosened(frame.sigma[known], 5e-4))
    triples = next(samples(len(known), 3, 30, 30, np.random.default_rng(1841)))
    poses = resect_three_points(targets[triples], bundle.rays[triples], nearly=True)
    if not len(poses.positions):
        return np.nan, True
    star = np.einsum("mij,mnj->mni", poses.rotations, targets - poses.positions[:, None])
    costs = np.log1p(np.fmin(misfits(bundle, star), 1e3) ** 2).mean(axis=1)
    best = int(np.argmin(costs))
    return float(costs[best]), not poses.rotations[best, :, 2] @ frame.up < 0.0
