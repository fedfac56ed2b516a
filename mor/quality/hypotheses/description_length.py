"""How well observations are explained: what is left of vᵀPv, with a price for everything that was chosen to fit.

Models that differ in their number of unknowns, in the units of their observations, and in how many others were looked
through are compared by −2 ln of how likely the observations are (J. Rissanen 1978; G. Schwarz 1978):

    L = Σ min(s², 2 ln n + 2 ln s) + q ln n + 2 ln m − 2 Σ ln |dl'/dl|

with s = |v|/σ. An observation that does not fit at all costs what it takes to say which of n it is, and how large its
error: a model is not judged by errors that it is not about. q additional unknowns, the best of m alike.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray


def cost_of_residuals(sizes: Sequence[FloatArray], count: int) -> float:
    """Σ min(s², 2 ln n + 2 ln s) of |v|/σ (n, m) by group, ``count`` being n."""
    price = 2.0 * np.log(max(count, 2))
    return float(
        sum(np.sum(np.minimum(size**2, price + 2.0 * np.log(np.maximum(size, 1.0)))) for size in sizes)
    )


def cost_of_choice(count: int, candidates: int, parameters: int, stretch: float) -> float:
    """The rest of L."""
    return parameters * float(np.log(max(count, 2))) + 2.0 * float(np.log(max(candidates, 1))) - 2.0 * stretch
