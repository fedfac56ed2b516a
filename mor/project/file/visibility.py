"""What a project file says of who sees what: surfaces in the way, normals of targets, limits of sights."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from mor.project.file.scalars import Measure, Name, Strict, Text
from mor.project.file.table import Table

_Place = Name | Annotated[list[Measure], Field(min_length=3, max_length=3)]


class Surface(Strict):
    """Something that no sight goes through: a plane polygon, or the faces of a mesh."""

    name: Name | None = Field(default=None, description="Its name, for normals that are its own")
    polygon: Annotated[list[_Place], Field(min_length=3)] | None = Field(
        default=None, description="Its corners in turn: names of points, or coordinates [x, y, z]"
    )
    file: Text | None = Field(
        default=None, description="A mesh in the coordinates of the project: PLY or OBJ; may be .gz"
    )
    unit: Literal["m", "dm", "cm", "mm", "um", "km", "ft", "us-ft", "in"] | None = Field(
        default=None, description="Unit of the coordinates of the file; default that of the project"
    )

    @model_validator(mode="after")
    def _one_source(self) -> Surface:
        if (self.polygon is None) == (self.file is None):
            raise ValueError("give either a polygon or a file")
        if self.unit is not None and self.file is None:
            raise ValueError("unit belongs to a file; coordinates of polygons may have units of their own")
        return self


class Normals(Table):
    """Normals of targets, which point to where they can be seen from: a table id, nx, ny, nz, or one for many."""

    points: list[Name] = Field(
        default_factory=list,
        description="Names, groups of points, or patterns, that direction or surface is for",
    )
    direction: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="Their common normal [nx, ny, nz], of any length"
    )
    surface: Name | None = Field(
        default=None, description="The surface they are on: each has the normal of its face"
    )

    @property
    def sources(self) -> dict[str, object]:
        """What the normals may come from, by its key; ``None`` if it is not given."""
        return {**super().sources, "direction": self.direction, "surface": self.surface}

    @model_validator(mode="after")
    def _points_of_one(self) -> Normals:
        if bool(self.points) == (self.file is not None or self.rows is not None):
            raise ValueError("points belong to a direction or a surface, which need them")
        return self


class Visibility(Strict):
    """What stands in the way of sights, and where targets look."""

    surfaces: list[Surface] = Field(default_factory=list, description="What no sight goes through")
    normals: list[Normals] = Field(
        default_factory=list, description="Normals of targets; of a point that is named twice the last one"
    )
    clearance: Measure = Field(
        default="1 mm",
        description="A surface whose plane is as close to either end of a sight is not in its way: targets are on it",
    )


class Visible(Strict):
    """Everything that can be seen is observed: the limits of it."""

    at: list[Name] = Field(
        default=["*"],
        description="Where sights begin: images, stations, systems or points, by the type; names or patterns",
    )
    to: list[Name] = Field(default=["*"], description="Targets: names, groups of points, or patterns")
    nearest: Measure | None = Field(default=None, description="Shortest sight")
    farthest: Measure | None = Field(default=None, description="Longest sight")
    incidence: Measure = Field(
        default="100 gon",
        description="Largest angle between the normal of a target and the sight to it, where it has a normal",
    )
    border: Measure | None = Field(
        default=None, description="Margin of the image format that is left empty, image unit"
    )
    steepest: Measure | None = Field(
        default=None, description="Largest angle of a sight of an instrument above or below the horizon"
    )
    both_ways: bool = Field(
        default=False, description="Between points: each pair from either end, not only from the first one"
    )
