"""The parts of ``results.json`` as models: times, and what moves points."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mor.report.results.models.model_parts import Number, Part


class Epoch(Part):
    """A time at which something was measured."""

    epoch: str = Field(description="As the project has it")
    year: float = Field(description="The same in years")


class Motion(Part):
    """Motion model of a point; for an annual oscillation x … are the sine terms."""

    point: str = Field(description="Its name")
    parameter: Literal["velocity", "annual oscillation", "step"] = Field(description="What it is")
    time: str = Field(description="Of a step")
    x: Number = Field(default=None, description="x, length unit; of velocities in a year")
    sx: Number = Field(default=None, description="σ of x")
    y: Number = Field(default=None, description="y, length unit; of velocities in a year")
    sy: Number = Field(default=None, description="σ of y")
    z: Number = Field(default=None, description="z, length unit; of velocities in a year")
    sz: Number = Field(default=None, description="σ of z")
    cos_x: Number = Field(default=None, description="cosine x, length unit; of velocities in a year")
    scos_x: Number = Field(default=None, description="σ of cosine x")
    cos_y: Number = Field(default=None, description="cosine y, length unit; of velocities in a year")
    scos_y: Number = Field(default=None, description="σ of cosine y")
    cos_z: Number = Field(default=None, description="cosine z, length unit; of velocities in a year")
    scos_z: Number = Field(default=None, description="σ of cosine z")
    freedom: int = Field(description="Degrees of freedom of the test")
    test: Number = Field(description="Test value, mean square")
    p: Number = Field(description="Its probability without any movement")
    smallest: Number = Field(description="Smallest length that is found in every direction with the power β0")
    moved: bool = Field(description="true: significant")


class Knot(Part):
    """A knot of a trajectory."""

    trajectory: str = Field(description="Name of the trajectory")
    time: float = Field(description="Seconds")
    stretch: int = Field(description="Number of the stretch between gaps, from 1")
    x: Number = Field(description="x, length unit")
    y: Number = Field(description="y")
    z: Number = Field(description="z")
    sx: Number = Field(description="σ of x")
    sy: Number = Field(description="σ of y")
    sz: Number = Field(description="σ of z")
    omega: Number = Field(description="ω, unit of angles")
    phi: Number = Field(description="φ")
    kappa: Number = Field(description="κ")
    somega: Number = Field(description="σ of ω")
    sphi: Number = Field(description="σ of φ")
    skappa: Number = Field(description="σ of κ")


class Boresight(Part):
    """From the axes of a trajectory to those of an inertial system."""

    instrument: str = Field(description="Its name")
    omega: Number = Field(description="ω, unit of angles")
    phi: Number = Field(description="φ")
    kappa: Number = Field(description="κ")
    somega: Number = Field(description="σ of ω")
    sphi: Number = Field(description="σ of φ")
    skappa: Number = Field(description="σ of κ")
