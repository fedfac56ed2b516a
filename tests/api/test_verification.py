"""``mor verify``: reference values are right by another way, a failure is told, reports hold the same data."""

from __future__ import annotations

import json
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest

import mor
from mor.api import verification
from mor.api.verification import About, VerificationTask, carried_out, reference_data, tasks
from mor.cli import run
from mor.report.language import words_of
from mor.report.simulation import NAMES
from mor.report.verification import ReferenceCheck

REGRESSIONS = json.loads((reference_data() / "nist" / "regression.json").read_text(encoding="utf-8"))
GERMAN = words_of("de", "planning").catalogue


def _exact(data):
    """Parameters, variances and residual variance as fractions, by elimination of the normal equations."""
    x, y = data["x"], [Fraction(str(value)) for value in data["y"]]
    rows = [[Fraction(str(value)) for value in (one if isinstance(one, list) else [one])] for one in x]
    if data["model"] == "polynomial":
        rows = [[row[0] ** k for k in range(data["degree"] + 1)] for row in rows]
    elif data["model"] == "multilinear":
        rows = [[Fraction(1), *row] for row in rows]
    p = len(rows[0])
    system = [
        [sum(row[i] * row[k] for row in rows) for k in range(p)]
        + [Fraction(int(i == k)) for k in range(p)]
        + [sum(row[i] * value for row, value in zip(rows, y, strict=True))]
        for i in range(p)
    ]
    for i in range(p):
        system[i] = [value / system[i][i] for value in system[i]]
        for k in range(p):
            if k != i:
                system[k] = [a - system[k][i] * b for a, b in zip(system[k], system[i], strict=True)]
    parameters = [row[-1] for row in system]
    residuals = (
        value - sum(a * b for a, b in zip(row, parameters, strict=True)) for row, value in zip(rows, y, strict=True)
    )
    variance = sum(v**2 for v in residuals) / (len(y) - p)
    return parameters, [system[i][p + i] * variance for i in range(p)], variance


def _root(value):
    with localcontext() as context:
        context.prec = 40
        return float((Decimal(value.numerator) / Decimal(value.denominator)).sqrt())


@pytest.mark.parametrize("name", REGRESSIONS)
def test_certified_values_agree_with_exact_rational_arithmetic(name):
    data = REGRESSIONS[name]
    parameters, variances, variance = _exact(data)
    np.testing.assert_allclose([float(value) for value in parameters], data["parameters"], rtol=1e-14)
    np.testing.assert_allclose([_root(value) for value in variances], data["standard_deviations"], rtol=1e-14)
    assert _root(variance) == pytest.approx(data["residual_standard_deviation"], rel=1e-14)


GROUPS = ("NIST linear regression", "closed forms", "start values")


@pytest.fixture(scope="module")
def quick():
    """Checks of all but networks and Monte Carlo."""
    return [check for task in tasks() if task.about.group in GROUPS for check in carried_out(task)]


def test_quick_checks_pass(quick):
    assert len(quick) > 90
    assert [check for check in quick if not check.passed] == []
    assert {check.group for check in quick} == set(GROUPS)


def test_names_quantities_and_sources_are_there_in_german(quick):
    said = {text for check in quick for text in (check.group, check.quantity)}
    said |= {text for check in quick if check.name == "quantiles and p-values" for text in (check.name, check.source)}
    said |= {text for check in quick if check.group == "start values" for text in (check.name,)}
    said |= {
        *verification._GROUPS.values(),
        *verification._QUANTITIES.values(),
        *NAMES.values(),
    }
    same = {text for text in said if "=" in text or text == "sigma0"}
    assert sorted(said - same - set(GERMAN)) == []


@pytest.mark.slow
def test_two_threads_give_what_one_gives():
    (task,) = [task for task in tasks() if task.about.group == "threads"]
    checks = carried_out(task)
    assert [(check.passed, check.limit) for check in checks] == [(True, 0.0)] * 5
    assert sum(check.numbers for check in checks) > 200_000
    assert {task.about.group, task.about.name, task.about.source} <= set(GERMAN)


@pytest.mark.slow
def test_two_processes_give_what_one_gives(monkeypatch):
    (task,) = [task for task in tasks() if task.about.group == "processes"]
    (check,) = carried_out(task)
    assert (check.passed, check.limit) == (True, 0.0)
    assert check.numbers > 200
    assert {check.group, check.source, check.quantity} <= set(GERMAN)
    monkeypatch.setattr(verification, "_SEED", 2)  # of this process only
    (check,) = carried_out(task)
    assert not check.passed
    assert np.isfinite(check.found)
    monkeypatch.setattr(verification, "_write_tally", run)  # a function that fails in the other process
    (check,) = carried_out(task)
    assert check.place.startswith("RuntimeError: ")


def test_a_check_that_raises_has_failed():
    def fails(about):
        raise ValueError("no solution")

    (check,) = carried_out(VerificationTask(About("closed forms", "x", "y"), fails))
    assert not check.passed
    assert check.place == "ValueError: no solution"


def _few(monkeypatch, difference):
    check = ReferenceCheck("closed forms", "levelling loop", "residuals", "<book>", "P1", 3, 1.0, 1.0 + difference, 0.1)
    task = VerificationTask(About("closed forms", "levelling loop", "<book>"), lambda about: [check])
    monkeypatch.setattr(verification, "tasks", lambda: [task])
    assert [one.passed for one in mor.verify()] == [difference < 0.1]


@pytest.mark.parametrize(("difference", "code"), [(0.05, 0), (0.2, 1), (np.nan, 1)])
def test_command_writes_three_reports_and_tells_failures_by_its_exit_code(
    monkeypatch, tmp_path, capsys, difference, code
):
    _few(monkeypatch, difference)
    assert run(["verify", "--json", "-o", str(tmp_path / "out")]) == code
    data = json.loads(capsys.readouterr().out)
    assert data == json.loads((tmp_path / "out" / "verification.json").read_text(encoding="utf-8"))
    assert data["failed"] == code
    (row,) = data["checks"]
    keys = {"source", "reference", "found", "difference", "limit", "passed"}
    assert keys <= row.keys()
    assert {"program", "python", "libraries", "processor", "system", "date"} <= data.keys()
    text = (tmp_path / "out" / "verification.txt").read_text(encoding="utf-8")
    page = (tmp_path / "out" / "verification.html").read_text(encoding="utf-8")
    assert "levelling loop: <book>" in text
    assert "<b>levelling loop</b>: &lt;book&gt;" in page
    assert ("FAILED" in text) == ("class=fails" in page) == bool(code)
    assert run(["verify", "-o", str(tmp_path / "out")]) == 2
    assert run(["verify", "--lang", "de", "-f", "-o", str(tmp_path / "out")]) == code
    assert ("NICHT BESTANDEN" in capsys.readouterr().out) == bool(code)
