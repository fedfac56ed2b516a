"""``results.json`` as a model: every key there is and what it means. The JSON Schema is made from it.

Keys may be added in later versions; those that are there keep their meaning while ``schema_version`` is 1.
"""

from __future__ import annotations

import json
from typing import Literal

from pydantic import Field

from mor.report.results.model_parts import (
    Axes,
    Camera,
    Check,
    Direction,
    Failure,
    Feature,
    FixedPoint,
    GlobalTest,
    GrossErrors,
    Group,
    Image,
    Number,
    Other,
    Pair,
    Part,
    Point,
    Residual,
    Sigma0,
    Station,
    Step,
    Suspects,
    System,
    Undeterminable,
    Units,
    VarianceComponents,
)


class Results(Part):
    """Results of an adjustment by mor, version 1."""

    schema_name: Literal["mor-results"] = Field(alias="schema")
    schema_version: Literal[1]
    program: str
    title: str
    units: Units
    axes: Axes
    outcome: Literal["converged", "not converged", "diverged", "singular"]
    reason: str
    solution: bool = Field(default=True, description="false: all values are those of the last iteration")
    iterations: int
    observations: int
    unknowns: int
    defect: int
    movements: list[str]
    undetermined: list[Direction]
    undeterminable: list[Undeterminable] = Field(
        default_factory=list, description="Things that nothing determines, and what was done about them"
    )
    hardly_determined: list[str] = Field(default_factory=list)
    datum: str
    redundancy: int | None
    redundancy_sum: Number = Field(description="Sum of all redundancy numbers, equal to redundancy")
    sigma0: Sigma0 | None
    global_test: GlobalTest | None
    critical_w: Number = None
    snooping_level: Number = None
    flagged: int | None
    uncontrolled: int | None = None
    iteration_log: list[Step]
    points: list[Point] | None = Field(description="null beyond 10 000: read the table")
    images: list[Image] | None = Field(description="null beyond 10 000: read the table")
    cameras: list[Camera]
    stations: list[Station]
    systems: list[System]
    pairs: list[Pair]
    features: list[Feature]
    others: list[Other]
    groups: list[Group]
    variance_components: VarianceComponents | None = None
    gross_errors: GrossErrors
    suspects: Suspects | None = Field(
        default=None, description="What was left out because all observations together have no solution"
    )
    fixed_points: list[FixedPoint]
    checks: list[Check]
    failure: Failure | None = Field(
        default=None, description="Where there is no solution: what does not come to rest, what fits worst"
    )
    tables: dict[str, str] = Field(description="Names of the tables beside results.json")
    residuals: list[Residual] | None = Field(description="null beyond 10 000: read the table")


def results_schema() -> str:
    """JSON Schema (2020-12) of ``results.json`` as text."""
    schema = Results.model_json_schema(by_alias=True)
    return (
        json.dumps(
            {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema},
            indent=2,
            ensure_ascii=False,
        )
        + "\n"
    )
