"""Score tests: they name planted mistakes, and what they say of vᵀPv is true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mor
from mor.api import pipeline
from mor.quality.solution import Solved
from tests.scenarios.planted_mistakes.survey import survey

CASES = Path(__file__).parents[1] / "cases" / "mistakes"


def _solved(path: Path) -> Solved:
    return pipeline.solve_network(pipeline.read_network(pipeline.read_document(path), path.parent))


def test_a_missing_antenna_height_is_named_and_its_decrease_is_that_of_corrected_vectors() -> None:
    solved = _solved(CASES / "antenna_height_missing.yaml")
    best = solved.possible_causes[0]
    assert (best.cause, best.things) == ("antenna height", ("G3",))
    assert best.amount is not None
    groups = list(solved.network.groups)
    for number, group in enumerate(groups):
        if group.type.key == "vector":
            begin, end = (np.array([name == "G3" for name in names]) for names in group.references)
            observed = group.observed.copy()
            observed[:, 2] -= best.amount.value * (end.astype(float) - begin)
            groups[number] = replace(group, observed=observed)
    corrected = pipeline.solve_network(replace(solved.network, groups=tuple(groups)))
    assert solved.quality is not None
    assert corrected.quality is not None
    assert solved.quality.omega - corrected.quality.omega == pytest.approx(best.gain, rel=1e-9)
    assert corrected.possible_causes == ()


def test_reversed_vectors_are_named_together() -> None:
    best = _solved(CASES / "vectors_reversed.yaml").possible_causes[0]
    assert best.cause == "vector sign"
    assert set(best.things) == {"G0", "G1", "G2", "G3"}
    assert best.line.count("→") == 3


def test_a_common_offset_of_distances_is_named_with_its_amount(tmp_path: Path) -> None:
    bridge = survey("bridge")
    for row in bridge.tables["distances.csv"]:
        row["distance"] = f"{float(row['distance']) + 0.03:.4f}"
    causes = _solved(bridge.write(tmp_path)).possible_causes
    found = [one for one in causes if one.cause == "distance offset"]
    assert len(found) == 1
    assert found[0].amount is not None
    assert abs(found[0].amount.value) == pytest.approx(0.03, abs=0.003)


def test_two_levelling_lines_that_are_left_out_are_named_together(tmp_path: Path) -> None:
    building = survey("building")
    turned = [row for row in building.tables["levelling.csv"] if row["from"] in ("N2", "HB2")]
    for row in turned:
        row["dz"] = f"{-float(row['dz']):.4f}"
    solved = _solved(building.write(tmp_path))
    assert solved.suspects is not None
    assert solved.suspects.count == len(turned) == 2
    best = solved.possible_causes[0]
    assert (best.cause, best.parameters) == ("levelling sign", 0)
    assert set(best.things) == {"N2", "HB2", "N3"}
    assert len(best.rows) == 2


def test_exchanged_names_are_named_if_only_the_worst_image_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    building = survey("building")
    rows = [row for row in building.tables["image_points.csv"] if row["image"] == "B11"]
    one, other = rows[3], rows[9]
    one["point"], other["point"] = other["point"], one["point"]
    monkeypatch.setattr("mor.diagnose.score_tests._THINGS", 1)
    named = {(cause.cause, frozenset(cause.things)) for cause in _solved(building.write(tmp_path)).possible_causes}
    assert ("names exchanged", frozenset({"B11", one["point"], other["point"]})) in named


def test_misclosures_of_levelling_do_not_tell_the_unit_of_its_heights() -> None:
    """Millimetres for metres would make every misclosure a thousand times smaller."""
    rows = [
        ["A", "B", 0.63],
        ["B", "C", 11.43],
        ["D", "C", 3.74],
        ["A", "D", 8.28],
        ["A", "C", 12.05],
        ["B", "D", 7.65],
    ]
    found = mor.adjust(
        {
            "mor": 1,
            "units": {"length": "m"},
            "points": [
                {"columns": ["id", "z"], "rows": [["A", 1313.0]], "values": {"x": 0, "y": 0}, "fixed": ["x", "y", "z"]},
                {"columns": ["id"], "rows": [["B"], ["C"], ["D"]], "values": {"x": 0, "y": 0}, "fixed": ["x", "y"]},
            ],
            "observations": [
                {
                    "type": "height_difference",
                    "columns": ["from", "to", "dz"],
                    "rows": rows,
                    "values": {"sigma": "0.5 mm"},
                }
            ],
        }
    ).solved
    assert found.quality is not None
    assert found.quality.sigma0 > 10.0
    assert not any(one.cause == "table unit" for one in found.possible_causes)


def test_no_prism_has_a_constant_of_a_metre(tmp_path: Path) -> None:
    bridge = survey("bridge")
    for row in bridge.tables["distances.csv"]:
        row["distance"] = f"{float(row['distance']) + 1.2:.4f}"
    causes = _solved(bridge.write(tmp_path)).possible_causes
    assert not any(one.cause == "distance offset" for one in causes)


def test_slope_distances_taken_for_horizontal_ones_are_named(tmp_path: Path) -> None:
    """Their σ would have to be hundreds of times larger: that explains them, too, but much worse."""
    building = survey("building")
    plates = "distances to plates"
    (entry,) = (one for one in building.project["observations"] if one.get("name") == plates)
    entry["type"] = "horizontal_distance"
    best, other = _solved(building.write(tmp_path)).possible_causes[:2]
    assert (best.cause, best.things) == ("slope distance", (plates,))
    assert other.cause == "sigma of a table"
    assert best.gain > 1.2 * other.gain


def test_a_wrong_name_of_a_target_is_named_with_the_right_one(tmp_path: Path) -> None:
    bridge = survey("bridge")
    row = next(row for row in bridge.tables["directions.csv"] if row["to"] == "NW1")
    row["to"] = "NE1"
    best = _solved(bridge.write(tmp_path)).possible_causes[0]
    assert best.cause == "wrong name"
    assert set(best.things) == {row["station"], "NE1", "NW1"}


def test_a_wrong_observed_camera_constant_is_named_with_the_right_value(tmp_path: Path) -> None:
    facade = survey("facade")
    c = facade.project["cameras"]["D7"]["interior"]["c"]
    c["observed"] = f"{float(c['observed']) * 1.2:.4f}"
    solved = _solved(facade.write(tmp_path))
    best = solved.possible_causes[0]
    assert (best.cause, best.things) == ("image scale", ("D7",))
    assert best.amount is not None
    c_of = {group.type.key: group for group in solved.network.groups}
    (block,) = np.unique(c_of["observed/interior/mor"].blocks[0])
    assert best.amount.value == pytest.approx(solved.adjustment.values["interior/mor"][block, 0], rel=1e-3)


@pytest.mark.parametrize("name", ["bridge", "aerial_strip"])
def test_nothing_is_named_if_nothing_is_rejected(name: str, tmp_path: Path) -> None:
    assert _solved(survey(name).write(tmp_path)).possible_causes == ()


@pytest.mark.slow
def test_two_images_of_another_lens_are_named_together() -> None:
    best = _solved(CASES / "other_lens_of_two_images.yaml").possible_causes[0]
    assert (best.cause, set(best.things)) == ("camera of images", {"I0", "I2"})


@pytest.mark.slow
def test_the_sense_of_circles_is_named_although_their_directions_are_left_out() -> None:
    solved = _solved(CASES / "circles_counterclockwise.yaml")
    assert solved.suspects is not None
    left_out = zip(solved.suspects.plain.problem.groups, solved.suspects.masks, strict=True)
    assert {group.type.key for group, mask in left_out if mask.any()} == {"zenith_directions"}
    causes = [(one.cause, one.things) for one in solved.possible_causes]
    assert causes == [("circle sense", ("zenith_directions 2",)), ("image flipped", ("A",))]  # mirror images


@pytest.mark.slow
def test_exchanged_set_ups_are_named_although_thirteen_suspects_are_left_out() -> None:
    solved = _solved(CASES / "set_ups_exchanged.yaml")
    assert solved.suspects is not None
    assert [(one.cause, set(one.things)) for one in solved.possible_causes] == [("set-ups exchanged", {"S0", "S1"})]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "cause", "thing"),
    [
        ("circles_counterclockwise", "circle sense", "zenith_directions 2"),
        ("instrument_height_in_centimetres", "instrument height", "S1"),
        ("set_ups_exchanged", "set-ups exchanged", "S0"),
    ],
)
def test_a_mistake_of_a_whole_is_diagnosed_with_nothing_left(name: str, cause: str, thing: str) -> None:
    path = CASES / f"{name}.yaml"
    network = pipeline.read_network(pipeline.read_document(path), path.parent)
    _, found = pipeline.diagnose_network(network, lambda _: True)
    best = found.offered[0]
    assert best.hypothesis.cause == cause
    assert thing in best.hypothesis.things
    assert best.after == pytest.approx(95.6, abs=2.0)
    assert best.hypothesis.edits


def test_a_height_beyond_reach_is_noted_before_adjusting() -> None:
    path = CASES / "instrument_height_in_centimetres.yaml"
    network = pipeline.read_network(pipeline.read_document(path), path.parent)
    notes = [note for note in network.notes if "height" in note.message]
    assert len(notes) == 1
    assert "station S1: the height is 159 m, more than 5 m" in notes[0].message
