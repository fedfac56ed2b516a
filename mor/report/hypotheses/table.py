"""What may be the cause where something is rejected, as plain data."""

from __future__ import annotations

from math import isfinite
from typing import Any

from mor.quality.hypotheses.hypothesis import Amount
from mor.quality.solved import Solved


def hypotheses(solved: Solved) -> list[dict[str, Any]]:
    """The hypotheses that are offered, the best first."""
    return [
        {
            "cause": offered.hypothesis.cause,
            "things": list(offered.hypothesis.things),
            "line": offered.hypothesis.line,
            "candidates": offered.hypothesis.candidates,
            "amount": _amount(solved, offered.amount),
            "vtpv_before": offered.before if isfinite(offered.before) else None,
            "freedom_before": offered.freedom_before,
            "vtpv_after": offered.after,
            "freedom_after": offered.freedom_after,
            "gain": offered.gain,
        }
        for offered in solved.causes
    ]


def _amount(solved: Solved, amount: Amount | None) -> dict[str, Any] | None:
    """What an additional unknown came out as, with its unit."""
    if amount is None:
        return None
    units = {"offset": solved.network.project.units.length, "scale": ""}
    units["height"] = units["offset"]
    unit = units.get(amount.name, next((scale.unit for scale in solved.network.scales.values()), ""))
    return {"name": amount.name, "value": amount.value, "unit": unit}
