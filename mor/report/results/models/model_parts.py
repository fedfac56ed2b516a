"""The parts of ``results.json`` as models: what is estimated, and what is said of its quality."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = float | None
"""``null`` where the number does not exist."""
Share = Annotated[float, Field(ge=-1.0, le=1.0)] | None


class Part(BaseModel):
    """Further keys may follow."""

    model_config = ConfigDict(extra="allow", strict=True)


class Input(Part):
    """A file that was read."""

    file: str = Field(description="Name, counted from the folder of the project")
    bytes: int = Field(description="Size as it was read")
    sha256: str = Field(description="SHA-256 of it, as sha256sum prints it")


class Note(Part):
    """A note made while the project was read."""

    message: str = Field(description="What was noted, in words")
    file: str = Field(description="File it stands in, counted from the folder of the project; empty: none")
    line: int = Field(description="Line of it; 0: none")


class Identity(Part):
    """Identity of the results: program, operator, client, input files."""

    program: str = Field(default="", description="Program and version")
    project_version: str = Field(default="1", description="Version of the project file, its key mor")
    measured: str | None = Field(
        default=None, description="date of the project: when the observations were made"
    )
    operator: str | None = Field(default=None, description="report: {operator} of the project")
    client: str | None = Field(default=None, description="report: {client} of the project")
    remarks: str | None = Field(default=None, description="report: {remarks} of the project")
    date: str | None = Field(
        default=None, description="Day of the newest input file (UTC), or of SOURCE_DATE_EPOCH"
    )
    options: list[str] = Field(default_factory=list, description="Options that numbers depend on")
    inputs: list[Input] = Field(default_factory=list, description="Files that were read, in that order")


class Units(Part):
    """Units of all values that say none of their own."""

    length: str = Field(description="Unit of lengths and coordinates")
    angle: str = Field(description="Unit of angles")


class Axes(Part):
    """Axes and senses of the project."""

    xy: str = Field(description="Directions of the x and y axes: en is x east, y north")
    angles: Literal["clockwise", "counterclockwise"] = Field(
        description="How horizontal angles and bearings count"
    )
    bearings_from: Literal["north", "east", "south", "west"] = Field(
        description="Where bearings and orientations count from"
    )


class Direction(Part):
    """A direction that is not determined: unknowns and the proportion in which they move."""

    unknowns: list[str] = Field(description="Thing and component of each unknown that moves")
    amounts: list[float] = Field(description="How far each of them moves, the largest 1")


class Sigma0(Part):
    """Standard deviation of unit weight."""

    apriori: float = Field(description="As set")
    aposteriori: Number = Field(description="√(vᵀPv / redundancy) times the one a priori")
    ratio: Number = Field(description="(aposteriori / apriori)²")
    ratio_of_sigmas: Number = Field(description="aposteriori / apriori")
    used_for_sigma: float = Field(description="What cofactors were multiplied with to become σ")


class GlobalTest(Part):
    """Two-sided χ² test of vᵀPv."""

    statistic: float = Field(description="vᵀPv for σ0 a priori")
    lower: float = Field(description="Lower limit")
    upper: float = Field(description="Upper limit")
    level: float = Field(description="Level of the test")
    accepted: bool = Field(description="True where the statistic lies between the limits")


class Step(Part):
    """One iteration."""

    number: int = Field(description="Number of the iteration, from 1")
    objective: float = Field(description="vᵀPv before the step")
    largest_change: float = Field(description="In units of σ")
    damping: float = Field(description="Damping of the step, 0 without")


class Component(Part):
    """A component of a block."""

    value: float = Field(description="Its value")
    sigma: Number = Field(description="Its standard deviation")
    status: Literal["free", "fixed"] = Field(description="Whether it is an unknown")
    t: Number = Field(default=None, description="|value| / σ, the test of its significance")


class Position(Part):
    """A name, coordinates and their σ."""

    id: str = Field(description="Its name")
    x: Number = Field(description="x in project axes, unit of lengths")
    y: Number = Field(description="y in project axes")
    z: Number = Field(description="z in project axes")
    sx: Number = Field(description="σ of x")
    sy: Number = Field(description="σ of y")
    sz: Number = Field(description="σ of z")


class Point(Position):
    """A row of points.csv."""

    ellipsoid_a: Number = Field(description="Longest semi-axis of the standard error ellipsoid")
    ellipsoid_b: Number = Field(description="Middle semi-axis")
    ellipsoid_c: Number = Field(description="Shortest semi-axis")
    ellipse_a: Number = Field(description="Larger semi-axis of the standard error ellipse in plan")
    ellipse_b: Number = Field(description="Smaller semi-axis")
    ellipse_azimuth: Number = Field(
        description="Bearing of the larger one, unit of angles, within half a circle"
    )
    rxy: Share = Field(description="Correlation of x and y")
    rxz: Share = Field(description="Correlation of x and z")
    ryz: Share = Field(description="Correlation of y and z")
    rays: int = Field(description="Number of image rays to it")
    others: int = Field(description="Number of other rows of observations that name it")
    mean_r: Number = Field(description="Mean redundancy number of its observations")
    largest_w: Number = Field(description="Largest |w| of its observations")
    status: Literal["free", "partly fixed", "fixed", "left out", "at infinity"] = Field(
        description="Whether its coordinates are unknowns"
    )


class Posed(Position):
    """A position with an attitude."""

    omega: Number = Field(description="ω, unit of angles")
    phi: Number = Field(description="φ")
    kappa: Number = Field(description="κ")
    somega: Number = Field(description="σ of ω")
    sphi: Number = Field(description="σ of φ")
    skappa: Number = Field(description="σ of κ")


class Image(Posed):
    """A row of images.csv."""

    camera: str = Field(description="Its camera")
    points: int = Field(description="Number of points measured in it")
    rms: Number = Field(description="Root mean square of its residuals, in the unit they were measured in")
    mean_r: Number = Field(description="Mean redundancy number of its image coordinates")
    largest_w: Number = Field(description="Largest |w| of its image coordinates")
    vx: Number = Field(
        default=None,
        description="Velocity while it is read out, axes of the image, unit of lengths per second",
    )
    vy: Number = Field(default=None, description="The same along y")
    vz: Number = Field(default=None, description="The same along z")
    svx: Number = Field(default=None, description="σ of vx, 0 where it is fixed")
    svy: Number = Field(default=None, description="σ of vy")
    svz: Number = Field(default=None, description="σ of vz")
    rate_x: Number = Field(default=None, description="Rate of rotation about x, unit of angles per second")
    rate_y: Number = Field(default=None, description="The same about y")
    rate_z: Number = Field(default=None, description="The same about z")
    srate_x: Number = Field(default=None, description="σ of rate_x, 0 where it is fixed")
    srate_y: Number = Field(default=None, description="σ of rate_y")
    srate_z: Number = Field(default=None, description="σ of rate_z")
    interior: dict[str, Component] | None = Field(
        default=None, description="Components of the interior orientation that the image has of its own"
    )


class Station(Posed):
    """A theodolite station."""

    orientation: Number = Field(description="Bearing of the zero of the horizontal circle")
    sorientation: Number = Field(description="σ of the orientation")
    height: Number = Field(description="Height of the instrument above its position")


class System(Posed):
    """A local system."""

    scale: Number = Field(description="λ")
    sscale: Number = Field(description="σ of the scale")


class Pair(Part):
    """A relative orientation of stereo images."""

    id: str = Field(description="Its name")
    bx: Number = Field(description="Projection centre of the follower in the image axes of the leader, x")
    by: Number = Field(description="y of the same")
    bz: Number = Field(description="z of the same")
    sbx: Number = Field(description="σ of bx")
    sby: Number = Field(description="σ of by")
    sbz: Number = Field(description="σ of bz")
    omega: Number = Field(description="ω*, unit of angles")
    phi: Number = Field(description="φ*")
    kappa: Number = Field(description="κ*")
    somega: Number = Field(description="σ of ω*")
    sphi: Number = Field(description="σ of φ*")
    skappa: Number = Field(description="σ of κ*")


class Format(Part):
    """Image size in px, pixel size in camera units, where coordinates count from."""

    width: float = Field(description="Image width, px")
    height: float = Field(description="Image height, px")
    pixel: float = Field(description="Size of a pixel, camera unit")
    origin: Literal["centred", "corner"] = Field(description="Where image coordinates count from")


class Correlations(Part):
    """Correlation matrix of the estimated components."""

    components: list[str] = Field(description="Names of the rows and columns")
    matrix: list[list[float]] | None = Field(description="Correlations, row by row")


class Camera(Part):
    """An interior orientation."""

    id: str = Field(description="Its name")
    model: str = Field(description="Its camera model")
    unit: str = Field(description="Unit of its interior orientation")
    r0: Number = Field(description="Second zero crossing of the radial distortion, camera unit")
    format: Format | None = Field(description="Image format, where it is given")
    components: dict[str, Component] = Field(description="Interior orientation by component")
    correlations: Correlations = Field(description="Correlations of the components that are unknowns")


class Feature(Part):
    """A plane or a line."""

    id: str = Field(description="Its name")
    type: Literal["plane", "line", "right angle"] = Field(description="What kind of feature it is")
    part: str = Field(description="plane or line; of a right angle which of its planes")
    dx: float = Field(description="Direction of the line, or normal of the plane: x")
    dy: float = Field(description="y of the same")
    dz: float = Field(description="z of the same")
    distance: Number = Field(description="Distance of the plane from the origin")
    x: float = Field(description="Mean of the points on it: x")
    y: float = Field(description="y of the same")
    z: float = Field(description="z of the same")
    points: int = Field(description="Number of points on it")
    rms: float = Field(description="Root mean square of their distances from it")


class Other(Part):
    """An estimated block that belongs to no other table."""

    kind: str = Field(description="What kind of block it is")
    id: str = Field(description="Whose it is")
    components: dict[str, Component] = Field(description="Its unknowns by component")


class Group(Part):
    """An observation group."""

    name: str = Field(description="Table, camera or instrument it comes from")
    type: str = Field(description="Type of its observations as a project names it")
    observations: int = Field(description="Number of observations that took part")
    redundancy: Number = Field(default=None, description="Sum of their redundancy numbers")
    vtpv: Number = Field(
        default=None,
        description="Its part of vᵀPv; may be negative where observations are correlated across groups",
    )
    sigma0: Number = Field(default=None, description="√(vtpv/redundancy); null where there is none")
    mean_r: Number = Field(default=None, description="Mean redundancy number")
    largest_w: Number = Field(default=None, description="Largest |w|")
    excluded: int | None = Field(default=None, description="Number of observations taken out")
    flagged: int | None = Field(default=None, description="Number of observations beyond the critical value")
    sigma_factor: Number = Field(default=None, description="Estimated factor on the σ of the group")
    sigma_of_factor: Number = Field(default=None, description="Standard deviation of that factor")


class VarianceComponents(Part):
    """Estimation of the variance components of the groups."""

    method: Literal["simplified", "helmert"] = Field(description="Each group by itself, or the full system")
    iterated: bool = Field(description="True where the weights have them in")
    settled: bool = Field(description="True where iterating them changed nothing any more")
    rounds: int = Field(description="Number of adjustments it took")


class FixedPoint(Part):
    """Test of the coordinates a point is held at."""

    id: str = Field(description="Its name")
    movement: list[float] = Field(description="Estimated movement in x, y, z")
    freedom: int = Field(description="Number of its fixed coordinates")
    test: float = Field(description="Test statistic, χ²")
    p: float = Field(description="Probability of one as large")
    test_estimated: Number = Field(description="The same with σ0 a posteriori, F")
    p_estimated: Number = Field(description="Its probability")


class Relative(Part):
    """The difference of two points: how well their distance and their relative place are known."""

    from_: str = Field(alias="from", description="The first point")
    to: str = Field(description="The second point")
    distance: float = Field(description="Their distance in space, unit of lengths")
    sdistance: Number = Field(description="Its σ; null for two points at one place")
    a: float = Field(description="Larger semi-axis of the relative standard error ellipse in plan")
    b: float = Field(description="Smaller semi-axis")
    azimuth: float = Field(description="Bearing of the larger one, unit of angles, within half a circle")
    direction: list[float] = Field(
        default_factory=list, description="The same as a unit vector in plan, x and y of the project"
    )
    sdz: float = Field(description="σ of the difference of heights")


class Check(Part):
    """Deviations of a group that was kept out, adjusted − known, one component."""

    group: str = Field(description="Table it comes from")
    type: str = Field(description="Type of its observations as a project names it")
    component: str = Field(description="Component of the type")
    unit: str = Field(description="Unit of the observation")
    count: int = Field(description="Number of observations")
    mean: float = Field(description="Mean deviation")
    rms: float = Field(description="Root mean square deviation")
    largest: float = Field(description="Largest deviation, with its sign")
    exceeding: int = Field(description="Number of deviations beyond the critical value")


class Residual(Part):
    """A row of residuals.csv."""

    model_config = ConfigDict(extra="allow", strict=True, serialize_by_alias=True)

    type: str = Field(description="Type of the observation as a project names it")
    group: str = Field(description="Table it comes from")
    at: str = Field(description="Station of an angle; empty otherwise")
    from_: str = Field(alias="from", description="Station, or image, or the first end")
    to: str = Field(description="Target, or point, or the second end")
    component: str = Field(description="Component of the type")
    unit: str = Field(description="Unit of observed, adjusted, v, sigma, sigma_adjusted, error, nabla")
    observed: Number = Field(description="As it was given")
    adjusted: Number = Field(description="observed + v")
    v: Number = Field(description="adjusted - observed")
    sigma: Number = Field(description="σ a priori")
    sigma_adjusted: Number = Field(description="σ of the adjusted observation")
    r: Number = Field(description="Redundancy number")
    w: Number = Field(description="Test statistic, for correlated observations too")
    normalised: Number = Field(description="v/σ_v for σ0 a priori: the same as w where it is uncorrelated")
    tau: Number = Field(description="v/σ_v for σ0 a posteriori")
    p: Number = Field(description="Probability of |w| as large")
    t2: Number = Field(description="Squared Student test, σ0 from the other observations")
    p_t: Number = Field(description="Probability of t2 as large")
    error: Number = Field(description="Estimated gross error")
    nabla: Number = Field(description="Smallest detectable error")
    external: Number = Field(description="Influence of nabla on the results, in units of their σ")
    influence: Number = Field(description="Influence of the error on its point, unit of lengths")
    joint: Number = Field(description="Joint test of the components of one row")
    joint_freedom: Number = Field(description="Its degrees of freedom")
    p_joint: Number = Field(description="Its probability")
    flag: Literal["", "gross", "uncontrolled", "excluded", "check"] = Field(
        description="gross: beyond the limit; uncontrolled: r < settings.least_redundancy; excluded, check: kept out"
    )
