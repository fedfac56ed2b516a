"""Lines of levels that were booked the other way round."""

from __future__ import annotations

from functools import partial

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.observations import PLAIN_TYPES
from mor.quality.hypotheses.changes import with_observed
from mor.quality.hypotheses.hypothesis import Hypothesis
from mor.quality.hypotheses.situation import Situation

_TRIED = 3


def levelling_hypotheses(situation: Situation) -> list[Hypothesis]:
    """The lines that fit best with the other sign, of those whose misclosures look like it."""
    found = []
    for number, group in enumerate(situation.network.groups):
        if group.type != PLAIN_TYPES["height_difference"] or not situation.misfitting[number].any():
            continue
        misclosure = misclosures(group, situation.values)[:, 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.abs(misclosure / (2.0 * group.observed[:, 0]) - 1.0)
        for row in np.argsort(np.nan_to_num(off, nan=np.inf), kind="stable")[:_TRIED].tolist():
            names = tuple(column[row] for column in group.references)
            rows = np.array([row])
            found.append(
                Hypothesis(
                    "levelling sign",
                    names,
                    partial(with_observed, number=number, rows=rows, change=np.negative),
                    f"{group.name}, {' → '.join(names)}: {names[1]} → {names[0]}",
                    group.count,
                    rows=((number, row),),
                )
            )
    return found
