"""The parts of ``results.json`` on the verdict, as models."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mor.report.results.models.model_gross_errors import Place
from mor.report.results.models.model_parts import Number, Part

Kind = Literal["group", "image", "camera", "station", "set", "instrument", "system"]


class Named(Part):
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


class CommonEffect(Part):
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


class Conventions(Part):
    """Values that were chosen because no observation determines them."""

    movements: list[str] = Field(description="Movements of the whole that the datum settles")
    scale: bool = Field(description="True where the scale is arbitrary")
    fixed_coordinates_uncontrolled: bool = Field(
        description="True where the fixed coordinates only settle the datum: nothing would show an error in them"
    )


class IllDetermined(Part):
    """A point or the place of a frame with a σ beyond the limit."""

    kind: str = Field(description="point, image, station, …")
    id: str = Field(description="Its name")
    sigma: float = Field(description="Largest semi-axis of its error ellipsoid, length unit of the project")


class Determined(Part):
    """Determination of the result, with σ a priori, or a posteriori if these are smaller."""

    as_a_whole: bool = Field(description="False where σ of more than half of the points are beyond the limit")
    everywhere: bool = Field(description="True where no point is beyond the limit and no direction is weak")
    size: float = Field(
        description="Twice the median distance of the points from their median; 0: no size to judge by"
    )
    limit: float = Field(description="Largest σ as a part of this size")
    points: int = Field(description="Number of points and places of frames that were judged")
    largest_sigma: float = Field(description="The largest σ of these, length unit of the project")
    median_sigma: float = Field(description="The median of these σ")
    beyond: int = Field(description="Number of those beyond the limit")
    worst: list[IllDetermined] = Field(description="The worst of them")
    directions: int = Field(description="Number of weak directions, see hardly_determined")


class Verdict(Part):
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
    explanations: list[Explanation] = Field(
        description="The worst groups; those first whose effect explains most"
    )
    conventions: Conventions = Field(description="What was chosen and not measured")
    determined: Determined = Field(description="Whether the result is determined")


class Further(Part):
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


class Weakest(Part):
    """Mean redundancy of a point, image, station or set."""

    id: str = Field(description="Its name")
    observations: int = Field(description="Number of its observations: a ray is two of them")
    smallest_r: float = Field(description="Smallest redundancy number among them")
    weakest: Place = Field(description="The observation that has it")
    nabla: Number = Field(
        description="Its smallest detectable error, in its unit; null where none would be found"
    )
    shift: Number = Field(
        description="An error that is not found moves its position by at most so much; null: by any amount"
    )


class ReliabilityMap(Part):
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
