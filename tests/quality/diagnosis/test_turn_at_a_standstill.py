"""An iteration that a turn nobody observed keeps going is told as that turn, not as one that needs more iterations."""

from __future__ import annotations

from pathlib import Path

import pytest

import mor
from mor.solve.datum import NOTHING_KNOWN, weak_turns

CASE = Path(__file__).parents[2] / "cases" / "line_free_system" / "project.yaml"


@pytest.mark.slow
def test_a_line_through_a_free_system_leaves_a_turn_that_is_named() -> None:
    result = mor.adjust(CASE)
    adjustment = result.solved.adjustment
    turns = weak_turns(adjustment.inverse.weak, adjustment.problem, adjustment.values)
    assert turns[0].sigma > NOTHING_KNOWN
    assert result.outcome == "singular"
    assert "rotation of the whole network" in result.reason
    assert "The rotation of the whole network about" in str(result)
    assert "Only the fixed kappa of system L prevents it" in str(result)
    assert "of one line" in str(result)
