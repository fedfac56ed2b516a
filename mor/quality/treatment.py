"""What is done about gross errors and weights after the first adjustment, as the project asks for it."""

from __future__ import annotations

from typing import NamedTuple

from mor.quality.assess import Levels, Quality
from mor.quality.gross_errors.data_snooping import Snooping, snoop
from mor.quality.gross_errors.exclusion import reweighted
from mor.quality.gross_errors.robust_estimation import Method, Robust, robust_estimate
from mor.quality.gross_errors.suspects import Suspects, with_suspects
from mor.quality.variance_components.simplified import Components, components, iterated_components
from mor.quality.variance_components.simplified import Method as ComponentMethod


class Wanted(NamedTuple):
    """What the project asks for."""

    snooping: bool = False
    robust: Method | None = None
    iterate_components: bool = False
    component_method: ComponentMethod = "simplified"


class Treatment(NamedTuple):
    """What was done."""

    components: Components
    snooping: Snooping | None = None
    robust: Robust | None = None


def treat(
    quality: Quality, levels: Levels, aposteriori: bool, wanted: Wanted, suspects: Suspects | None = None
) -> tuple[Quality, Treatment]:
    """Robust comparison, data snooping (starting from what the robust solution rejects), variance components.

    Data snooping begins with the suspects taken out, if there are any, and may put them back. With components iterated,
    it goes over it again with the new weights.
    """
    problem, rejected = quality.adjustment.problem, None
    if suspects is not None and wanted.snooping:
        problem, rejected = with_suspects(problem, suspects)
    robust = robust_estimate(quality, wanted.robust) if wanted.robust is not None else None
    snooping = None
    if wanted.snooping:
        if rejected is None and robust is not None and robust.settled:
            rejected = robust.rejected
        snooping = snoop(problem, quality, levels, aposteriori, rejected)
        quality = snooping.quality
    if not wanted.iterate_components:
        return quality, Treatment(components(quality, wanted.component_method), snooping, robust)
    found, quality = iterated_components(quality, levels, aposteriori, wanted.component_method)
    if snooping is not None and found.settled:
        weighted = reweighted(problem, [found.of(group, k) for k, group in enumerate(problem.groups)])
        out = tuple(group.left_out for group in quality.adjustment.problem.groups)
        again = snoop(weighted, quality, levels, aposteriori, out)
        snooping = again.after(snooping)
        quality = again.quality
    return quality, Treatment(found, snooping, robust)
