"""What a project file says of a plan: requirements it has to reach, and variants of it."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from mor.project.file.scalars import Measure, Name, Strict


class RequiredSigma(Strict):
    """Largest standard deviations that points may have."""

    points: list[Name] = Field(
        default=["*"],
        description="Names, groups of points, or patterns of names: P* is all that begin with P",
    )
    x: Measure | None = Field(default=None, description="Largest σ of x")
    y: Measure | None = Field(default=None, description="Largest σ of y")
    z: Measure | None = Field(default=None, description="Largest σ of z")
    xy: Measure | None = Field(default=None, description="Largest σ of x, and of y")
    xyz: Measure | None = Field(default=None, description="Largest σ of x, of y and of z")
    ellipsoid: Measure | None = Field(
        default=None, description="Longest semi-axis of the error ellipsoid: no direction has a larger σ"
    )

    @model_validator(mode="after")
    def _something(self) -> RequiredSigma:
        if all(getattr(self, key) is None for key in ("x", "y", "z", "xy", "xyz", "ellipsoid")):
            raise ValueError("give at least one of x, y, z, xy, xyz, ellipsoid")
        return self


class RequiredReliability(Strict):
    """How well observations must control each other."""

    groups: list[Name] = Field(
        default=["*"], description="Names of groups of observations, or patterns of them"
    )
    r: float | None = Field(default=None, gt=0.0, lt=1.0, description="Least redundancy number")
    external: float | None = Field(
        default=None,
        gt=0.0,
        description="Largest external reliability δ̄0: effect of an undetected error, in σ",
    )

    @model_validator(mode="after")
    def _something(self) -> RequiredReliability:
        if self.r is None and self.external is None:
            raise ValueError("give r, external, or both")
        return self


class Require(Strict):
    """What a plan has to reach: mor design says whether it does."""

    sigma: RequiredSigma | list[RequiredSigma] = Field(
        default_factory=list, description="Largest σ of points, a priori, in the datum of the project"
    )
    reliability: RequiredReliability | list[RequiredReliability] = Field(
        default_factory=list, description="Least redundancy numbers, largest external reliability"
    )


class Without(Strict):
    """What a variant leaves out: every observation that refers to one of these; names or patterns."""

    points: list[Name] = Field(default_factory=list, description="Points")
    images: list[Name] = Field(default_factory=list, description="Images")
    stations: list[Name] = Field(default_factory=list, description="Stations of theodolites, and their sets")
    groups: list[Name] = Field(default_factory=list, description="Groups of observations, by their names")


class Variant(Strict):
    """What would be if: the project with something left out, with other σ, or with more observations."""

    without: Without = Field(default=Without.model_construct(), description="What is left out")
    factor: dict[Name, Annotated[float, Field(gt=0.0, le=1e50)]] = Field(
        default_factory=dict, description="Factors on the σ of groups of observations, by names or patterns"
    )
    candidates: list[Name] = Field(
        default_factory=list, description="Tables of candidates that take part, by names or patterns"
    )
    cameras: dict[Name, dict[str, Any]] = Field(
        default_factory=dict, description="Keys of cameras that differ: another lens"
    )
