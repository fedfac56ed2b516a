"""``python -m sample_projects.expected [names]``: write down what the program gives for the sample projects today.

The files ``expected.json`` are compared by the tests; write them anew only when a change of results is understood.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from mor.api.pipeline import read_document, read_network, solve_network
from mor.model.parameters import INTERIORS
from mor.quality.assessment import Quality, standard_deviations
from mor.quality.solution import Solved
from mor.report.estimates import place_table
from sample_projects.simulate import SCENES

ROOT = Path(__file__).resolve().parent
SHOWN = 6
"""Points written down, spread evenly over all of them."""


def solve_sample(name: str) -> Solved:
    """A sample project, adjusted and assessed."""
    return solve_network(read_network(read_document(ROOT / name / "project.yaml"), ROOT / name))


def summary(solved: Solved) -> dict[str, Any]:
    """What is written down of an adjustment, in the units of the project."""
    adjustment, quality = solved.adjustment, quality_of(solved)
    points = point_results(solved)
    shown = [list(points)[k] for k in np.linspace(0, len(points) - 1, SHOWN).round().astype(int)]
    return {
        "outcome": adjustment.outcome.value,
        "observations": adjustment.problem.observations,
        "unknowns": adjustment.problem.index.count,
        "defect": adjustment.defect.datum.shape[1],
        "redundancy": quality.redundancy,
        "sigma0": _digits(quality.sigma0),
        "cameras": {
            name: {part: [_digits(value), _digits(sigma)] for part, (value, sigma) in components.items()}
            for name, components in camera_results(solved).items()
        },
        "points": [_point_entry(name, points[name]) for name in shown],
    }


def _point_entry(name: str, result: list[float]) -> dict[str, Any]:
    coordinates = [round(value, 8) for value in result[:3]]
    sigma = [_digits(value) for value in result[3:]]
    return {"id": name, **dict(zip(("x", "y", "z", "sx", "sy", "sz"), (*coordinates, *sigma), strict=True))}


def _digits(value: float) -> float:
    """A value with as many digits as repeat from run to run."""
    return float(f"{value:.9g}")


def quality_of(solved: Solved) -> Quality:
    """The quality of a converged adjustment. Raises ``ValueError`` where there is none."""
    if solved.quality is None:
        raise ValueError(f"{solved.adjustment.outcome.value}: {solved.adjustment.reason}")
    return solved.quality


def point_results(solved: Solved) -> dict[str, list[float]]:
    """x, y, z, sx, sy, sz of every point; the axes of the project are those of the program in all samples.

    On the earth they are east, north, height and σ east, north, up.
    """
    if solved.network.world is not None:
        places = place_table(solved).select("id", "east", "north", "height", "seast", "snorth", "sup")
        return {name: list(values) for name, *values in places.iter_rows()}
    things = solved.network.things["point"]
    blocks = things.parts["position"]
    values = solved.adjustment.values["point"][blocks]
    sigma = standard_deviations(quality_of(solved), "point")[blocks]
    return {name: [*map(float, xyz), *map(float, s)] for name, xyz, s in zip(things.ids, values, sigma, strict=True)}


def camera_results(solved: Solved) -> dict[str, dict[str, list[float]]]:
    """Value and σ of the estimated components of every camera."""
    network = solved.network
    result: dict[str, dict[str, list[float]]] = {}
    for name, camera in network.project.cameras.items():
        kind = INTERIORS[camera.model]
        block = network.things["camera"].part(name, "interior")
        values = solved.adjustment.values[kind.key][block]
        sigma = standard_deviations(quality_of(solved), kind.key)[block]
        free = network.blocks[kind.key].free[block]
        result[name] = {kind.names[k]: [float(values[k]), float(sigma[k])] for k in np.flatnonzero(free)}
    return result


def parameter_results(solved: Solved) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Value and σ of the free components of distance meters, eccentricities and bases, by kind, block, component."""
    result = {}
    for kind in (
        "distance meter",
        "eccentricity",
        "base",
        "refraction",
        "readout",
        "position shift",
        "attitude shift",
        "time offset",
        "image velocity",
        "rotation rate",
    ):
        blocks = solved.network.blocks.get(kind)
        if blocks is None:
            continue
        values, sigma = solved.adjustment.values[kind], standard_deviations(quality_of(solved), kind)
        for block, component in zip(*np.nonzero(blocks.free), strict=True):
            key = (kind, blocks.ids[block], blocks.kind.names[component])
            result[key] = (float(values[block, component]), float(sigma[block, component]))
    return result


def main(names: list[str]) -> int:
    """Write ``expected.json`` of the named samples, or of all; returns the exit code."""
    for name in names or SCENES:
        text = json.dumps(summary(solve_sample(name)), indent=1, ensure_ascii=False)
        (ROOT / name / "expected.json").write_text(text + "\n", encoding="utf-8", newline="\n")
        print(f"{name}: written", file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
