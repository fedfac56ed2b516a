"""The report of a Monte Carlo simulation: text and plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor import __version__
from mor.escapes import escaped
from mor.project.network.build import Network
from mor.project.network.entities import said_thing
from mor.quality.simulation.findings import LEVEL, Finding, findings
from mor.quality.simulation.monte_carlo import CONFIDENCE, Tally, Truth
from mor.report.columns import WIDTH, paragraphs
from mor.report.identity import Identity, identity_of
from mor.report.layout import heading, short, table
from mor.report.text import identity
from mor.report.words.language import Words

SCHEMA = "mor-montecarlo"
SCHEMA_VERSION = 1
_NAMES = {
    "solutions": "runs that lead to a solution",
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


def monte_carlo_data(
    network: Network, truth: Truth, tally: Tally, seed: int, starts: bool, of: Identity
) -> dict[str, Any]:
    """The findings, and bias and σ of every unknown, as plain data."""
    n = max(float(tally.solved), 1.0)
    index = truth.problem.index
    points = network.things["point"]
    name_of = dict(zip(points.parts["position"].tolist(), points.ids, strict=True))
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "program": f"mor {__version__}",
        "title": network.project.title,
        "runs": int(tally.runs),
        "solved": int(tally.solved),
        "seed": seed,
        "start_values": "worked out in every run" if starts else "true",
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
    return words(
        "SIMULATION AND THEORY DISAGREE in {count} of {all} figures.", count=len(apart), all=len(found)
    )


def monte_carlo_text(
    network: Network, truth: Truth, tally: Tally, seed: int, starts: bool, words: Words, of: Identity
) -> str:
    """The report of a simulation."""
    found = findings(truth, tally)
    title = network.project.title or words("Adjustment")
    begun = words("worked out in every run") if starts else words("the true values")
    lines = [
        title,
        "=" * min(len(title), WIDTH),
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
    sections = ["\n".join(lines), _weakest(network, truth, tally, words), identity.section(about, words)]
    return paragraphs(escaped("\n\n".join(section for section in sections if section))) + "\n"


def finding_table(found: list[Finding], words: Words) -> str:
    """Each figure with what theory says, what was found, and the limits of chance."""
    rows = [
        [
            words(_NAMES[one.name]),
            *(words.number(short(value, 4)) for value in (one.expected, one.found, one.lower, one.upper)),
            words("agrees") if one.agrees else words("DISAGREES"),
        ]
        for one in found
    ]
    headers = ["figure", "theory", "found", "from", "to", "verdict"]
    return table(headers, rows, 1, words, last_left=True)


def _weakest(network: Network, truth: Truth, tally: Tally, words: Words) -> str:
    """The unknowns whose bias is largest."""
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
