"""GNU Gama XML input (``.gkf``) as a project.

The physical meaning of ``axes-xy`` and ``angles`` is that of a project's axes, in all sixteen combinations: coordinates
and results stay those of the file. Weights depend on ratios of σ only, so ``sigma-apr`` is the σ0 of the report.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row
from mor.formats.gkf.clusters import (
    ANGULAR,
    KINDS,
    GamaCluster,
    GamaObservation,
    read_clusters,
    without_inactive,
    without_lonely_directions,
)
from mor.formats.gkf.grammar import check
from mor.formats.gkf.points import dimensions, put_datum, put_points, read_points
from mor.formats.gkf.tolerance import within_tolerance
from mor.formats.xml import Element, parse_xml
from mor.input_files import PROJECT, read_bytes
from mor.project.file.nodes import Document

LEFT_HANDED = ("ne", "sw", "es", "wn")
_X_AXIS = {"e": 300.0, "n": 0.0, "s": 200.0, "w": 100.0}


def read_gkf(path: Path) -> Document:
    """The project a GNU Gama XML file describes. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    root = parse_xml(read_bytes(path, PROJECT), draft.file)
    if root.name != "gama-local":
        raise InputError([Problem(f"found <{root.name}>, expected <gama-local>", draft.file, root.line)])
    check(root, draft)
    bodies = [body for network in root.all("network") for body in network.all("points-observations")]
    if len(bodies) != 1:
        draft.problem(f"found {len(bodies)} times <points-observations>, expected it once", root.line)
    if draft.problems:
        draft.finish()
    network = next(network for network in root.all("network") if network.all("points-observations"))
    _read_network(network, bodies[0], draft)
    return draft.finish()


def _read_network(network: Element, body: Element, draft: Draft) -> None:
    parameters = {key: value for part in network.all("parameters") for key, value in part.attributes.items()}
    axes, angles = (
        network.attributes.get("axes-xy", "ne").strip(),
        network.attributes.get("angles", "left-handed"),
    )
    left = angles.strip() == "left-handed"
    sigma_apriori = float(parameters.get("sigma-apr", "10"))
    points = read_points(body, draft)
    clusters = read_clusters(body, sigma_apriori, draft)
    clusters = without_inactive(clusters, points, draft)
    x_axis = _X_AXIS[axes[0]] * (1.0 if left else -1.0) * np.pi / 200.0
    y_sign = 1.0 if left == (axes in LEFT_HANDED) else -1.0
    tolerance = float(parameters.get("tol-abs", "1000")) / 1000.0
    clusters = within_tolerance(clusters, points, x_axis, y_sign, tolerance, sigma_apriori, draft)
    clusters = without_lonely_directions(clusters, draft)
    if given := [key for key in ("ellipsoid", "latitude") if key in parameters]:
        words = (
            f"{' and '.join(given)}: gama-local reduces directions and zenith angles to the vertical of a central "
            "point with it; here verticals are parallel, and curvature: true in the project models the curvature of "
            "the earth"
        )
        draft.note(words, network.line)
    draft.put("title", _title(network))
    draft.put("units", {"length": "m", "angle": "gon"})
    draft.put(
        "axes", {"xy": axes, "angles": "clockwise" if left else "counterclockwise", "bearings_from": "north"}
    )
    put_points(points, draft)
    _put_observations(clusters, draft)
    put_datum(points, draft)
    draft.put("settings", _settings(parameters, sigma_apriori, dimensions(points)))


def _title(network: Element) -> str:
    words = " ".join(" ".join(part.text for part in network.all("description")).split())
    return words if len(words) <= 200 else f"{words[:199]}…"


def _settings(parameters: dict[str, str], sigma_apriori: float, estimated: str) -> dict[str, Any]:
    level = 1.0 - float(parameters.get("conf-pr", "0.95"))
    return {
        "sigma0": repr(sigma_apriori),
        "dimensions": estimated,
        "sigma": parameters.get("sigma-act", "aposteriori").strip(),
        "global_level": f"{level:.10g}",
    }


def _put_observations(clusters: list[GamaCluster], draft: Draft) -> None:
    """One table for all uncorrelated observations of a kind and unit; one cluster for every covariance matrix."""
    sets: dict[str, int] = {}
    plain: dict[tuple[str, str], list[Row]] = {}
    for number, cluster in enumerate(clusters):
        names = _set_names(cluster, sets)
        tables: dict[tuple[str, str], list[Row]] = {} if cluster.covariance is not None else plain
        order: dict[tuple[str, str], list[int]] = {}
        first = 0
        for observation in cluster.observations:
            key = observation.kind, observation.unit
            tables.setdefault(key, []).append(_row(observation, names))
            order.setdefault(key, []).extend(range(first, first + observation.entries))
            first += observation.entries
        if cluster.covariance is not None:
            _put_correlated(cluster, tables, order, number, draft)
    for (kind, unit), rows in plain.items():
        _put_table(kind, unit, rows, draft)


def _set_names(cluster: GamaCluster, sets: dict[str, int]) -> dict[str, str]:
    """Name of the direction set of each station of a cluster; the first set of a station needs none."""
    stations = dict.fromkeys(o.names[0] for o in cluster.observations if o.kind == "direction")
    names = {}
    for station in stations:
        sets[station] = sets.get(station, 0) + 1
        names[station] = str(sets[station]) if sets[station] > 1 else ""
    return names


def _row(observation: GamaObservation, sets: dict[str, str]) -> Row:
    set_name = (sets[observation.names[0]] or None) if observation.kind == "direction" else None
    cells = [*observation.names, set_name, *observation.values, observation.sigma, *observation.heights]
    return Row(cells, observation.line)


def _put_table(kind: str, unit: str, rows: list[Row], draft: Draft, **keys: Any) -> None:
    known = KINDS[kind]
    columns = [column for _, column in known.names]
    columns += ["set", *(column for _, column in known.components), "sigma", "from_height", "to_height"]
    units = {"sigma": "mm"} if kind not in ANGULAR else {"sigma": "arcsec" if unit == "dms" else "cc"}
    if unit == "dms":
        units[known.components[0][1]] = "dms"
    draft.table("observations", columns, rows, type=known.type, units=units, **keys)


def _put_correlated(
    cluster: GamaCluster,
    tables: dict[tuple[str, str], list[Row]],
    order: dict[tuple[str, str], list[int]],
    number: int,
    draft: Draft,
) -> None:
    """Groups of one cluster: the matrix goes with the first, in the order of groups, rows and components."""
    if not tables or cluster.covariance is None:
        return
    entries = [entry for entries in order.values() for entry in entries]
    matrix: list[list[str]] | None = _texts(cluster.covariance[np.ix_(entries, entries)])
    name = f"{cluster.element} {number + 1}" if len(tables) > 1 else None
    for (kind, unit), rows in tables.items():
        _put_table(kind, unit, rows, draft, cluster=name, covariance=matrix)
        matrix = None


def _texts(matrix: Iterable[Iterable[float]]) -> list[list[str]]:
    return [[repr(float(value)) for value in row] for row in matrix]
