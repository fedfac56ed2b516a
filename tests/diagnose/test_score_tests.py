"""Score tests: they name planted mistakes, and what they say of vᵀPv is true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mor import pipeline
from mor.quality.solved import Solved
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


@pytest.mark.parametrize("name", ["bridge", "aerial_strip"])
def test_nothing_is_named_if_nothing_is_rejected(name: str, tmp_path: Path) -> None:
    assert _solved(survey(name).write(tmp_path)).possible_causes == ()
