"""Diffs of the edits that hypotheses need: applied, they change what they say and nothing else."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from mor.api import pipeline
from mor.diagnose.hypothesis import (
    CellEdit,
    Edit,
    as_diff,
    cells,
    computed,
    key_edit,
    table_key,
    to,
    with_amount,
)
from mor.project.document import Document
from mor.project.network import Network
from mor.quality.solution import AddedParameter
from tests.scenarios.planted_mistakes.survey import SAMPLES
from tests.scenarios.small_projects import write

INLINE = """\
mor: 1
points:
  # datum
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 100, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[C, 50, 80, 5]]}
observations:
  - type: distance  # taped
    columns: [from, to, distance]
    values: {sigma: 0.01}
    rows:
      - [A, C, 94.472]  # first
      - [B, C, 94.472]
"""


def _read(path: Path) -> tuple[Document, Network]:
    document = pipeline.read_document(path)
    return document, pipeline.read_network(document, path.parent)


def _applied(path: Path, edits: tuple[Edit, ...], amount: AddedParameter | None = None) -> str:
    """Apply the diff with ``patch``, and return it."""
    document, _ = _read(path)
    diff = as_diff(document, path.parent, edits, amount)
    assert diff is not None
    subprocess.run(["patch", "-p0", "--quiet"], input=diff, text=True, cwd=path.parent, check=True)
    return diff


@pytest.fixture
def bridge(tmp_path: Path) -> Path:
    shutil.copytree(SAMPLES / "bridge", tmp_path / "bridge")
    return tmp_path / "bridge" / "project.yaml"


def test_cells_of_a_table_beside_the_project(bridge: Path) -> None:
    _, before = _read(bridge)
    rows = [0, 7, 20]
    edits = cells(before, 0, rows, "horizontal", computed(lambda angle: (400.0 - angle) % 400.0))
    _applied(bridge, edits)
    _, after = _read(bridge)
    turned = (-before.groups[0].observed[rows, 0]) % (2.0 * np.pi)
    np.testing.assert_allclose(after.groups[0].observed[rows, 0], turned, atol=1e-9)
    others = np.setdiff1d(np.arange(before.groups[0].count), rows)
    np.testing.assert_array_equal(after.groups[0].observed[others], before.groups[0].observed[others])


def test_keys_of_the_project_file_keep_its_comments(bridge: Path) -> None:
    document, network = _read(bridge)
    edits = (
        key_edit(("instruments", "edm", "offset"), "{free: 0}"),
        *table_key(network, 1, "instrument", "edm"),
    )
    diff = _applied(bridge, edits)
    removed = [line for line in diff.splitlines() if line.startswith("-") and not line.startswith("---")]
    assert removed == []
    _, after = _read(bridge)
    assert after.project.observations[1].instrument == "edm"
    assert "edm" in after.project.instruments
    assert document.data["title"] == after.project.title


def test_a_row_in_the_project_file_and_a_row_by_its_name(tmp_path: Path) -> None:
    path = write(tmp_path, INLINE)
    _, network = _read(path)
    height = CellEdit(("points",), "z", with_amount(lambda _old, new: new), cells={"id": "C"})
    _applied(path, (*cells(network, 0, [1], "from", to("A")), height), AddedParameter("height", 7.25))
    text = path.read_text()
    assert "[A, C, 94.472]  # first\n      - [A, C, 94.472]" in text
    assert "[C, 50, 80, 7.2500]" in text
    assert "type: distance  # taped" in text


def test_what_cannot_be_expressed_has_no_diff(bridge: Path) -> None:
    document, network = _read(bridge)
    folder = bridge.parent
    assert as_diff(document, folder, cells(network, 0, [0], "no_such_column", to("1"))) is None
    assert as_diff(document, folder, cells(network, 1, [0], "to", computed(lambda value: value))) is None
    assert as_diff(document, folder, ()) is None
    nobody = CellEdit(("stations",), "height", to("1"), cells={"id": "nobody"})
    assert as_diff(document, folder, (nobody,)) is None


def test_an_alias_is_not_edited(tmp_path: Path) -> None:
    text = INLINE.replace("values: {sigma: 0.01}", "values: &s {sigma: 0.01}").replace(
        "      - [B, C, 94.472]\n",
        "      - [B, C, 94.472]\n"
        "  - {type: distance, columns: [from, to, distance], values: *s, rows: [[A, C, 94.47]]}\n",
    )
    document, _ = _read(write(tmp_path, text))
    edit = key_edit(("observations", 0, "values", "sigma"), "0.02")
    assert as_diff(document, tmp_path, (edit,)) is None
