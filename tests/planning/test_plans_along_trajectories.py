"""Plans along trajectories: worth what their simulated measurements are; rows of scanners against a closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml

from mor.api.pipeline import determinable_start, levels, make_problem, read_document, read_network
from mor.api.plan import at_its_place, read_plan, solve_plan
from mor.api.simulation import simulated
from mor.errors import InputError
from mor.plan.simulation import Wishes
from mor.project.network import Network
from mor.quality.assessment import assess
from mor.quality.solution import Solved, with_poses
from mor.report.output_folder import reserve
from mor.solve.iterate import SolverSettings, adjust
from sample_projects.expected import ROOT
from tests.scenarios.small_projects import mor, write

STRIP = ROOT / "three_line_strip" / "project.yaml"
MEASURED = {
    "trajectory_position": ("x", "y", "z"),
    "trajectory_attitude": ("omega", "phi", "kappa"),
    "image": ("x", "y"),
}


def _simulated(path: Path, folder: Path, seed: int = 1, noise: bool = False) -> Network:
    simulation = simulated(path, "", seed=seed, wishes=Wishes(), noise=noise)
    with reserve(folder, False) as place:
        simulation.write(place)
    return simulation.network


def _placed(folder: Path) -> Network:
    return at_its_place(read_plan(read_document(folder / "project.yaml"), folder).network)


def _adjusted(folder: Path) -> Solved:
    """The adjustment and its quality, without the search for the causes of residuals that are too small."""
    network, start = determinable_start(read_network(read_document(folder / "project.yaml"), folder))
    adjustment = adjust(make_problem(network, start, start), start, SolverSettings(50))
    return with_poses(
        Solved(network, adjustment, assess(adjustment, levels(network.project.settings), aposteriori=False))
    )


def _without_values(folder: Path, target: Path) -> None:
    """The simulated project as a plan: nothing of what it measured is left."""
    target.mkdir()
    for file in folder.iterdir():
        kind = file.stem.split("_", 2)[-1]
        if file.name.startswith("observations_"):
            pl.read_csv(file, infer_schema=False).drop(MEASURED[kind]).write_csv(target / file.name)
        else:
            (target / file.name).write_bytes(file.read_bytes())


def _same_quality(one: Solved, other: Solved) -> None:
    assert one.quality is not None
    assert other.quality is not None
    for ours, theirs in zip(one.quality.groups, other.quality.groups, strict=True):
        np.testing.assert_allclose(ours.r, theirs.r, rtol=0.0, atol=1e-9)
    for kind in one.quality.cofactors:
        sigma = [
            np.sqrt(np.maximum(np.diagonal(solved.quality.cofactors[kind], axis1=1, axis2=2), 0.0))
            for solved in (one, other)
            if solved.quality is not None
        ]
        np.testing.assert_allclose(sigma[0], sigma[1], rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_sigma_and_r_of_planned_lines_without_values(tmp_path: Path) -> None:
    _simulated(STRIP, tmp_path / "there")
    _without_values(tmp_path / "there", tmp_path / "plan")
    network = read_plan(read_document(tmp_path / "plan" / "project.yaml"), tmp_path / "plan").network
    assert len(network.unmeasured) == 3
    adjusted = _adjusted(tmp_path / "there")
    assert adjusted.quality is not None
    assert adjusted.quality.omega < 1e-9
    _same_quality(solve_plan(at_its_place(network)), adjusted)
    found = mor("design", tmp_path / "plan" / "project.yaml", "-o", tmp_path / "design")
    assert found.code == 0
    images = pl.read_csv(tmp_path / "design" / "images.csv")
    assert images["sz"].is_not_null().all() if "sz" in images.columns else images.height == 6


@pytest.mark.slow
def test_planned_rows_are_where_the_sample_was_measured(tmp_path: Path) -> None:
    """The sample has rows of code of its own; at the adjusted place ours differ from them by its residuals."""
    assert mor("adjust", STRIP, "-o", tmp_path / "results", "--quiet").code == 0
    adjusted = read_document(tmp_path / "results" / "adjusted.yaml")
    placed = at_its_place(read_plan(adjusted, tmp_path / "results").network)
    measured = read_network(read_document(STRIP), STRIP.parent)
    ours = [g for g in placed.groups if g.type.key.startswith("line scanner")]
    theirs = [g for g in measured.groups if g.type.key.startswith("line scanner")]
    assert len(ours) == len(theirs) == 3
    for one, other in zip(ours, theirs, strict=True):
        apart = (one.observed - other.observed) / other.sigma
        assert 0.5 < np.sqrt(np.mean(apart**2)) < 1.1
        assert np.abs(apart).max() < 5.0


FLIGHT = """\
mor: 1
units: {length: m, angle: deg}
cameras:
  line:
    image: {width: 4000, height: 1, pixel: 10 um}
    coordinates: corner
    line: 5
    interior: {c: 50}
    line_time: 2 ms
  frame: {r0: 10, interior: {c: {observed: 50, sigma: 0.1}, A1: 1e-5}, model: MODEL,
          image: {width: 6000, height: 6000, pixel: 10 um}}
trajectories:
  - columns: [trajectory, time, x, y, z, omega, phi, kappa]
    rows: [[north, 0, 0, 0, 1000, 0, 0, 0], [north, 4, 0, 200, 1000, 0, 0, 0],
           [north, 8, 0, 400, 1000, 0, 0, 0], [north, 12, 0, 600, 1000, 0, 0, 0]]
    smoothness: {position: 0.1 m/s^2, attitude: 0.1 deg/s^2}
images:
  - {columns: [id, camera, trajectory, time], rows: [[L, line, north, 0.5], [F, frame, north, 3.1],
                                                              [G, frame, north, 7.3]]}
points:
  - {columns: [id, x, y, z], rows: [[A, 150, 250, 0], [B, -200, 400, 40], [C, 50, 310, 20], [D, -90, 600, 10],
                                    [E, 120, 450, 5], [H, -150, 280, 30]], values: {sigma: 0.02}}
instruments:
  gnss:
    lever_arm: {rx: {observed: 0.2, sigma: 0.01}, ry: 0, rz: 1}
    position: {shift_x: {observed: 0.3, sigma: 0.1}}
  ins: {boresight: {omega: {observed: 0.1, sigma: 0.01}, phi: {observed: -0.2, sigma: 0.01}}}
observations:
  - {type: trajectory_position, instrument: gnss, columns: [trajectory, time], values: {sigma: 0.05},
     rows: [[north, 0], [north, 2], [north, 4], [north, 6], [north, 8], [north, 10], [north, 12]]}
  - {type: trajectory_attitude, instrument: ins, columns: [trajectory, time], values: {sigma: 0.01},
     rows: [[north, 0], [north, 2], [north, 4], [north, 6], [north, 8], [north, 10], [north, 12]]}
  - {type: image, columns: [image, point], values: {sigma: 0.5}, units: {sigma: px}, name: lines,
     rows: [[L, A], [L, B], [L, C], [L, D], [L, E], [L, H]]}
  - {type: image, columns: [image, point], values: {sigma: 0.005}, name: frames,
     rows: [[F, A], [F, B], [F, C], [F, D], [F, E], [F, H], [G, A], [G, B], [G, C], [G, D], [G, E], [G, H]]}
"""


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("model", ["mor", "brown"])
def test_a_level_flight_scans_in_closed_form(tmp_path: Path, model: str, interpolation: str) -> None:
    """Y0(t) = Y − a (Z0 − Z)/c at 50 m/s; straight flights are straight whatever the interpolation."""
    text = FLIGHT.replace("model: MODEL", f"model: {model}")
    if model == "brown":
        text = text.replace("r0: 10, ", "").replace("A1: 1e-5", "K1: 1e-5")
    write(tmp_path, text.replace("    smoothness", f"    interpolation: {interpolation}\n    smoothness"))
    placed = _placed(tmp_path)
    group = next(g for g in placed.groups if g.name == "lines")
    points = np.array([[150, 250, 0], [-200, 400, 40], [50, 310, 20], [-90, 600, 10], [120, 450, 5], [-150, 280, 30]])
    down = 1000.0 - points[:, 2]
    rows = ((points[:, 1] - 5.0 * down / 50.0) / 50.0 - 0.5) / 0.002
    scale = placed.scales["line"]
    np.testing.assert_allclose(scale.centre[1] - group.observed[:, 1] / scale.pixel, rows, atol=1e-7)
    np.testing.assert_allclose(group.observed[:, 0], 50.0 * points[:, 0] / down, atol=1e-9)


@pytest.mark.parametrize("model", ["mor", "brown"])
def test_flights_with_all_that_is_observed_of_them(tmp_path: Path, model: str) -> None:
    text = FLIGHT.replace("model: MODEL", f"model: {model}")
    if model == "brown":
        text = text.replace("r0: 10, ", "").replace("A1: 1e-5", "K1: 1e-5")
    write(tmp_path / "plan", text)
    _simulated(tmp_path / "plan" / "project.yaml", tmp_path / "there")
    adjusted = _adjusted(tmp_path / "there")
    assert adjusted.quality is not None
    assert adjusted.quality.omega < 1e-9
    _same_quality(solve_plan(_placed(tmp_path / "plan")), adjusted)


def test_the_path_stays_as_it_is_planned_where_it_is_not_smooth(tmp_path: Path) -> None:
    text = FLIGHT.replace("model: MODEL", "model: mor").replace("[north, 8, 0, 400,", "[north, 8, 30, 400,")
    write(tmp_path, text)
    placed = _placed(tmp_path)
    blocks = placed.trajectories["north"].positions
    np.testing.assert_allclose(placed.start["point"][blocks][:, 0], [0, 0, 30, 0], atol=1e-12)


@pytest.mark.slow
def test_errors_of_what_instruments_are_observed_to_have(tmp_path: Path) -> None:
    """Lever arm and misalignment are given beside the truth; the shift of a strip is true beside what is given."""
    write(tmp_path / "plan", FLIGHT.replace("model: MODEL", "model: mor"))
    drawn = []
    for seed in range(1, 25):
        _simulated(tmp_path / "plan" / "project.yaml", tmp_path / str(seed), seed, noise=True)
        given = yaml.safe_load((tmp_path / str(seed) / "project.yaml").read_text())["instruments"]
        truth = pl.read_csv(tmp_path / str(seed) / "truth.csv")
        shift = truth.filter(pl.col("component") == "shift_x", pl.col("id") != "none")["value"].item()
        boresight = str(given["ins"]["boresight"]["omega"]["observed"]).removesuffix(" deg")
        drawn.append(
            [
                (float(given["gnss"]["lever_arm"]["rx"]["observed"]) - 0.2) / 0.01,
                (float(boresight) - 0.1) / 0.01,
                (shift - 0.3) / 0.1,
            ]
        )
        assert given["gnss"]["position"]["shift_x"]["observed"] == 0.3
    size = np.std(np.array(drawn), axis=0)
    assert (size > 0.6).all()
    assert (size < 1.5).all()
    adjusted = _adjusted(tmp_path / "1")
    assert adjusted.quality is not None
    assert 0.5 < adjusted.quality.sigma0 < 1.5


def test_points_that_do_not_come_before_the_line_are_told(tmp_path: Path) -> None:
    write(
        tmp_path,
        FLIGHT.replace("model: MODEL", "model: mor").replace("[D, -90, 600, 10]", "[D, -90, 900, 10]"),
    )
    with pytest.raises(InputError, match="point 'D' does not cross the line of image 'L' where it is planned"):
        _placed(tmp_path)
    found = mor("design", tmp_path / "project.yaml", "-o", tmp_path / "out", "--lang", "de")
    assert found.code == 2
    assert "Punkt 'D' kommt nicht vor die Zeile von Bild 'L'" in found.err
    assert not (tmp_path / "out").exists()


def test_what_frames_see_from_a_trajectory(tmp_path: Path) -> None:
    listed = FLIGHT.replace("model: MODEL", "model: mor")
    begin = listed.index("columns: [image, point], values: {sigma: 0.005}, name: frames")
    rows = listed[begin : listed.index("}\n", begin + 60)]
    seen = listed.replace(rows, "visible: {at: [F, G]}, values: {sigma: 0.005}, name: frames")
    write(tmp_path / "listed", listed)
    write(tmp_path / "seen", seen)
    of_both = [solve_plan(_placed(tmp_path / name)) for name in ("listed", "seen")]
    _same_quality(*of_both)
    write(tmp_path / "lines", seen.replace("at: [F, G]", "at: [L]"))
    found = mor("design", tmp_path / "lines" / "project.yaml", "-o", tmp_path / "out")
    assert found.code == 2
    assert "visible: camera 'line' is a line scanner: list the points that its images have" in found.err


def test_turns_of_a_frame_are_written_in_the_unit_they_are_read_in(tmp_path: Path) -> None:
    text = """\
mor: 1
units: {length: m, angle: gon}
world: {crs: "EPSG:25832", heights: ellipsoidal}
points:
  - {columns: [id, east, north, height], rows: [[A, 600000, 5500000, 100], [B, 603000, 5501000, 200]], fixed: [x, y, z]}
  - {columns: [id, east, north, height], rows: [[C, 601000, 5502000, 150]]}
instruments: {s: {frame: {turn_x: {observed: 0.01, sigma: 0.001}}}}
observations:
  - {type: gnss_vector, instrument: s, columns: [from, to], rows: [[A, C], [B, C]], values: {sigma: 0.01}}
"""
    write(tmp_path / "plan", text)
    _simulated(tmp_path / "plan" / "project.yaml", tmp_path / "there")
    adjusted = _adjusted(tmp_path / "there")
    assert adjusted.quality is not None
    assert adjusted.quality.omega < 1e-6
