"""A common offset or scale in the observations of a group: how large it would be, and what would be left with it.

With c the derivatives of the whitened observations by the effect (1 for an offset, the measured value for a scale, each
over σ), R the cofactors of their residuals and v these residuals (W. Baarda, 1968, for one bias in many observations):

    ∇̂ = −cᵀv / (cᵀ R c),    σ = 1/√(cᵀ R c),    w = ∇̂/σ,    v' = v + R c ∇̂

v' are the residuals beside the effect, whose sum of squares in the group has the expectation Σr − ‖R_g c‖²/(cᵀ R c).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.observations import ObservationGroup
from mor.quality.assess import Quality
from mor.quality.reliability.whitened_rows import WhitenedRows
from mor.quality.tests.test_statistics import CONTROLLED


class CommonEffect(NamedTuple):
    """An effect on one component of the observations of one group, in internal units."""

    kind: Literal["offset", "scale"]
    group: int
    component: int
    size: float
    """∇̂, in the sense observed − true: of an offset in the unit of the component, of a scale a ratio."""
    sigma: float
    """Its standard deviation, σ0 = 1."""
    omega: float
    """What is left of the part of vᵀPv of all chosen observations."""
    redundancy: float
    """What is left of their Σr."""

    @property
    def test(self) -> float:
        """w, standard normal where there is no such effect; its square is what vᵀPv of all loses."""
        return self.size / self.sigma

    @property
    def factor(self) -> float:
        """√(Ω/Σr) that is left."""
        return float(np.sqrt(max(self.omega, 0.0) / self.redundancy)) if self.redundancy > 0.0 else np.nan


def common_effects(
    quality: Quality, rows: WhitenedRows, chosen: list[BoolArray], redundancy: float
) -> list[CommonEffect]:
    """Effects in the chosen observations, (n, m) of each group, whose Σr is given; the most significant first."""
    forms = [
        (kind, number, component, values)
        for number, (group, mask) in enumerate(zip(quality.adjustment.problem.groups, chosen, strict=True))
        for component in np.flatnonzero(mask.sum(axis=0) > 1).tolist()
        for kind, values in _forms(group, mask, component)
    ]
    if not forms:
        return []
    groups = quality.adjustment.problem.groups
    residuals = rows.whitened([np.nan_to_num(one.v) for one in quality.groups])
    white = np.stack(
        [
            rows.whitened([_only(groups, number, here, values) for here in range(len(groups))])
            for _, number, _, values in forms
        ],
        axis=1,
    )
    answer = rows.residuals_of(white)[0]
    q = np.sum(white * answer, axis=0)
    found = []
    for k, (kind, number, component, _) in enumerate(forms):
        if q[k] <= CONTROLLED * float(white[:, k] @ white[:, k]):
            continue
        size = -float(white[:, k] @ residuals) / q[k]
        left = residuals + answer[:, k] * size
        taken = float(answer[:, k] @ answer[:, k]) / q[k]
        sigma = float(1.0 / np.sqrt(q[k]))
        rest = float(left @ left), redundancy - taken
        found.append(CommonEffect(kind, number, component, size, sigma, *rest))
    return sorted(found, key=lambda effect: -abs(effect.test))


_Form = tuple[Literal["offset", "scale"], FloatArray]


def _forms(group: ObservationGroup, mask: BoolArray, component: int) -> list[_Form]:
    """Derivatives (n, m) of the observations by an offset of one component and, of lengths, by a scale."""
    ones = np.zeros(group.observed.shape)
    ones[mask[:, component], component] = 1.0
    forms: list[_Form] = [("offset", ones)]
    if not group.type.wraps[component] and group.type.components[component].quantity.length == 1:
        forms.append(("scale", ones * np.nan_to_num(group.observed)))
    return forms


def _only(groups: tuple[ObservationGroup, ...], number: int, here: int, values: FloatArray) -> FloatArray:
    return values if here == number else np.zeros(groups[here].observed.shape)
