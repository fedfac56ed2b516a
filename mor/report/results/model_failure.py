"""The parts of ``results.json`` on what nothing determines, and on outcomes without a solution, as models."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mor.report.results.model_parts import Number, Part, Residual


class Undeterminable(Part):
    """A row of undetermined.csv: a thing that nothing determines."""

    kind: str = Field(description="point, image, station, system, pair")
    id: str
    reason: str
    treatment: Literal["", "left out", "at infinity"]
    observations: int = Field(description="Rows of observations that refer to it")
    dx: Number = Field(description="Unit vector to a point at infinity, project axes")
    dy: Number
    dz: Number
    sigma: Number = Field(description="Its standard deviation across, the larger one, an angle")


class Moving(Part):
    """An unknown that does not come to rest."""

    kind: str
    of: str
    id: str
    component: str
    unit: str
    steps: list[Number] = Field(description="Its last steps, or the one that could not be taken")
    way: Literal["to and fro", "away", "wanted"]


class Misfit(Residual):
    """A residual at the last values, where there is no solution."""

    misfit: Number = Field(description="abs(v) / sigma")


class Failure(Part):
    """What is known where there is no solution."""

    notice: str
    moving: list[Moving]
    worst: list[Misfit]
