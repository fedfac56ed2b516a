"""Reference networks of the repository, reference data beside it, and results by name."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.model.parameters import moves_by_angles
from mor.model.rotations import angles_from_rotation
from mor.project.document import Document, read_yaml
from mor.project.network import Network, build_network
from mor.project.schema import validate
from mor.quality.precision import angle_cofactors
from mor.quality.solution import Solved

MISSING = "need the reference data of other programs (../shared/data, or the folder MOR_SHARED_DATA)"
"""Why tests of readers and of large blocks are skipped in a clone with nothing beside it."""

NETWORKS = sorted((Path(__file__).parent / "reference" / "networks").glob("*/*.yaml"))
"""Projects of the reference networks that stand in the repository."""


def network_name(path: Path) -> str:
    """Name of a reference network: its source and its file."""
    return f"{path.parent.name}/{path.stem}"


def reference_folder(name: str) -> Path | None:
    """Folder of a data set: below ``MOR_SHARED_DATA``, or ``shared/data`` beside the repository."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("MOR_SHARED_DATA") or beside) / name
    return folder if folder.is_dir() else None


def missing(_name: str) -> str:
    """Why a test is skipped: the same words for every data set, so that the summary counts them in one line."""
    return MISSING


def reference_file(name: str) -> Path:
    """A file of a data set, as ``gama/NAME.gkf``; the test is skipped where the data set is missing."""
    folder = reference_folder(name.split("/")[0])
    if folder is None:
        pytest.skip(MISSING)
    return folder.parent / name


def reference_files(name: str, pattern: str) -> Sequence[object]:
    """Files of a data set as test parameters; one skipped parameter where the set is missing."""
    folder = reference_folder(name)
    if folder is None:
        return [pytest.param(None, marks=pytest.mark.skip(reason=MISSING), id="missing")]
    return [pytest.param(path, id=path.stem) for path in sorted(folder.glob(pattern))]


class Outcome(NamedTuple):
    """One adjusted observation, in the axes and senses of the project; σ of the adjusted value for σ0 = 1."""

    line: int
    type: str
    component: str
    references: tuple[str, ...]
    observed: float
    v: float
    r: float
    s: float
    w: float


def observations(solved: Solved) -> list[Outcome]:
    """All observations in the order of their lines."""
    rows = []
    for group, quality, w in zip(solved.network.groups, solved.quality.groups, solved.quality.w, strict=True):
        T = group.external.transform if group.external else np.eye(len(group.type.components))
        offset = group.external.offset if group.external else 0.0
        observed, v, w_given = (np.nan_to_num(a) @ T for a in (group.observed - offset, quality.v, w))
        r, q = (np.nan_to_num(a) @ np.abs(T) for a in (quality.r, quality.q_adjusted))
        here = (group.mask @ np.abs(T)) > 0.5
        for i, k in zip(*np.nonzero(here), strict=True):
            names = tuple(reference[i] for reference in group.references)
            values = (observed[i, k], v[i, k], r[i, k], np.sqrt(max(q[i, k], 0.0)), w_given[i, k])
            component = group.type.components[k].name
            line = int(group.lines[i]) if len(group.lines) else 0
            rows.append(Outcome(line, group.type.key, component, names, *map(float, values)))
    return sorted(rows, key=lambda row: row.line)


def point_results(solved: Solved) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Coordinates and standard deviations for σ0 = 1 of every point, in the axes of the project."""
    points, M = solved.network.things["point"], solved.network.edge.matrix
    blocks = points.parts["position"]
    coordinates = solved.adjustment.values["point"][blocks] @ M
    variances = np.diagonal(solved.quality.cofactors["point"][blocks], axis1=1, axis2=2) @ np.abs(M)
    sigma = np.sqrt(np.maximum(variances, 0.0))
    return {name: (coordinates[i], sigma[i]) for i, name in enumerate(points.ids)}


def network_of(document: Document, folder: Path) -> Network:
    """The network of a document."""
    return build_network(validate(document), document, folder)


def network_of_yaml(text: str, folder: Path) -> Network:
    """The network of a project file given as text; its tables are looked for in ``folder``."""
    return network_of(read_yaml(text, "project.yaml"), folder)


@cache
def solved_network(path: Path) -> Solved:
    """The adjusted network of a project file; shared by all tests."""
    return solve_network(network_of_yaml(path.read_text(encoding="utf-8"), path.parent))


@cache
def expected_values(path: Path) -> dict[str, Any]:
    """The expected values that stand beside a project file of a reference network."""
    expected = path.with_suffix(".expected.json").read_text(encoding="utf-8")
    return dict(json.loads(expected))


def table(expected: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Rows of one table of expected values, by column."""
    rows = expected[name]["rows"] if name in expected else []
    return [dict(zip(expected[name]["columns"], row, strict=True)) for row in rows]


def image_results(solved: Solved) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """X, Y, Z, ω, φ, κ (rad) and standard deviations for σ0 = 1 of every image."""
    images = solved.network.things["image"]
    position, rotation = images.parts["position"], images.parts["rotation"]
    values = solved.adjustment.values
    pose = np.concatenate(
        [values["point"][position], angles_from_rotation(values["rotation"][rotation])], axis=1
    )
    by_angles = moves_by_angles(solved.network.blocks["rotation"])
    cofactors = solved.quality.cofactors
    angles = angle_cofactors(cofactors["rotation"], values["rotation"], by_angles)
    blocks = (cofactors["point"][position], angles[rotation])
    variances = np.concatenate([np.diagonal(q, axis1=1, axis2=2) for q in blocks], axis=1)
    return {name: (pose[i], np.sqrt(variances[i])) for i, name in enumerate(images.ids)}


def interior_results(solved: Solved, camera: str) -> dict[str, tuple[float, float]]:
    """Interior orientation of a camera: value and standard deviation for σ0 = 1 of every component."""
    model = f"interior/{solved.network.project.cameras[camera].model}"
    block = solved.network.things["camera"].part(camera, "interior")
    names = solved.network.blocks[model].kind.names
    values = solved.adjustment.values[model][block]
    sigma = np.sqrt(np.diagonal(solved.quality.cofactors[model][block]))
    return {name: (float(v), float(s)) for name, v, s in zip(names, values, sigma, strict=True)}
