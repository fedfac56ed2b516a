"""Reports and plots of approximate values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from mor.model.parameters import KINDS, Values
from mor.model.rotations import angles_from_rotation
from mor.project.entities import said_thing
from mor.project.network import Network
from mor.report.language import ENGLISH, Words
from mor.report.layout import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, heading, short, table
from mor.report.orientation import numbers
from mor.report.page_data import plan_axes
from mor.report.plots import sheet
from mor.report.units import angle_unit_of, number_or_none
from mor.solve.inverse import Local, local_precision
from mor.solve.problem import Problem
from mor.start.part import Approximation, Join, Phrase, rule
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE_UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# ---- Start values as data: of every unknown whether it was given, found or replaced, by which rule, and how good
# it is.
#
# σ is that which the observations of the thing itself give it while everything else stays where it starts,
# times the root mean square of their misclosures where that exceeds one. It does not contain what the
# neighbours are wrong by.

Status = Literal["given", "found", "replaced", "missing"]
WHAT = {"point": "position", "rotation": "attitude"}
"""What blocks of a kind are called; others are called as their kind."""


class StartValue(NamedTuple):
    """One block of unknowns."""

    kind: str
    """point, image, station, camera …"""
    name: str
    what: str
    """position, attitude, scale …"""
    status: Status
    found: tuple[str, ...]
    """Components that were found or replaced; what is observed or fixed stays."""
    part: int | None
    """The part in which it was known first, 0 for the object system; ``None`` if it has no value."""
    how: Phrase | None
    components: tuple[str, ...]
    values: FloatArray
    """(k,) in project axes and units."""
    units: tuple[str, ...]
    sigma: FloatArray
    """(k,) NaN if its own observations do not determine it, or hold it; of an attitude the largest, once."""
    misfit: float
    """Root mean square of the misclosures of its observations in units of their σ."""
    observations: int


def start_values(network: Network, approximation: Approximation, problem: Problem) -> list[StartValue]:
    """All blocks with unknowns, kind by kind. ``problem`` belongs to the network and its start values."""
    local = _local(network, problem, approximation.start)
    homes = _homes(approximation)
    rows = []
    for kind in sorted(network.blocks, key=_order):
        for number in np.flatnonzero(network.blocks[kind].free.any(axis=1)).tolist():
            rows.append(_row(network, approximation, kind, number, local[kind], homes.get((kind, number), 0)))
    return rows


def _order(kind: str) -> tuple[int, int]:
    return (("point", "rotation").index(kind) if kind in WHAT else 2, list(KINDS).index(kind))


def _local(network: Network, problem: Problem, start: Values) -> dict[str, Local]:
    """Precision of all blocks by themselves, attitudes together with the place that is theirs alone."""
    columns = problem.index.columns
    local = {kind: local_precision(problem, start, columns[kind]) for kind in network.blocks if kind != "rotation"}
    if "rotation" not in columns:
        return local
    place = _own_place(network)
    theirs = np.where((place >= 0)[:, None], columns["point"][place], -1)
    poses = local_precision(problem, start, np.concatenate([columns["rotation"], theirs], axis=1))
    local["rotation"] = poses._replace(sigma=poses.sigma[:, :3])
    own = np.flatnonzero(place >= 0)
    points = local["point"]
    points.sigma[place[own]], points.misfit[place[own]] = poses.sigma[own, 3:], poses.misfit[own]
    points.observations[place[own]] = poses.observations[own]
    return local


def _own_place(network: Network) -> IntArray:
    """(rotations,) position block that one attitude has for itself, −1 where it shares its place."""
    place = np.full(len(network.blocks["rotation"].ids), -1, dtype=np.int64)
    points = network.things["point"].parts["position"]
    for space in ("image", "station"):
        parts = network.things[space].parts
        if len(network.things[space].ids) == 0:
            continue
        own = ~np.isin(parts["position"], points) & (parts["rotation"] >= 0)
        place[parts["rotation"][own]] = parts["position"][own]
    values, counts = np.unique(place[place >= 0], return_counts=True)
    place[np.isin(place, values[counts > 1])] = -1
    return place


def _homes(approximation: Approximation) -> dict[tuple[str, int], int]:
    homes: dict[tuple[str, int], int] = {}
    for join in approximation.parts:
        blocks: list[tuple[str, int]] = [("point", int(p)) for p in join.points]
        for number in join.frames:
            frame = approximation.frames[number]
            turn = frame.rotation if frame.relative is None else frame.relative[0]
            blocks += [("rotation", turn), ("point", frame.position)]
        blocks += [("rotation", approximation.sights[number].rotation) for number in join.sights]
        for block in blocks:
            homes.setdefault(block, join.number)
    return homes


def _row(network: Network, approximation: Approximation, kind: str, number: int, local: Local, home: int) -> StartValue:
    before, after = network.start[kind][number], approximation.start[kind][number]
    given, known = np.isfinite(before), np.isfinite(after)
    changed = known & (~given | (before != after))
    status: Status = "given"
    if not known.all():
        status = "missing"
    elif (changed & given).any():
        status = "replaced"
    elif changed.any():
        status = "found"
    block = network.blocks[kind].ids[number]
    space, _, name = said_thing(kind, block).partition(" ")
    if space in ("rotation", "eccentricity") and " " in block:
        # Planes, lines and right angles: what stands there is replaced by what their points tell.
        space, _, name = block.partition(" ")
        status = "found" if status == "replaced" else status
    components, values, units = _outwards(network, kind, number, after)
    how = None
    # What values come from that have no rule of their own.
    by_default = {
        "point": rule("intersection of rays"),
        "station": rule("from the points it sights"),
        "system": rule("from the points measured in it"),
        "pair": rule("from the images that have it"),
    }
    if status in ("found", "replaced"):
        how = approximation.how.get(f"{space} {name}") or by_default.get(space, by_default["system"])
    factor = np.fmax(local.misfit[number], 1.0)
    per_unit = ANGLE_UNITS[angle_unit_of(network.project)] if kind == "rotation" else 1.0
    sigma = factor * local.sigma[number] / per_unit
    if kind == "rotation":
        sigma = np.array([np.nan if np.isnan(sigma).all() else np.nanmax(sigma)])
    elif kind == "point":
        sigma = np.abs(in_project_axes(network, sigma[None])[0])
    return StartValue(
        space, name, WHAT.get(kind, kind.partition("/")[0]), status,
        _changed_names(network, kind, number, changed), None if status == "missing" else home if changed.any() else 0,
        how, components, values, units, sigma,
        float(local.misfit[number]), int(local.observations[number]),
    )  # fmt: skip


def _changed_names(network: Network, kind: str, number: int, changed: BoolArray) -> tuple[str, ...]:
    if kind == "rotation":
        free = network.blocks[kind].free[number]
        return tuple(np.array(KINDS[kind].names)[free]) if changed.any() else ()
    if kind == "point":
        changed = np.abs(network.edge.matrix.T) @ changed > 0.0
    return tuple(np.array(KINDS[kind].names)[changed].tolist())


def _outwards(
    network: Network, kind: str, number: int, value: FloatArray
) -> tuple[tuple[str, ...], FloatArray, tuple[str, ...]]:
    edge, names = network.edge, KINDS[kind].names
    if kind == "rotation":
        turned = value @ edge.matrix if edge.right_handed else value
        angles = angles_from_rotation(turned[None])[0] / ANGLE_UNITS[angle_unit_of(network.project)]
        return names, angles, (angle_unit_of(network.project),) * 3
    if kind == "point":
        value = in_project_axes(network, value[None])[0]
    scale = network.scales.get(network.blocks[kind].ids[number].removeprefix("camera "))
    return names, value, tuple(edge.default_unit(component.quantity, scale) for component in KINDS[kind].components)


def in_project_axes(network: Network, xyz: FloatArray) -> FloatArray:
    """Coordinates (n, 3) in the axes of the project; what is not known of one does not spread to the others."""
    M = network.edge.matrix
    return np.asarray(xyz[:, np.argmax(np.abs(M), axis=0)] * M.sum(axis=0))


def counts(rows: Sequence[StartValue]) -> Iterator[tuple[str, str, dict[str, int]]]:
    """Count given, computed, replaced and missing start values by kind."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    for row in rows:
        of = found.setdefault((row.kind, row.what), dict.fromkeys(("given", "found", "replaced", "missing"), 0))
        of[row.status] += 1
    for (kind, what), number in found.items():
        yield kind, what, number


# ---- Start values as plain data, for programs.


def start_data(network: Network, approximation: Approximation, rows: Sequence[StartValue]) -> dict[str, Any]:
    """Counts, parts with what is in them, every value, what was replaced, and what is missing."""
    return {
        "schema_version": 1,
        "title": network.project.title,
        "counts": [{"kind": kind, "value": what, **of} for kind, what, of in counts(rows)],
        "parts": [_part(join, network, approximation) for join in approximation.parts],
        "values": [
            {
                "kind": row.kind,
                "id": row.name,
                "value": row.what,
                "status": row.status,
                "found": list(row.found),
                "part": row.part,
                "how": None if row.how is None else str(row.how),
                "components": list(row.components),
                "values": numbers(row.values),
                "units": list(row.units),
                "sigma": numbers(row.sigma),
                "misfit": number_or_none(row.misfit),
                "observations": row.observations,
            }
            for row in rows
        ],
        "replaced": [str(words) for words in approximation.replaced],
        "missing": [
            {"kind": thing.kind, "id": thing.name, "observations": thing.observations, "reason": thing.reason}
            for thing in approximation.missing
        ],
        "remarks": [str(remark) for remark in approximation.remarks],
    }


def _part(join: Join, network: Network, approximation: Approximation) -> dict[str, Any]:
    ids = network.blocks["point"].ids
    frames = [approximation.frames[number].name for number in join.frames]
    sets = [approximation.sights[number].name for number in join.sights]
    return {
        "part": join.number,
        "began_with": str(join.began),
        "joined": join.into,
        "frames": list(dict.fromkeys([*frames, *sets])),
        "points": [ids[point] for point in join.points],
        "knows": {"vertical": join.levelled, "direction": join.oriented, "scale": join.scaled},
        "tie": None
        if join.tie is None
        else {
            "redundancy": join.tie.redundancy,
            "misfit": number_or_none(join.tie.misfit),
            "open_movements": join.tie.open,
            "alternatives": join.tie.alternatives,
        },
    }


# ---- Start values for reading: how many, in which parts, each with its rule and its precision, and what is missing.


def start_text(approximation: Approximation, rows: Sequence[StartValue], words: Words) -> str:
    """The report on start values."""
    all_given = words("All start values are given.") if all(row.status == "given" for row in rows) else ""
    statuses = ("given", "found", "replaced", "missing")
    lines = [
        [words.listed(kind), words.listed(what), *(str(number[status]) for status in statuses)]
        for kind, what, number in counts(rows)
    ]
    parts = [
        all_given,
        f"{heading(words('Start values'))}\n{table(['thing', 'value', *statuses], lines, 2, words)}",
        _parts(approximation, words),
        *_values(rows, words),
        _missing(approximation, words),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _parts(approximation: Approximation, words: Words) -> str:
    if not approximation.parts:
        return ""
    lines = []
    for join in approximation.parts:
        images, stations = _frames(join, approximation)
        names = ("vertical", "direction", "scale")
        known = [words.listed(n) for n, k in zip(names, (join.levelled, join.oriented, join.scaled), strict=True) if k]
        lines.append(
            [
                str(join.number), str(images), str(stations), str(len(join.points)), ", ".join(known) or "-",
                words.listed("object system") if join.into == 0 else str(join.into), _tied(join, words),
                sentence(join.began, words),
            ]
        )  # fmt: skip
    headers = ["part", "images", "stations", "points", "knows", "joined", "what ties it", "began with"]
    drawn = table(headers, lines, 1, words, True)
    explained = words(
        "Part 0 is the object system with what is given. knows: vertical, direction of the axes in plan, scale."
    )
    return f"{heading(words('Parts'))}\n{drawn}\n{explained}"


def _frames(join: Join, approximation: Approximation) -> tuple[int, int]:
    names = {approximation.frames[number].name for number in join.frames}
    names |= {approximation.sights[number].name for number in join.sights}
    images = sum(name.startswith("image ") for name in names)
    return images, len(names) - images


def _tied(join: Join, words: Words) -> str:
    if join.tie is None:
        return words("nothing: it stays in its axes")
    tie = join.tie
    said = words(
        "redundancy {redundancy}, misfit {misfit} %", redundancy=tie.redundancy, misfit=short(100.0 * tie.misfit, 2)
    )
    if tie.open:
        said += "; " + words("{count:movement stays open|movements stay open}", count=tie.open)
    if tie.alternatives:
        said += "; " + words(
            "{count:other movement fits|other movements fit} as well: the most likely one is used",
            count=tie.alternatives,
        )
    return said


def _values(rows: Sequence[StartValue], words: Words) -> list[str]:
    # Values of a kind that the text lists; JSON has all.
    shown = 1000
    lines = [_line(row, words) for row in rows[:shown] if row.status != "missing"]
    if not lines:
        return []
    headers = ["thing", "id", "value", "status", "part", "observations", "misfit [sigma]", "sigma", "unit", "how"]
    parts = [heading(words("Values")), table(headers, lines, 4, words, True)]
    if len(rows) > shown:
        parts.append(words("{count} more are in the JSON report.", count=len(rows) - shown))
    explained = (
        "misfit: root mean square of observed - computed, from its own observations "
        "at the start values, in units of sigma.",
        "sigma: largest component, from these observations with all else held, times the misfit where that exceeds 1;",
        "it does not contain the errors of the neighbours. A dash: its own observations alone do not determine it.",
    )
    parts += [words(line) for line in explained]
    return ["\n".join(parts)]


def _line(row: StartValue, words: Words) -> list[str]:
    largest = float(np.nanmax(row.sigma)) if np.isfinite(row.sigma).any() else None
    status = words.listed(row.status)
    if row.status in ("found", "replaced") and 0 < len(row.found) < len(row.components):
        status += f" ({', '.join(row.found)})"
    return [
        words.listed(row.kind),
        row.name,
        words.listed(row.what),
        status,
        "-" if row.part is None else str(row.part),
        str(row.observations),
        short(row.misfit, 3),
        short(largest, 2),
        row.units[0] if largest is not None else "",
        "" if row.how is None else sentence(row.how, words),
    ]


def sentence(how: Phrase, words: Words) -> str:
    """A rule in the words of a language; names of things with the word for what they are."""
    return words(how.words, **{name: _named(value, words) for name, value in how.values.items()})


def _named(value: str | int | float, words: Words) -> str:
    kind, blank, name = str(value).partition(" ")
    return f"{words.listed(kind)} {name}" if blank else words.listed(kind)


def _missing(approximation: Approximation, words: Words) -> str:
    if not approximation.missing:
        return ""
    rows = [
        [words.listed(thing.kind), thing.name, str(thing.observations), words.told(thing.reason)]
        for thing in approximation.missing
    ]
    lines = [heading(words("Missing start values"))]
    lines.append(table(["object", "id", "observations", "reason"], rows, 2, words, True))
    lines += [sentence(remark, words) for remark in approximation.remarks]
    return "\n".join(lines)


# ---- The plan of what start values were found for: each part in a colour of its own.


def parts(network: Network, approximation: Approximation, words: Words = ENGLISH) -> Figure:
    """Points, images and stations in plan, or in elevation of what is higher than deep, coloured by part."""
    figure = sheet()
    axes = figure.add_subplot()
    xyz = in_project_axes(network, approximation.start["point"])
    chosen, backwards = _plane(network, xyz)
    for k, name in enumerate("xy"):
        getattr(axes, f"set_{name}label")(f"{'XYZ'[chosen[k]]} [{network.project.units.length}]")
        getattr(axes, f"{name}axis").set_inverted(backwards[k])
    axes.set_aspect("equal", adjustable="datalim")
    home, points = _start_values_homes(approximation, len(xyz)), network.things["point"].parts["position"]
    spaces = ("image", "images", "D"), ("station", "stations", "^")
    homes, sizes = np.unique(home, return_counts=True)
    largest = homes[np.argsort(-sizes, kind="stable")][:12].tolist()  # of more parts only these are drawn
    colours = (BLUE, ORANGE, GREEN, RED, PURPLE)
    for k, number in enumerate(sorted(largest)):
        colour = colours[k % len(colours)]
        label = words("part {number}", number=number) if number else words.listed("object system")
        _marks(axes, xyz[points[home[points] == number]][:, chosen], "o", 3, colour, label)
        for space, _, marker in spaces:
            places = np.unique(network.things[space].parts["position"])
            _marks(axes, xyz[places[home[places] == number]][:, chosen], marker, 6, colour, "")
    for _, called, marker in spaces:
        _marks(axes, np.zeros((0, 2)), marker, 6, GREY, words(called))
    named = [
        (name, xyz[block][chosen])
        for space in ("point", "image", "station")
        for name, block in zip(network.things[space].ids, network.things[space].parts["position"], strict=True)
    ]
    for name, place in named if len(named) <= 40 else ():
        if np.isfinite(place).all():
            axes.annotate(str(name), place, (3, 3), textcoords="offset points", fontsize=7)
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=5)
    missing = words("{count} without start values", count=len(approximation.missing))
    title = network.project.title or words("Network")
    axes.set_title(f"{title} – {missing}" if approximation.missing else title, fontsize=9, loc="left")
    return figure


def _plane(network: Network, xyz: FloatArray) -> tuple[list[int], list[bool]]:
    right, up, backwards = plan_axes(network.project.axes.xy)
    known = xyz[np.isfinite(xyz).all(axis=1)]
    extent = np.ptp(known, axis=0) if len(known) > 2 else np.zeros(3)
    if extent[2] <= 2.0 * min(extent[right], extent[up]):
        return [right, up], [backwards[right], backwards[up]]
    wider = right if extent[right] >= extent[up] else up
    return [wider, 2], [backwards[wider], False]


def _start_values_homes(approximation: Approximation, count: int) -> IntArray:
    home = np.zeros(count, dtype=np.int64)
    for join in reversed(approximation.parts):
        home[join.points] = join.number
        home[[approximation.frames[number].position for number in join.frames]] = join.number
    return home


def _marks(axes: Axes, xy: FloatArray, marker: str, size: float, colour: str, label: str) -> None:
    if len(xy) or label:
        axes.plot(xy[:, 0], xy[:, 1], marker, color=colour, ms=size, ls="none", label=label or "_", zorder=3)
