"""External reliability as vectors: where an error that stays unseen moves each point.

Of all observations of a point the one with the smallest redundancy number has the largest external reliability
(W. Baarda, 1968): a gross error in it of the size ∇, which the tests find with the power asked for and no better, moves
the point by the vector, in the datum of the adjustment.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.quality.reliability.effects import HARDLY_CONTROLLED
from mor.quality.reliability.local_influence import point_movements
from mor.quality.reliability.reliability_map import detectable
from mor.quality.solved import Solved
from mor.report.tables.reliability import place
from mor.report.tables.shared import once

FILE = "external_reliability.csv"
MOST = 500
"""Points that have a vector; of more, those with the smallest redundancy numbers."""
_ROOM = 300_000
"""Numbers of the reduced system that are worked out: in large networks fewer points have a vector."""
PARTS = ("dx", "dy", "dz")
SCHEMA: dict[str, type[pl.DataType]] = {
    "point": pl.String,
    **dict.fromkeys(PARTS, pl.Float64),
    "r": pl.Float64,
    **dict.fromkeys(("type", "group", "at", "from", "to", "component"), pl.String),
}


@once
def external_reliability(solved: Solved) -> pl.DataFrame:
    """One row for each point: its movement in project axes and units of length, by the observation that follows.

    Points that next to nothing controls are not among them: an error there has no bound.
    """
    quality = solved.quality
    seen = next((one for one in solved.reliability_map if one.of == "point"), None)
    if quality is None or quality.redundancy == 0 or seen is None:
        return pl.DataFrame(schema=SCHEMA)
    blocks = solved.network.things["point"].parts["position"]
    free = np.asarray((quality.adjustment.problem.index.columns["point"][blocks] >= 0).any(axis=1))
    most = min(MOST, max(1, _ROOM // max(1, len(quality.adjustment.plan.kept))))
    order = seen.worst(len(seen.names))
    chosen = order[free[order] & (seen.smallest_r[order] >= HARDLY_CONTROLLED)][:most].tolist()
    nabla = detectable(quality, seen.weakest[chosen])
    bounded = np.isfinite(nabla)  # of correlated observations r alone does not tell
    chosen, nabla = [k for k, known in zip(chosen, bounded, strict=True) if known], nabla[bounded]
    entries = [seen.entry(k) for k in chosen]
    moved = point_movements(quality, entries, nabla, [[int(blocks[k])] for k in chosen])
    rows = []
    for k, entry, (movement,) in zip(chosen, entries, moved, strict=True):
        group = quality.adjustment.problem.groups[entry.group]
        vector = (movement @ solved.network.edge.matrix).tolist()
        row: dict[str, Any] = {**place(group, entry.row, entry.component), "r": float(seen.smallest_r[k])}
        row |= {"point": seen.names[k], **dict(zip(PARTS, vector, strict=True))}
        rows.append({name: row.get(name, "") for name in SCHEMA})
    return pl.DataFrame(rows, schema=SCHEMA)
