"""Plans: weak random networks with what might be measured besides, and samples with candidates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.api.pipeline import read_document
from mor.api.plan import at_its_place, read_plan
from mor.api.project import build
from sample_projects.expected import ROOT


def grid(seed, side=3, share=0.45, candidates=0.9, require=None):
    """A weak random network of distances and directions in plan, and what might be measured besides."""
    generator = np.random.default_rng(seed)
    names = [f"P{i}" for i in range(side * side)]
    xy = np.array([(i, j) for i in range(side) for j in range(side)]) * 100.0
    xy += generator.uniform(-25.0, 25.0, xy.shape)
    pairs = [(a, b) for a in range(len(names)) for b in range(a) if np.hypot(*(xy[a] - xy[b])) < 230.0]
    drawn = generator.random(len(pairs))
    chain = {(k, k - 1) for k in range(1, len(names))} | {(k, k - 2) for k in range(2, len(names))}
    planned = [p for p, u in zip(pairs, drawn, strict=True) if p in chain or u < share * 0.3]
    further = [p for p, u in zip(pairs, drawn, strict=True) if p not in planned and u < candidates]
    distances = {"type": "horizontal_distance", "values": {"sigma": "2 mm"}, "columns": ["from", "to"]}

    def table(name, some):
        return {**distances, "name": name, "rows": [[f"P{a}", f"P{b}"] for a, b in some]}

    points = {"columns": ["id", "x", "y"], "rows": [[n, *row] for n, row in zip(names, xy, strict=True)]}
    document = build(
        {
            "settings": {"dimensions": "xy"},
            "points": [points],
            "observations": [table("planned", planned)],
            "candidates": [table("further", further)],
            "datum": "free",
            "require": require or {"reliability": {"r": 0.2}},
        }
    )
    return at_its_place(read_plan(document, ROOT).network)


def sample(name, **changes):
    path = ROOT / name / "project.yaml"
    document = read_document(path)
    return at_its_place(read_plan(replace(document, data={**document.data, **changes}), path.parent).network)


BRIDGE = {
    "require": {"sigma": {"points": ["N*"], "xyz": "0.3 mm"}},
    "candidates": [
        {
            "type": "zenith_directions",
            "name": "more",
            "columns": ["station", "to"],
            "values": {"sigma_horizontal": "0.3 mgon", "sigma_zenith": "0.5 mgon"},
            "centring": {"target_height": "0.3 mm"},
            "rows": [["P5", "SE1"], ["P1", "NE1"], ["P3", "NW2"], ["P5", "SW3"]],
        },
        {
            "type": "distance",
            "columns": ["from", "to"],
            "values": {"sigma": "0.8 mm"},
            "ppm": "1",
            "rows": [["P1", "NW1"], ["P4", "NE3"], ["P5", "NE2"]],
        },
    ],
}
