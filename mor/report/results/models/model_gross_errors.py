"""The parts of ``results.json`` on gross errors, as models."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict, Field

from mor.report.results.models.model_parts import Number, Part


class Place(Part):
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


class MostlyOut(Part):
    """An image, station or point of which more than half of the observations were taken out."""

    of: str = Field(description="image, station or point")
    id: str = Field(description="Its name")
    excluded: int = Field(description="Number of its observations that were taken out")
    observations: int = Field(description="Number of its observations")


class Snooping(Part):
    """Data snooping."""

    clean: bool = Field(description="True where nothing is flagged at the end")
    mostly_out: list[MostlyOut] = Field(
        default=[], description="Things of which more than half was taken out"
    )
    sigma0_before: float = Field(description="σ0 of the adjustment with all observations")
    steps: list[SnoopingStep] = Field(description="What was taken out and put back, in order")


class Robust(Part):
    """The robust solution beside the least-squares one."""

    method: Literal["l1", "danish"] = Field(description="Estimator")
    settled: bool = Field(description="True where the weights changed no more")
    rejected: list[Place] = Field(description="Observations left with next to no weight")
    largest_shift: float = Field(
        description="Largest difference of a coordinate from the least-squares solution"
    )
    rms_shift: float = Field(description="Root mean square of these differences")


class InCommon(Part):
    """A point, image, station or table that many flagged observations refer to."""

    of: Literal["group", "image", "camera", "station", "set", "instrument", "system", "point"] = Field(
        description="Kind of the object"
    )
    name: str = Field(description="Its name")
    flagged: int = Field(description="Number of its rows of observations that are flagged or left out")
    rows: int = Field(description="Number of its rows of observations")
    all_flagged: int = Field(description="Number of all rows of observations that are flagged or left out")


class GrossErrors(Part):
    """Tests of single observations; empty without a solution."""

    beta0: Number = Field(default=None, description="Power of the test of single observations")
    noncentrality: Number = Field(default=None, description="δ0² of the smallest detectable errors")
    familywise_level: Number = Field(
        default=None, description="Level of all tests together, where it was asked for"
    )
    global_level_of_b_method: Number = Field(
        default=None, description="Level of the global test that the level of single tests fits to (B-method)"
    )
    suspicious: list[Suspicious] = Field(
        default=[], description="Observations with the largest |w|, and what errors in them do"
    )
    in_common: list[InCommon] = Field(
        default=[], description="What more of the flagged observations refer to than chance explains"
    )
    snooping: Snooping | None = Field(default=None, description="Data snooping, where it was asked for")
    robust: Robust | None = Field(default=None, description="Robust solution, where it was asked for")


class Suspect(Place):
    """An observation that was left out."""

    misfit: float = Field(description="|v|/σ against the robust solution")


class Suspects(Part):
    """Observations left out so that the rest has a solution."""

    outcome: Literal["converged", "not converged", "diverged"] = Field(
        description="How the adjustment of all observations ended; converged: at a place that fits hardly any of them"
    )
    iterations: int = Field(description="Number of iterations of that adjustment")
    sigma0_ratio: Number = Field(description="Its σ0 a posteriori / a priori, where it came to an end")
    count: int = Field(description="Number of observations left out")
    observations: list[Suspect] = Field(description="The worst first, at most 10 000")


class Amount(Part):
    """Estimate of an additional unknown."""

    name: str = Field(description="offset, scale, height, c")
    value: float = Field(description="Its estimate")
    unit: str = Field(description="Its unit")


class PossibleCause(Part):
    """A mistake that would explain what is rejected, by a score test at the solution."""

    cause: str = Field(description="Key of the cause")
    things: list[str] = Field(description="Names of what it is about: points, images, stations, tables")
    line: str = Field(description="What to change in the project to try it")
    amount: Amount | None = Field(description="Its parameter at the solution, to first order")
    vtpv_decrease: float = Field(description="Decrease of vᵀPv to first order")
    parameters: int = Field(description="Number of its parameters")
    log10_p: float = Field(description="Decimal logarithm of the probability of such a decrease by chance")
    verified: bool = Field(description="False: no adjustment was made with it")
