"""Tests for ISO 17123-3, -4, -5 and -8 and VDI/VDE 2634, against formulas in NumPy and quantiles of SciPy."""

from __future__ import annotations

import json
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize, stats

import mor as api
from mor.report.protocol import figures, length_tests, statistical_tests
from mor.report.view import view_of_folder
from tests.scenarios.small_projects import mor

PLACES = np.array([0.0, 62.1, 105.3, 203.9, 311.2, 450.7, 601.4])


def measured(folder: Path, seed: int, offset: float, sigma: float) -> np.ndarray:
    """Fill in the table of a new project, adjust it, and return the distances."""
    assert mor("new", folder / "line.yaml", "--protocol", "iso17123-4", "-t", "line: 1").code == 0
    random = np.random.default_rng(seed)
    table = folder / "distances.csv"
    lines = table.read_text().splitlines()
    assert lines[0] == "from,to,distance"
    assert [line.split(",")[:2] for line in lines[1:]] == [[str(i), str(j)] for i, j in combinations(range(1, 8), 2)]
    values = np.array([PLACES[j] - PLACES[i] for i, j in combinations(range(7), 2)])
    values = np.round(values + offset + random.normal(0.0, sigma, 21), 4)
    rows = [line + repr(v) for line, v in zip(lines[1:], values.tolist(), strict=True)]
    table.write_text("\n".join([lines[0], *rows]) + "\n")
    assert mor("adjust", folder / "line.yaml", "--no-html").code == 0
    return values


def by_hand(values: np.ndarray) -> tuple[float, float, float]:
    """s, correction and its standard deviation by ordinary least squares: d = x_j − x_i − δ."""
    A = np.zeros((21, 7))
    for row, (i, j) in enumerate(combinations(range(7), 2)):
        A[row, i], A[row, j] = -1.0, 1.0
        A[row, 0] = -1.0
    x, squares, *_ = np.linalg.lstsq(A, values, rcond=None)
    s = float(np.sqrt(squares[0] / 14))
    return s, float(x[0]), s * float(np.sqrt(np.linalg.inv(A.T @ A)[0, 0]))


@pytest.mark.parametrize(("seed", "offset"), [(4, 0.0012), (5, 0.0), (6, -0.003)])
def test_figures_and_verdicts(tmp_path: Path, seed: int, offset: float) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    s, delta, s_delta = by_hand(measured(one, seed, offset, 0.001))
    other = by_hand(measured(two, seed + 10, 0.0, 0.003))[0]
    assert s_delta == pytest.approx(s / np.sqrt(5.0), rel=1e-12)  # as the standard says
    found, second = (figures(view_of_folder(folder / "line.results"), "iso17123-4") for folder in (one, two))
    (line,) = found
    np.testing.assert_allclose(line[1:], np.array([s, 0.002, delta, s_delta]) * 1e3, rtol=1e-7)
    tests = statistical_tests(found, second, "iso17123-4")
    expected = [
        (s * 1e3, None, 2.0 * np.sqrt(stats.chi2.ppf(0.95, 14) / 14)),
        ((s / other) ** 2, stats.f.ppf(0.025, 14, 14), stats.f.ppf(0.975, 14, 14)),
        (abs(delta) * 1e3, None, stats.t.ppf(0.975, 14) * s_delta * 1e3),
    ]
    for test, (found, low, high) in zip(tests, expected, strict=True):
        np.testing.assert_allclose([test.found, test.low or 0.0, test.high], [found, low or 0.0, high], rtol=1e-7)
        assert test.passed == ((low is None or low <= found) and found <= high)
    assert tests[0].high / 2.0 == pytest.approx(1.30, abs=0.005)  # factors that the standard prints
    assert [tests[1].low, tests[1].high] == pytest.approx([0.34, 2.98], abs=0.005)
    assert tests[2].high / line.sigma_offset == pytest.approx(2.14, abs=0.006)


@pytest.mark.parametrize("language", ["en", "de"])
def test_page(tmp_path: Path, language: str) -> None:
    values = measured(tmp_path, 6, -0.003, 0.001)
    results, path = tmp_path / "line.results", tmp_path / "page.txt"
    options = ("--protocol", "iso17123-4", "--against", results, "--lang", language, "-o", path)
    run = mor("report", results, *options)
    assert run.code == 0, run.err
    text = path.read_text(encoding="utf-8")
    delta = f"{1e3 * by_hand(values)[1]:.3f}"
    assert f"{delta.replace('.', ',') if language == 'de' else delta} mm" in text
    assert re.search(r"c\).* (verworfen|rejected)", text)
    assert re.search(r"b\).* (angenommen|accepted)", text)
    assert ("Nullpunktabweichung" in text) == (language == "de")
    assert len(text.splitlines()) < 40


@pytest.mark.parametrize("language", ["en", "de"])
def test_page_data_and_python_say_the_same(tmp_path: Path, language: str) -> None:
    """The numbers of the text stand on the page and, in full, in JSON and in Python."""
    s, delta, s_delta = by_hand(measured(tmp_path, 6, -0.003, 0.001))
    results = tmp_path / "line.results"
    for form in ("html", "json"):
        options = ("--protocol", "iso17123-4", "--lang", language, "-o", tmp_path / f"page.{form}")
        assert mor("report", results, *options).code == 0
    data = json.loads((tmp_path / "page.json").read_text(encoding="utf-8"))
    (part,) = data["parts"]
    found = [part[key] for key in ("s", "sigma", "offset", "sigma_offset", "freedom")]
    assert found == pytest.approx([s * 1e3, 2.0, delta * 1e3, s_delta * 1e3, 14], rel=1e-7)
    assert [(test["letter"], test["passed"]) for test in data["tests"]] == [("a", True), ("c", False)]
    assert (data["passed"], data["standard"]) == (False, "iso17123-4")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    said = f"{s * 1e3:.3f} mm"
    assert (said.replace(".", ",") if language == "de" else said) in page
    assert page.count("class=fails") == 1
    assert ("Nullpunktabweichung, absolut" in page) == (language == "de")
    result = api.adjust(tmp_path / "line.yaml")
    here = result.protocol("iso17123-4", against=result)
    assert here["parts"] == data["parts"]
    assert [test["letter"] for test in here["tests"]] == ["a", "b", "c"]
    assert here["tests"][1]["found"] == 1.0
    with pytest.raises(api.InputError, match="did you mean 'iso17123-4'"):
        result.protocol("iso17123-44")


def test_directions(tmp_path: Path) -> None:
    """s by the sums of the standard: residuals of directions reduced to the first target, less their mean in a set."""
    assert mor("new", tmp_path / "test.yaml", "--protocol", "iso17123-3").code == 0
    table, random = tmp_path / "directions.csv", np.random.default_rng(8)
    bearings = np.array([0.0, 71.3, 155.2, 238.9, 330.4])
    values = bearings + random.uniform(0.0, 400.0, (4, 3, 1)) + random.normal(0.0, 0.0006, (4, 3, 5))
    values = np.round(values % 400.0, 5)
    lines = table.read_text().splitlines()
    assert len(lines) == 61
    rows = [line + repr(v) for line, v in zip(lines[1:], values.ravel().tolist(), strict=True)]
    table.write_text("\n".join([lines[0], *rows]) + "\n")
    assert mor("adjust", tmp_path / "test.yaml", "--no-html").code == 0
    reduced = (values - values[:, :, :1]) % 400.0
    difference = reduced.mean(axis=1, keepdims=True) - reduced
    residual = difference - difference.mean(axis=2, keepdims=True)
    s = float(np.sqrt((residual**2).sum() / 32)) * 1e3
    found = figures(view_of_folder(tmp_path / "test.results"), "iso17123-3")
    assert found[0][1:3] == pytest.approx((s, 0.5), rel=1e-8)
    (test,) = statistical_tests(found, None, "iso17123-3")
    assert test.high == pytest.approx(0.5 * np.sqrt(stats.chi2.ppf(0.95, 32) / 32), rel=1e-12)
    assert test.high == pytest.approx(0.5 * 1.20, abs=0.003)  # the factor that the standard prints
    assert test.passed == (s <= test.high)
    run = mor("report", tmp_path / "test.results", "--protocol", "iso17123-3", "--lang", "de")
    assert run.code == 0, run.err
    text = (tmp_path / "test.results" / "protocol.txt").read_text(encoding="utf-8")
    assert f"{s:.3f} mgon, 32 Freiheitsgrade".replace(".", ",") in text
    run = mor("report", tmp_path / "test.results", "--protocol", "iso17123-4", "-o", tmp_path / "x.txt")
    assert (run.code, "found 32 redundancy, expected 14" in run.err) == (2, True)


def test_other_results_are_refused(tmp_path: Path) -> None:
    measured(tmp_path, 1, 0.0, 0.001)
    table = tmp_path / "distances.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:-1]) + "\n")
    assert mor("adjust", tmp_path / "line.yaml", "--no-html", "-f").code == 0
    run = mor("report", tmp_path / "line.results", "--protocol", "iso17123-4")
    assert run.code == 2
    assert "found 20 observations, expected 21" in run.err
    assert mor("report", tmp_path / "line.results", "--protocol", "iso17123-4", "--pdf").code == 2
    run = mor("report", tmp_path / "line.results", "--protocol", "iso17123-4", "-o", tmp_path / "x.csv")
    assert (run.code, "ends in .txt, .html or .json" in run.err) == (2, True)
    assert mor("new", tmp_path / "x.yaml", table, "--protocol", "iso17123-4").code == 2


def test_positions_by_gnss(tmp_path: Path) -> None:
    """s of positions and heights from the deviations from the means of the points, as the standard has it."""
    assert mor("new", tmp_path / "test.yaml", "--protocol", "iso17123-8").code == 0
    table, random = tmp_path / "positions.csv", np.random.default_rng(9)
    lines = table.read_text().splitlines()
    assert (lines[0], len(lines), lines[2]) == ("series,set,point,x,y,z", 31, "1,1,2,,,")
    places = np.array([[1000.0, 2000.0, 100.0], [1008.0, 2006.0, 100.5]])
    values = places + random.normal(0.0, [0.008, 0.008, 0.030], (15, 2, 3))
    rows = [
        line.replace(",,,", ",") + ",".join(map(repr, row))
        for line, row in zip(lines[1:], values.reshape(-1, 3).tolist(), strict=True)
    ]
    table.write_text("\n".join([lines[0], *rows]) + "\n")
    assert mor("adjust", tmp_path / "test.yaml", "--no-html").code == 0
    squares = ((values - values.mean(axis=0)) ** 2).sum(axis=(0, 1)) * 1e6
    expected = [np.sqrt((squares[0] + squares[1]) / 56), np.sqrt(squares[2] / 28)]
    found = figures(view_of_folder(tmp_path / "test.results"), "iso17123-8")
    assert [one.s for one in found] == pytest.approx(expected, rel=1e-7)
    tests = statistical_tests(found, found, "iso17123-8")
    assert [test.letter for test in tests] == ["a", "b", "c", "d"]
    limits = [15.0 * np.sqrt(stats.chi2.ppf(0.95, 56) / 56), 25.0 * np.sqrt(stats.chi2.ppf(0.95, 28) / 28)]
    limits += [stats.f.ppf(0.975, 56, 56), stats.f.ppf(0.975, 28, 28)]
    assert [test.high for test in tests] == pytest.approx(limits, rel=1e-10)
    assert [test.passed for test in tests] == [True, expected[1] <= limits[1], True, True]
    run = mor("report", tmp_path / "test.results", "--protocol", "iso17123-8", "--lang", "de")
    assert run.code == 0, run.err
    text = (tmp_path / "test.results" / "protocol.txt").read_text(encoding="utf-8")
    assert f"Standardabweichung s, Position  {expected[0]:.3f} mm, 56 Freiheitsgrade".replace(".", ",") in text
    assert "b) Standardabweichung s, Höhe" in text


def test_coordinates_of_a_total_station(tmp_path: Path) -> None:
    """s from a triangle and nine orientations adjusted as complex numbers, and from heights adjusted alone."""
    assert mor("new", tmp_path / "test.yaml", "--protocol", "iso17123-5").code == 0
    table, random = tmp_path / "coordinates.csv", np.random.default_rng(11)
    lines = table.read_text().splitlines()
    assert (lines[0], lines[1], len(lines)) == ("system,point,x,y,z", "1-1,2,,,", 19)
    at, to = (np.array([int(line.split(",")[k][-1]) - 1 for line in lines[1:]]) for k in (0, 1))
    places, heights = np.array([0.0, 120.0 + 15.0j, 50.0 + 95.0j]), np.array([0.0, 4.0, -3.0])
    turns = np.repeat(random.uniform(-3.0, 3.0, 9), 2)
    seen = (places[to] - places[at]) * np.exp(1j * turns) + 0.001 * (random.normal(size=(18, 2)) @ [1.0, 1j])
    dz = heights[to] - heights[at] + random.normal(0.0, 0.003, 18)
    rows = [
        f"{line.removesuffix(',,,')},{z.real!r},{z.imag!r},{h!r}"
        for line, z, h in zip(lines[1:], seen.tolist(), dz.tolist(), strict=True)
    ]
    table.write_text("\n".join([lines[0], *rows]) + "\n")
    assert mor("adjust", tmp_path / "test.yaml", "--no-html").code == 0

    def misclosures(x: np.ndarray) -> np.ndarray:
        triangle = np.array([0.0, x[0], x[1] + 1j * x[2]])
        off = (triangle[to] - triangle[at]) * np.exp(1j * np.repeat(x[3:], 2)) - seen
        return np.concatenate([off.real, off.imag])

    bearing = np.angle(places[1])
    start = np.concatenate([[121.0, 60.0, 90.0], turns[::2] + bearing])
    squares = 2.0 * optimize.least_squares(misclosures, start, x_scale="jac", ftol=1e-15, xtol=1e-15).cost
    A = np.eye(3)[to][:, 1:] - np.eye(3)[at][:, 1:]
    expected = 1e3 * np.sqrt([squares / (36 - 12), np.linalg.lstsq(A, dz, rcond=None)[1][0] / (18 - 2)])
    found = figures(view_of_folder(tmp_path / "test.results"), "iso17123-5")
    assert [one.s for one in found] == pytest.approx(expected, rel=1e-6)
    assert [one.part.freedom for one in found] == [24, 16]
    tests = statistical_tests(found, None, "iso17123-5")
    limits = [2.0 * np.sqrt(stats.chi2.ppf(0.95, nu) / nu) for nu in (24, 16)]
    assert [test.high for test in tests] == pytest.approx(limits, rel=1e-10)
    assert [test.passed for test in tests] == [True, False]
    assert mor("report", tmp_path / "test.results", "--protocol", "iso17123-5", "--lang", "de").code == 0
    text = (tmp_path / "test.results" / "protocol.txt").read_text(encoding="utf-8")
    assert text.startswith("Prüfung der Koordinaten einer Totalstation")
    assert f"Standardabweichung s, Höhe      {expected[1]:.3f} mm, 16".replace(".", ",") in text


def test_lengths(tmp_path: Path) -> None:
    """Errors of the lengths between mean coordinates, and their limits A + K·L, by NumPy alone."""
    assert mor("new", tmp_path / "new.yaml", "--protocol", "vdi2634-1").code == 0
    lines = (tmp_path / "lengths.csv").read_text().splitlines()
    ends = [line.split(",")[:2] for line in lines[1:]]
    assert ends == [[f"L{k}-1", f"L{k}-{end}"] for k in range(1, 8) for end in range(2, 7)]
    random = np.random.default_rng(3)
    names = [f"L{k}-{end}" for k in range(1, 8) for end in range(1, 7)]
    ways = random.normal(size=(7, 1, 3))
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    places = (ways * np.array([0.0, 300.0, 600.0, 900.0, 1200.0, 1500.0])[:, None]).reshape(-1, 3)
    measured = places + random.normal(0.0, 0.01, (2, 42, 3))
    mean = dict(zip(names, measured.mean(axis=0), strict=True))
    lengths = np.tile([300.0, 600.0, 900.0, 1200.0, 1500.0], 7)
    table = [f"{a},{b},{length!r}" for (a, b), length in zip(ends, lengths.tolist(), strict=True)]
    (tmp_path / "lengths.csv").write_text("\n".join([lines[0], *table]) + "\n")
    rows = [[name, *map(float, row)] for one in measured for name, row in zip(names, one, strict=True)]
    project = {
        "mor": 1,
        "units": {"length": "mm"},
        "points": [{"columns": ["id"], "rows": [[name] for name in names]}],
        "observations": [
            {
                "type": "coordinates",
                "columns": ["point", "x", "y", "z"],
                "values": {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_z": 0.01},
                "rows": rows,
            }
        ],
        "checks": [{"type": "distance", "file": "lengths.csv", "values": {"sigma": 0.005}}],
    }
    (tmp_path / "test.yaml").write_text(json.dumps(project))
    assert mor("adjust", tmp_path / "test.yaml", "--no-html").code == 0
    found = np.array([np.linalg.norm(mean[b] - mean[a]) for a, b in ends])
    errors, limits = np.abs(found - lengths).reshape(7, 5), (0.01 + 0.01 * lengths / 1e3).reshape(7, 5)
    worst = (errors / limits).argmax(axis=1)[:, None]
    tests = length_tests(view_of_folder(tmp_path / "test.results"), (0.01, 0.01))
    assert [test.found for test in tests] == pytest.approx(np.take_along_axis(errors, worst, 1)[:, 0], rel=1e-6)
    assert [test.high for test in tests] == pytest.approx(np.take_along_axis(limits, worst, 1)[:, 0], rel=1e-9)
    assert [test.passed for test in tests] == (errors <= limits).all(axis=1).tolist()
    options = ("--protocol", "vdi2634-1", "--permissible", 0.01, 0.01, "--lang", "de")
    assert mor("report", tmp_path / "test.results", *options).code == 0
    text = (tmp_path / "test.results" / "protocol.txt").read_text(encoding="utf-8")
    assert f"größte Längenmessabweichung  {errors.max():.4f} mm".replace(".", ",") in text
    assert text.count("angenommen") == (errors <= limits).all(axis=1).sum()
    data = api.adjust(tmp_path / "test.yaml").protocol("vdi2634-1", permissible=(0.01, 0.01))
    assert data["largest_error"] == pytest.approx(errors.max(), rel=1e-6)
    assert data["permissible"] == {"A": 0.01, "K": 0.01}
    assert mor("report", tmp_path / "test.results", *options[:5], "-o", tmp_path / "page.json").code == 0
    written = json.loads((tmp_path / "page.json").read_text(encoding="utf-8"))
    assert [test["passed"] for test in written["tests"]] == (errors <= limits).all(axis=1).tolist()
    assert mor("report", tmp_path / "test.results", *options, "-o", tmp_path / "page.html").code == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert f"{errors.max():.4f} mm".replace(".", ",") in page
    assert mor("report", tmp_path / "test.results", *options[:2], "-o", tmp_path / "x.txt").code == 2
    (tmp_path / "lengths.csv").write_text("\n".join([lines[0], *table[:-1]]) + "\n")
    assert mor("adjust", tmp_path / "test.yaml", "--no-html", "-f").code == 0
    run = mor("report", tmp_path / "test.results", *options[:5], "-o", tmp_path / "x.txt")
    assert (run.code, "found 4 lengths from L7-1, expected at least 5" in run.err) == (2, True)
    (tmp_path / "lengths.csv").write_text("\n".join([lines[0], *table[:-5]]) + "\n")
    assert mor("adjust", tmp_path / "test.yaml", "--no-html", "-f").code == 0
    run = mor("report", tmp_path / "test.results", *options[:5], "-o", tmp_path / "x.txt")
    assert (run.code, "found 6 lines, expected at least 7" in run.err) == (2, True)
