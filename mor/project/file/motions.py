"""What a project file says of time: its reference, and how points move."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from mor.project.file.scalars import Name, Strict, Text
from mor.project.file.table import Table

_Component = Literal["vx", "vy", "vz", "sin_x", "sin_y", "sin_z", "cos_x", "cos_y", "cos_z", "dx", "dy", "dz"]


class Epochs(Strict):
    """What the times of observations are counted from."""

    reference: Text | None = Field(
        default=None,
        description="Time at which points with a velocity have their coordinates: 2015-05-12 or 2015.36; "
        "default the first epoch",
    )


class Motion(Table):
    """Points that move alike: all that are named, or those of a table with a column id."""

    model: Literal["velocity", "seasonal", "steps", "epochs"] = Field(
        description="velocity: vx, vy, vz in a year; seasonal: an annual oscillation sin_x … cos_z; "
        "steps: dx, dy, dz at a time; epochs: coordinates of its own in every epoch"
    )
    points: list[Name] | None = Field(
        default=None, description="In place of a table: names, groups of points, or patterns such as D*"
    )
    fixed: list[_Component] = Field(default_factory=list, description="Components held as they are")

    @property
    def sources(self) -> dict[str, object]:
        """What the rows may come from, by its key; ``None`` if it is not given."""
        return {**super().sources, "points": self.points}

    @model_validator(mode="after")
    def _no_components(self) -> Motion:
        if self.model == "epochs" and self.fixed:
            raise ValueError("coordinates of every epoch are fixed among the points: D1@2015-05-12")
        return self
