"""Networks on the earth as DynAdjust's files: written, read again and adjusted to the same; what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import determinable_start, make_problem
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from mor.formats.dynadjust.writer import sexagesimal_text
from mor.formats.fieldbook.book import sexagesimal
from mor.project.document import Document
from mor.solve.iterate import adjust
from mor.units import parse_dms
from tests.reference_data import missing, network_of, reference_folder

from .test_dynadjust import _files
from .test_dynaml import _rows
from .test_dynaml import files as dynaml

REAL = reference_folder("earth/dynadjust")


def _written(document: Document, folder: Path, target: Path, key: str = "dynadjust") -> Path:
    target.parent.mkdir()
    for path, content in write_foreign(document, folder, target, key).files.items():
        path.write_bytes(content)
    return target


def _same(first: Document, second: Document) -> None:
    """The same observations in any order of their tables, to what their digits carry."""
    both = [sorted(_rows(document), key=lambda row: (row[0], row[1], row[2][:3])) for document in (first, second)]
    for (type_, names, values), (other, theirs, numbers) in zip(*both, strict=True):
        assert (type_, names) == (other, theirs)
        np.testing.assert_allclose(values, numbers, rtol=3e-13, atol=3e-12)


def test_written_and_read_again_it_is_the_same(tmp_path: Path) -> None:
    path = _files(tmp_path)
    document = read_foreign(path)
    again = read_foreign(_written(document, tmp_path, tmp_path / "o" / "n.msr"))
    _same(document, again)
    held = [table["rows"][0][0] for table in again.data["points"] if table.get("fixed")]
    assert held == ["A"]


def test_dynaml_written_and_read_again_is_the_same(tmp_path: Path) -> None:
    document = read_foreign(dynaml(tmp_path))
    path = _written(document, tmp_path, tmp_path / "o" / "n.xml", "dynaml")
    assert sorted(file.name for file in path.parent.iterdir()) == ["nmsr.xml", "nstn.xml"]
    assert format_of(path.with_name("nmsr.xml")) == "dynaml"
    again = read_foreign(path.with_name("nmsr.xml"))
    _same(document, again)
    assert [table["rows"][0][0] for table in again.data["points"] if table.get("fixed")] == ["A"]


def test_dna_becomes_dynaml(tmp_path: Path) -> None:
    document = read_foreign(_files(tmp_path))
    path = _written(document, tmp_path, tmp_path / "o" / "n_msr.xml", "dynaml")
    _same(document, read_foreign(path.with_name("nstn.xml")))


def test_dynaml_becomes_dna(tmp_path: Path) -> None:
    path = dynaml(tmp_path)
    document = read_foreign(path)
    _same(document, read_foreign(_written(document, tmp_path, tmp_path / "o" / "n.msr")))


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
@pytest.mark.parametrize("name", ["gnss-network", "urban-network"])
@pytest.mark.parametrize("key", ["dynadjust", "dynaml"])
def test_real_networks_adjust_to_the_same(tmp_path: Path, name: str, key: str) -> None:
    """With geoid, deflections, stations held in part; geocentric metres have 1e-9 of rounding."""
    assert REAL is not None
    before = read_foreign(REAL / f"{name}.msr")
    path = _written(before, REAL, tmp_path / "o" / ("n.msr" if key == "dynadjust" else "nmsr.xml"), key)
    after = read_foreign(path.with_name("nmsr.xml") if key == "dynaml" else path)
    _same(before, after)
    found = []
    for document, folder in ((before, REAL), (after, tmp_path)):
        network, start = determinable_start(network_of(document, folder))
        values = adjust(make_problem(network, start, start), start).values["point"]
        points = network.things["point"]
        there = network.world.horizon.to_geocentric(values[points.parts["position"]])
        found.append(dict(zip(points.ids, there, strict=True)))
    assert set(found[0]) == set(found[1])
    difference = [np.abs(found[0][name] - found[1][name]).max() for name in found[0]]
    assert max(difference) < 1e-8


def test_angles_as_text() -> None:
    """Every digit again, and no 60 seconds."""
    rng = np.random.default_rng(2)
    for angle in [*rng.uniform(-3.1, 3.1, 200), np.radians(59.99999999999999), -np.radians(1e-9)]:
        assert sexagesimal(sexagesimal_text(float(angle))) == pytest.approx(np.degrees(angle), abs=6e-14)


def test_what_dna_cannot_say_is_refused(tmp_path: Path) -> None:
    document = read_foreign(_files(tmp_path))
    changes = (
        (
            {"world": {"crs": "EPSG:4326", "heights": "ellipsoidal"}},
            "files are in GDA94 or GDA2020 or .*, found WGS 84",
        ),
        ({"axes": {"angles": "counterclockwise"}}, "angles clockwise"),
    )
    for change, words in changes:
        other = replace(document, data={**document.data, **change})
        with pytest.raises(InputError, match=words):
            write_foreign(other, tmp_path, tmp_path / "o.msr", "dynadjust")
    plain = {key: value for key, value in document.data.items() if key != "world"}
    with pytest.raises(InputError, match="this project has no world"):
        write_foreign(replace(document, data=plain), tmp_path, tmp_path / "o.msr", "dynadjust")
    points = [dict(table) for table in document.data["points"]]
    points[0] = {**points[0], "values": {"sigma": "0.01"}, "fixed": []}
    with pytest.raises(InputError, match="DNA holds coordinates or leaves them free"):
        write_foreign(
            replace(document, data={**document.data, "points": points}), tmp_path, tmp_path / "o", "dynadjust"
        )


@pytest.mark.parametrize("key", ["dynadjust", "dynaml"])
def test_directions_of_set_ups_and_in_face_two(tmp_path: Path, key: str) -> None:
    """Two set-ups over a point are two sets from it; readings of face two are those of face one."""
    document = read_foreign(_files(tmp_path))
    sights = [
        ["S1", "B B", "10", "0.001", None],
        ["S1", "C", "250", "0.001", "2"],
        ["S2", "C", "3", "0.002", None],
    ]
    columns = ["station", "to", "horizontal", "sigma", "face"]
    units = {"horizontal": "gon", "sigma": "gon"}
    table = {"type": "directions", "columns": columns, "rows": sights, "units": units}
    tables = [table, *(one for one in document.data["observations"] if one["type"] != "directions")]
    set_ups = [{"columns": ["id", "point", "height"], "rows": [["S1", "A", "1.5"], ["S2", "A", "0"]]}]
    document = replace(document, data={**document.data, "observations": tables, "stations": set_ups})
    notes = [note.message for note in write_foreign(document, tmp_path, tmp_path / "n.msr", key).notes]
    assert "directions have no heights of instrument and target in DynAdjust" in notes
    path = _written(document, tmp_path, tmp_path / "o" / ("n.msr" if key == "dynadjust" else "nmsr.xml"), key)
    table = next(one for one in read_foreign(path).data["observations"] if one["type"] == "directions")
    assert [(row[0], row[1], row[4]) for row in table["rows"]] == [
        ("A", "B B", "1"),
        ("A", "C", "1"),
        ("A", "C", "2"),
    ]
    found = [parse_dms(row[2]) for row in table["rows"]]
    np.testing.assert_allclose(found, [9.0, 45.0, 2.7], atol=1e-11)
    set_ups[0]["rows"][1][1] = None
    with pytest.raises(InputError, match="station 'S2' has no point"):
        write_foreign(document, tmp_path, tmp_path / "n.msr", key)
