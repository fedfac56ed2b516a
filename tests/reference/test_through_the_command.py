"""Every reference network, sample and case through the command, all written: a documented end, finite values."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.reference import test_aicon, test_camcal, test_sxb
from tests.reference_data import NETWORKS, network_name, reference_file
from tests.scenarios.small_projects import Run, mor

TESTS = Path(__file__).parents[1]
SAMPLES, CASES = TESTS.parent / "sample_projects", TESTS / "cases"
DOCUMENTED = {0, 2, 3, 4}
NOT_A_NUMBER = re.compile(r"(?<![\w.])[+-]?(nan|inf|infinity)(?![\w.])", re.IGNORECASE)


class Project(NamedTuple):
    """A project file or a foreign file; ``text``: a project file that is written for the tables of a data set."""

    place: str | Path
    text: str = ""


BLOCKS = {
    "aicon": Project("aicon-115", test_aicon.project(disturbed=False)),
    "camcal": Project("camcal", test_camcal.project("reference_model3")),
    "camcal forward": Project("camcal", test_camcal.project("reference_model_forward")),
    "camcal free": Project("camcal", test_camcal.project("free_network_model3")),
    "sxb": Project("sxb-s4", test_sxb.PROJECT),
    "aicon flat files": Project("aicon-115/example.obc"),
    "camcal-pmexport": Project("camcal/camcal-pmexport.txt"),
}
"""Large blocks of the reference data."""
SETTLED_CASES = {
    "control_2full_1height/project.yaml",
    "control_3plan_3height/project.yaml",
    "control_crash_70/project.yaml",
    "control_far_says_datum_undefined/project.yaml",
    "control_rough_poses/project.yaml",
    "correlated_vector_crash.yaml",
    "dynamic_datum_crash.dat",
    "one_direction_in_a_set/project.yaml",
    "set_in_two_tables.yaml",
    "shared_covariance_crash.yaml",
    "theodolite_and_two_images/project.yaml",
    "vectors_crash_70/project.yaml",
}
"""Cases that have to be adjusted; of the others a documented end is asked here."""

LONG_SAMPLES = {"drone_block", "dam", "three_line_strip"}
LONG_CASES = {"line_free_system/project.yaml", "mixture_in_a_bent_valley.yaml"}


def _found() -> list[object]:
    found: list[object] = [pytest.param(project, True, id=name) for name, project in BLOCKS.items()]
    for number, path in enumerate(NETWORKS):
        marks = [pytest.mark.slow] if number % 6 else []  # the default run adjusts them all in test_networks
        found.append(pytest.param(Project(path), True, id=network_name(path), marks=marks))
    for path in sorted(SAMPLES.glob("*/project.yaml")):
        marks = [pytest.mark.slow] if path.parent.name in LONG_SAMPLES else []
        found.append(pytest.param(Project(path), True, id=path.parent.name, marks=marks))
    for path in sorted((*CASES.glob("*/project.yaml"), *CASES.glob("*.yaml"), *CASES.glob("*.dat"))):
        name = path.relative_to(CASES).as_posix()
        marks = [pytest.mark.slow] if name in LONG_CASES else []
        found.append(pytest.param(Project(path), name in SETTLED_CASES, id=name, marks=marks))
    return found


def _adjusted(project: Project, folder: Path) -> Run:
    place = reference_file(project.place) if isinstance(project.place, str) else project.place
    if project.text:
        for path in place.iterdir():
            (folder / path.name).symlink_to(path)
        place = folder / "project.yaml"
        place.write_text(project.text, encoding="utf-8")
    return mor("adjust", place, "-o", folder / "out", "--html", "--tables", "all")


@pytest.mark.parametrize(("project", "solvable"), _found())
def test_ends_as_documented_and_every_value_is_finite_or_null(project: Project, solvable: bool, tmp_path: Path) -> None:
    done, out = _adjusted(project, tmp_path), tmp_path / "out"
    assert done.code in ({0} if solvable else DOCUMENTED), done.err
    assert not NOT_A_NUMBER.search(done.err), done.err
    if done.code == 2:
        assert not out.exists()
        return
    results = json.loads((out / "results.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    text = (out / "report.txt").read_text(encoding="utf-8")
    assert not NOT_A_NUMBER.search(text), NOT_A_NUMBER.search(text)
    if done.code != 0:
        return
    assert results["redundancy_sum"] == pytest.approx(results["redundancy"], abs=1e-6 * results["observations"])
    assert (out / "report.html").stat().st_size > 10_000
    tables = list(out.glob("*.csv"))
    assert {"residuals.csv", "points.csv", "images.csv"} <= {path.name for path in tables}
    for path in tables:
        _check_table(path)


def _check_table(path: Path) -> None:
    with path.open(newline="", encoding="utf-8") as file:
        for number, row in enumerate(csv.reader(file), 1):
            wrong = [cell for cell in row if NOT_A_NUMBER.fullmatch(cell)]
            assert not wrong, f"{path.name}:{number}: {row}"
