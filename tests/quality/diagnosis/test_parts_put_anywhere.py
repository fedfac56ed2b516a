"""Singular where parts were put anywhere is not said of the observations."""

from dataclasses import replace

import numpy as np

from mor.api.pipeline import make_problem, read_document, read_network
from mor.errors import Message
from mor.quality.determinability import PUT_ANYWHERE, with_fitting_reason
from mor.quality.solution import Solved
from mor.report.text import verdict
from mor.solve.iterate import OPEN, Outcome, adjust
from mor.start.part import Join, Tie, rule, untied

TWO_PARTS = """mor: 1
points: [{columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 100, 0, 0], [C, 0, 9, 0], [D, 9, 9, 0]]}]
datum: free
observations:
  - type: distance
    values: {sigma: 0.01}
    columns: [from, to, distance]
    rows: [[A, B, 3], [A, B, 3], [A, B, 3], [C, D, 1], [C, D, 1], [C, D, 1]]
"""


def adjusted(tmp_path, text=TWO_PARTS):
    (tmp_path / "project.yaml").write_text(text, encoding="utf-8")
    network = read_network(read_document(tmp_path / "project.yaml"), tmp_path)
    return adjust(make_problem(network, network.start, network.start), network.start)


def test_where_parts_lie_anywhere_and_do_not_fit_the_start_values_are_to_blame(tmp_path):
    singular = adjusted(tmp_path)
    assert singular.outcome is Outcome.SINGULAR
    assert with_fitting_reason(singular, untied=True).reason == PUT_ANYWHERE
    assert with_fitting_reason(singular).reason == OPEN


def test_where_they_fit_the_observations_are(tmp_path):
    singular = adjusted(tmp_path, TWO_PARTS.replace("B, 3]", "B, 100]").replace("D, 1]", "D, 9]"))
    assert with_fitting_reason(singular, untied=True).reason == OPEN


def test_fewer_observations_than_any_start_values_would_need_are_to_blame(tmp_path):
    singular = adjusted(tmp_path, TWO_PARTS.replace("[A, B, 3], [A, B, 3], ", ""))
    assert with_fitting_reason(singular, untied=True).reason == OPEN


def test_a_part_is_untied_where_movements_stay_open_and_it_is_not_the_first_of_a_free_network():
    def join(number, tie):
        none = np.zeros(0, dtype=np.int64)
        return Join(number, rule("what is given"), 0, none, (), (), False, False, False, tie)

    firm, loose = Tie(0, 3, 1e-4, 0), Tie(2, -2, 0.0, 11)
    parts = join(1, None), join(2, firm), join(3, loose)
    assert [one.number for one in untied(parts, given=True)] == [1, 3]
    assert [one.number for one in untied(parts, given=False)] == [3]


def test_no_solution_names_the_parts_that_nothing_ties(tmp_path):
    (tmp_path / "project.yaml").write_text(TWO_PARTS, encoding="utf-8")
    network = read_network(read_document(tmp_path / "project.yaml"), tmp_path)
    parts = tuple(Message(f"start values: part {number} has an arbitrary position") for number in range(5))
    solved = Solved(replace(network, untied=parts), adjusted(tmp_path), None)
    lines = verdict(solved)
    assert [line for line in lines if "start values: part" in line] == [f"{part}." for part in parts[:3]]
    assert "2 more parts have an arbitrary position." in lines
    assert "Start values or coordinates of two points of a part would tie it." in lines
