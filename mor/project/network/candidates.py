"""Observations that a plan might have besides: they are read like all others, and take no part in the adjustment."""

from __future__ import annotations

from dataclasses import replace

from mor.observations import ObservationGroup
from mor.project.network.reading import Reading
from mor.project.observations.groups import read_groups


def candidate_groups(reading: Reading) -> tuple[ObservationGroup, ...]:
    """Groups of the section ``candidates``, whose values are planned. Correlations between them are mistakes."""
    if not reading.project.candidates:
        return ()
    for number, entry in enumerate(reading.project.candidates):
        if entry.covariance is not None or entry.cluster is not None:
            words = "candidates are uncorrelated; give each a σ"
            reading.problems.append(reading.at("candidates", number).problem(words))
    project = reading.project.model_copy(update={"observations": reading.project.candidates})
    apart = replace(reading, project=project, section="candidates", planned=True, unmeasured=[])
    known = len(reading.problems)
    groups = [found for found in read_groups(apart) if len(reading.problems) == known]
    for found in groups:
        if found.covariances is not None:
            words = "candidates are uncorrelated; give each a σ, not covariances"
            reading.problems.append(reading.at("candidates", found.entry).problem(words))
    return tuple(found.group for found in groups)
