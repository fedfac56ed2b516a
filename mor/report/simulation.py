"""Files of simulated projects, and reports of Monte Carlo."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import polars as pl

from mor.errors import escaped
from mor.model.contract import ObservationGroup
from mor.model.images import is_image_point
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import Values
from mor.model.rotations import angles_from_rotation
from mor.plan.simulation import (
    CONFIDENCE,
    LEVEL,
    Finding,
    Planted,
    Tally,
    Truth,
    coverage_intervals,
    findings,
    interval_noise,
)
from mor.project.axes import UnitError
from mor.project.document import Document
from mor.project.entities import AT, said_thing
from mor.project.network import Network
from mor.project.rows import AIR
from mor.project.schema import Observations
from mor.project.tables import Source, TableLocation, raw_table
from mor.report import layout
from mor.report.adjusted_project import Given, Placed, Setting, adjusted_project, grids_moved, with_settings
from mor.report.identity import RunIdentity, identity_of, schema_of
from mor.report.language import Words
from mor.report.layout import heading, paragraphs, short, table
from mor.report.observations import named_places
from mor.report.units import ends_of_group, reported_component, said_differences, said_one, said_values
from mor.types import FloatArray, IntArray
from mor.units import ANGLE, ANGLE_UNITS, LENGTH, Quantity

# ---- A simulated project as files: simulated values in place of measured ones, the rest as it was given.

_OF_VALUES = ("parameter", "difference")


def simulated_project(
    network: Network, place: Values, document: Document, source: Path, target: Path
) -> tuple[str, dict[str, Given]]:
    """YAML text of a project with the observations of the network, to stand in ``target``, and its tables.

    ``source`` is the folder of the original project; start values are those of the ``place``. Rows without any value
    are left out. Simulated distances are corrected for the air already, and their tables have none.
    """
    text_of: dict[str, Any] = {}
    tables: dict[str, Given] = {}
    for section, groups in (("observations", network.groups), ("checks", network.checks)):
        entries = getattr(network.project, section)
        if entries:
            text_of[section] = [
                _simulated(network, groups, document, source, section, number, entry, tables)
                for number, entry in enumerate(entries)
            ]
    data = {**document.data, **text_of}
    if data.get("candidates"):
        data["candidates"] = [
            entry if document.frame(str(entry.get("file"))) is not None else _where_it_stands(entry, source, target)
            for entry in data["candidates"]
        ]
    for section in ("cameras", "instruments"):
        if data.get(section):
            data[section] = with_settings(network, section, data[section], network.observed, _observed)
    if data.get("world"):
        data["world"] = grids_moved(data["world"], source, target)
    data.pop("visibility", None)  # it has been worked out; its meshes stay where they are
    text, starts = adjusted_project(Placed(network, place), replace(document, data=data), target, target)
    return text, {**starts, **tables}


def _where_it_stands(entry: dict[str, Any], source: Path, target: Path) -> dict[str, Any]:
    """A table of candidates, which nobody has measured, found from the new folder."""
    if not isinstance(entry.get("file"), str):
        return entry
    return {"name": entry["file"], **entry, "file": Path(os.path.relpath(source / entry["file"], target)).as_posix()}


def _simulated(
    network: Network,
    groups: Sequence[ObservationGroup],
    document: Document,
    source: Path,
    section: str,
    number: int,
    entry: Observations,
    tables: dict[str, Given],
) -> dict[str, Any]:
    """An entry whose table stands in a file of its own, with simulated values."""
    found = _raw(document, source, section, number, entry)
    columns = {name: cells.cast(pl.String) for name, cells in found.columns.items() if name not in AIR}
    label = entry.name or entry.file or f"{entry.type} {number + 1}"
    mine = [
        group
        for group in groups
        if len(group.lines) and (group.name, group.file) == (label, found.file) and _is_of(group, entry)
    ]
    keep = np.zeros(len(found.lines), dtype=bool)
    values: dict[str, Any] = {}
    measured: dict[str, str] = {}
    for group in mine:
        rows = _rows_of(group, found, len(mine) == 1)
        given = said_values(group, group.observed)
        keep[rows] |= np.isfinite(given).any(axis=1)
        if entry.type in _OF_VALUES:
            _put_values(group, given, rows, values, columns, len(found.lines))
            continue
        for k, component in enumerate(group.type.components):
            column = values.setdefault(component.name, np.full(len(found.lines), np.nan))
            column[rows] = np.where(np.isfinite(given[:, k]), _wrapped(group, k, given[:, k]), np.nan)
            measured[component.name] = ends_of_group(group).external.units[k]
    if entry.type in _OF_VALUES:
        keep[:] = True
    frame = pl.DataFrame({**columns, **values}).with_columns(pl.col(pl.Float64).fill_nan(None))
    name = f"{section}_{number + 1}_{entry.type.replace(' ', '_')}.csv"
    kept = [c for c in frame.columns if c not in measured or frame[c].is_not_null().any()]
    tables[name] = frame.filter(pl.Series(keep)).select(kept)
    data = dict(document.data[section][number])
    for key in ("rows", "columns", "delimiter", "file", "values", "units"):
        data.pop(key, None)
    data |= {"name": label, "file": name}
    constants = {key: text for key, text in entry.values.items() if key not in {*measured, *values, *AIR}}
    type_ = mine[0].type if mine else PLAIN_TYPES.get(entry.type)
    components = {one.name: one.quantity for one in type_.components} if type_ is not None else {}
    units = _units(network, entry, components, [*columns, *constants], measured)
    covariance = data.get("covariance")
    if isinstance(covariance, str):
        data["covariance"] = str((source / covariance).resolve())
    return {**data, **({"values": constants} if constants else {}), **({"units": units} if units else {})}


def _rows_of(group: ObservationGroup, found: Source, alone: bool) -> IntArray:
    """(n,) rows of a table that the rows of a group came from: by their lines, or by names where lines hold several."""
    count = len(found.lines)
    if len(np.unique(found.lines)) == count:
        order = np.argsort(found.lines, kind="stable")
        return order[np.searchsorted(found.lines[order], group.lines)].astype(np.int64)
    if alone and group.count == count:
        return np.arange(count, dtype=np.int64)
    named = [found.columns[r.name].cast(pl.String).str.strip_chars().to_list() for r in group.type.references]
    left: dict[tuple[object, ...], list[int]] = {}
    for row, key in reversed(list(enumerate(zip(found.lines.tolist(), *named, strict=True)))):
        left.setdefault(key, []).append(row)
    # of a point at a time the table has the name of the point
    given = ([name.partition(AT)[0] for name in names.texts()] for names in group.references)
    return np.array([left[key].pop() for key in zip(group.lines.tolist(), *given, strict=True)], dtype=np.int64)


def _is_of(group: ObservationGroup, entry: Observations) -> bool:
    if entry.type == "image":
        return is_image_point(group.type)
    return entry.type in _OF_VALUES or group.type.name == entry.type


def _put_values(
    group: ObservationGroup,
    given: FloatArray,
    rows: IntArray,
    values: dict[str, Any],
    columns: dict[str, pl.Series],
    count: int,
) -> None:
    texts = values.setdefault("value", columns["value"].to_list() if "value" in columns else [None] * count)
    units = ends_of_group(group).external.units
    for row, line in zip(rows.tolist(), given, strict=True):
        component = int(np.flatnonzero(np.isfinite(line))[0])
        unit = units[component]
        texts[row] = f"{float(line[component])!r}{'' if unit in ('', '1') else ' ' + unit}"


def _wrapped(group: ObservationGroup, component: int, given: FloatArray) -> FloatArray:
    internal = int(ends_of_group(group).source[component])
    if not group.type.wraps[internal] or internal not in (*group.type.turns, *group.type.bearings):
        return given
    factor = float(ends_of_group(group).external.factors[component])
    return np.remainder(given, 2.0 * np.pi / factor)


def _raw(document: Document, source: Path, section: str, number: int, entry: Observations) -> Source:
    """The table of an entry as it stands there; it has been read before, so that it has no mistakes."""
    at = TableLocation(document, (section, number), source)
    found = raw_table(entry, at)
    assert found is not None
    return found


def _units(
    network: Network,
    entry: Observations,
    components: dict[str, Quantity],
    names: Sequence[str],
    measured: dict[str, str],
) -> dict[str, str]:
    if not isinstance(entry.units, str):
        units = {key: unit for key, unit in entry.units.items() if key in names}
    else:
        units = {name: entry.units for name in names if _fits(network, entry, components, name)}
    return {**units, **{name: unit for name, unit in measured.items() if unit not in ("", "1")}}


def _fits(network: Network, entry: Observations, components: dict[str, Quantity], name: str) -> bool:
    if entry.type == "image":
        return name.startswith("sigma")
    if name.endswith("_height"):
        quantity = LENGTH
    elif name.startswith(("sigma", "cov_")) and components:
        parts = [part for part in name.split("_")[1:] if part in components]
        quantity = components[parts[0]] if parts else next(iter(components.values()))
    else:
        return name == "sigma"
    try:
        network.edge.factor(quantity, str(entry.units))
    except UnitError:
        return False
    return True


def _observed(setting: Setting, value: str) -> Setting:
    """A setting with the simulated value, where it is observed."""
    return {**setting, "observed": value} if isinstance(setting, dict) and "observed" in setting else setting


def truth_table(network: Network, place: Values) -> pl.DataFrame:
    """True values of everything, in the axes and units of the project: kind, id, component, value, unit."""
    rows = []
    edge = network.edge
    angle = edge.default_unit(ANGLE)
    for kind, values in place.items():
        blocks = network.blocks[kind]
        said_of = values
        if kind == "point":
            said_of = values @ edge.matrix
        elif blocks.kind.is_rotation:
            said_of = angles_from_rotation(values @ edge.matrix if edge.turned else values) / ANGLE_UNITS[angle]
        for k, name in enumerate(blocks.ids):
            for component, value in zip(blocks.kind.components, said_of[k], strict=True):
                rows.append((kind, name, component.name, float(value), edge.default_unit(component.quantity)))
    schema = ["kind", "id", "component", "value", "unit"]
    return pl.DataFrame(rows, schema=schema, orient="row")


def planted_table(network: Network, errors: Sequence[Planted]) -> pl.DataFrame:
    """The errors that were planted: which observation, how much, in its unit and in units of σ."""
    rows = []
    for one in errors:
        group = network.groups[one.group]
        names = {key: column.texts()[one.row] for key, column in named_places(group).items()}
        component, unit, amount, ratio = "", "", None, None
        if one.component >= 0:
            k = reported_component(group, one.component)
            component, unit = group.type.components[k].name, ends_of_group(group).external.units[k]
            amount = said_one(said_differences, group, one.component, one.amount)
            ratio = abs(one.amount / float(group.sigma[one.row, one.component]))
        ends = (names.get("at", ""), names["from"], names["to"])
        rows.append((one.kind, group.name, *ends, component, amount, unit, ratio))
    schema = {
        **dict.fromkeys(("kind", "group", "at", "from", "to", "component"), pl.String),
        "amount": pl.Float64,
        "unit": pl.String,
        "sigmas": pl.Float64,
    }
    return pl.DataFrame(rows, schema=schema, orient="row")


# ---- The report of a Monte Carlo simulation: text and plain data.

NAMES = {
    "solutions": "runs with a solution",
    "variance": "mean of vTPv / redundancy",
    "global": "runs that the global test rejects",
    "flagged": "observations without error that are flagged",
    "coverage": "points inside their 95 % region, sigma0 a priori",
    "coverage least": "the point that is covered least",
    "coverage most": "the point that is covered most",
    "coverage after": "points inside their 95 % region, sigma0 a posteriori",
    "bias": "largest bias of an unknown / sigma of its mean",
    "sigma least": "smallest sigma found / sigma said",
    "sigma most": "largest sigma found / sigma said",
    "power": "errors of the size nabla that are found",
}
"""Figures of a simulation by key."""


def monte_carlo_data(
    network: Network, truth: Truth, tally: Tally, seed: int, starts: bool, of: RunIdentity
) -> dict[str, Any]:
    """The findings, and bias and σ of every unknown, as plain data."""
    n = max(float(tally.solved), 1.0)
    index = truth.problem.index
    intervals = coverage_intervals(tally)
    points = network.things["point"]
    name_of = dict(zip(points.parts["position"].tolist(), points.ids, strict=True))
    return {
        **schema_of("mor-montecarlo", 1),
        "title": network.project.title,
        "runs": int(tally.runs),
        "solved": int(tally.solved),
        "seed": seed,
        "start_values": "computed in every run" if starts else "true",
        "confidence": CONFIDENCE,
        "level": LEVEL,
        "redundancy": truth.quality.redundancy,
        "agrees": all(one.agrees for one in findings(truth, tally)),
        "findings": [{**one._asdict(), "agrees": one.agrees} for one in findings(truth, tally)],
        "points": [
            {"id": name_of.get(int(block), ""), "coverage": float(tally.covered[k]) / n}
            for k, block in enumerate(truth.points)
        ],
        "unknowns": [
            {
                "of": said_thing(*index.label(column)[:2]),
                "component": index.label(column)[2],
                "bias": float(tally.correction[column]) / n,
                "sigma_ratio": float(np.sqrt(tally.square[column] / n)),
                "interval": None if intervals is None else intervals[column].tolist(),
            }
            for column in range(index.count)
            if truth.sigma[column] > 0.0
        ],
        "identity": identity_of(network.project, of),
    }


def verdict(found: list[Finding], words: Words) -> str:
    """In one sentence: whether theory and simulation agree."""
    apart = [one for one in found if not one.agrees]
    if not apart:
        return words("Simulation and theory agree in all {count} figures.", count=len(found))
    return words("SIMULATION AND THEORY DISAGREE in {count} of {all} figures.", count=len(apart), all=len(found))


def monte_carlo_text(
    network: Network, truth: Truth, tally: Tally, seed: int, starts: bool, words: Words, of: RunIdentity
) -> str:
    """The report of a simulation."""
    found = findings(truth, tally)
    title = network.project.title or words("Adjustment")
    begun = words("computed in every run") if starts else words("the true values")
    lines = [
        *layout.titled(title),
        "",
        words(
            "MONTE CARLO: {runs} simulated measurements (seed {seed}; start values: {starts}).",
            runs=int(tally.runs),
            seed=seed,
            starts=begun,
        ),
        verdict(found, words),
        words(
            "Chance alone leaves a figure outside its limits with {level}; σ, regions and tests are those of the "
            "adjustment at the true place.",
            level=f"{LEVEL:g}",
        ),
        "",
        finding_table(found, words),
    ]
    about = identity_of(network.project, of)
    sections = [
        "\n".join(lines),
        _weakest(truth, tally, words),
        _coverage(truth, tally, words),
        layout.section(about, words),
    ]
    return paragraphs(escaped("\n\n".join(section for section in sections if section))) + "\n"


def finding_table(found: list[Finding], words: Words) -> str:
    """Each figure with what theory says, what was found, and the limits of chance."""
    rows = [
        [
            words(NAMES[one.name]),
            *(words.number(short(value, 4)) for value in (one.expected, one.found, one.lower, one.upper)),
            words("agrees") if one.agrees else words("DISAGREES"),
        ]
        for one in found
    ]
    headers = ["figure", "theory", "found", "from", "to", "verdict"]
    return table(headers, rows, 1, words, last_left=True)


def _weakest(truth: Truth, tally: Tally, words: Words) -> str:
    n = float(tally.solved)
    if n < 2.0 or not (truth.sigma > 0.0).any():
        return ""
    index = truth.problem.index
    order = np.argsort(-np.abs(tally.correction), kind="stable")[:5]
    rows = [
        [
            f"{said_thing(*index.label(int(k))[:2])} {index.label(int(k))[2]}",
            words.number(f"{tally.correction[k] / n:.4f}"),
            words.number(f"{np.sqrt(tally.square[k] / n):.4f}"),
        ]
        for k in order
    ]
    headers = ["unknown", "mean of (x - true) / sigma", "sigma found / sigma said"]
    return "\n".join([heading(words("Largest bias")), table(headers, rows, 1, words)])


def _coverage(truth: Truth, tally: Tally, words: Words) -> str:
    intervals = coverage_intervals(tally)
    used = np.flatnonzero(truth.sigma > 0.0)
    if intervals is None or not len(used):
        return ""
    k = -NormalDist().inv_cdf(0.5 * (1.0 - CONFIDENCE))
    apart = np.abs(intervals - [-k, k]).max(axis=1)
    order = used[np.argsort(-apart[used], kind="stable")[:5]]
    index = truth.problem.index
    rows = [
        [
            f"{said_thing(*index.label(int(u))[:2])} {index.label(int(u))[2]}",
            *(words.number(f"{value:.3f}") for value in (*intervals[u], apart[u])),
        ]
        for u in order
    ]
    sentence = (
        "The adjustment says ±{k} sigma. Chance moves an end of an interval by about {noise} sigma (one standard "
        "deviation)."
    )
    said = words(sentence, k=f"{k:.3f}", noise=f"{interval_noise(len(tally.drawn)):.3f}")
    title = words("95 % coverage intervals of (x - true) / sigma (GUM Supplement 1, JCGM 101:2008)")
    headers = ["unknown", "from", "to", "largest difference"]
    return "\n".join([heading(title), table(headers, rows, 1, words), said])
