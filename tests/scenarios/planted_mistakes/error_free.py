"""Error-free projects: a sample with new noise of exactly the σ it claims; no hypothesis may come of it."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from mor.api import pipeline
from mor.project.network import Network
from mor.quality.group_tests import Rejection, rejection
from mor.quality.solution import Solved
from tests.scenarios.planted_mistakes.survey import survey


def sound(name: str) -> Solved:
    """A sample project, adjusted."""
    with tempfile.TemporaryDirectory() as folder:
        path = survey(name).write(Path(folder))
        return pipeline.solve_network(pipeline.read_network(pipeline.read_document(path), path.parent))


def with_noise(solved: Solved, seed: int) -> Network:
    """The network with observations that are what its result says, and noise."""
    random, values = np.random.default_rng(seed), solved.adjustment.values
    groups = []
    for group, own in zip(solved.network.groups, solved.adjustment.problem.groups, strict=False):
        pairs = zip(group.type.slots, group.blocks, strict=True)
        computed = group.type.equation([values[s.kind][n] for s, n in pairs], group.constants).values
        noise = np.nan_to_num(own.sigma) * random.standard_normal(computed.shape)
        groups.append(replace(group, observed=np.where(group.mask, computed + noise, np.nan)))
    return replace(solved.network, groups=tuple(groups), start=dict(values))


def rates(name: str, count: int) -> tuple[int, int, int]:
    """Projects, those in which something was rejected and those with a possible cause."""
    solved = sound(name)
    found = [pipeline.solve_network(with_noise(solved, seed)) for seed in range(count)]
    rejected = sum(one.quality is None or rejection(one.quality, one.network) is not Rejection.NOTHING for one in found)
    return count, rejected, sum(bool(one.possible_causes) for one in found)
