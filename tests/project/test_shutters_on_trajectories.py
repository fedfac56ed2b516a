"""Rolling shutters on trajectories: against a simulation of their own, against images with a motion, in projects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import determinable_start, make_problem, read_document, read_network
from mor.api.simulation import simulated as planned_at
from mor.model.images import MOVING_TYPES, shutter_on_trajectory
from mor.model.motion import linear_weights, pose_at
from mor.model.rotations import exponential, rotation_from_angles
from mor.plan.simulation import Wishes
from mor.project.entities import Trajectory
from mor.solve.iterate import SolverSettings, adjust
from tests.mistakes import mistakes
from tests.scenarios.shutter_flights import READOUT, Files, Moment, moments, simulated
from tests.scenarios.small_projects import Run, mor
from tests.selection import slow_after

NAMES = ("x", "y", "z", "omega", "phi", "kappa")
KNOWN = ", ".join(NAMES)
OBSERVED = "    values: {" + ", ".join(f"sigma_{name}: {0.02 if len(name) == 1 else 0.05}" for name in NAMES) + "}\n"


def written(folder: Path, given: Files, *changes: tuple[str, str]) -> Path:
    """The files of a flight, the project file with changes."""
    folder.mkdir()
    text = given.files["project.yaml"]
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    for name, content in {**given.files, "project.yaml": text}.items():
        (folder / name).write_text(content, encoding="utf-8")
    return folder / "project.yaml"


def adjusted(project: Path, target: Path) -> tuple[Run, dict]:
    run = mor("adjust", project, "--no-html", "-o", target)
    found = target / "results.json"
    return run, json.loads(found.read_text(encoding="utf-8")) if found.exists() else {}


def readout_of(found: dict) -> dict:
    return next(row for row in found["others"] if row["kind"] == "readout")["components"]["readout"]


@pytest.mark.parametrize("cubic", slow_after(1, [False, True]))
def test_points_are_where_an_independent_simulation_sees_them(tmp_path: Path, cubic: bool) -> None:
    """Without errors of measurement; half of the images are read out across a knot."""
    given = simulated(0, cubic, "{free: 30 ms}", strips=1)
    project = written(tmp_path / "p", given)
    network, start = determinable_start(read_network(read_document(project), project.parent))
    found = adjust(make_problem(network, start, start), start, SolverSettings(30))
    assert found.values["readout"][0, 0] == pytest.approx(READOUT, abs=1e-10)
    places = found.values["point"][network.things["point"].parts["position"]]
    true = np.stack([given.points[name] for name in network.things["point"].ids])
    np.testing.assert_allclose(places, true, atol=1e-8)
    assert len({tuple(row) for row in np.stack(network.groups[0].blocks[:2]).T.tolist()}) > 12


@pytest.mark.slow
def test_readout_time_is_recovered_whatever_it_starts_with(tmp_path: Path) -> None:
    """Which rows belong to which interval is settled at the result: the adjusted project stands still."""
    found = []
    for number, start in enumerate(("0", "20 ms")):
        project = written(tmp_path / f"p{number}", simulated(3, readout=f"{{free: {start}}}", strips=1))
        run, results = adjusted(project, tmp_path / f"out{number}")
        assert run.code == 0, run.err
        found.append(readout_of(results))
    assert found[0]["value"] == pytest.approx(found[1]["value"], rel=1e-9)
    assert abs(found[1]["value"] - READOUT) < 4.0 * found[1]["sigma"]
    assert found[1]["sigma"] < 0.0005
    _, again = adjusted(tmp_path / "out1" / "adjusted.yaml", tmp_path / "again")
    assert again["iterations"] == 1
    assert readout_of(again)["value"] == pytest.approx(found[1]["value"], rel=1e-9)
    assert readout_of(again)["sigma"] == pytest.approx(found[1]["sigma"], rel=1e-6)


def test_a_steady_flight_is_an_image_with_a_motion() -> None:
    """Image coordinates and their derivatives, at the pose, velocity and rate that the trajectory has."""
    random, n = np.random.default_rng(4), 30
    places = random.normal(0.0, 1.0, (n, 2, 3)) + np.array([[0.0, 0.0, 60.0], [9.0, 2.0, 60.0]])
    turns = rotation_from_angles(random.normal(0.0, 0.1, (n, 2, 3)))
    weights, since = linear_weights(np.full(n, 1.3)), random.uniform(0.0, 1.3, n)
    pose = pose_at(places, turns, weights, since)
    star = np.column_stack([random.uniform(-30, 30, n), random.uniform(-20, 20, n), np.full(n, -60.0)])
    points = pose.position + np.einsum("nji,nj->ni", pose.rotation, star)
    interior = np.tile([8.8, 0.1, -0.1, -6e-4, 4e-6, 0.0, 1e-5, -1e-5, 1e-4, 0.0], (n, 1))
    others = [np.full((n, 1), 0.2), np.tile([0.1, -0.2, 0.05], (n, 1))]
    constants = np.column_stack([random.uniform(-4, 4, (n, 2)), np.full(n, 5.0), np.zeros(n), np.full((n, 2), -0.1)])
    readout = np.full((n, 1), 0.05)
    along = shutter_on_trajectory("mor", 2).equation(
        [*places.swapaxes(0, 1), *turns.swapaxes(0, 1), *others, readout, interior, points],
        np.column_stack([constants, since, weights.reshape(n, 4)]),
    )
    velocity = np.einsum("nij,nj->ni", pose.rotation, pose.velocity)
    own = MOVING_TYPES["mor"].equation(
        [pose.position, pose.rotation, *others, velocity, pose.rate, readout, interior, points], constants
    )
    np.testing.assert_allclose(along.values, own.values, rtol=0.0, atol=1e-11)
    for one, other in zip(along.jacobians[4:], (*own.jacobians[2:4], *own.jacobians[6:]), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


@pytest.mark.slow
def test_a_steady_flight_in_a_project_is_images_with_motions(tmp_path: Path) -> None:
    """Knots that are known, and images away from them, against poses and motions of the simulation."""
    given = simulated(5, strips=1, readout="{free: 25 ms}")
    flight = given.flights["strip 1"]
    known = given.files["knots.csv"].splitlines()
    exact = [known[0]]
    rows = ["id,camera,x,y,z,omega,phi,kappa,vx,vy,vz,rate_x,rate_y,rate_z"]
    for k, line in enumerate(known[1:]):
        place, matrix = flight.places[k], flight.turns[k].as_matrix()
        exact.append(",".join([*line.split(",")[:2], *map(repr, map(float, [*place, *_angles(matrix.T)]))]))
    kept = []
    for image, (strip, time) in moments(given.flights).items():
        if int(image[-1]) % 2 == 0:
            continue
        moment = Moment(flight, time)
        here, later = moment.at(0.0), moment.at(1e-3)
        velocity = here.D @ (later.position - here.position) / 1e-3
        turn = later.D @ here.D.T  # exp(−[ω t]×)
        rate = np.array([turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]]) / 2e-3
        np.testing.assert_allclose(exponential(-rate[None] * 1e-3)[0], turn, atol=1e-9)
        numbers = [*here.position, *_angles(here.D), *velocity, *np.degrees(rate)]
        rows.append(",".join([image, "drone", *map(repr, map(float, numbers))]))
        kept.append(f"{image},drone,{strip},{time!r}")
    rays = given.files["image_points.csv"].splitlines()
    names = {row.split(",")[0] for row in kept}
    rays = [rays[0], *(ray for ray in rays[1:] if ray.split(",")[0] in names)]
    seen = [ray.split(",")[1] for ray in rays]
    points = [name for name in given.files["points.csv"].split() if name == "id" or seen.count(name) > 1]
    rays = [ray for ray in rays if ray.split(",")[1] in {*points, "point", "C1", "C2", "C3", "C4", "C5"}]
    files = {
        **given.files,
        "image_points.csv": "\n".join(rays) + "\n",
        "points.csv": "\n".join(points) + "\n",
    }
    files["control.csv"] = "\n".join(
        line for line in given.files["control.csv"].splitlines() if line[:2] == "id" or line.split(",")[0] in seen
    )
    along = {**files, "knots.csv": "\n".join(exact) + "\n"}
    along["images.csv"] = "\n".join(["id,camera,trajectory,time", *kept]) + "\n"
    fixed = f"    fixed: [{KNOWN}]\n"
    flown = written(tmp_path / "flown", given._replace(files=along), (OBSERVED, fixed))
    text = given.files["project.yaml"]
    begin, end = text.index("trajectories:"), text.index("points:")
    own = {**files, "images.csv": "\n".join(rows) + "\n"}
    images = "images:\n  - file: images.csv\n" + fixed
    moved = written(tmp_path / "moved", given._replace(files=own), (text[begin:end], images))
    (run, one), (other_run, other) = (adjusted(p, p.parent / "out") for p in (flown, moved))
    assert run.code == other_run.code == 0, run.err + other_run.err
    for key in ("value", "sigma"):
        assert readout_of(one)[key] == pytest.approx(readout_of(other)[key], rel=1e-7)
    places = [(p.parent / "out" / "points.csv").read_text(encoding="utf-8").splitlines()[1:] for p in (flown, moved)]
    for first, second in zip(*places, strict=True):
        assert [float(c) for c in first.split(",")[1:7]] == pytest.approx(
            [float(c) for c in second.split(",")[1:7]], abs=2e-8
        )


def _angles(D: np.ndarray) -> list[float]:
    from mor.model.rotations import angles_from_rotation

    return list(np.degrees(angles_from_rotation(D[None])[0]))


@pytest.mark.slow
def test_a_readout_time_of_0_is_an_image_on_the_trajectory_to_the_last_digit(tmp_path: Path) -> None:
    line = "    readout: READOUT\n    readout_direction: down\n".replace("READOUT", "{free: 20 ms}")
    given = simulated(6, strips=1, true=0.0)
    for name, text in (("none", ""), ("zero", "    readout: 0\n")):
        run, _ = adjusted(written(tmp_path / name, given, (line, text)), tmp_path / name / "out")
        assert run.code == 0
    for file in ("images.csv", "points.csv", "residuals.csv", "trajectories.csv"):
        one, other = ((tmp_path / name / "out" / file).read_bytes() for name in ("none", "zero"))
        assert one == other, file


def test_simulated_rows_are_those_of_an_independent_simulation(tmp_path: Path) -> None:
    """A plan without measured coordinates: in which interval a row is read out, its place says."""
    given = simulated(0, strips=1, readout="30 ms")
    rays = given.files["image_points.csv"].splitlines()
    unmeasured = "\n".join(["image,point", *(",".join(ray.split(",")[:2]) for ray in rays[1:])]) + "\n"
    places = [",".join([name, *map(repr, map(float, place))]) for name, place in given.points.items()]
    files = {**given.files, "image_points.csv": unmeasured}
    files["points.csv"] = "\n".join(["id,x,y,z", *(p for p in places if not p.startswith("C"))]) + "\n"
    interior = (
        "{c: {free: 8.8}, xh: {free: 0}, yh: {free: 0}, A1: {free: 0}, A2: {free: 0}}",
        "{c: 8.7712, xh: 0.0183, yh: -0.0094, A1: -6.1e-4, A2: 4.3e-6}",
    )
    project = written(tmp_path / "p", given._replace(files=files), interior)
    found = planned_at(project, "", seed=1, wishes=Wishes(), noise=False).network.groups[0]
    true = np.array([[float(c) for c in ray.split(",")[2:]] for ray in rays[1:]])
    seen = found.observed / 0.0024 * [1.0, -1.0] + [2736.0, 1824.0]
    np.testing.assert_allclose(seen, true, atol=2e-6)


@pytest.mark.slow
def test_readout_time_of_flights_that_stand_still_is_named(tmp_path: Path) -> None:
    """Three trajectories, each at one place throughout; points that are seen from one place alone are left out."""
    given, exact = (simulated(seed, true=0.0, still=True) for seed in (1, 0))
    given = given._replace(files={**given.files, "knots.csv": exact.files["knots.csv"]})
    for curve in ("linear", "cubic"):
        known = (OBSERVED, f"    fixed: [{KNOWN}]\n"), ("interpolation: linear", f"interpolation: {curve}")
        leave_out = ("units:", "settings: {undetermined: leave_out}\nunits:")
        project = written(tmp_path / curve, given, *known, leave_out)
        run = mor("adjust", project, "--no-html", "-o", tmp_path / curve / "out")
        assert run.code == 4, run.err
        said = "Camera drone: the trajectories of its images stand still at their times, so its readout time has no"
        assert said in " ".join((run.err + run.out).split())


MISTAKES = [
    (
        "images.csv",
        "time\n",
        "time,vy\n",
        ",9\n",
        "images.csv:2: image '1_00' is on a trajectory: its velocity and",
    ),
    (
        "images.csv",
        "time\n",
        "time,sigma_rate_z\n",
        ",1\n",
        "images.csv:2: image '1_00' is on a trajectory: its",
    ),
    (
        "images.csv",
        "time\n",
        "time,shared_image_velocity\n",
        ",all\n",
        "images.csv:2: image '1_00' is on a trajectory: its",
    ),
]


@pytest.mark.parametrize(("file", "old", "new", "cell", "said"), MISTAKES, ids=[m[2] for m in MISTAKES])
def test_motions_of_images_on_trajectories_are_mistakes(
    tmp_path: Path, file: str, old: str, new: str, cell: str, said: str
) -> None:
    given = simulated(0, strips=1)
    head, *rows = given.files[file].splitlines(keepends=True)
    text = head.replace(old, new) + rows[0].replace("\n", cell) + "".join(row.replace("\n", ",\n") for row in rows[1:])
    project = written(tmp_path / "p", given._replace(files={**given.files, file: text}))
    told = mistakes(project)
    assert told[0].startswith(said)
    assert "those of the trajectory" in told[0]


def test_free_motions_of_images_on_trajectories_are_mistakes(tmp_path: Path) -> None:
    images = "  - file: images.csv\n"
    project = written(tmp_path / "p", simulated(0, strips=1), (images, images + "    free: [vx]\n"))
    assert "images.csv:2: image '1_00' is on a trajectory: its velocity and rate" in mistakes(project)[0]


def test_beyond_the_last_knot_its_interval_goes_on() -> None:
    times, numbers = np.array([0.0, 1.0, 2.0, 10.0, 11.0]), np.arange(5)
    flown = Trajectory("t", times, np.array([0, 0, 0, 1, 1]), numbers, numbers, False)
    at = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 10.0, 11.0, 2.02])
    clock = flown.clock(at, np.array([-0.015, -0.015, 0.015, 0.015, -0.015, -0.015, 0.015, 0.0]))
    assert clock.knots[:, 0].tolist() == [0, 0, 1, 1, 1, 3, 3, 1]
    assert clock.constants[:, 0].tolist() == pytest.approx((at - times[clock.knots[:, 0]]).tolist())
    assert clock.inside.tolist() == [True] * 7 + [False]
