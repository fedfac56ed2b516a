"""Answers that fit alike are tried one after another; start values are judged by all observations."""

import numpy as np

from mor.api.pipeline import read_document, read_network
from mor.start.sights import Choices, Judgement, disagreement, likeliest

LEVELS = """mor: 1
points: [{columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 1, 0, 1]]}]
datum: free
observations:
  - {type: height_difference, values: {sigma: 0.01}, columns: [from, to, dz], rows: [[A, B, 1.01], [B, A, -5]]}
"""


def test_the_likeliest_answer_is_taken_where_no_other_is_wanted():
    choices = Choices()
    assert [choices.take(count) for count in (1, 3, 2)] == [0, 0, 0]
    assert choices.others() == [(1,), (0, 1), (2,)]
    other = Choices((0, 1))
    assert [other.take(count) for count in (1, 3, 2)] == [0, 0, 1]
    assert Choices((5,)).take(2) == 1


def test_what_fits_alike_is_tried_before_what_was_clear():
    choices = Choices()
    choices.take(2, alike=False)
    choices.take(2)
    assert choices.others() == [(0, 1), (1,)]


def test_a_first_other_answer_to_each_question_comes_before_a_second_one_to_any():
    """Each question has its turn before answers that fit alike use up all tries."""
    choices = Choices()
    choices.take(2, alike=False)
    choices.take(4)
    assert choices.others() == [(0, 1), (1,), (0, 2), (0, 3)]


def test_one_answer_after_another_is_changed_as_long_as_that_helps():
    """Three questions, of which two were answered wrongly: each right answer helps by itself."""
    right = (1, 0, 2)

    def attempt(choices):
        return tuple(choices.take(count) for count in (2, 2, 3))

    def judged(found):
        wrong = sum(one != other for one, other in zip(found, right, strict=True))
        return Judgement(0, 2.0 * wrong, 5.0 * wrong)

    assert likeliest(attempt, judged, lambda _, as_it_stands: as_it_stands, 20)[0] == right
    assert likeliest(attempt, judged, lambda _, as_it_stands: as_it_stands, 0)[0] == (0, 0, 0)


def test_nothing_else_is_tried_where_start_values_agree():
    tried = []

    def attempt(choices):
        tried.append(choices.take(2))
        return tried[-1]

    likeliest(attempt, lambda _: Judgement(0, 0.5, 0.6), lambda _, as_it_stands: as_it_stands, 20)
    assert tried == [0]
    likeliest(attempt, lambda _: Judgement(1, 0.5, 0.6), lambda _, as_it_stands: as_it_stands, 20)
    assert tried == [0, 0, 1]


def test_of_start_values_that_come_to_one_end_those_are_better_that_fit_as_they_stand():
    """Gross errors can draw good start values and bad ones to one absurd end."""
    bad, good = (Judgement(0, 7.7, 9.7, 1.2e9, before) for before in (5.0, 1.0))
    assert good.beats(bad)
    assert not bad.beats(good)
    assert not good.beats(good)
    assert Judgement(0, 7.7, 9.7, 1.1e9, 5.0).beats(good)


def test_start_values_are_judged_by_logarithms_of_their_misclosures(tmp_path):
    (tmp_path / "project.yaml").write_text(LEVELS, encoding="utf-8")
    network = read_network(read_document(tmp_path / "project.yaml"), tmp_path)
    heights = [group for group in network.groups if group.type.key == "height_difference"]
    mean, worst = disagreement(heights, network.start)
    np.testing.assert_allclose(mean, 0.5 * (np.log1p(1.0) + np.log1p(400.0**2)), rtol=1e-6)
    assert worst == mean


def test_no_more_answers_are_tried_in_a_row_than_asked_for():
    tried: list[int] = []

    def attempt(choices: Choices) -> int:
        tried.append(choices.take(20))
        return tried[-1]

    likeliest(attempt, lambda _: Judgement(0, 9.0, 9.0), lambda _, as_it_stands: as_it_stands, 3)
    assert tried == [0, 1, 2, 3]


def test_start_values_count_as_they_stood_where_an_adjustment_is_drawn_away():
    assert Judgement(0, 8.2, 2.4, 2.6e7, before=1.3).agrees
    assert not Judgement(0, 8.2, 4.2, 2.6e7, before=3.1).agrees
    assert not Judgement(0, 1.3, 2.4, 2.6e7, before=8.2).agrees
