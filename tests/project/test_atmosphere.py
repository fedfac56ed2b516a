"""First velocity correction of distances: published formulas of manufacturers, and Ciddor's group index."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network
from mor.project.rows import Air, dispersion_constant, first_velocity_correction, vapour_pressure
from tests.scenarios.small_projects import mor, write


def _air(temperature: float, pressure: float, humidity: float = 0.0) -> Air:
    t = np.array([temperature])
    return Air(t, np.array([pressure]), vapour_pressure(t, np.array([humidity])))


def test_the_reference_atmosphere_of_an_instrument_has_no_correction() -> None:
    """Leica, 658 nm: 286.338 − [0.29535 p/(1 + αt) − 4.126e-4 h/(1 + αt) 10^x] is 0 at 12 °C, 1013.25 hPa, 60 %."""
    D = dispersion_constant(0.658)
    assert pytest.approx(0.29535, abs=2e-5) == D / 273.15
    assert 1e6 * first_velocity_correction(_air(12.0, 1013.25, 60.0), 286.338, D)[0] == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(
    ("temperature", "pressure", "humidity"), [(35.0, 850.0, 80.0), (-15.0, 1030.0, 20.0), (20.0, 700.0, 0.0)]
)
def test_the_formula_of_a_manufacturer(temperature: float, pressure: float, humidity: float) -> None:
    """The same in Leica's own terms: its Magnus formula and its α."""
    x = 7.5 * temperature / (237.3 + temperature) + 0.7857
    grows = 1.0 + temperature / 273.15
    ppm = 286.338 - (0.29535 * pressure / grows - 4.126e-4 * humidity / grows * 10.0**x)
    found = first_velocity_correction(_air(temperature, pressure, humidity), 286.338, dispersion_constant(0.658))
    assert 1e6 * found[0] == pytest.approx(ppm, abs=0.02)


def test_the_constant_of_another_manufacturer() -> None:
    """Geodimeter System 600, 850 nm: 274.41 − 79.39 p/(273.15 + t) + 11.27 e/(273.15 + t)."""
    assert dispersion_constant(0.85) == pytest.approx(79.39, abs=0.01)


def _ciddor_group_refractivity(wavelength: float) -> float:
    """(n_g − 1) · 10⁶ of dry air at 15 °C, 1013.25 hPa, 450 ppm CO2 (Ciddor and Hill, Applied Optics 38, 1999)."""
    k0, k1, k2, k3 = 238.0185, 5792105.0, 57.362, 167917.0
    s2 = wavelength**-2
    return 0.01 * (k1 * (k0 + s2) / (k0 - s2) ** 2 + k3 * (k2 + s2) / (k2 - s2) ** 2)


@pytest.mark.parametrize("wavelength", [0.532, 0.633, 0.658, 0.85, 0.91])
def test_group_refractivity_against_ciddor(wavelength: float) -> None:
    """Barrell and Sears agree with it to 0.2 ppm: n is C less the correction in units of 1e-6."""
    correction = first_velocity_correction(_air(15.0, 1013.25), 0.0, dispersion_constant(wavelength))
    assert -1e6 * correction[0] == pytest.approx(_ciddor_group_refractivity(wavelength), abs=0.3)


PROJECT = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[B, 1000, 0, 0]], fixed: [y, z]}
instruments:
  EDM: {atmosphere: {C: 286.338, wavelength: 0.658 um}}
observations:
  - type: distance
    columns: [from, to, distance, temperature, pressure, humidity]
    rows: [[A, B, 1000, 35, 850, 80], [A, B, 1000, 12, 1013.25, 60]]
    values: {sigma: 1 mm}
    instrument: EDM
"""


def test_distances_are_corrected_when_they_are_read(tmp_path: Path) -> None:
    project = write(tmp_path, PROJECT)
    observed = read_network(read_document(project), project.parent).groups[0].observed[:, 0]
    x = 7.5 * 35.0 / (237.3 + 35.0) + 0.7857
    ppm = 286.338 - (0.29535 * 850.0 - 4.126e-4 * 80.0 * 10.0**x) / (1.0 + 35.0 / 273.15)
    np.testing.assert_allclose(observed - 1000.0, [1e-3 * ppm, 0.0], atol=3e-5)
    assert mor("simulate", project, "-o", tmp_path / "again", "--seed", "1").code == 0
    assert "temperature" not in (tmp_path / "again" / "observations_1_distance.csv").read_text()
    again = read_network(read_document(tmp_path / "again" / "project.yaml"), tmp_path / "again")
    np.testing.assert_allclose(again.groups[0].observed, 1000.0, atol=5e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("850, 80", '"", 80'),
            ":10: a distance with a column of the air needs both temperature and pressure",
        ),
        (("850", "85000"), ":10: pressure: expected a value between 300 and 1100 hPa"),
        (("    instrument: EDM\n", ""), "the instrument has no atmosphere: {C: 286.34, D: 80.67}"),
        (("0.658 um", "658 um"), "wavelength: found 658 um, expected one of light"),
        ((", wavelength: 0.658 um", ""), "give either D or wavelength"),
        (("type: distance", "type: horizontal_distance"), "unknown column 'temperature'"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    found = mor("check", write(tmp_path, PROJECT.replace(*change)))
    assert found.code == 2
    assert words in found.err
    assert len(found.err.splitlines()) <= 4
