"""Reports from folders whose table of movements is missing or there."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from mor.cli import run
from tests.report.html.conftest import SAMPLES

NEW = {
    "point": ["P1", "P2"],
    "from": ["1", "1"],
    "to": ["2", "2"],
    **{name: [0.1, 0.0] for name in "xyz"},
    **{name: [0.01, 0.01] for name in ("sx", "sy", "sz")},
    **{name: [0.0, 0.0] for name in ("rxy", "rxz", "ryz")},
    "test": [100.0, 0.0],
    "p": [0.0, 1.0],
    "moved": [True, False],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results that name a table of movements."""
    target = tmp_path_factory.mktemp("results") / "bridge"
    assert run(["adjust", str(SAMPLES / "bridge/project.yaml"), "-o", str(target)]) == 0
    path = target / "results.json"
    data = json.loads(path.read_text())
    data["tables"]["movements"] = "movements.csv"
    path.write_text(json.dumps(data))
    NEW["point"] = pl.read_csv(target / "points.csv")["id"].cast(pl.String).to_list()[:2]
    return target


@pytest.mark.parametrize(("table", "drawn"), [(None, False), (NEW, True)])
@pytest.mark.parametrize("option", [[], ["--pdf"]])
def test_report_with_and_without_movements(
    folder: Path, table: dict[str, list[object]] | None, drawn: bool, option: list[str]
) -> None:
    (folder / "movements.csv").unlink(missing_ok=True)
    if table is not None:
        pl.DataFrame(table).write_csv(folder / "movements.csv")
    target = folder.parent / "report"
    assert run(["report", str(folder), *option, "-o", str(target), "--force"]) == 0
    if not option:
        assert ('id="movements"' in target.read_text()) == drawn
