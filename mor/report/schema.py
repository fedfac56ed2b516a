"""The contents of results.json as pydantic models."""

from __future__ import annotations

import json
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from mor.project.schema import optional, required, several

# ---- The parts of ``results.json`` as models: what is estimated, and what is said of its quality.

Number = float | None
"""``null`` where the number does not exist."""
Share = Annotated[float, Field(ge=-1.0, le=1.0)] | None


class OpenModel(BaseModel):
    """Further keys may follow."""

    model_config = ConfigDict(extra="allow", strict=True)


class Input(OpenModel):
    """A file that was read."""

    file: str = required("Name, counted from the folder of the project")
    bytes: int = required("Size as it was read")
    sha256: str = required("SHA-256 of it, as sha256sum prints it")


class Note(OpenModel):
    """A note made while the project was read."""

    message: str = required("What was noted, in words")
    file: str = required("File it stands in, counted from the folder of the project; empty: none")
    line: int = required("Line of it; 0: none")


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

    length: str = required("Unit of lengths and coordinates")
    angle: str = required("Unit of angles")


class Axes(OpenModel):
    """Axes and senses of the project."""

    xy: str = required("Directions of the x and y axes: en is x east, y north")
    angles: Literal["clockwise", "counterclockwise"] = required("How horizontal angles and bearings count")
    bearings_from: Literal["north", "east", "south", "west"] = required("Where bearings and orientations count from")


class Direction(OpenModel):
    """A direction that is not determined: unknowns and the proportion in which they move."""

    unknowns: list[str] = required("Thing and component of each unknown that moves")
    amounts: list[float] = required("How far each of them moves, the largest 1")


class Sigma0(OpenModel):
    """Standard deviation of unit weight."""

    apriori: float = required("As set")
    aposteriori: Number = required("√(vᵀPv / redundancy) times the one a priori")
    ratio: Number = required("(aposteriori / apriori)²")
    ratio_of_sigmas: Number = required("aposteriori / apriori")
    used_for_sigma: float = required("What cofactors were multiplied with to become σ")


class GlobalTest(OpenModel):
    """Two-sided χ² test of vᵀPv."""

    statistic: float = required("vᵀPv for σ0 a priori")
    lower: float = required("Lower limit")
    upper: float = required("Upper limit")
    level: float = required("Level of the test")
    accepted: bool = required("True where the statistic lies between the limits")


class Step(OpenModel):
    """One iteration."""

    number: int = required("Number of the iteration, from 1")
    objective: float = required("vᵀPv before the step")
    largest_change: float = required("In units of σ")
    damping: float = required("Damping of the step, 0 without")


class Component(OpenModel):
    """A component of a block."""

    value: float = required("Its value")
    sigma: Number = required("Its standard deviation")
    status: Literal["free", "fixed"] = required("Whether it is an unknown")
    t: Number = optional("|value| / σ, the test of its significance")


class Position(OpenModel):
    """A name, coordinates and their σ."""

    id: str = required("Its name")
    x: Number = required("x in project axes, unit of lengths")
    y: Number = required("y in project axes")
    z: Number = required("z in project axes")
    sx: Number = required("σ of x")
    sy: Number = required("σ of y")
    sz: Number = required("σ of z")


class Point(Position):
    """A row of points.csv."""

    ellipsoid_a: Number = required("Longest semi-axis of the standard error ellipsoid")
    ellipsoid_b: Number = required("Middle semi-axis")
    ellipsoid_c: Number = required("Shortest semi-axis")
    ellipse_a: Number = required("Larger semi-axis of the standard error ellipse in plan")
    ellipse_b: Number = required("Smaller semi-axis")
    ellipse_azimuth: Number = required("Bearing of the larger one, unit of angles, within half a circle")
    rxy: Share = required("Correlation of x and y")
    rxz: Share = required("Correlation of x and z")
    ryz: Share = required("Correlation of y and z")
    rays: int = required("Number of image rays to it")
    others: int = required("Number of other rows of observations that name it")
    mean_r: Number = required("Mean redundancy number of its observations")
    largest_w: Number = required("Largest |w| of its observations")
    status: Literal["free", "partly fixed", "fixed", "left out", "at infinity"] = required(
        "Whether its coordinates are unknowns"
    )


class Posed(Position):
    """A position with an attitude."""

    omega: Number = required("ω, unit of angles")
    phi: Number = required("φ")
    kappa: Number = required("κ")
    somega: Number = required("σ of ω")
    sphi: Number = required("σ of φ")
    skappa: Number = required("σ of κ")


class Image(Posed):
    """A row of images.csv."""

    camera: str = required("Its camera")
    points: int = required("Number of points measured in it")
    rms: Number = required("Root mean square of its residuals, in the unit they were measured in")
    mean_r: Number = required("Mean redundancy number of its image coordinates")
    largest_w: Number = required("Largest |w| of its image coordinates")
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

    orientation: Number = required("Bearing of the zero of the horizontal circle")
    sorientation: Number = required("σ of the orientation")
    height: Number = required("Height of the instrument above its position")


class System(Posed):
    """A local system."""

    scale: Number = required("λ")
    sscale: Number = required("σ of the scale")


class Pair(OpenModel):
    """A relative orientation of stereo images."""

    id: str = required("Its name")
    bx: Number = required("Projection centre of the follower in the image axes of the leader, x")
    by: Number = required("y of the same")
    bz: Number = required("z of the same")
    sbx: Number = required("σ of bx")
    sby: Number = required("σ of by")
    sbz: Number = required("σ of bz")
    omega: Number = required("ω*, unit of angles")
    phi: Number = required("φ*")
    kappa: Number = required("κ*")
    somega: Number = required("σ of ω*")
    sphi: Number = required("σ of φ*")
    skappa: Number = required("σ of κ*")


class Format(OpenModel):
    """Image size in px, pixel size in camera units, where coordinates count from."""

    width: float = required("Image width, px")
    height: float = required("Image height, px")
    pixel: float = required("Size of a pixel, camera unit")
    origin: Literal["centred", "corner"] = required("Where image coordinates count from")


class Correlations(OpenModel):
    """Correlation matrix of the estimated components."""

    components: list[str] = required("Names of the rows and columns")
    matrix: list[list[float]] | None = required("Correlations, row by row")


class Camera(OpenModel):
    """An interior orientation."""

    id: str = required("Its name")
    model: str = required("Its camera model")
    unit: str = required("Unit of its interior orientation")
    r0: Number = required("Second zero crossing of the radial distortion, camera unit")
    format: Format | None = required("Image format, where it is given")
    components: dict[str, Component] = required("Interior orientation by component")
    correlations: Correlations = required("Correlations of the components that are unknowns")


class Feature(OpenModel):
    """A plane, a line or another shape."""

    id: str = required("Its name")
    type: Literal["plane", "line", "right angle", "circle", "sphere", "cylinder", "cone", "torus"] = required(
        "What kind of feature it is"
    )
    part: str = required("Of a right angle which of its planes")
    dx: Number = required("Direction of the line or axis, or normal of the plane: x")
    dy: Number = required("y of the same")
    dz: Number = required("z of the same")
    sd: Number = required("Largest σ of this direction, unit of angles")
    distance: Number = required("Distance of the plane from the origin")
    x: float = required("Centre, apex of a cone, or mean of the points on it: x")
    y: float = required("y of the same")
    z: float = required("z of the same")
    sx: Number = required("σ of x; that along a plane, line or cylinder is 0")
    sy: Number = required("σ of y")
    sz: Number = required("σ of z")
    radius: Number = required("Radius of a circle, sphere or cylinder, or of the centre line of a torus")
    sradius: Number = required("σ of the radius")
    minor_radius: Number = required("Radius of the tube of a torus")
    sminor_radius: Number = required("σ of this radius")
    semi_angle: Number = required("Angle between the axis and the surface of a cone")
    ssemi_angle: Number = required("σ of this angle")
    points: int = required("Number of points on it")
    rms: float = required("Root mean square of their distances from it")
    form: float = required("Form deviation: the largest of their residuals minus the smallest")


class Other(OpenModel):
    """An estimated block that belongs to no other table."""

    kind: str = required("What kind of block it is")
    id: str = required("Whose it is")
    components: dict[str, Component] = required("Its unknowns by component")


class Group(OpenModel):
    """An observation group."""

    name: str = required("Table, camera or instrument it comes from")
    type: str = required("Type of its observations as a project names it")
    observations: int = required("Number of observations that took part")
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

    method: Literal["simplified", "helmert"] = required("Each group by itself, or the full system")
    iterated: bool = required("True where the weights have them in")
    settled: bool = required("True where iterating them changed nothing any more")
    rounds: int = required("Number of adjustments it took")


class FixedPoint(OpenModel):
    """Test of the coordinates a point is held at."""

    id: str = required("Its name")
    movement: list[float] = required("Estimated movement in x, y, z")
    freedom: int = required("Number of its fixed coordinates")
    test: float = required("Test statistic, χ²")
    p: float = required("Probability of one as large")
    test_estimated: Number = required("The same with σ0 a posteriori, F")
    p_estimated: Number = required("Its probability")


class Relative(OpenModel):
    """The difference of two points: how well their distance and their relative place are known."""

    from_: str = Field(alias="from", description="The first point")
    to: str = required("The second point")
    distance: float = required("Their distance in space, unit of lengths")
    sdistance: Number = required("Its σ; null for two points at one place")
    a: float = required("Larger semi-axis of the relative standard error ellipse in plan")
    b: float = required("Smaller semi-axis")
    azimuth: float = required("Bearing of the larger one, unit of angles, within half a circle")
    direction: list[float] = several("The same as a unit vector in plan, x and y of the project")
    sdz: float = required("σ of the difference of heights")


class Check(OpenModel):
    """Deviations of a group that was kept out, adjusted − known, one component."""

    group: str = required("Table it comes from")
    type: str = required("Type of its observations as a project names it")
    component: str = required("Component of the type")
    unit: str = required("Unit of the observation")
    count: int = required("Number of observations")
    mean: float = required("Mean deviation")
    rms: float = required("Root mean square deviation")
    largest: float = required("Largest deviation, with its sign")
    exceeding: int = required("Number of deviations beyond the critical value")


class Residual(OpenModel):
    """A row of residuals.csv."""

    model_config = ConfigDict(extra="allow", strict=True, serialize_by_alias=True)

    type: str = required("Type of the observation as a project names it")
    group: str = required("Table it comes from")
    at: str = required("Station of an angle; empty otherwise")
    from_: str = Field(alias="from", description="Station, or image, or the first end")
    to: str = required("Target, or point, or the second end")
    component: str = required("Component of the type")
    unit: str = required("Unit of observed, adjusted, v, sigma, sigma_adjusted, error, nabla")
    observed: Number = required("As it was given")
    adjusted: Number = required("observed + v")
    v: Number = required("adjusted - observed")
    sigma: Number = required("σ a priori")
    sigma_adjusted: Number = required("σ of the adjusted observation")
    r: Number = required("Redundancy number")
    w: Number = required("Test statistic, for correlated observations too")
    normalised: Number = required("v/σ_v for σ0 a priori: the same as w where it is uncorrelated")
    tau: Number = required("v/σ_v for σ0 a posteriori")
    p: Number = required("Probability of |w| as large")
    t2: Number = required("Squared Student test, σ0 from the other observations")
    p_t: Number = required("Probability of t2 as large")
    error: Number = required("Estimated gross error")
    nabla: Number = required("Smallest detectable error")
    external: Number = required("Influence of nabla on the results, in units of their σ")
    influence: Number = required("Influence of the error on its point, unit of lengths")
    joint: Number = required("Joint test of the components of one row")
    joint_freedom: Number = required("Its degrees of freedom")
    p_joint: Number = required("Its probability")
    flag: Literal["", "gross", "uncontrolled", "excluded", "check"] = required(
        "gross: beyond the limit; uncontrolled: r < settings.least_redundancy; excluded, check: kept out"
    )


# ---- The parts of ``results.json`` on gross errors, as models.


class Place(OpenModel):
    """Name of an observation."""

    model_config = ConfigDict(extra="allow", strict=True, serialize_by_alias=True)

    type: str = required("Type of the observation as a project names it")
    group: str = required("Table it comes from")
    at: str = required("Station of an angle; empty otherwise")
    from_: str = Field(alias="from", description="Station, or image, or the first end")
    to: str = required("Target, or point, or the second end")
    names: dict[str, str] = required("Names by the references of its type")
    component: str = required("Component of the type")
    unit: str = required("Unit of the observation")


class Suspicious(Place):
    """An observation with a large test value, and what an error in it does."""

    w: float = required("Test statistic")
    r: float = required("Redundancy number")
    error: float = required("Estimated gross error")
    nabla: float = required("Smallest detectable error")
    point: str | None = required("The point that it moves most")
    movement: list[float] | None = required(
        "By the estimated error; null where so little controls the observation that this says nothing"
    )
    flagged: bool = required("True beyond the critical value")


class SnoopingStep(Place):
    """An observation that was taken out or put back."""

    round: int = required("Number of the adjustment in which it happened")
    action: Literal["excluded", "put back"] = required("What was done with it")
    w: float = required("Test statistic")


class MostlyOut(OpenModel):
    """An image, station or point of which more than half of the observations were taken out."""

    of: str = required("image, station or point")
    id: str = required("Its name")
    excluded: int = required("Number of its observations that were taken out")
    observations: int = required("Number of its observations")


class Snooping(OpenModel):
    """Data snooping."""

    clean: bool = required("True where nothing is flagged at the end")
    mostly_out: list[MostlyOut] = Field([], description="Things of which more than half was taken out")
    sigma0_before: float = required("σ0 of the adjustment with all observations")
    steps: list[SnoopingStep] = required("What was taken out and put back, in order")


class Robust(OpenModel):
    """The robust solution beside the least-squares one."""

    method: Literal["l1", "danish"] = required("Estimator")
    settled: bool = required("True where the weights changed no more")
    rejected: list[Place] = required("Observations left with next to no weight")
    largest_shift: float = required("Largest difference of a coordinate from the least-squares solution")
    rms_shift: float = required("Root mean square of these differences")


class InCommon(OpenModel):
    """A point, image, station or table that many flagged observations refer to."""

    of: Literal["group", "image", "camera", "station", "set", "instrument", "system", "point"] = required(
        "Kind of the object"
    )
    name: str = required("Its name")
    flagged: int = required("Number of its rows of observations that are flagged or left out")
    rows: int = required("Number of its rows of observations")
    all_flagged: int = required("Number of all rows of observations that are flagged or left out")


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

    misfit: float = required("|v|/σ against the robust solution")


class Suspects(OpenModel):
    """Observations left out so that the rest has a solution."""

    outcome: Literal["converged", "not converged", "diverged"] = required(
        "How the adjustment of all observations ended; converged: at a place that fits hardly any of them"
    )
    iterations: int = required("Number of iterations of that adjustment")
    sigma0_ratio: Number = required("Its σ0 a posteriori / a priori, where it came to an end")
    count: int = required("Number of observations left out")
    observations: list[Suspect] = required("The worst first, at most 10 000")


class Amount(OpenModel):
    """Estimate of an additional unknown."""

    name: str = required("offset, scale, height, c")
    value: float = required("Its estimate")
    unit: str = required("Its unit")


class PossibleCause(OpenModel):
    """A mistake that would explain what is rejected, by a score test at the solution."""

    cause: str = required("Key of the cause")
    things: list[str] = required("Names of what it is about: points, images, stations, tables")
    line: str = required("What to change in the project to try it")
    amount: Amount | None = required("Its parameter at the solution, to first order")
    vtpv_decrease: float = required("Decrease of vᵀPv to first order")
    parameters: int = required("Number of its parameters")
    log10_p: float = required("Decimal logarithm of the probability of such a decrease by chance")
    verified: bool = required("False: no adjustment was made with it")


# ---- The parts of ``results.json`` on what nothing determines, and on outcomes without a solution, as models.


class Undeterminable(OpenModel):
    """A row of undetermined.csv: a thing that nothing determines."""

    kind: str = required("point, image, station, system, pair")
    id: str = required("Its name")
    reason: str = required("Why it is not determined")
    treatment: Literal["", "left out", "at infinity"] = required("What was done about it; empty: nothing")
    observations: int = required("Rows of observations that refer to it")
    dx: Number = required("Unit vector to a point at infinity, project axes")
    dy: Number = required("y of the same")
    dz: Number = required("z of the same")
    sigma: Number = required("Its standard deviation across, the larger one, an angle")


class Moving(OpenModel):
    """An unknown that does not come to rest."""

    kind: str = required("Kind of its block")
    of: str = required("What kind of thing it belongs to")
    id: str = required("Name of that thing")
    component: str = required("Which component")
    unit: str = required("Unit of the steps")
    steps: list[Number] = required("Its last steps, or the one that could not be taken")
    way: Literal["to and fro", "away", "wanted"] = required(
        "to and fro, away, or wanted: the step that the last values call for"
    )


class Misfit(Residual):
    """A residual at the last values, where there is no solution."""

    misfit: Number = required("abs(v) / sigma")


class Failure(OpenModel):
    """State of an adjustment without a solution."""

    notice: str = required("What the values of such results are worth")
    moving: list[Moving] = required("Unknowns that do not come to rest")
    worst: list[Misfit] = required("Observations that fit worst at the last values")


# ---- The parts of ``results.json`` as models: times, and what moves points.


class Epoch(OpenModel):
    """A time at which something was measured."""

    epoch: str = required("As the project has it")
    year: float = required("The same in years")


class Motion(OpenModel):
    """Motion model of a point; for an annual oscillation x … are the sine terms."""

    point: str = required("Its name")
    parameter: Literal["velocity", "annual oscillation", "step"] = required("What it is")
    time: str = required("Of a step")
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
    freedom: int = required("Degrees of freedom of the test")
    test: Number = required("Test value, mean square")
    p: Number = required("Its probability without any movement")
    smallest: Number = required("Smallest length that is found in every direction with the power β0")
    moved: bool = required("true: significant")


class Knot(OpenModel):
    """A knot of a trajectory."""

    trajectory: str = required("Name of the trajectory")
    time: float = required("Seconds")
    stretch: int = required("Number of the stretch between gaps, from 1")
    x: Number = required("x, length unit")
    y: Number = required("y")
    z: Number = required("z")
    sx: Number = required("σ of x")
    sy: Number = required("σ of y")
    sz: Number = required("σ of z")
    omega: Number = required("ω, unit of angles")
    phi: Number = required("φ")
    kappa: Number = required("κ")
    somega: Number = required("σ of ω")
    sphi: Number = required("σ of φ")
    skappa: Number = required("σ of κ")


class Boresight(OpenModel):
    """From the axes of a trajectory to those of an inertial system."""

    instrument: str = required("Its name")
    omega: Number = required("ω, unit of angles")
    phi: Number = required("φ")
    kappa: Number = required("κ")
    somega: Number = required("σ of ω")
    sphi: Number = required("σ of φ")
    skappa: Number = required("σ of κ")


# ---- The parts of ``results.json`` on the verdict, as models.

Kind = Literal["group", "image", "camera", "station", "set", "instrument", "system"]


class Named(OpenModel):
    """A thing that observations belong to."""

    of: Kind = required("What it is; group is a table of observations")
    name: str = required("Its name")


class GroupTest(Named):
    """Two-sided test of the part of vᵀPv that the observations of one thing have."""

    also: list[Named] = required("Further things with just the same observations")
    observations: int = required("Number of its observations")
    redundancy: float = required("Sum of their redundancy numbers")
    vtpv: float = required("Their part of vᵀPv")
    sigma_factor: float = required("√(vtpv / redundancy): what would make its σ fit its residuals")
    freedom: float = required("Degrees of freedom of the χ² distribution that a multiple of vtpv is compared with")
    p: float = required("Two-sided probability; at least so much where the test accepts, at most where it rejects")
    rejected: bool = required("True where p is below level_of_each_group")


class CommonEffect(OpenModel):
    """An offset or scale that all observations of a group may have in common. It is offered, and never applied."""

    kind: Literal["offset", "scale"] = required("Added to each observation, or a part of its size")
    group: str = required("Table of the observations")
    type: str = required("Their type")
    component: str = required("The component that has it")
    size: float = required("In the sense observed − true")
    sigma: float = required("Its standard deviation, σ0 a priori")
    unit: str = required("Unit of both; 1 of a scale")
    w: float = required("|size| / sigma")
    vtpv_falls_by: float = required("What vᵀPv of all observations would lose with it")
    sigma_factor_left: Number = required("sigma_factor of the group with it")
    suffices: bool = required("True where the test of the group accepts with it")


class Explanation(Named):
    """Factor or parameter that would explain a rejected group."""

    sigma_factor: float = required("What would make its σ fit its residuals")
    flagged: int = required("Number of its observations that are flagged")
    share_of_flagged: float = required("Their share of its part of vᵀPv")
    effect: CommonEffect | None = required("The most significant effect, null where none is")


class Conventions(OpenModel):
    """Values that were chosen because no observation determines them."""

    movements: list[str] = required("Movements of the whole that the datum settles")
    scale: bool = required("True where the scale is arbitrary")
    fixed_coordinates_uncontrolled: bool = required(
        "True where the fixed coordinates only settle the datum: nothing would show an error in them"
    )


class IllDetermined(OpenModel):
    """A point or the place of a frame with a σ beyond the limit."""

    kind: str = required("point, image, station, …")
    id: str = required("Its name")
    sigma: float = required("Largest semi-axis of its error ellipsoid, length unit of the project")


class Determined(OpenModel):
    """Determination of the result, with σ a priori, or a posteriori if these are smaller."""

    as_a_whole: bool = required("False where σ of more than half of the points are beyond the limit")
    everywhere: bool = required("True where no point is beyond the limit and no direction is weak")
    size: float = required("Twice the median distance of the points from their median; 0: no size to judge by")
    limit: float = required("Largest σ as a part of this size")
    points: int = required("Number of points and places of frames that were judged")
    largest_sigma: float = required("The largest σ of these, length unit of the project")
    median_sigma: float = required("The median of these σ")
    beyond: int = required("Number of those beyond the limit")
    worst: list[IllDetermined] = required("The worst of them")
    directions: int = required("Number of weak directions, see hardly_determined")


class Verdict(OpenModel):
    """The tests of the whole and of all groups together, and whether the result is determined."""

    accepted: bool | None = required(
        "True where the global test and all tests of groups accept and the result as a whole is "
        "determined; null without redundancy"
    )
    says: Literal[
        "accepted",
        "accepted, observations uncontrolled",
        "accepted, partly ill-determined",
        "not accepted",
        "not determined",
        "not tested",
    ] = required("In words; not tested: without redundancy")
    uncontrolled: int = required("Number of observations with r below least_redundancy")
    level_of_groups: float = required("Level of all tests of groups together")
    level_of_each_group: float = required("Level of each of them (Šidák)")
    tests: int = required("Number of tests of groups")
    rejected: int = required("Number of those that reject")
    all_alike: bool = required(
        "True where groups are rejected but none of them beside all others: one factor for all σ is wrong"
    )
    groups: list[GroupTest] = required("The tests; beyond 10 000 those that reject")
    explanations: list[Explanation] = required("The worst groups; those first whose effect explains most")
    conventions: Conventions = required("What was chosen and not measured")
    determined: Determined = required("Whether the result is determined")


class Further(OpenModel):
    """A further observation of the kinds at hand."""

    again: bool = required("True where the weak observation itself is to be measured once more")
    type: str = required("Type of the observation as a project names it")
    group: str = required("Table whose σ it would have")
    names: dict[str, str] = required("Names by the references of its type")
    r: float = required("Redundancy number that the weak observation would have then")


class Uncontrolled(Place):
    """An observation with a redundancy number below the least one."""

    r: float = required("Redundancy number")
    nabla: Number = required("Smallest detectable error; null where none would be found")
    carries: list[str] | None = required(
        "Points of whose variance, in some direction, more than half comes from it; null: not worked out"
    )
    cure: Further | None = required("The one further observation that would raise r most; null: not worked out")


class Weakest(OpenModel):
    """Mean redundancy of a point, image, station or set."""

    id: str = required("Its name")
    observations: int = required("Number of its observations: a ray is two of them")
    smallest_r: float = required("Smallest redundancy number among them")
    weakest: Place = required("The observation that has it")
    nabla: Number = required("Its smallest detectable error, in its unit; null where none would be found")
    shift: Number = required("An error that is not found moves its position by at most so much; null: by any amount")


class ReliabilityMap(OpenModel):
    """Internal and external reliability by point, image, station and set."""

    least_redundancy: float = required("r below which an observation is called uncontrolled")
    uncontrolled: int = required("Number of these observations")
    observations: list[Uncontrolled] = required("They, the weakest first, at most 200")
    points_barely_determined: int = required(
        "Number of points with at most one observation more than they have unknown coordinates"
    )
    points: list[Weakest] = required("Of more than 1 000 the weakest")
    images: list[Weakest] = required("The same of images")
    stations: list[Weakest] = required("The same of stations")
    sets: list[Weakest] = required("The same of sets of directions")


# ---- ``results.json`` as a model: every key there is and what it means. The JSON Schema is made from it.
#
# Keys may be added in later versions; those that are there keep their meaning while ``schema_version`` is 2.


class Results(OpenModel):
    """Results of an adjustment by mor, version 1."""

    schema_name: Literal["mor-results"] = Field(alias="schema", description="What this file is")
    schema_version: Literal[2] = required("Version of its keys")
    program: str = required("Program and version")
    title: str = required("Title of the project")
    identity: Identity = Field(Identity(), description="What the results are of")
    notes: list[Note] = several("What was noted before the adjustment")
    units: Units = required("Units of all values that say none of their own")
    axes: Axes = required("Axes and senses of the project")
    outcome: Literal["converged", "not converged", "diverged", "singular"] = required("How the adjustment ended")
    reason: str = required("The same in words")
    solution: bool = Field(True, description="false: all values are those of the last iteration")
    iterations: int = required("Number of iterations")
    observations: int = required("n")
    unknowns: int = required("u")
    defect: int = required("d, number of movements the observations leave open")
    movements: list[str] = required("These movements in words")
    undetermined: list[Direction] = required("Not determined inside the network")
    undeterminable: list[Undeterminable] = several("Things that nothing determines, and what was done about them")
    hardly_determined: list[str] = several("What is determined, but hardly, in words")
    datum: str = required("In words")
    redundancy: int | None = required("n - u + d, without what is kept out")
    redundancy_sum: Number = required("Sum of all redundancy numbers, equal to redundancy")
    sigma0: Sigma0 | None = required("Standard deviation of unit weight")
    global_test: GlobalTest | None = required("Test of all residuals together")
    verdict: Verdict | None = optional("The tests of the whole and of its groups; null without a solution")
    reliability: ReliabilityMap | None = optional("Where errors would hide; null without redundancy")
    critical_w: Number = optional("Limit of |w|")
    snooping_level: Number = optional("α0, level of the test of single observations")
    flagged: int | None = required("Number of observations beyond the limit")
    uncontrolled: int | None = optional("Number of observations with r below settings.least_redundancy")
    iteration_log: list[Step] = required("The iterations")
    kernels: Literal["numpy", "numba"] = Field(
        "numpy", description="What did the work: plain NumPy, or kernels compiled by Numba"
    )
    points: list[Point] | None = required("null beyond 10 000: read the table")
    images: list[Image] | None = required("null beyond 10 000: read the table")
    motions: list[Motion] = Field([], description="What moves points")
    epochs: list[Epoch] = Field([], description="Times of the observations, in their order")
    trajectories: list[Knot] | None = Field([], description="Knots of trajectories; null beyond 10 000: read the table")
    boresights: list[Boresight] = Field([], description="Misalignments of inertial systems that were estimated")
    cameras: list[Camera] = required("Interior orientations")
    stations: list[Station] = required("Theodolite stations and further sets of directions")
    systems: list[System] = required("Local systems")
    pairs: list[Pair] = required("Relative orientations of stereo images")
    features: list[Feature] = required("Planes, lines, right angles and other shapes")
    others: list[Other] = required("Unknowns of instruments, heights, eccentricities and offsets")
    groups: list[Group] = required("Groups of observations, in the order of the input")
    variance_components: VarianceComponents | None = optional("How the factors of the σ of the groups were estimated")
    gross_errors: GrossErrors = required("Tests of single observations")
    suspects: Suspects | None = optional("What was left out because all observations together have no solution")
    possible_causes: list[PossibleCause] = Field(
        [], description="Mistakes that would explain what is rejected, by score tests, the best first; not verified"
    )
    fixed_points: list[FixedPoint] = required("Tests of the coordinates held fixed")
    relative: list[Relative] = Field(
        [], description="Distances and relative error ellipses of the pairs that report: {relative: …} names"
    )
    checks: list[Check] = required("Observations kept out to check by")
    failure: Failure | None = optional("Where there is no solution: what does not come to rest, what fits worst")
    tables: dict[str, str] = required("Names of the tables beside results.json")
    files: list[str] = Field(
        [], description="Names of all files of this run in its folder; nothing else there is ever replaced"
    )
    residuals: list[Residual] | None = required("null beyond 10 000: read the table")


def results_schema() -> str:
    """JSON Schema (2020-12) of ``results.json`` as text."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:mor:schema:results:2"}
    return json.dumps({**head, **Results.model_json_schema(by_alias=True)}, indent=2, ensure_ascii=False) + "\n"
