"""Content of the page of two epochs, from their adjustments."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl

from mor.input_files import note_input
from mor.quality.deformation.epochs import Epochs, blocks_of
from mor.quality.solved import Solved
from mor.report.epochs.drawing import Moved
from mor.report.epochs.sheet import Epoch
from mor.report.html.payload import drawn_axes
from mor.report.identity import Identity, identity_of
from mor.report.results.summary import summary


def epoch(place: Path, solved: Solved) -> Epoch:
    """An epoch, with the identity its results had; of a project, which has none yet, that of its file."""
    file = place / "results.json" if place.is_dir() else place
    identity = identity_of(solved.network.project, Identity())
    if file.name == "results.json" and file.is_file():
        note_input(file)
        identity |= json.loads(file.read_text(encoding="utf-8")).get("identity", {})
    return Epoch(str(place), summary(solved), identity)


def moved(first: Solved, found: Epochs, table: pl.DataFrame) -> Moved:
    """Places of the first epoch, movements and covariances, in project axes."""
    M = first.network.edge.matrix
    tests = found.result.points
    places = first.adjustment.values["point"][blocks_of(first.network, found.names)]
    drawn = drawn_axes(first.network.project.axes.xy)
    right = "xy".index(drawn["right"])
    backwards = [False, False, False]
    backwards[right], backwards[1 - right] = drawn["right_reversed"], drawn["up_reversed"]
    cofactors = np.array([test.cofactors for test in tests]).reshape(-1, 3, 3)
    return Moved(
        names=found.names,
        places=places @ M,
        movements=np.array([test.movement @ M for test in tests]).reshape(-1, 3),
        covariances=found.result.variance * (M.T @ cofactors @ M),
        moved=table["moved"].to_numpy(),
        unit=first.network.project.units.length,
        reversed=(backwards[0], backwards[1], backwards[2]),
        right=right,
    )
