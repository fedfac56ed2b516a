"""What may be the cause where something is rejected, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

from mor.project.network.build import Network
from mor.quality.hypotheses.hypothesis import Amount, Offered
from mor.quality.solved import Solved


def hypotheses(solved: Solved) -> list[dict[str, Any]]:
    """The hypotheses that are offered, the best first."""
    return rows(solved.network, solved.causes)


def rows(network: Network, causes: Sequence[Offered]) -> list[dict[str, Any]]:
    """Hypotheses about a network as plain data."""
    return [
        {
            "cause": offered.hypothesis.cause,
            "things": list(offered.hypothesis.things),
            "line": offered.hypothesis.line,
            "candidates": offered.hypothesis.candidates,
            "amount": _amount(network, offered.amount),
            "vtpv_before": offered.before if isfinite(offered.before) else None,
            "freedom_before": offered.freedom_before,
            "vtpv_after": offered.after,
            "freedom_after": offered.freedom_after,
            "gain": offered.gain,
        }
        for offered in causes
    ]


def _amount(network: Network, amount: Amount | None) -> dict[str, Any] | None:
    """What an additional unknown came out as, with its unit."""
    if amount is None:
        return None
    units = {"offset": network.project.units.length, "scale": ""}
    units["height"] = units["offset"]
    unit = units.get(amount.name, next((scale.unit for scale in network.scales.values()), ""))
    return {"name": amount.name, "value": amount.value, "unit": unit}
