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


class Units(Part):
    """Units of all values that say none of their own."""

    length: str
    angle: str


class Axes(Part):
    """Axes and senses of the project."""

    xy: str
    angles: Literal["clockwise", "counterclockwise"]
    bearings_from: Literal["north", "east", "south", "west"]


class Direction(Part):
    """A direction that is not determined: unknowns and the proportion in which they move."""

    unknowns: list[str]
    amounts: list[float]


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


class Sigma0(Part):
    """Standard deviation of unit weight."""

    apriori: float
    aposteriori: Number
    ratio: Number = Field(description="(aposteriori / apriori)²")
    ratio_of_sigmas: Number
    used_for_sigma: float = Field(description="What cofactors were multiplied with to become σ")


class GlobalTest(Part):
    """Two-sided χ² test of vᵀPv."""

    statistic: float
    lower: float
    upper: float
    level: float
    accepted: bool


class Step(Part):
    """One iteration."""

    number: int
    objective: float
    largest_change: float = Field(description="In units of σ")
    damping: float


class Position(Part):
    """A name, coordinates and their σ."""

    id: str
    x: Number
    y: Number
    z: Number
    sx: Number
    sy: Number
    sz: Number


class Point(Position):
    """A row of points.csv."""

    ellipsoid_a: Number
    ellipsoid_b: Number
    ellipsoid_c: Number
    rxy: Share
    rxz: Share
    ryz: Share
    rays: int
    others: int
    mean_r: Number
    largest_w: Number
    status: Literal["free", "partly fixed", "fixed", "left out", "at infinity"]


class Posed(Position):
    """A position with an attitude."""

    omega: Number
    phi: Number
    kappa: Number
    somega: Number
    sphi: Number
    skappa: Number


class Image(Posed):
    """A row of images.csv."""

    camera: str
    points: int
    rms: Number
    mean_r: Number
    largest_w: Number


class Station(Posed):
    """A theodolite station."""

    orientation: Number = Field(description="Bearing of the zero of the horizontal circle")
    sorientation: Number
    height: Number


class System(Posed):
    """A local system."""

    scale: Number
    sscale: Number


class Pair(Part):
    """A relative orientation of stereo images."""

    id: str
    bx: Number
    by: Number
    bz: Number
    sbx: Number
    sby: Number
    sbz: Number
    omega: Number
    phi: Number
    kappa: Number
    somega: Number
    sphi: Number
    skappa: Number


class Component(Part):
    """A component of a block."""

    value: float
    sigma: Number
    status: Literal["free", "fixed"]
    t: Number = Field(default=None, description="|value| / σ, the test of its significance")


class Format(Part):
    """Image size in px, pixel size in camera units, where coordinates count from."""

    width: float
    height: float
    pixel: float
    origin: Literal["centred", "corner"]


class Correlations(Part):
    """Correlation matrix of the estimated components."""

    components: list[str]
    matrix: list[list[float]] | None


class Camera(Part):
    """An interior orientation."""

    id: str
    model: str
    unit: str
    r0: str | None
    format: Format | None
    components: dict[str, Component]
    correlations: Correlations


class Feature(Part):
    """A plane or a line."""

    id: str
    type: Literal["plane", "line", "right angle"]
    part: str
    dx: float
    dy: float
    dz: float
    distance: Number
    x: float
    y: float
    z: float
    points: int
    rms: float


class Other(Part):
    """An estimated block that belongs to no other table."""

    kind: str
    id: str
    components: dict[str, Component]


class Group(Part):
    """An observation group."""

    name: str
    type: str
    observations: int
    redundancy: Number = None
    omega: Number = Field(
        default=None,
        description="Its part of vᵀPv; may be negative where observations are correlated across groups",
    )
    sigma0: Number = Field(default=None, description="√(omega/redundancy); null where there is none")
    mean_r: Number = None
    largest_w: Number = None
    excluded: int | None = None
    flagged: int | None = None
    sigma_factor: Number = None
    sigma_of_factor: Number = None


class VarianceComponents(Part):
    """How the factors of the σ of the groups were estimated."""

    method: Literal["simplified", "helmert"]
    iterated: bool = Field(description="True where the weights have them in")
    settled: bool = Field(description="True where iterating them changed nothing any more")
    rounds: int


class Place(Part):
    """Which observation."""

    type: str
    group: str
    names: dict[str, str]
    component: str
    unit: str


class Suspicious(Place):
    """An observation with a large test value, and what an error in it does."""

    w: float
    r: float
    error: float
    nabla: float
    point: str | None = Field(description="The point that it moves most")
    movement: list[float] | None = Field(
        description="By the estimated error; null where so little controls the observation that this says nothing"
    )
    flagged: bool


class SnoopingStep(Place):
    """An observation that was taken out or put back."""

    round: int
    action: Literal["excluded", "put back"]
    w: float


class MostlyOut(Part):
    """An image, station or point of which more than half of the observations were taken out."""

    of: str
    id: str
    excluded: int
    observations: int


class Snooping(Part):
    """Data snooping."""

    clean: bool
    mostly_out: list[MostlyOut] = []
    sigma0_before: float
    steps: list[SnoopingStep]


class Robust(Part):
    """The robust solution beside the least-squares one."""

    method: Literal["l1", "danish"]
    settled: bool
    rejected: list[Place]
    largest_shift: float
    rms_shift: float


class GrossErrors(Part):
    """Tests of single observations; empty without a solution."""

    alpha0: Number = None
    beta0: Number = None
    noncentrality: Number = None
    familywise_level: Number = None
    global_level_of_b_method: Number = None
    suspicious: list[Suspicious] = []
    snooping: Snooping | None = None
    robust: Robust | None = None


class Suspect(Place):
    """An observation that was left out."""

    misfit: float = Field(description="|v|/σ against the robust solution")


class Suspects(Part):
    """Observations left out so that the rest has a solution."""

    outcome: Literal["converged", "not converged", "diverged"] = Field(
        description="How the adjustment of all observations ended; converged: at a place that fits hardly any of them"
    )
    iterations: int
    sigma0_ratio: Number
    count: int
    observations: list[Suspect] = Field(description="The worst first, at most 10 000")


class FixedPoint(Part):
    """Test of the coordinates a point is held at."""

    id: str
    movement: list[float]
    freedom: int
    test: float
    p: float
    test_estimated: Number
    p_estimated: Number


class Check(Part):
    """Deviations of a group that was kept out, adjusted − known, one component."""

    group: str
    type: str
    component: str
    unit: str
    count: int
    mean: float
    rms: float
    largest: float
    exceeding: int


class Moving(Part):
    """An unknown that does not come to rest."""

    kind: str
    of: str
    id: str
    component: str
    unit: str
    steps: list[Number] = Field(description="Its last steps, or the one that could not be taken")
    way: Literal["to and fro", "away", "wanted"]


class Residual(Part):
    """A row of residuals.csv."""

    model_config = ConfigDict(extra="allow", strict=True, serialize_by_alias=True)

    type: str
    group: str
    at: str
    from_: str = Field(alias="from")
    to: str
    component: str
    unit: str
    observed: Number
    adjusted: Number
    v: Number
    sigma: Number
    sigma_adjusted: Number
    r: Number
    w: Number
    tau: Number
    test: Number
    p: Number
    t2: Number
    p_t: Number
    error: Number
    nabla: Number
    external: Number
    influence: Number
    joint: Number
    joint_freedom: Number
    p_joint: Number
    flag: Literal["", "gross", "uncontrolled", "excluded", "check"]


class Misfit(Residual):
    """A residual at the last values, where there is no solution."""

    misfit: Number = Field(description="abs(v) / sigma")


class Failure(Part):
    """What is known where there is no solution."""

    notice: str
    moving: list[Moving]
    worst: list[Misfit]
