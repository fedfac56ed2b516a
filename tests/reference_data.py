"""Reference networks of the repository, reference data beside it, and results by name."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from mor.api.pipeline import solve_network
from mor.api.verification import (
    expected_values,
    image_results,
    interior_results,
    observations,
    point_results,
    reference_data,
    table,
)
from mor.project.document import Document, read_yaml
from mor.project.network import Network, build_network
from mor.project.schema import validate
from mor.quality.solution import Solved

__all__ = [
    "MISSING",
    "NETWORKS",
    "expected_values",
    "image_results",
    "interior_results",
    "missing",
    "network_name",
    "network_of",
    "network_of_yaml",
    "observations",
    "point_results",
    "reference_file",
    "reference_files",
    "reference_folder",
    "solved_network",
    "table",
]

MISSING = "need the reference data of other programs (../shared/data, or the folder MOR_SHARED_DATA)"
"""Why tests of readers and of large blocks are skipped in a clone with nothing beside it."""

NETWORKS = sorted(reference_data().glob("*/*.yaml"))
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
