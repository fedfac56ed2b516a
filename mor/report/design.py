"""Reports of a planned network."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from markupsafe import Markup, escape

from mor.errors import escaped
from mor.output_files import Content
from mor.plan.ranking import GreedyStep, Ranked
from mor.plan.requirements import (
    MOST_UNITS,
    MOST_UNKNOWNS,
    REASONS,
    PlanMeasures,
    RequiredControl,
    RequiredPrecision,
    RequirementResult,
    Sighted,
    Switching,
    Unit,
    switching,
)
from mor.project.network import Network
from mor.quality.plausibility import count_outside_the_format
from mor.quality.reliability_map import detectable
from mor.quality.singularity import enumerated
from mor.quality.solution import Solved
from mor.report import layout, text_findings, text_tables
from mor.report import verdict as words_of_reliability
from mor.report.estimates import image_table, point_summary, point_table, station_table
from mor.report.identity import RunIdentity, identity_of
from mor.report.language import Words
from mor.report.layout import DIGITS, cells, heading, paragraphs, round_length, short, sigma_decimals, small_unit, table
from mor.report.movements import DRAWING_WIDTH, MARGIN, drawing, fitted, labels, widest_view
from mor.report.observations import named_places, observation_table
from mor.report.output_folder import Reservation, write_folder
from mor.report.page import asset, rendered
from mor.report.page_data import plan_axes
from mor.report.results import table_writer
from mor.report.summary import summary
from mor.report.text import counts, redundancy
from mor.report.units import ends_of_group, number_or_none, picked, reported_component
from mor.report.verdict import reliability_rows
from mor.types import FloatArray, IntArray

# ---- A plan as plain data, and its tables.


def design_data(solved: Solved, judged: Sequence[RequirementResult], of: RunIdentity) -> dict[str, Any]:
    """Return the expected precision of a plan; nothing in it depends on measured values."""
    of_measurement = (
        *("iterations", "iteration_log", "kernels", "global_test", "flagged", "sigma0", "critical_w", "schema"),
    )
    about = {key: value for key, value in summary(solved).items() if key not in of_measurement}
    about["schema_version"] = 1
    data: dict[str, Any] = {"schema": "mor-design", **about, "plan": True}
    data["require"] = [requirement_row(one, solved) for one in judged]
    data["fulfilled"] = solved.quality is not None and all(one.met for one in judged)
    data["outside_format"] = count_outside_the_format(solved.network)
    data["identity"] = identity_of(solved.network.project, of)
    if solved.quality is None:
        return data
    data["groups"] = group_rows(solved)
    data["reliability"] = reliability_rows(solved)
    data["points"] = point_table(solved).to_dicts()
    data["images"] = image_table(solved).drop("rms").to_dicts()
    data["stations"] = station_table(solved).to_dicts()
    return data


def requirement_row(judged: RequirementResult, solved: Solved) -> dict[str, Any]:
    """A requirement with its verdict, in the units of the project."""
    wanted = judged.requirement
    row = {
        "of": wanted.of,
        "pattern": list(wanted.pattern),
        "limit": wanted.limit,
        "worst": number_or_none(judged.worst),
        "where": _where(judged, solved),
        **picked(judged, "count", "failing", "met"),
    }
    unit = solved.network.project.units.length if isinstance(wanted, RequiredPrecision) else "1"
    return {"what": "sigma" if isinstance(wanted, RequiredPrecision) else "reliability", **row, "unit": unit}


def _where(judged: RequirementResult, solved: Solved) -> str:
    wanted = judged.requirement
    if isinstance(wanted, RequiredControl):
        number, row, component = judged.where
        if number < 0:
            return ""
        group = solved.adjustment.problem.groups[number]
        names = group.said_names(row)
        return f"{group.type.name} {names} {group.type.components[component].name}"
    return wanted.names[judged.where[0]]


def group_rows(solved: Solved) -> list[dict[str, Any]]:
    """Each group with its number of observations, Σ r, smallest r and ∇, largest δ̄0."""
    quality = solved.quality
    assert quality is not None
    rows = []
    for number, (group, one, tests) in enumerate(
        zip(solved.adjustment.problem.groups, quality.groups, quality.reliability, strict=True)
    ):
        r = one.r
        known = np.isfinite(r)
        if not known.any():
            continue
        at = np.unravel_index(int(np.nanargmin(r)), r.shape)
        external = np.where(known & ~np.isfinite(tests.external), np.inf, tests.external)
        largest = float(np.nanmax(external))
        nabla = detectable(quality, np.array([[number, *at]]))[0]
        external_of = ends_of_group(group).external
        component = reported_component(group, int(at[1]))
        found = float(nabla / external_of.factors[component])
        rows.append(
            {
                "name": group.name,
                "type": group.type.name,
                "observations": int(np.count_nonzero(known)),
                "redundancy": float(np.nansum(r)),
                "smallest_r": float(r[at]),
                "nabla": found if np.isfinite(found) else None,
                "unit": external_of.units[component],
                "largest_external": largest if np.isfinite(largest) else None,
            }
        )
    return rows


# ---- Drawings of a plan (SVG): the network with its sights and ellipses, and variants side by side.

_MOST = 640
"""Largest height of the drawing of a network."""


class NetworkDrawing(NamedTuple):
    """Points with their covariances, and where sights begin and end, in project axes."""

    names: Sequence[str]
    places: FloatArray
    """(n, 3); NaN if a point is nowhere."""
    covariances: FloatArray
    """(n, 3, 3)."""
    at: Mapping[str, FloatArray]
    """Place of everything by its name."""
    axes: tuple[int, int]
    """Axes drawn to the right and upwards."""
    signs: tuple[float, float]
    """Of the drawing, whose y counts downwards."""
    unit: str

    @property
    def ellipse_scale(self) -> float:
        """Units of the drawing per unit of σ: the largest of nearly all ellipses is a twentieth of its height."""
        axes = list(self.axes)
        sizes = np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariances[:, axes][:, :, axes])[:, -1], 0.0))
        largest = float(np.quantile(sizes, 0.95)) if len(sizes) else 0.0
        return 0.05 * _MOST / largest if largest > 0.0 else 1.0


def network_drawing(found: NetworkDrawing, sights: Sequence[tuple[str, Sequence[str]]], words: Words) -> Markup:
    """The network: a path for each of the sights (kind, names of its ends), an ellipse of 1σ for each point."""
    axes, signs = list(found.axes), np.array(found.signs)
    everything = np.array([*found.places, *found.at.values()]).reshape(-1, 3)[:, axes] * signs
    everything = everything[np.isfinite(everything).all(axis=1)]
    if not len(everything):
        return Markup("")
    low, high = everything.min(axis=0), everything.max(axis=0)
    factor, height, middle = fitted(low, high, _MOST)

    def on_paper(place: FloatArray) -> FloatArray:
        return np.asarray((place[..., axes] * signs - (low + high) / 2.0) * factor + middle)

    parts = []
    for number, (kind, names) in enumerate(sights[:3_000]):
        ends = [on_paper(found.at[name]) for name in names if name in found.at]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in ends)
        said = escape(" – ".join(names))
        parts.append(
            f'<polyline class="sight {kind}" data-unit="{number}" points="{path}"><title>{said}</title></polyline>'
        )
    for number, (name, place, covariance) in enumerate(zip(found.names, found.places, found.covariances, strict=True)):
        if np.isfinite(place).all():
            parts.append(_point(number, name, on_paper(place), _drawn(found, covariance)))
    xy = on_paper(found.places)
    parts += labels(found.names, xy, np.flatnonzero(np.isfinite(xy).all(axis=1)), height, 7.2)
    parts.append(_scale_bar(found, height))
    return drawing(parts, DRAWING_WIDTH, height, words("The network as planned"), name="network")


def _drawn(found: NetworkDrawing, covariance: FloatArray) -> FloatArray:
    """(2, 2) covariances in the axes of the drawing, in its units."""
    axes = list(found.axes)
    part = covariance[np.ix_(axes, axes)] * np.outer(found.signs, found.signs)
    return np.asarray(part * found.ellipse_scale**2)


def _point(number: int, name: str, at: FloatArray, covariance: FloatArray) -> str:
    values, vectors = np.linalg.eigh(covariance)
    b, a = np.sqrt(np.maximum(values, 0.0))
    turn = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    place = f"translate({at[0]:.1f} {at[1]:.1f})"
    return (
        f'<g transform="{place}"><ellipse class="before" rx="{a:.2f}" ry="{b:.2f}" transform="rotate({turn:.2f})"/>'
        f'<ellipse class="now" data-point="{number}" rx="{a:.2f}" ry="{b:.2f}" transform="rotate({turn:.2f})"/>'
        f'<circle r="2.2"/><title>{escape(name)}</title></g>'
    )


def _scale_bar(found: NetworkDrawing, height: float) -> str:
    wanted = 100.0 / found.ellipse_scale
    unit, factor = small_unit(found.unit, wanted)
    length = round_length(wanted * factor)
    drawn = length / factor * found.ellipse_scale
    y = height - 14
    return (
        f'<line class="bar" x1="{MARGIN}" x2="{MARGIN + drawn:.1f}" y1="{y:.0f}" y2="{y:.0f}"/>'
        f'<text x="{MARGIN + drawn + 8:.1f}" y="{y + 4:.0f}">1σ: {length:g} {unit}</text>'
    )


def variants_drawing(rows: Sequence[Mapping[str, Any]], unit: str, words: Words) -> Markup:
    """Mean σ of x, y, z and the smallest r of each variant as bars, the plan itself first."""
    keys = ("rms_sx", "rms_sy", "rms_sz")
    largest = max([float(row[key] or 0.0) for row in rows for key in keys] + [1e-300])
    best = max([float(row["smallest_r"] or 0.0) for row in rows] + [1e-300])
    parts, y = [], 10.0
    bar, gap, room_of_names, room_of_bars = 11, 14, 220, 520
    for number, row in enumerate(rows):
        name = words.listed(row["name"]) if number == 0 else row["name"]
        said_name = name if len(name) <= 30 else f"{name[:29]}…"
        verdict = "none" if row["redundancy"] is None else "good" if row["fulfilled"] else "bad"
        judged = verdict if row["require"] or verdict == "none" else "none"
        parts.append(
            f'<text class="name {judged}" x="{room_of_names - 10}" y="{y + 2 * bar + 4:.0f}">{escape(said_name)}</text>'
        )
        bars = [*((f"s{k[-1].upper()}", row[k], largest, unit, k[-1]) for k in keys)]
        bars.append(("min r", row["smallest_r"], best, "", "r"))
        for said, value, most, its_unit, kind in bars:
            length = room_of_bars * float(value or 0.0) / most
            number_said = words.number(f"{value:#.3g}") if value is not None else words("no solution")
            parts.append(
                f'<rect class="{kind}" x="{room_of_names}" y="{y:.1f}" width="{length:.1f}" height="{bar - 2}"/>'
                f'<text class="value" x="{room_of_names + length + 5:.1f}" y="{y + bar - 3:.1f}">'
                f"{said} {escape(number_said)} {its_unit}</text>"
            )
            y += bar
        y += gap
    return drawing(parts, DRAWING_WIDTH, y, words("Variants"), "drawing variants")


# ---- The ranking of a plan as a table, and its first lines in words.


def now_row(now: PlanMeasures, network: Network) -> dict[str, Any]:
    """Return the row of the unchanged plan; ``rms_sigma`` is in parts of the limits, or in the length unit."""
    return {
        "shortfall": float(now.shortfall[0]),
        "rms_sigma": float(np.sqrt(now.precision[0])),
        "rms_sigma_unit": _unit(now, network) or "limit",
        "largest_sigma_ratio": number_or_none(now.largest_ratio[0]),
        "smallest_r": number_or_none(now.smallest_r[0]),
    }


def ranking_table(
    network: Network, planned: Sequence[Ranked], candidates: Sequence[Ranked], steps: Sequence[GreedyStep]
) -> pl.DataFrame:
    """All of them: ``spare`` for planned observations, ``add`` for candidates, ``greedy`` for the choices in turn."""
    texts: dict[tuple[bool, int], dict[str, pl.Series]] = {}
    rows = [
        *(_row(network, "spare", k, one, one.unit.cost, texts) for k, one in enumerate(planned, start=1)),
        *(_row(network, "add", k, one, one.unit.cost, texts) for k, one in enumerate(candidates, start=1)),
        *(_row(network, "greedy", k, one.ranked, one.measurements, texts) for k, one in enumerate(steps, 1)),
    ]
    schema = {
        **dict.fromkeys(("kind", "type", "group", "at", "from", "to"), pl.String),
        **dict.fromkeys(("rank", "measurements"), pl.Int64),
        **dict.fromkeys(("shortfall", "rms_sigma", "largest_sigma_ratio", "smallest_r"), pl.Float64),
        "possible": pl.Boolean,
    }
    return pl.DataFrame(rows, schema=schema, orient="row")


def _row(
    network: Network,
    kind: str,
    rank: int,
    one: Ranked,
    measurements: int,
    texts: dict[tuple[bool, int], dict[str, pl.Series]],
) -> tuple[Any, ...]:
    """A row of the table; ``texts`` keeps the names of each group."""
    unit = one.unit
    group = (network.candidates if unit.is_candidate else network.groups)[unit.group]
    key = (unit.is_candidate, unit.group)
    if key not in texts:
        texts[key] = {name: column.texts() for name, column in named_places(group).items()}
    places = [texts[key][name][unit.row] if name in texts[key] else "" for name in ("at", "from", "to")]
    ratio, r = number_or_none(one.largest_ratio), number_or_none(one.smallest_r)
    numbers = (one.shortfall, float(np.sqrt(max(one.precision, 0.0))), ratio, r)
    said = numbers if one.possible else (None,) * len(numbers)
    return (kind, group.type.name, group.name, *places, rank, measurements, *said, one.possible)


def _unit(now: PlanMeasures, network: Network) -> str:
    """Length unit of the mean σ; empty if σ are required, for then it is in parts of their limits."""
    return "" if np.isfinite(now.largest_ratio[0]) else network.project.units.length


def ranking_text(frame: pl.DataFrame, now: PlanMeasures, network: Network, unestimable: int, words: Words) -> str:
    """Return the changes that lose least, those that gain most, and the greedy plan as text."""
    lines = [
        heading(words("Value of single observations")),
        words(
            "As it is: shortfall {shortfall}, {name} {sigma}, worst / limit {ratio}, smallest r {r}.",
            shortfall=short(float(now.shortfall[0]), 4),
            name=words.header(_rms(now, network)),
            sigma=short(float(np.sqrt(now.precision[0])), 5),
            ratio=short(float(now.largest_ratio[0]), 4),
            r=short(float(now.smallest_r[0]), 4),
        ),
        words(
            "The shortfall is 0 if all requirements are met. Each line describes the plan with this one change; "
            "ranking.csv lists all of them."
        ),
    ]
    for kind, title in (
        ("spare", "Without it (the most easily spared first)"),
        ("add", "With it in addition (the most useful first)"),
        ("greedy", "Chosen one after another, each with those before it"),
    ):
        some = frame.filter(pl.col("kind") == kind)
        # Observations of each kind that the text names.
        shown = some if kind == "greedy" else some.head(10)
        if some.height:
            rms = _rms(now, network)
            columns = "measurements shortfall:.4g rms_sigma:.5g largest_sigma_ratio:.4g smallest_r:.4g"
            rows = [
                [row["type"], " ".join(row[key] for key in ("at", "from", "to") if row[key]), *cells(row, columns)]
                for row in shown.to_dicts()
            ]
            headers = ["type", "between", "n", "shortfall", "worst / limit", "smallest r"]
            lines += ["", f"{words(title)}:", table([*headers[:4], rms, *headers[4:]], rows, 2, words, margin=2)]
    lost = frame.filter(~pl.col("possible") & (pl.col("kind") == "spare")).height
    if lost:
        said = "{count:observation|observations} cannot be spared: something would be undetermined."
        lines += ["", words(said, count=lost)]
    beyond = frame.filter(~pl.col("possible") & (pl.col("kind") == "add")).height
    if beyond:
        said = "{count:candidate|candidates} could not be assessed: the line of sight is far beyond any measurement."
        lines += ["", words(said, count=beyond)]
    if not frame.filter(pl.col("kind") == "spare").height:
        lines += ["", words("In a block of this size only candidates are ranked.")]
    if unestimable:
        said = (
            "{count:candidate is|candidates are} not ranked: it would determine a free movement of the network "
            "and so change the datum."
        )
        lines += ["", words(said, count=unestimable)]
    return "\n".join(lines)


def _rms(now: PlanMeasures, network: Network) -> str:
    unit = _unit(now, network)
    return f"rms sigma [{unit}]" if unit else "rms / limit"


# ---- The text report of a plan.

WHAT = {
    "x": "sigma of x",
    "y": "sigma of y",
    "z": "sigma of z",
    "xy": "sigma of x and of y",
    "xyz": "sigma of x, y and z",
    "ellipsoid": "longest semi-axis of the error ellipsoid",
    "r": "redundancy number r",
    "external": "external reliability",
}


def design_text(
    solved: Solved, judged: Sequence[RequirementResult], words: Words, of: RunIdentity, more: Sequence[str]
) -> str:
    """The report of a plan: the verdict on what is required first, ``more`` sections, then what can be expected."""
    about = identity_of(solved.network.project, of)
    sections = [
        head(solved, judged, words, layout.persons(about, words)),
        requirement_section(solved, judged, words),
        *more,
        text_findings.undetermined_section(solved, words),
        text_findings.listed(solved, words),
    ]
    if solved.quality is not None:
        columns = "name type observations redundancy:.2f smallest_r:.4f nabla:.3g unit largest_external:.3g"
        rows = [cells(row, columns) for row in group_rows(solved)]
        headers = ["group", "type", "n", "sum r", "smallest r [1]", "nabla", "unit", "external [1]"]
        sections += [
            words_of_reliability.section_of_reliability(solved, words),
            "\n".join([heading(words("Planned observations")), table(headers, rows, 2, words)]),
            text_tables.camera_section(solved, words),
            _images(solved, words),
            text_tables.station_section(solved, words),
            text_tables.feature_section(solved, words),
            text_tables.section_of_others(solved, words),
            text_tables.point_section(solved, words),
        ]
    sections.append(layout.section(about, words))
    return paragraphs(escaped("\n\n".join(section for section in sections if section))) + "\n"


def verdict(solved: Solved, judged: Sequence[RequirementResult], words: Words) -> list[str]:
    """State whether the plan can be adjusted and meets its requirements, and its visibility limits."""
    failing = sum(not one.met for one in judged)
    if solved.quality is None:
        lines = [words("THE PLAN HAS NO SOLUTION: {reason}.", reason=words.told(solved.adjustment.reason))]
    elif not judged:
        lines = [words("The project file has no requirements (require: …).")]
    elif not failing:
        lines = [words("It meets all requirements ({count}).", count=len(judged))]
    else:
        lines = [words("IT DOES NOT MEET {count} of {all} requirements.", count=failing, all=len(judged))]
    outside = count_outside_the_format(solved.network)
    said = "{count:planned image point lies|planned image points lie} outside the format of the camera."
    return [*lines, *([words(said, count=outside)] if outside else [])]


def head(
    solved: Solved, judged: Sequence[RequirementResult], words: Words, persons: Sequence[tuple[str, str]] = ()
) -> str:
    """Return title, verdict and key figures."""
    data = summary(solved)
    title = data["title"] or words("Adjustment")
    plan = words("PLAN: nothing has been measured; σ are expected values, a priori.")
    rows = counts(data, words) + ([redundancy(data, words)] if solved.quality is not None else [])
    rows.append(("units", words("lengths {length}, angles {angle}", **data["units"])))
    said = [*persons, *((words(name), value) for name, value in rows)]
    return "\n".join([*layout.titled(title), "", plan, *verdict(solved, judged, words), "", *layout.aligned(said)])


def requirement_section(solved: Solved, judged: Sequence[RequirementResult], words: Words) -> str:
    """Each requirement with its limit, the worst value, and where that is."""
    if not judged:
        return ""
    rows = [requirement_row(one, solved) for one in judged]
    return "\n".join([heading(words("Requirements")), *(_sentence(row, words) for row in rows)])


def _sentence(row: dict[str, Any], words: Words) -> str:
    limit, worst = _limit_and_worst(row, words)
    return words(
        "{verdict}: {what}, {id}: {sign} {limit}; worst {worst} ({place}); {failing} of {count} fail",
        verdict=words("reached") if row["met"] else words("NOT REACHED"),
        what=words(WHAT[row["of"]]),
        id=", ".join(row["pattern"]),
        sign="≥" if row["of"] == "r" else "≤",
        limit=limit,
        worst=worst,
        place=row["where"],
        failing=row["failing"],
        count=row["count"],
    )


def _limit_and_worst(row: dict[str, Any], words: Words) -> list[str]:
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    return [words.number("∞" if v is None else short(v, 4)) + unit for v in (row["limit"], row["worst"])]


def _images(solved: Solved, words: Words) -> str:
    frame = image_table(solved)
    if frame.height == 0:
        return ""
    unit = solved.network.project.units.length
    numbers = " ".join(f"{name}:.{DIGITS[unit]}f" for name in ("x", "y", "z", "sx", "sy", "sz"))
    rows = [cells(row, f"id camera {numbers} points") for row in frame.to_dicts()]
    headers = ["image", "camera", *(f"{name} [{unit}]" for name in ("X0", "Y0", "Z0", "sX0", "sY0", "sZ0"))]
    return "\n".join([heading(words("Images")), table([*headers, "points"], rows, 2, words)])


# ---- Variants of a plan side by side.

Named = tuple[str, Solved, Sequence[RequirementResult]]


def variant_row(name: str, solved: Solved, judged: Sequence[RequirementResult]) -> dict[str, Any]:
    """Return counts, mean σ of the free points, and requirements of a variant."""
    quality = solved.quality
    row: dict[str, Any] = {
        "name": name,
        "outcome": solved.adjustment.outcome.value,
        "reason": solved.adjustment.reason,
        "observations": solved.adjustment.problem.observations,
        "redundancy": quality.redundancy if quality is not None else None,
        "fulfilled": quality is not None and all(one.met for one in judged),
        "require": [requirement_row(one, solved) for one in judged],
        "left_out": [[thing.kind, thing.name] for thing in solved.network.undeterminable],
        "outside_format": count_outside_the_format(solved.network),
        "smallest_r": None,
        **dict.fromkeys(("rms_sx", "rms_sy", "rms_sz")),
    }
    if quality is None:
        return row
    known = [float(np.nanmin(one.r)) for one in quality.groups if np.isfinite(one.r).any()]
    row["smallest_r"] = min(known) if known else None
    sigma = point_summary(solved).rms
    return row | {f"rms_s{axis}": value for axis, value in zip("xyz", sigma, strict=True)}


def variant_text(rows: Sequence[dict[str, Any]], unit: str, words: Words) -> str:
    """One line for each variant, the plan itself first."""
    numbers = " ".join(f"rms_s{axis}:.{DIGITS[unit] + 1}f" for axis in "xyz")
    columns = f"observations redundancy {numbers} smallest_r:.3g"
    names = [words.listed(rows[0]["name"]), *(row["name"] for row in rows[1:])]
    lines_of = [[name, *cells(row, columns), _reached(row, words)] for name, row in zip(names, rows, strict=True)]
    headers = ["variant", "n", "redundancy", *(f"rms s{a} [{unit}]" for a in "XYZ"), "smallest r", "required"]
    lines = [heading(words("Variants")), table(headers, lines_of, 1, words, last_left=True)]
    for row in rows:
        if row["left_out"]:
            told = [f"{words.listed(kind)} {name}" for kind, name in row["left_out"]]
            said = "{id}: nothing determines {names} any more; left out."
            lines.append(words(said, id=row["name"], names=enumerated(told, 8, words)))
        if row["outside_format"]:
            said = "{id}: {count:image point lies|image points lie} outside the format of the camera."
            lines.append(words(said, id=row["name"], count=row["outside_format"]))
        if row["redundancy"] is None:
            lines.append(words("{id}: no solution: {reason}.", id=row["name"], reason=words.told(row["reason"])))
    return "\n".join(lines)


def _reached(row: dict[str, Any], words: Words) -> str:
    if row["redundancy"] is None:
        return words("no solution")
    wanted = row["require"]
    failing = sum(not one["met"] for one in wanted)
    if not wanted:
        return "-"
    return words("reached") if not failing else words("{count} of {all} fail", count=failing, all=len(wanted))


# ---- Visibility: how many sights there are, and what keeps the others from being made.


def visible_rows(sighted: Sequence[Sighted]) -> list[dict[str, Any]]:
    """Return the sights of each group of planned observations as plain data."""
    return [
        {
            "group": one.name,
            "section": one.section,
            **dict(zip(REASONS, one.counts, strict=True)),
            "seen_from_nowhere": list(one.unseen),
            "seen_once": list(one.once),
        }
        for one in sighted
    ]


def visible_section(sighted: Sequence[Sighted], words: Words) -> str:
    """A line for each group, the targets that nothing sees, and those that are seen only once."""
    if not sighted:
        return ""
    rows = [[one.name, str(sum(one.counts)), *map(str, one.counts)] for one in sighted]
    headers = ["group", "sights", "seen", "out of range", "off format", "slanting", "hidden"]
    lines = [
        heading(words("Visibility")),
        table(headers, rows, 1, words),
        words("A sight counts where it fails first: range; format, or steepness; incidence; surfaces in its way."),
    ]
    for one in sighted:
        for names, said in (
            (one.unseen, "{id}: {count:target is|targets are} not seen from anywhere: {names}."),
            (one.once, "{id}: {count:target is|targets are} seen from one place only: {names}."),
        ):
            if names:
                lines.append(words(said, id=one.name, count=len(names), names=enumerated(names, 12, words)))
    return "\n".join(lines)


# ---- The files of a plan.

USUAL_FILES = ("design.json", "design.txt", "design.html")
"""Files that every plan has."""


def write_design(solved: Solved, text: str, data: str, more: dict[str, Content], place: Reservation) -> None:
    """Write report, data and tables of a plan; where it has no solution report and data alone."""
    writers: dict[str, Content] = {"design.txt": text, "design.json": data, **more}
    if solved.quality is not None:
        writers["points.csv"] = table_writer(point_table(solved))
        # All planned observations: the value to be expected, σ, σ adjusted, r, ∇, δ̄0.
        frame = observation_table(solved).rename({"observed": "planned"})
        # Columns of the table of planned observations.
        observations = (
            *("type", "group", "at", "from", "to", "component", "unit", "planned", "sigma", "sigma_adjusted"),
            *("r", "nabla", "external"),
        )
        writers["planned.csv"] = table_writer(frame.select(observations))
        if solved.network.things["image"].ids:
            writers["images.csv"] = table_writer(image_table(solved).drop("rms"))
    write_folder(place, writers)


# ---- The page of a plan, in one file that needs nothing else; in that of a small network observations can be switched.

_SIGMAS = ("sx", "sy", "sz")


def design_page(
    solved: Solved,
    judged: Sequence[RequirementResult],
    sighted: Sequence[Sighted],
    variants: Sequence[dict[str, Any]],
    words: Words,
    of: RunIdentity,
) -> str:
    """Verdict, requirements, the network with its ellipses, observations to switch, variants, points."""
    about = identity_of(solved.network.project, of)
    title = summary(solved)["title"] or words("Adjustment")
    headline, *more = verdict(solved, judged, words)
    quality, network = solved.quality, solved.network
    found = switching(quality, network.candidates) if quality is not None else None
    plan = _drawing(solved) if quality is not None else None
    units = [_unit_row(network, k, unit) for k, unit in enumerate(found.units)] if found else []
    ends = [(row["kind"], row["ends"]) for row in units] if found else _all_sights(network)
    good = quality is not None and all(one.met for one in judged)
    return rendered(
        "design.html.j2",
        title,
        about,
        words,
        ("page.css", "certificate.css", "design.css"),
        headline=headline,
        state="good" if good and judged else "doubt" if good else "bad",
        more=more,
        requirements=[_requirement(one, solved, words) for one in judged],
        sighted=[{"name": s.name, "all": sum(s.counts), "counts": s.counts} for s in sighted],
        drawing=network_drawing(plan, ends, words) if plan else "",
        variants=variants_drawing(variants, network.project.units.length, words) if variants else "",
        units=units,
        points=_point_rows(solved, words) if quality is not None else [],
        unit=network.project.units.length,
        payload=Markup(_payload(found, plan, judged, solved, words)) if found and plan else "",
        limits={"unknowns": MOST_UNKNOWNS, "units": MOST_UNITS},
        script=Markup(asset("design.js")),
    )


def _requirement(one: RequirementResult, solved: Solved, words: Words) -> dict[str, Any]:
    row = requirement_row(one, solved)
    limit, worst = _limit_and_worst(row, words)
    return {
        "what": words(WHAT[row["of"]]),
        "of": ", ".join(row["pattern"]),
        "limit": f"{'≥' if row['of'] == 'r' else '≤'} {limit}",
        "worst": worst,
        "where": row["where"],
        "met": row["met"],
    }


def _drawing(solved: Solved) -> NetworkDrawing:
    """Positions, and error ellipses of the points, in the axes of the drawing."""
    quality, network = solved.quality, solved.network
    assert quality is not None
    table = point_table(solved)
    names = table["id"].cast(pl.String).to_list()
    places = table.select("x", "y", "z").to_numpy().astype(float)
    M = network.edge.matrix
    blocks = network.things["point"].parts["position"]
    covariances = M.T @ np.nan_to_num(quality.cofactors["point"][blocks]) @ M * quality.sigma_factor**2
    right, _, backwards = plan_axes(network.project.axes.xy)
    chosen = widest_view(places[np.isfinite(places).all(axis=1)], right)
    signs = [-1.0 if backwards[k] else 1.0 for k in chosen]
    others: dict[str, FloatArray] = {}
    for frame in (station_table(solved), image_table(solved)):
        if frame.height:
            others |= dict(zip(frame["id"].cast(pl.String), frame.select("x", "y", "z").to_numpy(), strict=True))
    at = {**others, **dict(zip(names, places, strict=True))}
    return NetworkDrawing(names, places, covariances, at, chosen, (signs[0], -signs[1]), network.project.units.length)


def _all_sights(network: Network) -> list[tuple[str, list[str]]]:
    found: dict[tuple[str, ...], None] = {}
    for group in network.groups:
        if len(group.lines):
            columns = [names.texts().to_list() for names in named_places(group).values()]
            found |= dict.fromkeys(zip(*columns, strict=True))
    return [("on", list(ends)) for ends in found]


def _unit_row(network: Network, number: int, unit: Unit) -> dict[str, Any]:
    groups = network.candidates if unit.is_candidate else network.groups
    group = groups[unit.group]
    ends = [names.texts()[unit.row] for names in named_places(group).values()]
    said = [end for end in ends if end]
    return {
        "number": number,
        "kind": "candidate" if unit.is_candidate else "on",
        "type": group.type.name,
        "group": group.name,
        "between": " – ".join(said),
        "ends": said,
        "count": unit.cost,
    }


def _point_rows(solved: Solved, words: Words) -> list[dict[str, Any]]:
    form = " ".join(f"{name}:.{_decimals(solved)}f" for name in _SIGMAS)
    rows = point_table(solved).to_dicts()
    return [{"id": row["id"], "sigma": [*map(words.number, cells(row, form))]} for row in rows]


def _decimals(solved: Solved) -> int:
    """Decimals of the σ of points: nearly all have three digits, for plans are compared by them."""
    return sigma_decimals(point_table(solved).select(_SIGMAS).to_numpy().ravel(), 3)


def _payload(
    found: Switching, drawing: NetworkDrawing, judged: Sequence[RequirementResult], solved: Solved, words: Words
) -> str:
    """Rows, cofactors and what is required, for the script: numbers exactly as they are."""
    quality, network = solved.quality, solved.network
    assert quality is not None
    row, column = np.nonzero(found.rows)
    blocks = network.things["point"].parts["position"]
    # Sentences that the script of the page says.
    sentences = (
        "reached",
        "NOT REACHED",
        "This cannot be spared: something would be undetermined.",
        "{on} of {all} observations; smallest r {r} ({place})",
    )
    data = {
        "unknowns": len(found.cofactors),
        "cofactors": _packed(found.cofactors),
        "start": np.searchsorted(row, np.arange(len(found.rows) + 1)).tolist(),
        "column": column.tolist(),
        "value": _packed(found.rows[row, column]),
        "group": found.group.tolist(),
        "groups": len(network.groups),
        "units": [{"rows": one.rows.tolist(), "candidate": one.is_candidate} for one in found.units],
        "correlated": [
            {"rows": rows.tolist(), "L": L.tolist(), "inverse": np.linalg.inv(L).tolist()}
            for rows, L in found.correlated
        ],
        "points": [
            {"name": name, "columns": columns}
            for name, columns in zip(drawing.names, found.columns[blocks].tolist(), strict=True)
        ],
        "axes": network.edge.matrix.tolist(),
        "view": {"axes": drawing.axes, "signs": drawing.signs, "scale": drawing.ellipse_scale},
        "require": [_wanted(one, blocks, quality.noncentrality) for one in judged],
        "unit": network.project.units.length,
        "decimal": words.decimal,
        "decimals": _decimals(solved),
        "words": {english: words.listed(english) for english in sentences},
    }
    return json.dumps(data, ensure_ascii=False, allow_nan=False).replace("</", "<\\/")


def _wanted(one: RequirementResult, blocks: IntArray, noncentrality: float) -> dict[str, Any]:
    wanted = one.requirement
    if isinstance(wanted, RequiredPrecision):
        number = {int(block): k for k, block in enumerate(blocks)}
        points = [number[int(block)] for block in wanted.blocks]
        return {"of": "sigma", "points": points, "components": wanted.components, "limit": wanted.limit}
    least = wanted.limit if wanted.of == "r" else noncentrality / (noncentrality + wanted.limit**2)
    return {
        "of": wanted.of,
        "groups": wanted.groups,
        "limit": wanted.limit,
        "least": least,
        "noncentrality": noncentrality,
    }


def _packed(values: FloatArray) -> str:
    """Eight bytes for each number, little-endian, in base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode("ascii")
