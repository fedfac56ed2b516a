"""Movements of points in one adjustment of several epochs, as a page that needs nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from markupsafe import Markup

from mor.quality.deformation.movements import Tested
from mor.quality.solved import Solved
from mor.report.epochs.drawing import Moved, movement_drawing
from mor.report.epochs.series import series_drawing
from mor.report.html.figures.layout import small_unit
from mor.report.html.page import asset, environment
from mor.report.html.paper import running_heads
from mor.report.html.payload import drawn_axes
from mor.report.identity import Identity, identity_of
from mor.report.motions.table import found_movements, movement_rows
from mor.report.motions.text import listed_movements, listed_parameters, statements
from mor.report.words.language import Words

MOST_SERIES = 60
"""Points whose movements are drawn against time, the most significant ones."""
MOST_ROWS = 300


def movements_page(solved: Solved, of: Identity, words: Words) -> str:
    """Verdict, drawing of the movements from the first to the last epoch, curves against time, tables."""
    found = found_movements(solved)
    assert found is not None
    identity = identity_of(solved.network.project, of)
    title = solved.network.project.title or words("Movements of points")
    last = movement_rows(solved).group_by("point", maintain_order=True).last()
    moved = int(last["moved"].sum()) if last.height else 0
    return (
        environment()
        .get_template("movements.html.j2")
        .render(
            title=title,
            headline=words("{count:point has|points have} moved, of {all}", count=moved, all=last.height)
            if moved
            else words("Nothing has moved"),
            state="bad" if moved else "good",
            statements=statements(solved, words),
            drawing=movement_drawing(_moved(solved, found.between, last), words) if last.height else "",
            series=_series(solved, last),
            shown=MOST_SERIES,
            parameters=listed_parameters(solved, words, MOST_ROWS),
            movements=listed_movements(solved, words, MOST_ROWS),
            say=words,
            style=Markup(asset("page.css") + asset("certificate.css") + asset("epochs.css")),
            running=running_heads(title, identity, words),
        )
    )


def _moved(solved: Solved, between: Tested, last: pl.DataFrame) -> Moved:
    """Movements of the points from their first to their last epoch, in project axes."""
    network, quality = solved.network, solved.quality
    assert quality is not None
    M = network.edge.matrix
    row_of = {name: k for k, name in enumerate(between.names)}  # the last of each
    rows = [row_of[name] for name in last["point"]]
    blocks = [network.things["point"].part(name, "position") for name in last["point"]]
    drawn = drawn_axes(network.project.axes.xy)
    right = "xy".index(drawn["right"])
    backwards = [False, False, False]
    backwards[right], backwards[1 - right] = drawn["right_reversed"], drawn["up_reversed"]
    return Moved(
        names=tuple(last["point"]),
        places=solved.adjustment.values["point"][blocks] @ M,
        movements=between.tests.vectors[rows, :3] @ M,
        covariances=quality.sigma_factor**2 * (M.T @ between.tests.cofactors[rows][:, :3, :3] @ M),
        moved=last["moved"].to_numpy(),
        unit=network.project.units.length,
        reversed=(backwards[0], backwards[1], backwards[2]),
        right=right,
    )


def _series(solved: Solved, last: pl.DataFrame) -> list[Any]:
    """Curves against time, the most significant points first."""
    frame = movement_rows(solved)
    year = dict(zip(solved.network.motion.labels, solved.network.motion.times, strict=True))
    sizes = [float(frame[name].abs().max() or 0.0) for name in "xyz"] if frame.height else [0.0]  # type: ignore[arg-type]
    unit, factor = small_unit(solved.network.project.units.length, max(sizes) or 1.0)
    drawings = []
    for name in last.sort("p", nulls_last=True)["point"].head(MOST_SERIES):
        own = frame.filter(pl.col("point") == name)
        years = np.array([year[own["from"][0]], *(year[label] for label in own["to"])])
        values, sigma = (
            np.vstack([np.zeros(3), own.select(*(f"{s}{axis}" for axis in "xyz")).to_numpy()]) * factor
            for s in ("", "s")
        )
        drawings.append(series_drawing(f"{name} [{unit}]", years, values, sigma, unit, ("X", "Y", "Z")))
    return drawings
