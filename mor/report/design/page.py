"""The page of a plan, in one file that needs nothing else; in that of a small network observations can be switched."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl
from markupsafe import Markup

from mor.arrays import FloatArray, IntArray
from mor.project.network.build import Network
from mor.quality.design.interest import Unit
from mor.quality.design.requirements import Judged, RequiredPrecision
from mor.quality.design.sighted import REASONS, Sighted
from mor.quality.design.switching import MOST_UNITS, MOST_UNKNOWNS, Switching, switching
from mor.quality.solved import Solved
from mor.report.design.content import requirement_row
from mor.report.design.drawing import Drawing, network_drawing, variants_drawing
from mor.report.design.text import WHAT, verdict
from mor.report.epochs.drawing import widest_view
from mor.report.html.page import asset, environment
from mor.report.html.paper import running_heads
from mor.report.html.payload import drawn_axes
from mor.report.identity import Identity, identity_of
from mor.report.layout import fixed, short, sigma_decimals
from mor.report.results.summary import summary
from mor.report.tables.estimates import image_table, point_table, station_table
from mor.report.tables.observations import named_places
from mor.report.words.language import Words

_WORDS = (
    "reached",
    "NOT REACHED",
    "This cannot be spared: something would be undetermined.",
    "{on} of {all} observations; smallest r {r} ({place})",
)
"""Sentences that the script of the page says."""
_SIGMAS = ("sx", "sy", "sz")


def design_page(
    solved: Solved,
    judged: Sequence[Judged],
    sighted: Sequence[Sighted],
    variants: Sequence[dict[str, Any]],
    words: Words,
    of: Identity,
) -> str:
    """Verdict, requirements, the network with its ellipses, observations to switch, variants, points."""
    about = identity_of(solved.network.project, of)
    title = summary(solved)["title"] or words("Adjustment")
    headline, *more = verdict(solved, judged, words)
    quality, network = solved.quality, solved.network
    found = switching(quality, network.candidates) if quality is not None else None
    drawing = _drawing(solved) if quality is not None else None
    units = [_unit_row(network, k, unit, solved) for k, unit in enumerate(found.units)] if found else []
    ends = [(row["kind"], row["ends"]) for row in units] if found else _all_sights(network)
    good = quality is not None and all(one.met for one in judged)
    return (
        environment()
        .get_template("design.html.j2")
        .render(
            title=title,
            headline=headline,
            state="good" if good and judged else "doubt" if good else "bad",
            more=more,
            requirements=[_requirement(one, solved, words) for one in judged],
            sighted=[{"name": s.name, "all": sum(s.counts), "counts": s.counts} for s in sighted],
            reasons=REASONS,
            drawing=network_drawing(drawing, ends, words) if drawing else "",
            variants=variants_drawing(variants, network.project.units.length, words) if variants else "",
            units=units,
            points=_point_rows(solved, words) if quality is not None else [],
            unit=network.project.units.length,
            payload=Markup(_payload(found, drawing, judged, solved, words)) if found and drawing else "",
            limits={"unknowns": MOST_UNKNOWNS, "units": MOST_UNITS},
            identity=about,
            say=words,
            style=Markup(asset("page.css") + asset("certificate.css") + asset("design.css")),
            script=Markup(asset("design.js")),
            running=running_heads(title, about, words),
        )
    )


def _requirement(one: Judged, solved: Solved, words: Words) -> dict[str, Any]:
    row = requirement_row(one, solved)
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    limit, worst = (
        words.number("∞" if v is None else short(v, 4)) + unit for v in (row["limit"], row["worst"])
    )
    return {
        "what": words(WHAT[row["of"]]),
        "of": ", ".join(row["pattern"]),
        "limit": f"{'≥' if row['of'] == 'r' else '≤'} {limit}",
        "worst": worst,
        "where": row["where"],
        "met": row["met"],
    }


def _drawing(solved: Solved) -> Drawing:
    """Positions, and error ellipses of the points, in the axes of the drawing."""
    quality, network = solved.quality, solved.network
    assert quality is not None
    table = point_table(solved)
    names = table["id"].cast(pl.String).to_list()
    places = table.select("x", "y", "z").to_numpy().astype(float)
    M = network.edge.matrix
    blocks = network.things["point"].parts["position"]
    covariances = M.T @ np.nan_to_num(quality.cofactors["point"][blocks]) @ M * quality.sigma_factor**2
    axes = drawn_axes(network.project.axes.xy)
    known = np.isfinite(places).all(axis=1)
    chosen = widest_view(places[known], "xy".index(axes["right"]))
    reversed_ = {axes["right"]: axes["right_reversed"], axes["up"]: axes["up_reversed"]}
    signs = [-1.0 if reversed_.get("xyz"[k], False) else 1.0 for k in chosen]
    others: dict[str, FloatArray] = {}
    for frame in (station_table(solved), image_table(solved)):
        if frame.height:
            others |= dict(
                zip(frame["id"].cast(pl.String), frame.select("x", "y", "z").to_numpy(), strict=True)
            )
    at = {**others, **dict(zip(names, places, strict=True))}
    return Drawing(
        names, places, covariances, at, chosen, (signs[0], -signs[1]), network.project.units.length
    )


def _all_sights(network: Network) -> list[tuple[str, list[str]]]:
    """Ends of the sights of a network that is too large to be switched, each pair once."""
    found: dict[tuple[str, ...], None] = {}
    for group in network.groups:
        if len(group.lines):
            columns = [names.texts().to_list() for names in named_places(group).values()]
            found |= dict.fromkeys(zip(*columns, strict=True))
    return [("on", list(ends)) for ends in found]


def _unit_row(network: Network, number: int, unit: Unit, solved: Solved) -> dict[str, Any]:
    """Row of a set of observations that are made together."""
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
    table, decimals = point_table(solved), _decimals(solved)
    return [
        {"id": row["id"], "sigma": [words.number(fixed(row[key], decimals)) for key in _SIGMAS]}
        for row in table.iter_rows(named=True)
    ]


def _decimals(solved: Solved) -> int:
    """Decimals of the σ of points: nearly all have three digits, for plans are compared by them."""
    return sigma_decimals(point_table(solved).select(_SIGMAS).to_numpy().ravel(), 3)


def _payload(
    found: Switching, drawing: Drawing, judged: Sequence[Judged], solved: Solved, words: Words
) -> str:
    """Rows, cofactors and what is required, for the script: numbers exactly as they are."""
    quality, network = solved.quality, solved.network
    assert quality is not None
    row, column = np.nonzero(found.rows)
    blocks = network.things["point"].parts["position"]
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
        "words": {english: words.listed(english) for english in _WORDS},
    }
    return json.dumps(data, ensure_ascii=False, allow_nan=False).replace("</", "<\\/")


def _wanted(one: Judged, blocks: IntArray, noncentrality: float) -> dict[str, Any]:
    """A requirement for the script; external reliability as the redundancy number that it is."""
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
