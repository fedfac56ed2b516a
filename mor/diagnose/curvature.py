"""The curvature of the earth, where a project with parallel verticals was measured over distances at which it shows."""

from __future__ import annotations

from dataclasses import replace

from mor.diagnose.edits import key
from mor.diagnose.hypothesis import Hypothesis
from mor.diagnose.situation import Situation
from mor.observations.curvature import on_sphere
from mor.project.network.build import Network
from mor.quality.plausibility.curvature import NOTED, largest_effect, sphere_under


def curvature_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the hypothesis that the verticals are not parallel, if that changes any observation by enough."""
    effect = largest_effect(situation.network, situation.values) if situation.begun else None
    if effect is None or effect.in_sigma < NOTED:
        return []
    sphere = sphere_under(situation.network, situation.values)

    def change(network: Network) -> Network:
        metres = network.edge.metres
        groups = (replace(group, type=on_sphere(group.type, sphere, metres)) for group in network.groups)
        return replace(network, groups=tuple(groups), sphere=sphere)

    return [Hypothesis("curvature", (), change, "curvature: true", edits=(key(("curvature",), "true"),))]
