"""Networks on the earth as SNAP's files: written, read again and adjusted to the same; what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from mor.api.pipeline import determinable_start, make_problem, read_document
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from mor.project.document import Document
from mor.solve.iterate import adjust
from mor.solve.problem import misclosures
from mor.types import FloatArray
from tests.reference_data import missing, network_of, reference_folder

from .test_dynadjust import _files as dynadjust
from .test_snap import _files, _text

REAL = reference_folder("earth/snap")


def written(document: Document, folder: Path, target: Path) -> Path:
    """A command file with its two others; returns it."""
    target.parent.mkdir(exist_ok=True)
    for path, content in write_foreign(document, folder, target, "snap").files.items():
        path.write_bytes(content)
    return target.with_suffix(".snp")


_VECTORS = ("x", "y", "z", "dx", "dy", "dz")


class Adjusted(NamedTuple):
    """Every scalar observation by name, with its σ and v; vᵀPv; geocentric places of all points."""

    omega: float
    components: list[tuple[str, float, float]]
    places: dict[str, FloatArray]


def _adjusted(document: Document, folder: Path) -> Adjusted:
    network, start = determinable_start(network_of(document, folder))
    done = adjust(make_problem(network, start, start), start)
    values, found = done.values, []
    for group in network.groups:
        misclosure = misclosures(group, values)
        for row, column in np.argwhere(group.mask).tolist():
            name = group.type.components[column].name
            if name in _VECTORS:  # they may be whitened
                continue
            found.append((name, float(group.given_sigma[row, column]), float(misclosure[row, column])))
    points = network.things["point"]
    places = network.world.horizon.to_geocentric(values["point"][points.parts["position"]])
    ordered = sorted(found, key=lambda one: (one[0], round(one[1], 10), one[2]))
    return Adjusted(done.iterations[-1].objective, ordered, dict(zip(points.ids, places, strict=True)))


def _same(first: Adjusted, second: Adjusted) -> None:
    """Latitudes and longitudes in degrees, and geocentric metres, have some 1e-9 m of rounding."""
    assert second.omega == pytest.approx(first.omega, rel=1e-7)
    for (name, sigma, v), (other, own, w) in zip(first.components, second.components, strict=True):
        assert name == other
        assert (own, w) == (pytest.approx(sigma, rel=1e-9), pytest.approx(v, abs=6e-9))
    assert first.places.keys() == second.places.keys()
    for name, place in first.places.items():
        np.testing.assert_allclose(place, second.places[name], atol=6e-9)


@pytest.mark.skipif(REAL is None, reason=missing("earth/snap"))
def test_its_own_test_of_all_observations_comes_back(tmp_path: Path) -> None:
    """Every observation, its σ, residual and redundancy; once more written it is the same text."""
    assert REAL is not None
    before = read_foreign(REAL / "test1.snp")
    path = written(before, REAL, tmp_path / "o" / "n.snp")
    assert format_of(path) == format_of(path.with_suffix(".dat")) == "snap"
    after = read_foreign(path)
    _same(_adjusted(before, REAL), _adjusted(after, path.parent))
    again = written(after, path.parent, tmp_path / "p" / "n.snp")
    for end in (".snp", ".crd"):
        assert again.with_suffix(end).read_bytes() == path.with_suffix(end).read_bytes()


@pytest.mark.slow
def test_generated_networks_adjust_to_the_same(tmp_path: Path) -> None:
    for seed in range(8):
        stations, data, _ = _text(np.random.default_rng(seed))
        before = read_foreign(_files(tmp_path, data, stations, "coordinate_file n.crd\ndata_file n.dat\nfix s0 S1\n"))
        path = written(before, tmp_path, tmp_path / "o" / "n.snp")
        _same(_adjusted(before, tmp_path), _adjusted(read_foreign(path), path.parent))


_PROJECT = """
mor: "1"
title: all kinds ! of rows
units: {length: m, angle: gon}
world: {crs: EPSG:2193, heights: orthometric}
points:
  - columns: [id, east, north, height, geoid, deflection_north, deflection_east]
    units: {deflection_north: arcsec, deflection_east: arcsec}
    fixed: [x, y, z]
    rows: [[A, 1600000.0, 5400000.0, 100.0, 12.5, 3.0, -2.0]]
  - columns: [id, east, north, height, geoid, deflection_north, deflection_east]
    units: {deflection_north: arcsec, deflection_east: arcsec}
    rows: [[B, 1600800.0, 5400500.0, 140.0, 12.6, 3.1, -2.1], [C, 1600100.0, 5400900.0, 80.0, 12.7, 3.2, -2.2]]
stations:
  - columns: [id, point, height]
    rows: [[S1, A, 1.6], [S2, A, 1.6]]
instruments:
  refraction day: {refraction: {free: 0.13}}
  EDM: {scale: {free: 1}}
observations:
  - {type: directions, columns: [station, to, horizontal, sigma], units: {sigma: mgon},
     rows: [[S1, B, 10.0, 0.5], [S1, C, 345.8, 0.5], [S2, B, 20.001, 0.6], [S2, C, 355.802, 0.6]]}
  - {type: zenith_angle, instrument: refraction day, columns: [from, to, zenith_angle, from_height, to_height, sigma],
     units: {sigma: mgon}, rows: [[A, B, 97.3, 1.6, 1.2, 1], [A, C, 101.5, 1.6, 0, 1], [B, C, 103.4, 0, 0, 1]]}
  - {type: zenith_angle, columns: [from, to, zenith_angle, sigma], units: {sigma: mgon}, rows: [[C, B, 96.66, 1]]}
  - {type: distance, columns: [from, to, distance, from_height, sigma], rows: [[A, B, 944.2, 1.6, 0.004]]}
  - {type: distance, instrument: EDM, columns: [from, to, distance, sigma],
     rows: [[B, A, 944.21, 0.004], [B, C, 809.1, 0.004]]}
  - {type: gnss_vector, values: {sigma: 0.01}, columns: [from, to, dx, dy, dz, from_height, to_height],
     rows: [[A, B, -273.0, -845.0, 331.0, 0, 0], [A, C, -520.0, -135.0, 720.0, 1.2, 1.3]]}
  - {type: gnss_vector, columns: [from, to, dx, dy, dz],
     rows: [[B, A, 273.0, 845.0, -331.0], [B, C, -247.0, 710.0, 389.0]],
     covariance: [[4.e-4, 0, 0, 1.e-5, 0, 0], [0, 5.e-4, 0, 0, 1.e-5, 2.e-5], [0, 0, 6.e-4, 0, 0, 1.e-5],
                  [1.e-5, 0, 0, 4.e-4, 0, 0], [0, 1.e-5, 0, 0, 4.e-4, 0], [0, 2.e-5, 1.e-5, 0, 0, 4.e-4]]}
  - {type: geodetic_position, columns: [point, latitude, sigma_latitude, height, sigma_height],
     units: {sigma_latitude: mgon}, rows: [[B, -46.162, 0.05, 152.6, 0.5]]}
  - {type: projected_bearing, columns: [from, to, bearing, sigma], units: {sigma: mgon}, rows: [[A, B, 64.4, 2]]}
  - {type: orthometric_height, columns: [point, height, sigma], rows: [[C, 80.01, 0.02]]}
"""


def _project(folder: Path, text: str = _PROJECT) -> Document:
    (folder / "n.yaml").write_text(text)
    return read_document(folder / "n.yaml")


def test_a_project_of_all_kinds_comes_back(tmp_path: Path) -> None:
    """In a projection, with heights above the geoid, deflections, set-ups, heights, refraction, a scale, clusters."""
    document = _project(tmp_path)
    notes = " / ".join(note.message for note in write_foreign(document, tmp_path, tmp_path / "n.snp", "snap").notes)
    assert "directions are written without heights" in notes
    path = written(document, tmp_path, tmp_path / "o" / "n.snp")
    after = read_foreign(path)
    assert after.data["instruments"]["refraction DAY"] == {"refraction": {"free": "0.13"}}
    assert sum("covariance" in table for table in after.data["observations"]) == 1
    plain = _project(tmp_path, _PROJECT.replace("A, 1.6]", "A, 0]"))
    _same(_adjusted(plain, tmp_path), _adjusted(after, path.parent))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[A, 1600000.0", "[A-1, 1600000.0", "SNAP's codes have up to 15 letters"),
        (
            "refraction: {free: 0.13}",
            "refraction: {observed: 0.13, sigma: 0.01}",
            "instrument 'refraction day'",
        ),
        ("EDM: {scale: {free: 1}}", "EDM: {offset: {free: 0}}", "instrument 'EDM': of instruments SNAP has"),
        (
            "[B, A, 273.0, 845.0, -331.0]",
            "[A, B, -273.0, -845.0, 331.0]",
            "clusters of vectors that begin in one",
        ),
        ("[B, C, 809.1, 0.004]", "[A, C, 905.0, 0.004]", "ratios from one station"),
        ("fixed: [x, y, z]", "values: {sigma: 0.01}", "SNAP holds coordinates or leaves them free"),
        (
            "type: orthometric_height,",
            "type: orthometric_height, centring: {target: 0.1},",
            "without centring",
        ),
    ],
)
def test_what_snap_cannot_say_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in _PROJECT
    text = _PROJECT.replace(old, new, 1)
    if "A-1" in new:
        text = text.replace(", A,", ", A-1,").replace("[A,", "[A-1,")
    with pytest.raises(InputError) as raised:
        write_foreign(_project(tmp_path, text), tmp_path, tmp_path / "o.snp", "snap")
    assert any(said in problem.message for problem in raised.value.problems), raised.value


def test_other_projects_are_refused(tmp_path: Path) -> None:
    document = _project(tmp_path)
    plain = {key: value for key, value in document.data.items() if key != "world"}
    with pytest.raises(InputError, match="this project has no world"):
        write_foreign(replace(document, data=plain), tmp_path, tmp_path / "o.snp", "snap")
    with pytest.raises(InputError, match=r"SNAP's coordinates are written in .*, found GDA2020"):
        write_foreign(read_foreign(dynadjust(tmp_path)), tmp_path, tmp_path / "o.snp", "snap")
