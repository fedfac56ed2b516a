"""The contents of results.json as pydantic models."""

from __future__ import annotations

import json
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from mor.project.schema import optional, several

# ---- The parts of ``results.json`` as models: what is estimated, and what is said of its quality.

Number = float | None
"""``null`` where the number does not exist."""
Share = Annotated[float, Field(ge=-1.0, le=1.0)] | None


class OpenModel(BaseModel):
    """Further keys may follow."""

    model_config = ConfigDict(extra="allow", strict=True)


class Input(OpenModel):
    """A file that was read."""

    file: str = Field(description="Name, counted from the folder of the project")
    bytes: int = Field(description="Size as it was read")
    sha256: str = Field(description="SHA-256 of it, as sha256sum prints it")


class Note(OpenModel):
    """A note made while the project was read."""

    message: str = Field(description="What was noted, in words")
    file: str = Field(description="File it stands in, counted from the folder of the project; empty: none")
    line: int = Field(description="Line of it; 0: none")


class Identity(OpenModel):
    """Identity of the results: program, operator, client, input files."""

    program: str = Field("", description="Program and version")
    project_version: str = Field("1", description="Version of the project file, its key mor")
    measured: str | None = optional("date of the project: when the observations were made")
    operator: str | None = optional("report: {operator} of the project")
    client: str | None = optional("report: {client} of the project")
    remarks: str | None = optional("report: {remarks} of the project")
    date: str | None = optional("Day of the newest input file (UTC), or of SOURCE_DATE_EPOCH")
    options: list[str] = several("Options that numbers depend on")
    inputs: list[Input] = several("Files that were read, in that order")


class Units(OpenModel):
    """Units of all values that say none of their own."""

    length: str = Field(description="Unit of lengths and coordinates")
    angle: str = Field(description="Unit of angles")


class Axes(OpenModel):
    """Axes and senses of the project."""

    xy: str = Field(description="Directions of the x and y axes: en is x east, y north")
    angles: Literal["clockwise", "counterclockwise"] = Field(description="How horizontal angles and bearings count")
    bearings_from: Literal["north", "east", "south", "west"] = Field(
        description="Where bearings and orientations count from"
    )


class Direction(OpenModel):
    """A direction that is not determined: unknowns and the proportion in which they move."""

    unknowns: list[str] = Field(description="Thing and component of each unknown that moves")
    amounts: list[float] = Field(description="How far each of them moves, the largest 1")


class Sigma0(OpenModel):
    """Standard deviation of unit weight."""

    apriori: float = Field(description="As set")
    aposteriori: Number = Field(description="√(vᵀPv / redundancy) times the one a priori")
    ratio: Number = Field(description="(aposteriori / apriori)²")
    ratio_of_sigmas: Number = Field(description="aposteriori / apriori")
    used_for_sigma: float = Field(description="What cofactors were multiplied with to become σ")


class GlobalTest(OpenModel):
    """Two-sided χ² test of vᵀPv."""

    statistic: float = Field(description="vᵀPv for σ0 a priori")
    lower: float = Field(description="Lower limit")
    upper: float = Field(description="Upper limit")
    level: float = Field(description="Level of the test")
    accepted: bool = Field(description="True where the statistic lies between the limits")


class Step(OpenModel):
    """One iteration."""

    number: int = Field(description="Number of the iteration, from 1")
    objective: float = Field(description="vᵀPv before the step")
    largest_change: float = Field(description="In units of σ")
    damping: float = Field(description="Damping of the step, 0 without")


class Component(OpenModel):
    """A component of a block."""

    value: float = Field(description="Its value")
    sigma: Number = Field(description="Its standard deviation")
    status: Literal["free", "fixed"] = Field(description="Whether it is an unknown")
    t: Number = optional("|value| / σ, the test of its significance")


class Position(OpenModel):
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
    ellipse_azimuth: Number = Field(description="Bearing of the larger one, unit of angles, within half a circle")
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
    vx: Number = optional("Velocity while it is read out, axes of the image, unit of lengths per second")
    vy: Number = optional("The same along y")
    vz: Number = optional("The same along z")
    svx: Number = optional("σ of vx, 0 where it is fixed")
    svy: Number = optional("σ of vy")
    svz: Number = optional("σ of vz")
    rate_x: Number = optional("Rate of rotation about x, unit of angles per second")
    rate_y: Number = optional("The same about y")
    rate_z: Number = optional("The same about z")
    srate_x: Number = optional("σ of rate_x, 0 where it is fixed")
    srate_y: Number = optional("σ of rate_y")
    srate_z: Number = optional("σ of rate_z")
    interior: dict[str, Component] | None = optional(
        "Components of the interior orientation that the image has of its own"
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


class Pair(OpenModel):
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


class Format(OpenModel):
    """Image size in px, pixel size in camera units, where coordinates count from."""

    width: float = Field(description="Image width, px")
    height: float = Field(description="Image height, px")
    pixel: float = Field(description="Size of a pixel, camera unit")
    origin: Literal["centred", "corner"] = Field(description="Where image coordinates count from")


class Correlations(OpenModel):
    """Correlation matrix of the estimated components."""

    components: list[str] = Field(description="Names of the rows and columns")
    matrix: list[list[float]] | None = Field(description="Correlations, row by row")


class Camera(OpenModel):
    """An interior orientation."""

    id: str = Field(description="Its name")
    model: str = Field(description="Its camera model")
    unit: str = Field(description="Unit of its interior orientation")
    r0: Number = Field(description="Second zero crossing of the radial distortion, camera unit")
    format: Format | None = Field(description="Image format, where it is given")
    components: dict[str, Component] = Field(description="Interior orientation by component")
    correlations: Correlations = Field(description="Correlations of the components that are unknowns")


class Feature(OpenModel):
    """A plane, a line or another shape."""

    id: str = Field(description="Its name")
    type: Literal["plane", "line", "right angle", "circle", "sphere", "cylinder", "cone", "torus"] = Field(
        description="What kind of feature it is"
    )
    part: str = Field(description="Of a right angle which of its planes")
    dx: Number = Field(description="Direction of the line or axis, or normal of the plane: x")
    dy: Number = Field(description="y of the same")
    dz: Number = Field(description="z of the same")
    sd: Number = Field(description="Largest σ of this direction, unit of angles")
    distance: Number = Field(description="Distance of the plane from the origin")
    x: float = Field(description="Centre, apex of a cone, or mean of the points on it: x")
    y: float = Field(description="y of the same")
    z: float = Field(description="z of the same")
    sx: Number = Field(description="σ of x; that along a plane, line or cylinder is 0")
    sy: Number = Field(description="σ of y")
    sz: Number = Field(description="σ of z")
    radius: Number = Field(description="Radius of a circle, sphere or cylinder, or of the centre line of a torus")
    sradius: Number = Field(description="σ of the radius")
    minor_radius: Number = Field(description="Radius of the tube of a torus")
    sminor_radius: Number = Field(description="σ of this radius")
    semi_angle: Number = Field(description="Angle between the axis and the surface of a cone")
    ssemi_angle: Number = Field(description="σ of this angle")
    points: int = Field(description="Number of points on it")
    rms: float = Field(description="Root mean square of their distances from it")
    form: float = Field(description="Form deviation: the largest of their residuals minus the smallest")


class Other(OpenModel):
    """An estimated block that belongs to no other table."""

    kind: str = Field(description="What kind of block it is")
    id: str = Field(description="Whose it is")
    components: dict[str, Component] = Field(description="Its unknowns by component")


class Group(OpenModel):
    """An observation group."""

    name: str = Field(description="Table, camera or instrument it comes from")
    type: str = Field(description="Type of its observations as a project names it")
    observations: int = Field(description="Number of observations that took part")
    redundancy: Number = optional("Sum of their redundancy numbers")
    vtpv: Number = optional("Its part of vᵀPv; may be negative where observations are correlated across groups")
    sigma0: Number = optional("√(vtpv/redundancy); null where there is none")
    mean_r: Number = optional("Mean redundancy number")
    largest_w: Number = optional("Largest |w|")
    excluded: int | None = optional("Number of observations taken out")
    flagged: int | None = optional("Number of observations beyond the critical value")
    sigma_factor: Number = optional("Estimated factor on the σ of the group")
    sigma_of_factor: Number = optional("Standard deviation of that factor")


class VarianceComponents(OpenModel):
    """Estimation of the variance components of the groups."""

    method: Literal["simplified", "helmert"] = Field(description="Each group by itself, or the full system")
    iterated: bool = Field(description="True where the weights have them in")
    settled: bool = Field(description="True where iterating them changed nothing any more")
    rounds: int = Field(description="Number of adjustments it took")


class FixedPoint(OpenModel):
    """Test of the coordinates a point is held at."""

    id: str = Field(description="Its name")
    movement: list[float] = Field(description="Estimated movement in x, y, z")
    freedom: int = Field(description="Number of its fixed coordinates")
    test: float = Field(description="Test statistic, χ²")
    p: float = Field(description="Probability of one as large")
    test_estimated: Number = Field(description="The same with σ0 a posteriori, F")
    p_estimated: Number = Field(description="Its probability")


class Relative(OpenModel):
    """The difference of two points: how well their distance and their relative place are known."""

    from_: str = Field(alias="from", description="The first point")
    to: str = Field(description="The second point")
    distance: float = Field(description="Their distance in space, unit of lengths")
    sdistance: Number = Field(description="Its σ; null for two points at one place")
    a: float = Field(description="Larger semi-axis of the relative standard error ellipse in plan")
    b: float = Field(description="Smaller semi-axis")
    azimuth: float = Field(description="Bearing of the larger one, unit of angles, within half a circle")
    direction: list[float] = several("The same as a unit vector in plan, x and y of the project")
    sdz: float = Field(description="σ of the difference of heights")


class Check(OpenModel):
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


class Residual(OpenModel):
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


# ---- The parts of ``results.json`` on gross errors, as models.


class Place(OpenModel):
    """Name of an observation."""

    model_config = ConfigDict(extra="allow", strict=True, serialize_by_alias=True)

    type: str = Field(description="Type of the observation as a project names it")
    group: str = Field(description="Table it comes from")
    at: str = Field(description="Station of an angle; empty otherwise")
    from_: str = Field(alias="from", description="Station, or image, or the first end")
    to: str = Field(description="Target, or point, or the second end")
    names: dict[str, str] = Field(description="Names by the references of its type")
    component: str = Field(description="Component of the type")
    unit: str = Field(description="Unit of the observation")


class Suspicious(Place):
    """An observation with a large test value, and what an error in it does."""

    w: float = Field(description="Test statistic")
    r: float = Field(description="Redundancy number")
    error: float = Field(description="Estimated gross error")
    nabla: float = Field(description="Smallest detectable error")
    point: str | None = Field(description="The point that it moves most")
    movement: list[float] | None = Field(
        description="By the estimated error; null where so little controls the observation that this says nothing"
    )
    flagged: bool = Field(description="True beyond the critical value")


class SnoopingStep(Place):
    """An observation that was taken out or put back."""

    round: int = Field(description="Number of the adjustment in which it happened")
    action: Literal["excluded", "put back"] = Field(description="What was done with it")
    w: float = Field(description="Test statistic")


class MostlyOut(OpenModel):
    """An image, station or point of which more than half of the observations were taken out."""

    of: str = Field(description="image, station or point")
    id: str = Field(description="Its name")
    excluded: int = Field(description="Number of its observations that were taken out")
    observations: int = Field(description="Number of its observations")


class Snooping(OpenModel):
    """Data snooping."""

    clean: bool = Field(description="True where nothing is flagged at the end")
    mostly_out: list[MostlyOut] = Field([], description="Things of which more than half was taken out")
    sigma0_before: float = Field(description="σ0 of the adjustment with all observations")
    steps: list[SnoopingStep] = Field(description="What was taken out and put back, in order")


class Robust(OpenModel):
    """The robust solution beside the least-squares one."""

    method: Literal["l1", "danish"] = Field(description="Estimator")
    settled: bool = Field(description="True where the weights changed no more")
    rejected: list[Place] = Field(description="Observations left with next to no weight")
    largest_shift: float = Field(description="Largest difference of a coordinate from the least-squares solution")
    rms_shift: float = Field(description="Root mean square of these differences")


class InCommon(OpenModel):
    """A point, image, station or table that many flagged observations refer to."""

    of: Literal["group", "image", "camera", "station", "set", "instrument", "system", "point"] = Field(
        description="Kind of the object"
    )
    name: str = Field(description="Its name")
    flagged: int = Field(description="Number of its rows of observations that are flagged or left out")
    rows: int = Field(description="Number of its rows of observations")
    all_flagged: int = Field(description="Number of all rows of observations that are flagged or left out")


class GrossErrors(OpenModel):
    """Tests of single observations; empty without a solution."""

    beta0: Number = optional("Power of the test of single observations")
    noncentrality: Number = optional("δ0² of the smallest detectable errors")
    familywise_level: Number = optional("Level of all tests together, where it was asked for")
    global_level_of_b_method: Number = optional(
        "Level of the global test that the level of single tests fits to (B-method)"
    )
    suspicious: list[Suspicious] = Field(
        [], description="Observations with the largest |w|, and what errors in them do"
    )
    in_common: list[InCommon] = Field(
        [], description="What more of the flagged observations refer to than chance explains"
    )
    snooping: Snooping | None = optional("Data snooping, where it was asked for")
    robust: Robust | None = optional("Robust solution, where it was asked for")


class Suspect(Place):
    """An observation that was left out."""

    misfit: float = Field(description="|v|/σ against the robust solution")


class Suspects(OpenModel):
    """Observations left out so that the rest has a solution."""

    outcome: Literal["converged", "not converged", "diverged"] = Field(
        description="How the adjustment of all observations ended; converged: at a place that fits hardly any of them"
    )
    iterations: int = Field(description="Number of iterations of that adjustment")
    sigma0_ratio: Number = Field(description="Its σ0 a posteriori / a priori, where it came to an end")
    count: int = Field(description="Number of observations left out")
    observations: list[Suspect] = Field(description="The worst first, at most 10 000")


class Amount(OpenModel):
    """Estimate of an additional unknown."""

    name: str = Field(description="offset, scale, height, c")
    value: float = Field(description="Its estimate")
    unit: str = Field(description="Its unit")


class PossibleCause(OpenModel):
    """A mistake that would explain what is rejected, by a score test at the solution."""

    cause: str = Field(description="Key of the cause")
    things: list[str] = Field(description="Names of what it is about: points, images, stations, tables")
    line: str = Field(description="What to change in the project to try it")
    amount: Amount | None = Field(description="Its parameter at the solution, to first order")
    vtpv_decrease: float = Field(description="Decrease of vᵀPv to first order")
    parameters: int = Field(description="Number of its parameters")
    log10_p: float = Field(description="Decimal logarithm of the probability of such a decrease by chance")
    verified: bool = Field(description="False: no adjustment was made with it")


# ---- The parts of ``results.json`` on what nothing determines, and on outcomes without a solution, as models.


class Undeterminable(OpenModel):
    """A row of undetermined.csv: a thing that nothing determines."""

    kind: str = Field(description="point, image, station, system, pair")
    id: str = Field(description="Its name")
    reason: str = Field(description="Why it is not determined")
    treatment: Literal["", "left out", "at infinity"] = Field(description="What was done about it; empty: nothing")
    observations: int = Field(description="Rows of observations that refer to it")
    dx: Number = Field(description="Unit vector to a point at infinity, project axes")
    dy: Number = Field(description="y of the same")
    dz: Number = Field(description="z of the same")
    sigma: Number = Field(description="Its standard deviation across, the larger one, an angle")


class Moving(OpenModel):
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


class Failure(OpenModel):
    """State of an adjustment without a solution."""

    notice: str = Field(description="What the values of such results are worth")
    moving: list[Moving] = Field(description="Unknowns that do not come to rest")
    worst: list[Misfit] = Field(description="Observations that fit worst at the last values")


# ---- The parts of ``results.json`` as models: times, and what moves points.


class Epoch(OpenModel):
    """A time at which something was measured."""

    epoch: str = Field(description="As the project has it")
    year: float = Field(description="The same in years")


class Motion(OpenModel):
    """Motion model of a point; for an annual oscillation x … are the sine terms."""

    point: str = Field(description="Its name")
    parameter: Literal["velocity", "annual oscillation", "step"] = Field(description="What it is")
    time: str = Field(description="Of a step")
    x: Number = optional("x, length unit; of velocities in a year")
    sx: Number = optional("σ of x")
    y: Number = optional("y, length unit; of velocities in a year")
    sy: Number = optional("σ of y")
    z: Number = optional("z, length unit; of velocities in a year")
    sz: Number = optional("σ of z")
    cos_x: Number = optional("cosine x, length unit; of velocities in a year")
    scos_x: Number = optional("σ of cosine x")
    cos_y: Number = optional("cosine y, length unit; of velocities in a year")
    scos_y: Number = optional("σ of cosine y")
    cos_z: Number = optional("cosine z, length unit; of velocities in a year")
    scos_z: Number = optional("σ of cosine z")
    freedom: int = Field(description="Degrees of freedom of the test")
    test: Number = Field(description="Test value, mean square")
    p: Number = Field(description="Its probability without any movement")
    smallest: Number = Field(description="Smallest length that is found in every direction with the power β0")
    moved: bool = Field(description="true: significant")


class Knot(OpenModel):
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


class Boresight(OpenModel):
    """From the axes of a trajectory to those of an inertial system."""

    instrument: str = Field(description="Its name")
    omega: Number = Field(description="ω, unit of angles")
    phi: Number = Field(description="φ")
    kappa: Number = Field(description="κ")
    somega: Number = Field(description="σ of ω")
    sphi: Number = Field(description="σ of φ")
    skappa: Number = Field(description="σ of κ")


# ---- The parts of ``results.json`` on the verdict, as models.

Kind = Literal["group", "image", "camera", "station", "set", "instrument", "system"]


class Named(OpenModel):
    """A thing that observations belong to."""

    of: Kind = Field(description="What it is; group is a table of observations")
    name: str = Field(description="Its name")


class GroupTest(Named):
    """Two-sided test of the part of vᵀPv that the observations of one thing have."""

    also: list[Named] = Field(description="Further things with just the same observations")
    observations: int = Field(description="Number of its observations")
    redundancy: float = Field(description="Sum of their redundancy numbers")
    vtpv: float = Field(description="Their part of vᵀPv")
    sigma_factor: float = Field(description="√(vtpv / redundancy): what would make its σ fit its residuals")
    freedom: float = Field(
        description="Degrees of freedom of the χ² distribution that a multiple of vtpv is compared with"
    )
    p: float = Field(
        description="Two-sided probability; at least so much where the test accepts, at most where it rejects"
    )
    rejected: bool = Field(description="True where p is below level_of_each_group")


class CommonEffect(OpenModel):
    """An offset or scale that all observations of a group may have in common. It is offered, and never applied."""

    kind: Literal["offset", "scale"] = Field(description="Added to each observation, or a part of its size")
    group: str = Field(description="Table of the observations")
    type: str = Field(description="Their type")
    component: str = Field(description="The component that has it")
    size: float = Field(description="In the sense observed − true")
    sigma: float = Field(description="Its standard deviation, σ0 a priori")
    unit: str = Field(description="Unit of both; 1 of a scale")
    w: float = Field(description="|size| / sigma")
    vtpv_falls_by: float = Field(description="What vᵀPv of all observations would lose with it")
    sigma_factor_left: Number = Field(description="sigma_factor of the group with it")
    suffices: bool = Field(description="True where the test of the group accepts with it")


class Explanation(Named):
    """Factor or parameter that would explain a rejected group."""

    sigma_factor: float = Field(description="What would make its σ fit its residuals")
    flagged: int = Field(description="Number of its observations that are flagged")
    share_of_flagged: float = Field(description="Their share of its part of vᵀPv")
    effect: CommonEffect | None = Field(description="The most significant effect, null where none is")


class Conventions(OpenModel):
    """Values that were chosen because no observation determines them."""

    movements: list[str] = Field(description="Movements of the whole that the datum settles")
    scale: bool = Field(description="True where the scale is arbitrary")
    fixed_coordinates_uncontrolled: bool = Field(
        description="True where the fixed coordinates only settle the datum: nothing would show an error in them"
    )


class IllDetermined(OpenModel):
    """A point or the place of a frame with a σ beyond the limit."""

    kind: str = Field(description="point, image, station, …")
    id: str = Field(description="Its name")
    sigma: float = Field(description="Largest semi-axis of its error ellipsoid, length unit of the project")


class Determined(OpenModel):
    """Determination of the result, with σ a priori, or a posteriori if these are smaller."""

    as_a_whole: bool = Field(description="False where σ of more than half of the points are beyond the limit")
    everywhere: bool = Field(description="True where no point is beyond the limit and no direction is weak")
    size: float = Field(description="Twice the median distance of the points from their median; 0: no size to judge by")
    limit: float = Field(description="Largest σ as a part of this size")
    points: int = Field(description="Number of points and places of frames that were judged")
    largest_sigma: float = Field(description="The largest σ of these, length unit of the project")
    median_sigma: float = Field(description="The median of these σ")
    beyond: int = Field(description="Number of those beyond the limit")
    worst: list[IllDetermined] = Field(description="The worst of them")
    directions: int = Field(description="Number of weak directions, see hardly_determined")


class Verdict(OpenModel):
    """The tests of the whole and of all groups together, and whether the result is determined."""

    accepted: bool | None = Field(
        description="True where the global test and all tests of groups accept and the result as a whole is "
        "determined; null without redundancy"
    )
    says: Literal[
        "accepted",
        "accepted, observations uncontrolled",
        "accepted, partly ill-determined",
        "not accepted",
        "not determined",
        "not tested",
    ] = Field(description="In words; not tested: without redundancy")
    uncontrolled: int = Field(description="Number of observations with r below least_redundancy")
    level_of_groups: float = Field(description="Level of all tests of groups together")
    level_of_each_group: float = Field(description="Level of each of them (Šidák)")
    tests: int = Field(description="Number of tests of groups")
    rejected: int = Field(description="Number of those that reject")
    all_alike: bool = Field(
        description="True where groups are rejected but none of them beside all others: one factor for all σ is wrong"
    )
    groups: list[GroupTest] = Field(description="The tests; beyond 10 000 those that reject")
    explanations: list[Explanation] = Field(description="The worst groups; those first whose effect explains most")
    conventions: Conventions = Field(description="What was chosen and not measured")
    determined: Determined = Field(description="Whether the result is determined")


class Further(OpenModel):
    """A further observation of the kinds at hand."""

    again: bool = Field(description="True where the weak observation itself is to be measured once more")
    type: str = Field(description="Type of the observation as a project names it")
    group: str = Field(description="Table whose σ it would have")
    names: dict[str, str] = Field(description="Names by the references of its type")
    r: float = Field(description="Redundancy number that the weak observation would have then")


class Uncontrolled(Place):
    """An observation with a redundancy number below the least one."""

    r: float = Field(description="Redundancy number")
    nabla: Number = Field(description="Smallest detectable error; null where none would be found")
    carries: list[str] | None = Field(
        description="Points of whose variance, in some direction, more than half comes from it; null: not worked out"
    )
    cure: Further | None = Field(
        description="The one further observation that would raise r most; null: not worked out"
    )


class Weakest(OpenModel):
    """Mean redundancy of a point, image, station or set."""

    id: str = Field(description="Its name")
    observations: int = Field(description="Number of its observations: a ray is two of them")
    smallest_r: float = Field(description="Smallest redundancy number among them")
    weakest: Place = Field(description="The observation that has it")
    nabla: Number = Field(description="Its smallest detectable error, in its unit; null where none would be found")
    shift: Number = Field(
        description="An error that is not found moves its position by at most so much; null: by any amount"
    )


class ReliabilityMap(OpenModel):
    """Internal and external reliability by point, image, station and set."""

    least_redundancy: float = Field(description="r below which an observation is called uncontrolled")
    uncontrolled: int = Field(description="Number of these observations")
    observations: list[Uncontrolled] = Field(description="They, the weakest first, at most 200")
    points_barely_determined: int = Field(
        description="Number of points with at most one observation more than they have unknown coordinates"
    )
    points: list[Weakest] = Field(description="Of more than 1 000 the weakest")
    images: list[Weakest] = Field(description="The same of images")
    stations: list[Weakest] = Field(description="The same of stations")
    sets: list[Weakest] = Field(description="The same of sets of directions")


# ---- ``results.json`` as a model: every key there is and what it means. The JSON Schema is made from it.
#
# Keys may be added in later versions; those that are there keep their meaning while ``schema_version`` is 2.


class Results(OpenModel):
    """Results of an adjustment by mor, version 1."""

    schema_name: Literal["mor-results"] = Field(alias="schema", description="What this file is")
    schema_version: Literal[2] = Field(description="Version of its keys")
    program: str = Field(description="Program and version")
    title: str = Field(description="Title of the project")
    identity: Identity = Field(Identity(), description="What the results are of")
    notes: list[Note] = several("What was noted before the adjustment")
    units: Units = Field(description="Units of all values that say none of their own")
    axes: Axes = Field(description="Axes and senses of the project")
    outcome: Literal["converged", "not converged", "diverged", "singular"] = Field(
        description="How the adjustment ended"
    )
    reason: str = Field(description="The same in words")
    solution: bool = Field(True, description="false: all values are those of the last iteration")
    iterations: int = Field(description="Number of iterations")
    observations: int = Field(description="n")
    unknowns: int = Field(description="u")
    defect: int = Field(description="d, number of movements the observations leave open")
    movements: list[str] = Field(description="These movements in words")
    undetermined: list[Direction] = Field(description="Not determined inside the network")
    undeterminable: list[Undeterminable] = several("Things that nothing determines, and what was done about them")
    hardly_determined: list[str] = several("What is determined, but hardly, in words")
    datum: str = Field(description="In words")
    redundancy: int | None = Field(description="n - u + d, without what is kept out")
    redundancy_sum: Number = Field(description="Sum of all redundancy numbers, equal to redundancy")
    sigma0: Sigma0 | None = Field(description="Standard deviation of unit weight")
    global_test: GlobalTest | None = Field(description="Test of all residuals together")
    verdict: Verdict | None = optional("The tests of the whole and of its groups; null without a solution")
    reliability: ReliabilityMap | None = optional("Where errors would hide; null without redundancy")
    critical_w: Number = optional("Limit of |w|")
    snooping_level: Number = optional("α0, level of the test of single observations")
    flagged: int | None = Field(description="Number of observations beyond the limit")
    uncontrolled: int | None = optional("Number of observations with r below settings.least_redundancy")
    iteration_log: list[Step] = Field(description="The iterations")
    kernels: Literal["numpy", "numba"] = Field(
        "numpy", description="What did the work: plain NumPy, or kernels compiled by Numba"
    )
    points: list[Point] | None = Field(description="null beyond 10 000: read the table")
    images: list[Image] | None = Field(description="null beyond 10 000: read the table")
    motions: list[Motion] = Field([], description="What moves points")
    epochs: list[Epoch] = Field([], description="Times of the observations, in their order")
    trajectories: list[Knot] | None = Field([], description="Knots of trajectories; null beyond 10 000: read the table")
    boresights: list[Boresight] = Field([], description="Misalignments of inertial systems that were estimated")
    cameras: list[Camera] = Field(description="Interior orientations")
    stations: list[Station] = Field(description="Theodolite stations and further sets of directions")
    systems: list[System] = Field(description="Local systems")
    pairs: list[Pair] = Field(description="Relative orientations of stereo images")
    features: list[Feature] = Field(description="Planes, lines, right angles and other shapes")
    others: list[Other] = Field(description="Unknowns of instruments, heights, eccentricities and offsets")
    groups: list[Group] = Field(description="Groups of observations, in the order of the input")
    variance_components: VarianceComponents | None = optional("How the factors of the σ of the groups were estimated")
    gross_errors: GrossErrors = Field(description="Tests of single observations")
    suspects: Suspects | None = optional("What was left out because all observations together have no solution")
    possible_causes: list[PossibleCause] = Field(
        [], description="Mistakes that would explain what is rejected, by score tests, the best first; not verified"
    )
    fixed_points: list[FixedPoint] = Field(description="Tests of the coordinates held fixed")
    relative: list[Relative] = Field(
        [], description="Distances and relative error ellipses of the pairs that report: {relative: …} names"
    )
    checks: list[Check] = Field(description="Observations kept out to check by")
    failure: Failure | None = optional("Where there is no solution: what does not come to rest, what fits worst")
    tables: dict[str, str] = Field(description="Names of the tables beside results.json")
    files: list[str] = Field(
        [], description="Names of all files of this run in its folder; nothing else there is ever replaced"
    )
    residuals: list[Residual] | None = Field(description="null beyond 10 000: read the table")


def results_schema() -> str:
    """JSON Schema (2020-12) of ``results.json`` as text."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:mor:schema:results:2"}
    return json.dumps({**head, **Results.model_json_schema(by_alias=True)}, indent=2, ensure_ascii=False) + "\n"
