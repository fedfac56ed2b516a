"""Mistakes in GNU Gama files: all at once, each with its line."""

from __future__ import annotations

import pytest

from mor.errors import InputError
from mor.formats import read_foreign


def _problems(tmp_path, text):
    path = tmp_path / "wrong.gkf"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_foreign(path)
    assert all(problem.file == str(path) for problem in error.value.problems)
    return [(problem.line, problem.message) for problem in error.value.problems]


def _network(tmp_path, body, network=""):
    head = f"<gama-local><network {network}><points-observations>\n"
    return _problems(tmp_path, f"{head}{body}\n</points-observations></network></gama-local>")


def test_every_mistake_is_told_with_its_line(tmp_path):
    problems = _network(
        tmp_path,
        '<point id="A" x="0" y="o" fix="xy"/>\n'
        '<pont id="B"/>\n'
        '<point id="C" X="1"/>\n'
        '<point x="1" y="2" adj="yx"/>\n'
        '<obs from="A">\n'
        '<direction to="B" stdev="1"/>\n'
        '<distance to="B" val="-3" stdev="0"/>\n'
        "</obs>",
        'axes-xy="nn"',
    )
    assert [line for line, _ in problems] == [1, 2, 3, 4, 5, 5, 7, 8, 8]
    words = "\n".join(message for _, message in problems)
    for expected in (
        "axes-xy: found 'nn'",
        "found 'o', expected a number",
        "unknown element <pont> in <points-observations>; did you mean 'point'?",
        "unknown attribute 'X'",
        "attribute 'id' is missing",
        "found 'yx', expected xy, XY",
        "attribute 'val' is missing",
        "found '-3', expected a number > 0",
        "found '0', expected a number > 0",
    ):
        assert expected in words


@pytest.mark.parametrize(
    ("body", "line", "words"),
    [
        ('<obs from="A">\n<distance to="B" val="1"/></obs>', 3, "no stdev, and no distance-stdev"),
        ('<obs>\n<distance to="B" val="1" stdev="1"/></obs>', 3, "'from' is given neither here nor in <obs>"),
        ('<obs from="A">\n<distance to="A" val="1" stdev="1"/></obs>', 3, "'A' is given twice"),
        ('<obs from="A">\n<angle bs="B" fs="B" val="1" stdev="1"/></obs>', 3, "'A' is given twice"),
        ('<vectors>\n<vec from="A" to="B" dx="1" dy="1" dz="1"/></vectors>', 2, "<cov-mat> is missing"),
        (
            '<point id="A" x="1" adj="xy"/>\n<point id="B" x="1" fix="xy"/>',
            3,
            "point 'B': y is fixed but not given",
        ),
        (
            '<obs from="A"><distance to="B" val="1"/>\n<cov-mat dim="2" band="1">1 0 1</cov-mat></obs>',
            3,
            "dim = 2, but 1 values",
        ),
        (
            '<obs from="A"><distance to="B" val="1"/>\n<cov-mat dim="1" band="0">1 0 1</cov-mat></obs>',
            3,
            "found 3 numbers, expected 1",
        ),
        (
            '<obs from="A"><distance to="B" val="1"/>\n<cov-mat dim="1" band="0">one</cov-mat></obs>',
            3,
            "found 'one', expected a number",
        ),
        ('<obs from="A">\n<azimuth to="B" val="12-61-00" stdev="1"/></obs>', 3, "must stay below 60"),
        (
            '<obs from="A">\n<azimuth to="B" val="twelve" stdev="1"/></obs>',
            3,
            "expected an angle in gon or d-m-s",
        ),
        ("<obs>\n<cov-mat dim='x' band='0'>1</cov-mat></obs>", 3, "expected a whole number"),
    ],
)
def test_single_mistakes(tmp_path, body, line, words):
    if "bs=" in body:
        words = "is given twice"
    assert any(at == line and words in message for at, message in _network(tmp_path, body))


def test_what_is_no_gama_file(tmp_path):
    assert _problems(tmp_path, "<gama-local>\n<network>\n</gama-local>")[0][0] == 3
    assert "expected <gama-local>" in _problems(tmp_path, "<html/>")[0][1]
    assert "not well-formed" in _problems(tmp_path, "mor: 1")[0][1]
    assert "found 0 times <points-observations>" in _problems(tmp_path, "<gama-local><network/></gama-local>")[0][1]


def test_observations_without_points(tmp_path):
    body = '<obs from="A">\n<distance to="B" val="5" stdev="2"/></obs>'
    ((line, words),) = _problems(
        tmp_path, f"<gama-local><network>\n<points-observations>{body}</points-observations></network></gama-local>"
    )
    assert line == 2
    assert "no points are given" in words


def test_entities_are_refused(tmp_path):
    text = '<!DOCTYPE x [\n<!ENTITY a "aaaa">\n<!ENTITY b "&a;&a;">]>\n<gama-local>&b;</gama-local>'
    ((line, words),) = _problems(tmp_path, text)
    assert line == 2
    assert "entity" in words


def test_a_covariance_matrix_must_be_positive_definite(tmp_path):
    from tests.reference_data import network_of

    path = tmp_path / "network.gkf"
    path.write_text(
        '<gama-local><network><points-observations>\n<point id="A" x="0" y="0" fix="xy"/>'
        '<point id="B" x="0" y="5" adj="xy"/>\n<obs from="A"><distance to="B" val="5"/><azimuth to="B" val="100"/>'
        '<cov-mat dim="2" band="1">1 2 1</cov-mat></obs></points-observations></network></gama-local>'
    )
    with pytest.raises(InputError, match="positive definite") as error:
        network_of(read_foreign(path), tmp_path)
    assert error.value.problems[0].line == 3


def test_an_encoding_that_nobody_knows(tmp_path):
    assert "nobody knows" in _problems(tmp_path, '<?xml version="1.0" encoding="utf-81"?><gama-local/>')[0][1]
