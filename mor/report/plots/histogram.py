"""The test values w against the normal distribution, and the redundancy numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mor.report.bins import normal_bins
from mor.report.palette import BLUE, GREEN, ORANGE, RED
from mor.report.plots.sheet import sheet
from mor.report.view import View
from mor.report.words.language import ENGLISH, Words

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def histogram(view: View, words: Words = ENGLISH) -> Figure:
    """Density of w with N(0, 1) and the critical values; counts of r."""
    used = view.used
    w, r = used["w"].drop_nulls().to_numpy(), used["r"].drop_nulls().to_numpy()
    bins = normal_bins(w, view.critical)
    figure = sheet(9.0, 3.8)
    left, right = figure.subplots(1, 2)
    counted = words("w ({count:observation|observations})", count=len(w))
    if bins.beyond:
        limit = f"{bins.limit:g}"
        counted += "\n" + words("{count} of them beyond ±{limit}", count=bins.beyond, limit=limit)
    left.hist(bins.w, bins=bins.edges, density=bool(len(w)), color=BLUE, label=counted)
    t = np.linspace(-bins.limit, bins.limit, 401)
    left.plot(t, np.exp(-0.5 * t**2) / np.sqrt(2.0 * np.pi), color=ORANGE, label="N(0, 1)")
    for value in (-view.critical, view.critical):
        left.axvline(value, color=RED, ls="--", lw=1.0)
    left.set_xlabel("w [1]")
    left.set_ylabel(words("density [1]"))
    left.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    right.hist(r, bins=np.linspace(0.0, 1.0, 41), color=GREEN)
    right.set_xlabel(words("redundancy number r [1]"))
    right.set_ylabel(words("observations"))
    return figure
