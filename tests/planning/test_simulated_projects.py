"""Simulated projects: free of errors they fit exactly, with the quality of the plan; planted errors are in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.api.plan import at_its_place, read_plan, solve_plan
from mor.api.simulation import simulated
from mor.errors import InputError
from mor.plan.simulation import Systematic, Wishes
from mor.report.output_folder import reserve
from mor.solve.problem import misclosures
from sample_projects.expected import ROOT
from tests.selection import slow_after

SAMPLES = ("bridge", "stereo_rig", "building", "machine_part")


def _written(name, folder, **wishes):
    simulation = simulated(ROOT / name / "project.yaml", "", **wishes)
    with reserve(folder, False) as place:
        simulation.write(place)
    return simulation


def _adjusted(folder):
    return solve_network(read_network(read_document(folder / "project.yaml"), folder))


def _plan(name):
    path = ROOT / name / "project.yaml"
    return solve_plan(at_its_place(read_plan(read_document(path), path.parent).network))


@pytest.mark.parametrize("name", slow_after(2, SAMPLES))
def test_sigma_and_r_of_a_plan_are_those_of_its_simulated_observations(name, tmp_path):
    _written(name, tmp_path / "there", seed=1, wishes=Wishes(), noise=False)
    planned, solved = _plan(name), _adjusted(tmp_path / "there")
    assert solved.quality.omega < 1e-12
    for one, other in zip(planned.quality.groups, solved.quality.groups, strict=True):
        assert np.allclose(one.r, other.r, rtol=0.0, atol=1e-9, equal_nan=True)
    for kind in planned.quality.cofactors:
        expected, found = (
            np.sqrt(np.maximum(np.diagonal(one.quality.cofactors[kind], axis1=1, axis2=2), 0.0))
            for one in (planned, solved)
        )
        assert np.allclose(found, expected, rtol=1e-9, atol=1e-15)


def test_planted_errors_are_in_the_observations_and_in_their_table(tmp_path):
    wishes = Wishes(gross=2, size=60.0, dropped=0.05)
    clean = simulated(ROOT / "stereo_rig" / "project.yaml", "", 5, Wishes())
    found = _written("stereo_rig", tmp_path / "there", seed=5, wishes=wishes)
    table = pl.read_csv(tmp_path / "there" / "planted.csv")
    gross = table.filter(pl.col("kind") == "gross")
    assert gross.height == 2
    assert np.allclose(gross["sigmas"], 60.0)
    rows = sum(np.isfinite(group.observed).any(axis=1).sum() for group in clean.network.groups)
    left = sum(np.isfinite(group.observed).any(axis=1).sum() for group in found.network.groups)
    assert rows - left == table.filter(pl.col("kind") == "dropped").height > 5
    for one in found.planted:
        if one.kind == "gross":
            change = found.network.groups[one.group].observed - clean.network.groups[one.group].observed
            assert change[one.row, one.component] == pytest.approx(one.amount, rel=1e-9)
    solved = _adjusted(tmp_path / "there")
    flagged = sum(int(flags.sum()) for flags in solved.quality.flagged)
    assert flagged >= 2


def test_a_seed_gives_the_same_bytes_and_another_seed_others(tmp_path):
    for name, seed in (("one", 3), ("again", 3), ("other", 4)):
        _written("bridge", tmp_path / name, seed=seed, wishes=Wishes(gross=1))
    texts = {
        name: [path.read_bytes() for path in sorted((tmp_path / name).iterdir())] for name in ("one", "again", "other")
    }
    assert texts["one"] == texts["again"]
    assert texts["one"] != texts["other"]


def test_an_offset_is_in_the_unit_of_its_group_and_shows_as_the_zero_error_it_is():
    path = ROOT / "bridge" / "project.yaml"
    plain = simulated(path, "", 1, Wishes()).network
    shifted = simulated(path, "", 1, Wishes(systematic=(Systematic("distances.csv", 0.01),))).network
    stretched = simulated(path, "", 1, Wishes(systematic=(Systematic("distances*", 100.0, True),))).network
    k = next(k for k, group in enumerate(plain.groups) if group.name == "distances.csv")
    assert np.allclose(shifted.groups[k].observed - plain.groups[k].observed, 0.01)
    assert np.allclose(stretched.groups[k].observed / plain.groups[k].observed, 1.0001)


def test_systematic_errors_of_groups_that_are_not_there_are_mistakes():
    wishes = Wishes(systematic=(Systematic("distance.csv", 0.01),))
    with pytest.raises(InputError, match=r"did you mean 'distances\.csv'"):
        simulated(ROOT / "bridge" / "project.yaml", "", 1, wishes)


def test_prior_knowledge_gets_its_error_too():
    found = simulated(ROOT / "facade" / "project.yaml", "", 2, Wishes())
    sigma = found.network.sigma["point"]
    observed = np.isfinite(sigma)
    error = (found.network.observed["point"] - found.place["point"])[observed] / sigma[observed]
    assert 0.6 < error.std() < 1.5


@pytest.mark.slow
def test_cameras_that_correct_what_is_measured_look_at_simulated_coordinates(tmp_path):
    """Brown's distortion is taken at the measured coordinates: the planned ones, not those of the file."""
    path = ROOT / "facade" / "project.yaml"
    document = read_document(path)
    camera = {**document.data["cameras"]["D7"], "model": "brown"}
    camera.pop("r0")
    camera["interior"] = {"c": {"free": "28"}, "K1": {"free": "1e-4"}, "P1": {"free": "1e-5"}}
    changed = replace(document, data={**document.data, "cameras": {"D7": camera}})
    network = at_its_place(read_plan(changed, path.parent).network)
    group = next(group for group in network.groups if len(group.lines))
    assert np.allclose(group.constants[:, :2], group.observed, rtol=0.0, atol=1e-12)
    assert np.abs(misclosures(group, network.start)).max() < 1e-12
