"""``results.json``, the adjusted project and the page of domains: those of one machine, key by key."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from tests.domains_compared import ELSEWHERE, both, differences, have_small_domains, results
from tests.scenarios.domains_blocks import Kind, command, write_block

pytestmark = pytest.mark.slow


@pytest.fixture
def small_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    have_small_domains(monkeypatch)


MINIMAL = "{minimal: {xyz: [P1, P40], z: P7}}"
BLOCKS = {
    "minimal": Kind(convergent=True, points=150, gnss=False, datum=MINIMAL),
    "control and sights": Kind(control=6, sights=30),
    "free": Kind(convergent=True, points=150, gnss=False, datum="free"),
    "free over named points": Kind(
        convergent=True, points=150, gnss=False, datum="{free: [P1, P2, P3, P5, P7, P11, P40]}"
    ),
}


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize("name", BLOCKS)
def test_results_are_those_of_one_machine(name: str, tmp_path: Path) -> None:
    one, several = both(tmp_path, BLOCKS[name])
    assert several["iterations"] > 0
    if name == "minimal":  # the anchors are others, and so are the steps into a datum of few points
        one["iterations"] = several["iterations"]
    assert len(several["points"]) == pl.read_csv(tmp_path / "one" / "points.csv").height
    assert one["gross_errors"]["suspicious"]
    assert one["reliability"]["observations"] or name != "control and sights"
    undecided = {
        json.dumps([row["of"], row["name"]])
        for row in several["verdict"]["groups"]
        if row["of"] == "image" and any("not decided" in note["message"] for note in several["notes"])
    }
    found = [
        line
        for line in differences(
            *({k: v for k, v in each.items() if k not in ELSEWHERE} for each in (one, several))
        )
        if not ("/verdict/groups/" in line and any(group in line for group in undecided))
    ]
    assert found == []


@pytest.mark.usefixtures("small_domains")
def test_checks_take_no_part_and_are_told(tmp_path: Path) -> None:
    kept_out = "checks:\n  - {type: distance"
    one, several = both(
        tmp_path,
        Kind(sights=20),
        **{"  - {type: distance": f"{kept_out}", "  - {type: height": "  - {type: height"},
    )
    assert one["checks"]
    assert differences(one["checks"], several["checks"]) == []
    assert several["observations"] == one["observations"]
    assert several["sigma0"]["aposteriori"] == pytest.approx(one["sigma0"]["aposteriori"], rel=1e-10)
    tables = [pl.read_csv(tmp_path / name / "residuals.csv") for name in ("one", "several")]
    assert [(table["flag"] == "check").sum() for table in tables] == [40, 40]


@pytest.mark.usefixtures("small_domains")
def test_the_adjusted_project_stands_still_at_the_same_solution(tmp_path: Path) -> None:
    one, _ = both(tmp_path, Kind(control=6, sights=10))
    again = command("adjust", tmp_path / "several" / "adjusted.yaml", "-o", tmp_path / "again")
    assert again.exit_code == 0, again.stderr
    found = results(tmp_path / "again")
    assert found["iterations"] <= 2
    assert found["sigma0"]["aposteriori"] == pytest.approx(one["sigma0"]["aposteriori"], rel=1e-9)
    here, there = (pl.read_csv(tmp_path / name / "reference.csv").sort("id") for name in ("one", "several"))
    assert here["id"].equals(there["id"])
    assert here.select("x", "y", "z").to_numpy() == pytest.approx(
        there.select("x", "y", "z").to_numpy(), abs=1e-12
    )


@pytest.mark.usefixtures("small_domains")
def test_the_page_says_what_that_of_one_machine_says(tmp_path: Path) -> None:
    both(tmp_path, Kind(sights=10))
    pages = [(tmp_path / name / "report.html").read_text(encoding="utf-8") for name in ("one", "several")]
    told = [page.partition('<section id="network"')[0].partition("<body")[2] for page in pages]
    files = [page.replace(" 1 note under Files.", "") for page in told]
    assert len(files[0]) > 1000
    assert files[0] == files[1]


@pytest.mark.usefixtures("small_domains")
def test_programs_that_read_results_read_those_of_domains(tmp_path: Path) -> None:
    both(tmp_path, Kind())
    done = command("covariance", tmp_path / "several", "--points", "P1,P2", "-o", tmp_path / "q.npz")
    assert done.exit_code == 0, done.stderr
    assert command("compare", tmp_path / "one", tmp_path / "several").exit_code in (0, 1)


@pytest.mark.usefixtures("small_domains")
def test_no_solution_has_results_without_numbers(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(gnss=False))
    done = command("adjust", project, "-o", tmp_path / "out", "--memory", "400MB")
    assert done.exit_code == 4
    found = results(tmp_path / "out")
    assert (found["outcome"], found["solution"], found["sigma0"]) == ("singular", False, None)
    assert not (tmp_path / "out" / "adjusted.yaml").exists()


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize("sights", [0, 200])
def test_fixed_points_are_tested(sights: int, tmp_path: Path) -> None:
    """Sights are in a domain of their own, and name most points."""
    observed = "{sigma_x: '0.02', sigma_y: '0.02', sigma_z: '0.02'}"
    fixed = "{sigma_x: '0', sigma_y: '0', sigma_z: '0'}"
    one, several = both(tmp_path, Kind(control=8, sights=sights), **{observed: fixed})
    assert len(one["fixed_points"]) == 8
    assert differences(one["fixed_points"], several["fixed_points"]) == []


@pytest.mark.usefixtures("small_domains")
def test_gross_errors_reject_the_same_groups_and_move_the_same_points(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(control=6))
    rays = pl.read_parquet(project.parent / "rays.parquet")
    wrong = (pl.int_range(pl.len()) % 97 == 5) | (pl.col("image") == "I7")
    rays.with_columns(x=pl.col("x") + 0.03 * wrong * (pl.int_range(pl.len()) % 3 - 1)).write_parquet(
        project.parent / "rays.parquet"
    )
    for folder, options in (("one", ()), ("several", ("--memory", "400MB", "--no-html"))):
        done = command("adjust", project, "-o", tmp_path / folder, *options)
        assert done.exit_code == 0, done.stderr
    one, several = results(tmp_path / "one"), results(tmp_path / "several")
    assert one["verdict"]["rejected"] > 0
    assert len(one["gross_errors"]["suspicious"]) > 20
    assert differences(one["gross_errors"], several["gross_errors"]) == []
    rejected = [
        {(row["of"], row["name"]) for row in each["verdict"]["groups"] if row["rejected"]}
        for each in (one, several)
    ]
    assert rejected[0] == rejected[1]
    assert one["verdict"]["all_alike"] == several["verdict"]["all_alike"]
    assert several["verdict"]["explanations"] == []  # not looked for, which a note says
    assert any("is not looked for" in note["message"] for note in several["notes"])
    for folder in ("one", "several"):
        said = " ".join((tmp_path / folder / "report.txt").read_text(encoding="utf-8").split())
        assert "image I7 (sigma times" in said


@pytest.mark.usefixtures("small_domains")
def test_sigma_of_distances_are_those_of_the_result(tmp_path: Path) -> None:
    """Start values that are far off have σ that the results must not have."""
    given = "{type: distance, file: distances.parquet,"
    grows = "{type: distance, ppm: 50, centring: {instrument: 0.002, target: 0.003}, file: distances.parquet,"
    kind = Kind(control=6, sights=30)
    one, several = both(tmp_path, kind, **{given: grows})
    project, table = tmp_path / "block" / "project.yaml", tmp_path / "block" / "points.parquet"
    moved = pl.read_parquet(table).with_columns(x=pl.col("x") + 40.0 * (pl.int_range(pl.len()) % 3 - 1))
    moved.write_parquet(table)
    for folder, options in (("one", ()), ("several", ("--memory", "400MB"))):
        done = command("adjust", project, "-o", tmp_path / folder, "--force", "--no-html", *options)
        assert done.exit_code == 0, done.stderr
    far = results(tmp_path / "one"), results(tmp_path / "several")
    for found in (several, *far):
        assert found["sigma0"]["aposteriori"] == pytest.approx(one["sigma0"]["aposteriori"], rel=1e-9)
        assert differences(one["points"], found["points"]) == []
    tables = [pl.read_csv(tmp_path / name / "residuals.csv") for name in ("one", "several")]
    sigma = [table.filter(pl.col("type") == "distance").sort("from", "to")["sigma"] for table in tables]
    assert sigma[0].n_unique() > 10
    assert sigma[0].to_numpy() == pytest.approx(sigma[1].to_numpy(), rel=1e-9)


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize(
    ("datum", "told"),
    [
        (
            "{minimal: {xyz: [P1, P40, P7]}}",
            "minimal names 9 free coordinates, but the network has 7 free movements",
        ),
        ("{minimal: {xyz: [P1, P40], z: NOPE}}", "'NOPE'"),
        ("{free: [P1, P2, P3, NOPE]}", "'NOPE'"),
    ],
)
def test_a_datum_that_cannot_be_is_told_as_on_one_machine(datum: str, told: str, tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(convergent=True, points=150, gnss=False, datum=datum))
    said = []
    for options in ((), ("--memory", "400MB")):
        done = command("adjust", project, "-o", tmp_path / "out", *options)
        assert done.exit_code == 2
        assert told in done.stderr
        said.append([line for line in done.stderr.splitlines() if told in line])
    assert said[0][0].partition("; ")[0] == said[1][0].partition("; ")[0]
