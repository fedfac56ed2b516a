"""The front door for Python: the same numbers as the command, from files and without them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml

import mor
from tests.scenarios.small_projects import block, write_block

ROOT = Path(__file__).parents[2]
FACADE = ROOT / "sample_projects" / "facade" / "project.yaml"


@pytest.fixture(scope="module")
def facade() -> mor.Result:
    return mor.adjust(FACADE)


def levelling(**changes: Any) -> dict[str, Any]:
    """A loop of three height differences in metres, misclosed by 3 mm, of equal weight; one height given."""
    return {
        "datum": "fixed",
        "points": [
            {"columns": ["id", "x", "y", "z"], "rows": [["A", 0, 0, 10]], "fixed": ["x", "y", "z"]},
            {
                "columns": ["id", "x", "y", "z"],
                "rows": [["B", 10, 0, 11], ["C", 5, 5, 13]],
                "fixed": ["x", "y"],
            },
        ],
        "observations": [
            {
                "type": "height_difference",
                "file": pl.DataFrame({"from": ["A", "B", "C"], "to": ["B", "C", "A"], "dz": [1.0, 2.0, -3.003]}),
                "values": {"sigma": 0.001},
                **changes,
            }
        ],
    }


def test_import_loads_nothing() -> None:
    code = "import sys, mor; sys.exit(bool({'numpy', 'scipy', 'polars', 'numba', 'yaml'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_every_name_is_there_and_documented() -> None:
    for name in mor.__all__:
        assert getattr(mor, name).__doc__ or name == "__version__"
    with pytest.raises(AttributeError, match="no attribute 'adjuts'"):
        mor.adjuts  # noqa: B018


def test_numbers_are_those_of_the_command(facade: mor.Result, tmp_path: Path) -> None:
    from mor.cli import run

    assert run(["adjust", str(FACADE), "-o", str(tmp_path / "results"), "-q"]) == 0
    facade.write(tmp_path / "again", tables="all")
    for name in ("results.json", "report.txt", "points.csv", "residuals.csv", "adjusted.yaml"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "results" / name).read_bytes()
    written = json.loads((tmp_path / "results" / "results.json").read_text())
    assert facade.sigma0 == written["sigma0"]["aposteriori"]
    assert facade.redundancy == written["redundancy"]
    assert facade.points.frame.height == len(written["points"])


def test_a_project_of_dictionaries_and_frames_is_the_project_of_the_files(facade: mor.Result) -> None:
    data = yaml.safe_load(FACADE.read_text())
    for section in ("images", "points", "observations"):
        for table in data[section]:
            text = dict.fromkeys(("id", "image", "point", "from", "to", "camera", "at"), pl.String)
            table["file"] = pl.read_csv(FACADE.parent / table["file"], schema_overrides=text, comment_prefix="#")
    built = mor.adjust(data)
    assert built.points.frame.equals(facade.points.frame)
    assert built.to_dict()["sigma0"] == facade.to_dict()["sigma0"]


def test_a_loop_of_levels_by_hand() -> None:
    result = mor.adjust(levelling())
    assert result.converged
    assert result.redundancy == 1
    assert result.points.row("B")["z"] == pytest.approx(11.001, abs=1e-12)
    assert result.points.row("C")["z"] == pytest.approx(13.002, abs=1e-12)
    assert result.sigma0 == pytest.approx(np.sqrt(3.0), rel=1e-12)
    assert result.cofactor("B").matrix == pytest.approx(np.array([[2.0 / 3.0 * 1e-6]]), rel=1e-12)
    assert result.observations.frame["r"].to_list() == pytest.approx([1 / 3] * 3, abs=1e-6)


def test_what_is_flagged_alone_is_not_accepted_either(tmp_path: Path) -> None:
    rows = block(noise=0.002)
    assert mor.adjust(write_block(tmp_path / "good", rows=rows)).accepted
    rows.rays[5][2] += 0.012
    result = mor.adjust(write_block(tmp_path / "wrong", rows=rows))
    assert result.to_dict()["global_test"]["accepted"]
    assert not result.accepted


def test_frames_of_other_libraries_are_taken() -> None:
    class Frame:
        """A data frame as others have it: columns, and arrays by name."""

        columns = ("from", "to", "dz")

        def __getitem__(self, name: str) -> np.ndarray:
            columns: dict[str, list[Any]] = {
                "from": ["A", "B", "C"],
                "to": ["B", "C", "A"],
                "dz": [1.0, 2.0, -3.003],
            }
            return np.array(columns[name], dtype=None if name == "dz" else object)

    assert mor.adjust(levelling(file=Frame())).sigma0 == mor.adjust(levelling()).sigma0


def test_units_stand_with_the_columns(facade: mor.Result) -> None:
    assert facade.points.units["x"] == "m"
    assert facade.images.units["omega"] == "deg"
    assert facade.cameras.frame.filter(pl.col("component") == "A1")["unit"].item() == "1/mm^2"
    with pytest.raises(KeyError, match="'CPI'; did you mean 'CP"):
        facade.points.row("CPI")


def test_mistakes_say_where_they_stand() -> None:
    data = levelling(values={"sigmaa": 1.0}, typ="x")
    data["observations"][0]["file"] = pl.DataFrame({"from": ["A"], "to": ["D"], "dz": [1.0]})
    with pytest.raises(mor.InputError) as found:
        mor.read(data)
    assert str(found.value) == (
        "observations[0].typ: unknown key 'typ'; did you mean 'type'? (known here: "
        + str(found.value).split("known here: ")[1]
    )
    del data["observations"][0]["typ"]
    with pytest.raises(mor.InputError, match=r"observations\[0\].*sigmaa"):
        mor.read(data)
    data["observations"][0]["values"] = {"sigma": 0.001}
    with pytest.raises(mor.InputError, match=r"observations\[0\]:1: .*'D'"):
        mor.read(data)
    with pytest.raises(mor.InputError, match=r"points\[0\]\.rows: found object"):
        mor.read({"points": [{"rows": object()}]})


def test_no_solution_is_an_outcome_and_its_tables_are_not_there() -> None:
    data = levelling()
    data["observations"][0]["file"] = pl.DataFrame({"from": ["A"], "to": ["B"], "dz": [1.0]})
    result = mor.adjust(data)
    assert result.outcome == "singular"
    assert not result.converged
    assert not result.accepted
    assert "singular" in str(result).lower() or result.reason in str(result)
    with pytest.raises(mor.NoSolutionError, match=result.reason):
        _ = result.points


def test_another_datum_is_that_of_a_direct_adjustment() -> None:
    path = ROOT / "sample_projects" / "test_field" / "project.yaml"
    result = mor.adjust(path)
    project = mor.read(path)
    names = result.points["id"].to_list()[:4]
    carried = result.in_datum(f"free: [{', '.join(names)}]")
    data = {**project.document.data, "datum": {"free": names}}
    direct = mor.adjust(data | {"mor": 1}) if not project.document.table_files() else None
    if direct is None:
        direct = mor.adjust(mor.read(data, path.parent))
    for name in "xyz":
        np.testing.assert_allclose(carried.points[name], direct.points[name], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(carried.points[f"s{name}"], direct.points[f"s{name}"], rtol=1e-7, atol=1e-13)
    np.testing.assert_allclose(carried.observations["r"], result.observations["r"], rtol=0.0, atol=1e-6)


def test_a_datum_that_leaves_heights_open_says_which_movement() -> None:
    network = levelling() | {"datum": "free"}
    for points in network["points"]:
        points["fixed"] = ["x", "y"]
    with pytest.raises(mor.InputError, match=r"(?s)no solution: .*movement of the whole network open: translation Z"):
        mor.adjust(network).in_datum("fixed")


def test_written_without_files_it_is_read_again(tmp_path: Path) -> None:
    result = mor.adjust(levelling())
    result.write(tmp_path / "results", html=False)
    again = mor.adjust(tmp_path / "results" / "adjusted.yaml")
    assert again.points.frame.equals(result.points.frame)


def test_notebooks_show_summary_and_network(facade: mor.Result) -> None:
    pytest.importorskip("matplotlib")
    shown = facade._repr_html_()
    assert "sigma0" in shown
    assert "<svg" in shown
    assert "[m]" in facade.points._repr_html_()
