"""Start values as plain data, for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mor.approximate.approximation import Approximation
from mor.approximate.parts.history import Join
from mor.project.network.build import Network
from mor.report.orientation.numbers import number, numbers
from mor.report.start_values.data import StartValue, counts

SCHEMA = 1


def start_data(network: Network, approximation: Approximation, rows: Sequence[StartValue]) -> dict[str, Any]:
    """Counts, parts with what is in them, every value, what was replaced, and what is missing."""
    return {
        "schema_version": SCHEMA,
        "title": network.project.title,
        "counts": [{"kind": kind, "value": what, **of} for kind, what, of in counts(rows)],
        "parts": [_part(join, network, approximation) for join in approximation.parts],
        "values": [_value(row) for row in rows],
        "replaced": [str(words) for words in approximation.replaced],
        "missing": [
            {
                "kind": thing.kind,
                "id": thing.name,
                "observations": thing.observations,
                "reason": thing.reason,
            }
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
            "misfit": number(join.tie.misfit),
            "open_movements": join.tie.open,
            "alternatives": join.tie.alternatives,
        },
    }


def _value(row: StartValue) -> dict[str, Any]:
    return {
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
        "misfit": number(row.misfit),
        "observations": row.observations,
    }
