"""``results.json`` as a model: every key there is and what it means. The JSON Schema is made from it.

Keys may be added in later versions; those that are there keep their meaning while ``schema_version`` is 2.
"""

from __future__ import annotations

import json
from typing import Literal

from pydantic import Field

from mor.report.results.models.model_failure import Failure, Undeterminable
from mor.report.results.models.model_gross_errors import GrossErrors, PossibleCause, Suspects
from mor.report.results.models.model_motions import Boresight, Epoch, Knot, Motion
from mor.report.results.models.model_parts import (
    Axes,
    Camera,
    Check,
    Direction,
    Feature,
    FixedPoint,
    GlobalTest,
    Group,
    Identity,
    Image,
    Note,
    Number,
    Other,
    Pair,
    Part,
    Point,
    Relative,
    Residual,
    Sigma0,
    Station,
    Step,
    System,
    Units,
    VarianceComponents,
)
from mor.report.results.models.model_verdict import ReliabilityMap, Verdict


class Results(Part):
    """Results of an adjustment by mor, version 1."""

    schema_name: Literal["mor-results"] = Field(alias="schema", description="What this file is")
    schema_version: Literal[2] = Field(description="Version of its keys")
    program: str = Field(description="Program and version")
    title: str = Field(description="Title of the project")
    identity: Identity = Field(default=Identity(), description="What the results are of")
    notes: list[Note] = Field(default_factory=list, description="What was noted before the adjustment")
    units: Units = Field(description="Units of all values that say none of their own")
    axes: Axes = Field(description="Axes and senses of the project")
    outcome: Literal["converged", "not converged", "diverged", "singular"] = Field(
        description="How the adjustment ended"
    )
    reason: str = Field(description="The same in words")
    solution: bool = Field(default=True, description="false: all values are those of the last iteration")
    iterations: int = Field(description="Number of iterations")
    observations: int = Field(description="n")
    unknowns: int = Field(description="u")
    defect: int = Field(description="d, number of movements the observations leave open")
    movements: list[str] = Field(description="These movements in words")
    undetermined: list[Direction] = Field(description="What is not determined inside the network")
    undeterminable: list[Undeterminable] = Field(
        default_factory=list, description="Things that nothing determines, and what was done about them"
    )
    hardly_determined: list[str] = Field(
        default_factory=list, description="What is determined, but hardly, in words"
    )
    datum: str = Field(description="In words")
    redundancy: int | None = Field(description="n - u + d, without what is kept out")
    redundancy_sum: Number = Field(description="Sum of all redundancy numbers, equal to redundancy")
    sigma0: Sigma0 | None = Field(description="Standard deviation of unit weight")
    global_test: GlobalTest | None = Field(description="Test of all residuals together")
    verdict: Verdict | None = Field(
        default=None, description="The tests of the whole and of its groups; null without a solution"
    )
    reliability: ReliabilityMap | None = Field(
        default=None, description="Where errors would hide; null without redundancy"
    )
    critical_w: Number = Field(default=None, description="Limit of |w|")
    snooping_level: Number = Field(default=None, description="α0, level of the test of single observations")
    flagged: int | None = Field(description="Number of observations beyond the limit")
    uncontrolled: int | None = Field(
        default=None, description="Number of observations with r below settings.least_redundancy"
    )
    iteration_log: list[Step] = Field(description="The iterations")
    kernels: Literal["numpy", "numba"] = Field(
        default="numpy", description="What did the work: plain NumPy, or kernels compiled by Numba"
    )
    points: list[Point] | None = Field(description="null beyond 10 000: read the table")
    images: list[Image] | None = Field(description="null beyond 10 000: read the table")
    motions: list[Motion] = Field(default=[], description="What moves points")
    epochs: list[Epoch] = Field(default=[], description="Times of the observations, in their order")
    trajectories: list[Knot] | None = Field(
        default=[], description="Knots of trajectories; null beyond 10 000: read the table"
    )
    boresights: list[Boresight] = Field(
        default=[], description="Misalignments of inertial systems that were estimated"
    )
    cameras: list[Camera] = Field(description="Interior orientations")
    stations: list[Station] = Field(description="Theodolite stations and further sets of directions")
    systems: list[System] = Field(description="Local systems")
    pairs: list[Pair] = Field(description="Relative orientations of stereo images")
    features: list[Feature] = Field(description="Planes, lines and right angles")
    others: list[Other] = Field(description="Unknowns of instruments, heights, eccentricities and offsets")
    groups: list[Group] = Field(description="Groups of observations, in the order of the input")
    variance_components: VarianceComponents | None = Field(
        default=None, description="How the factors of the σ of the groups were estimated"
    )
    gross_errors: GrossErrors = Field(description="Tests of single observations")
    suspects: Suspects | None = Field(
        default=None, description="What was left out because all observations together have no solution"
    )
    possible_causes: list[PossibleCause] = Field(
        default=[],
        description="Mistakes that would explain what is rejected, by score tests, the best first; not verified",
    )
    fixed_points: list[FixedPoint] = Field(description="Tests of the coordinates held fixed")
    relative: list[Relative] = Field(
        default=[],
        description="Distances and relative error ellipses of the pairs that report: {relative: …} names",
    )
    checks: list[Check] = Field(description="Observations kept out to check by")
    failure: Failure | None = Field(
        default=None, description="Where there is no solution: what does not come to rest, what fits worst"
    )
    tables: dict[str, str] = Field(description="Names of the tables beside results.json")
    files: list[str] = Field(
        default=[],
        description="Names of all files of this run in its folder; nothing else there is ever replaced",
    )
    residuals: list[Residual] | None = Field(description="null beyond 10 000: read the table")


def results_schema() -> str:
    """JSON Schema (2020-12) of ``results.json`` as text."""
    schema = Results.model_json_schema(by_alias=True)
    return (
        json.dumps(
            {
                "$schema": "https://json-schema.org/draft/2020-12/schema",
                "$id": "urn:mor:schema:results:2",
                **schema,
            },
            indent=2,
            ensure_ascii=False,
        )
        + "\n"
    )
