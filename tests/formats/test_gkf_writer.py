"""Networks as GNU Gama's XML: real ones written and read again adjust to the same; what it cannot say is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, solve_network
from mor.errors import InputError
from mor.formats import write_foreign
from tests.reference_data import NETWORKS, network_name, network_of, point_results


def _again(source: Path, folder: Path) -> tuple[Path, list[str]]:
    document = read_document(source)
    out = write_foreign(document, source.parent, folder / "again.gkf", "gkf")
    for path, content in out.files.items():
        path.write_bytes(content)
    return folder / "again.gkf", [note.message for note in out.notes]


REAL = [path for path in NETWORKS if path.parent.name == "gama" or path.match("textbook/[bk]*.yaml")]


@pytest.mark.parametrize("path", REAL, ids=network_name)
def test_real_networks_adjust_to_the_same(path: Path, tmp_path: Path) -> None:
    again, _ = _again(path, tmp_path)
    first, second = (solve_network(network_of(read_document(p), p.parent)) for p in (path, again))
    before, after = point_results(first), point_results(second)
    assert list(before) == list(after)
    scale = max(float(np.abs(xyz).max()) for xyz, _ in before.values())
    for name, (xyz, sigma) in before.items():
        np.testing.assert_allclose(after[name][0], xyz, rtol=0, atol=1e-9 * max(scale, 1.0), err_msg=name)
        np.testing.assert_allclose(after[name][1], sigma, rtol=1e-6, atol=1e-12, err_msg=name)


NET = """mor: 1
units: {length: mm, angle: deg}
points:
  - columns: [id, x, y, z]
    rows: [["A & B", 0, 0, 10000], [B, 100000, 0, 10000]]
    fixed: [x, y, z]
  - columns: [id, x, y, z, sigma_z]
    rows: [[C, 50000, 80000, 12000, 5]]
stations:
  - columns: [id, point, height]
    rows: [[S, "A & B", 1500]]
observations:
  - type: zenith_directions
    columns: [station, to, horizontal, zenith, to_height, face]
    rows: [[S, B, 10, 90.5, 1300, 1], [S, C, 307.9, 89.0, 1300, 1], [S, C, 127.9, 271.0, 1300, 2]]
    values: {sigma: 5 arcsec}
  - type: distance
    columns: [from, to, distance, from_height, to_height]
    rows: [["A & B", C, 94362, 1500, 1300]]
    values: {sigma: 2}
    ppm: 5
  - type: vector
    columns: [from, to, dx, dy, dz, sigma]
    rows: [[B, C, -50001, 80002, 1999, 10]]
  - type: spatial_angle
    columns: [at, from, to, angle, sigma]
    rows: [["A & B", B, C, 58, 0.01]]
"""


def test_heights_faces_units_and_what_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "net.yaml"
    path.write_text(NET)
    again, notes = _again(path, tmp_path)
    assert "observations spatial_angle" in " ".join(notes)
    without = tmp_path / "without.yaml"
    without.write_text(NET[: NET.index("  - type: spatial_angle")])
    first, second = (solve_network(network_of(read_document(p), tmp_path)) for p in (without, again))
    before, after = point_results(first), point_results(second)
    for name in before:
        np.testing.assert_allclose(after[name][0], before[name][0] / 1e3, rtol=0, atol=1e-7)
        np.testing.assert_allclose(after[name][1], before[name][1] / 1e3, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("fixed: [x, y, z]", "fixed: [x, z]", "GNU Gama fixes x and y together"),
        (
            'height]\n    rows: [[S, "A & B", 1500]]',
            'height]\n    rows: [[S, "A & B", 1500]]\n    level: 2 mgon',
            "levelled",
        ),
        ("units:", "axes: {bearings_from: south}\nunits:", "counts bearings from north"),
    ],
)
def test_what_it_cannot_say_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "net.yaml"
    path.write_text(NET.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        _again(path, tmp_path)


def _changed_net(tmp_path: Path, old: str, new: str) -> Path:
    path = tmp_path / "net.yaml"
    assert old in NET
    path.write_text(NET.replace(old, new))
    return path


def test_a_distance_from_a_station_begins_at_its_point_with_its_height(tmp_path: Path) -> None:
    path = _changed_net(tmp_path, '[["A & B", C, 94362, 1500, 1300]]', '[[S, point:C, 94362, "", 1300]]')
    written, _ = _again(path, tmp_path)
    line = next(one for one in written.read_text().splitlines() if "<s-distance" in one)
    assert 'from="A &amp; B" to="C"' in line
    assert 'from_dh="1.5" to_dh="1.3"' in line


def test_a_set_up_that_sights_its_own_point_is_refused(tmp_path: Path) -> None:
    path = _changed_net(tmp_path, "[S, B, 10, 90.5, 1300, 1]", '[S, "A & B", 10, 90.5, 1300, 1]')
    with pytest.raises(InputError, match=r"net.yaml:\d+: point 'A & B' is observed from itself"):
        _again(path, tmp_path)
