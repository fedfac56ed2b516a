"""Possible causes of a rejection, and hypotheses that were tried, as plain data."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any

from mor.diagnose.edits import as_diff
from mor.diagnose.hypothesis import Diagnosis
from mor.project.file.nodes import Document
from mor.project.network.build import Network
from mor.quality.solved import Amount, Solved


def possible_causes(solved: Solved) -> list[dict[str, Any]]:
    """Possible causes by score tests, the best first."""
    return [
        {
            "cause": one.cause,
            "things": list(one.things),
            "line": one.line,
            "amount": _amount(solved.network, one.amount),
            "vtpv_decrease": one.gain,
            "parameters": one.parameters,
            "log10_p": one.log10_p,
            "verified": False,
        }
        for one in solved.possible_causes
    ]


def diagnosis(network: Network, found: Diagnosis, document: Document, folder: Path) -> dict[str, Any]:
    """A search for mistakes: vᵀPv before, what is offered, and what was tried.

    ``document`` is the project file and ``folder`` that of its tables: hypotheses come with the diff of their edits.
    """
    before = found.before
    return {
        "vtpv_before": before.told if isfinite(before.told) else None,
        "freedom_before": before.freedom,
        "offered": [
            {
                "cause": one.hypothesis.cause,
                "things": list(one.hypothesis.things),
                "line": one.hypothesis.line,
                "diff": as_diff(document, folder, one.hypothesis.edits, one.amount),
                "candidates": one.hypothesis.candidates,
                "amount": _amount(network, one.amount),
                "vtpv_after": one.after,
                "freedom_after": one.freedom_after,
                "gain": one.gain,
            }
            for one in found.offered
        ],
        "tried": [
            {
                "cause": one.hypothesis.cause,
                "things": list(one.hypothesis.things),
                "vtpv_after": one.fit.omega if one.fit is not None else None,
                "freedom_after": one.fit.freedom if one.fit is not None else None,
                "gain": one.gain if one.fit is not None and isfinite(one.gain) else None,
            }
            for one in found.trials
        ],
        "untried": found.untried,
    }


def _amount(network: Network, amount: Amount | None) -> dict[str, Any] | None:
    """The value of an additional parameter, with its unit."""
    if amount is None:
        return None
    units = {"offset": network.project.units.length, "scale": "", "sigma factor": ""}
    units["height"] = units["offset"]
    unit = units.get(amount.name, next((scale.unit for scale in network.scales.values()), ""))
    return {"name": amount.name, "value": amount.value, "unit": unit}
