"""The parts of ``results.json`` on what nothing determines, and on outcomes without a solution, as models."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mor.report.results.models.model_parts import Number, Part, Residual


class Undeterminable(Part):
    """A row of undetermined.csv: a thing that nothing determines."""

    kind: str = Field(description="point, image, station, system, pair")
    id: str = Field(description="Its name")
    reason: str = Field(description="Why it is not determined")
    treatment: Literal["", "left out", "at infinity"] = Field(
        description="What was done about it; empty: nothing"
    )
    observations: int = Field(description="Rows of observations that refer to it")
    dx: Number = Field(description="Unit vector to a point at infinity, project axes")
    dy: Number = Field(description="y of the same")
    dz: Number = Field(description="z of the same")
    sigma: Number = Field(description="Its standard deviation across, the larger one, an angle")


class Moving(Part):
    """An unknown that does not come to rest."""

    kind: str = Field(description="Kind of its block")
    of: str = Field(description="What kind of thing it belongs to")
    id: str = Field(description="Name of that thing")
    component: str = Field(description="Which component")
    unit: str = Field(description="Unit of the steps")
    steps: list[Number] = Field(description="Its last steps, or the one that could not be taken")
    way: Literal["to and fro", "away", "wanted"] = Field(
        description="to and fro, away, or wanted: the step that the last values call for"
    )


class Misfit(Residual):
    """A residual at the last values, where there is no solution."""

    misfit: Number = Field(description="abs(v) / sigma")


class Failure(Part):
    """State of an adjustment without a solution."""

    notice: str = Field(description="What the values of such results are worth")
    moving: list[Moving] = Field(description="Unknowns that do not come to rest")
    worst: list[Misfit] = Field(description="Observations that fit worst at the last values")
