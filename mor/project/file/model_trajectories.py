"""What a project file says of trajectories: their knots, how poses lie between them, how steady they are."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mor.project.file.scalars import Measure, Strict, Text
from mor.project.file.table import Table


class Steadiness(Strict):
    """σ of differences of neighbouring knots, which are observed as 0."""

    position: Measure | None = Field(default=None, description="σ of x, y, z each, e.g. 0.5 m/s^2")
    attitude: Measure | None = Field(default=None, description="σ about each axis, e.g. 0.1 deg/s^2")


class Trajectory(Table):
    """Knots of trajectories: trajectory, time, x, y, z, omega, phi, kappa; sigma columns make components observed."""

    fixed: list[Literal["x", "y", "z", "omega", "phi", "kappa"]] = Field(
        default_factory=list, description="Components held as they are"
    )
    interpolation: Literal["linear", "cubic"] = Field(
        default="linear", description="Between two knots, or through four"
    )
    spacing: Measure | None = Field(
        default=None,
        description="Rows are no knots: there is one every so many seconds, free, starting between the rows",
    )
    gap: Measure | None = Field(
        default=None,
        description="Knots (or rows) further apart than this belong to different stretches; nothing is in between",
    )
    constancy: Steadiness = Field(
        default=Steadiness.model_construct(),
        description="σ of velocity and rate of rotation between knots, observed as 0",
    )
    smoothness: Steadiness = Field(
        default=Steadiness.model_construct(),
        description="σ of acceleration and change of the rate of rotation, observed as 0",
    )


class LineTimes(Table):
    """Times of the lines of scanners, where their rate is not steady: image, row, time; in between they are linear."""

    name: Text | None = Field(default=None, description="Name in messages; default the file")
