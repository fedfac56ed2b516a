"""Geoid heights and deflections of the vertical from grids: GSB against PROJ, against closed forms, and by columns."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from pyproj import Transformer

from mor.project.reference_system import ARCSEC, GridError, values_at
from tests.reference_data import missing, reference_folder
from tests.scenarios.small_projects import mor, write

REAL = reference_folder("earth/dynadjust")
SOUTH, WEST, STEP = 49.0, 9.5, 0.5


def plane(latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
    """(…, 3) N (m), ξ, η (″) of a field that is linear, and so exact by any interpolation."""
    north, east = latitude - SOUTH, longitude - WEST
    return np.stack([45.0 + 3.0 * north - 2.0 * east, 4.0 + 6.0 * north, -7.0 + 8.0 * east + north], axis=-1)


def gsb(order: str = "<", unit: str = "SECONDS", finer: float = 0.0) -> bytes:
    """A GSB grid of 3 × 4 nodes of the plane, and a finer one inside that is higher by so much."""
    scale = {"SECONDS": 3600.0, "MINUTES": 60.0, "DEGREES": 1.0}[unit]

    def record(name: str, value: object) -> bytes:
        if isinstance(value, int):
            packed = struct.pack(order + "i4x", value)
        else:
            packed = struct.pack(order + "d", value) if isinstance(value, float) else f"{value:8}".encode()
        return f"{name:8}".encode() + packed

    def grid(name: str, south: float, west: float, step: float, rows: int, columns: int, up: float) -> bytes:
        latitude = south + step * np.arange(rows)
        longitude = west + step * np.arange(columns)[::-1]  # from the east
        values = plane(*np.meshgrid(latitude, longitude, indexing="ij"))
        nodes = np.zeros((rows, columns, 4))
        nodes[..., :3] = values + np.array([up, 0.0, 0.0])
        limits = (south, latitude[-1], -longitude[0], -west, step, step)
        names = ("S_LAT", "N_LAT", "E_LONG", "W_LONG", "LAT_INC", "LONG_INC")
        head = [record("SUB_NAME", name), *(record(key, "NONE") for key in ("PARENT", "CREATED", "UPDATED"))]
        head += [record(key, float(limit * scale)) for key, limit in zip(names, limits, strict=True)]
        head += [record("GS_COUNT", rows * columns)]
        return b"".join(head) + nodes.astype(order + "f4").tobytes()

    files = 2 if finer else 1
    head = [
        record("NUM_OREC", 11),
        record("NUM_SREC", 11),
        record("NUM_FILE", files),
        record("GS_TYPE", unit),
    ]
    head += [record(key, "X") for key in ("VERSION", "SYSTEM_F", "SYSTEM_T")]
    head += [record(key, 6378137.0) for key in ("MAJOR_F", "MINOR_F", "MAJOR_T", "MINOR_T")]
    fine = grid("FINE", 49.5, 10.0, 0.125, 5, 5, finer) if finer else b""
    whole = grid("WHOLE", SOUTH, WEST, STEP, 3, 4, 0.0)
    return b"".join(head) + fine + whole + record("END", 0.0)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("unit", ["SECONDS", "MINUTES", "DEGREES"])
def test_a_plane_comes_out_of_a_gsb_grid(tmp_path: Path, order: str, unit: str) -> None:
    random = np.random.default_rng(5)
    (tmp_path / "g.gsb").write_bytes(gsb(order, unit, finer=1.0))
    places = np.stack([random.uniform(49.0, 50.0, 50), random.uniform(9.5, 11.0, 50), np.zeros(50)], axis=1)
    places[:2, :2] = [[49.0, 9.5], [50.0, 11.0]]  # corners
    found = values_at(tmp_path / "g.gsb", np.radians(places))
    expected = plane(places[:, 0], places[:, 1])
    fine = (np.abs(places[:, 0] - 49.75) <= 0.25) & (np.abs(places[:, 1] - 10.25) <= 0.25)
    assert 2 < fine.sum() < 48
    expected[fine, 0] += 1.0
    np.testing.assert_allclose(found / [1.0, ARCSEC, ARCSEC], expected, atol=1e-5)
    beyond = np.radians([[48.99, 10.0, 0.0], [49.5, 9.49, 0.0], [49.5, 11.01, 0.0], [50.01, 10.0, 0.0]])
    assert np.isnan(values_at(tmp_path / "g.gsb", beyond)).all()


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
def test_a_real_grid_against_proj() -> None:
    """PROJ takes the same file for shifts of latitude and longitude in ″: those are N and −ξ."""
    assert REAL is not None
    file = REAL / "gnss-network-geoid.gsb"
    random = np.random.default_rng(3)
    latitude, longitude = random.uniform(-37.4, -36.1, 200), random.uniform(145.1, 147.4, 200)
    shift = Transformer.from_pipeline(f"+proj=hgridshift +grids={file}")
    east, north = shift.transform(longitude, latitude)
    found = values_at(file, np.radians(np.stack([latitude, longitude], axis=1)))
    np.testing.assert_allclose((north - latitude) * 3600.0, found[:, 0], atol=1e-6)
    np.testing.assert_allclose((east - longitude) * -3600.0, found[:, 1] / ARCSEC, atol=1e-6)


@pytest.mark.skipif(REAL is None, reason=missing("earth/dynadjust"))
def test_deflections_of_a_real_grid_are_those_of_the_file_beside_it() -> None:
    """``.geo`` was interpolated by DynAdjust, not linearly: to 6 mm and 0.04″, and no sign or order is another."""
    assert REAL is not None
    zone = Transformer.from_crs("EPSG:28355", "EPSG:4283", always_xy=True)
    given = {}
    for line in (REAL / "urban-network.geo").read_text().splitlines()[1:]:
        given[line[:20].strip()] = [float(word) for word in line[20:].split()]
    rows = [line for line in (REAL / "urban-network.stn").read_text().splitlines() if line[24:27] == "UTM"]
    names = [row[:20].strip() for row in rows]
    longitude, latitude = zone.transform(*np.array([row[27:].split()[:2] for row in rows], dtype=float).T)
    found = values_at(REAL / "urban-network-geoid.gsb", np.radians(np.stack([latitude, longitude], axis=1)))
    expected = np.array([given[name] for name in names])
    assert len(expected) > 100
    difference = np.abs(found / [1.0, ARCSEC, ARCSEC] - expected).max(axis=0)
    assert (difference < [0.006, 0.04, 0.04]).all()


def _network(world: str, rows: str, columns: str = "id,east,north,height") -> str:
    return f"""\
mor: 1
units: {{length: m, angle: deg, deflection_north: arcsec, deflection_east: arcsec}}
world: {{crs: "EPSG:25832", heights: orthometric, {world}}}
points:
  - columns: [{columns}]
    rows: [{rows}]
    units: {{deflection_north: arcsec, deflection_east: arcsec}}
settings: {{sigma: apriori}}
datum: fixed
observations:
  - type: zenith_directions
    columns: [station, to, horizontal, zenith]
    rows: [[A, B, 10, 85], [A, C, 320, 87], [A, D, 350.0, 86.0], [B, A, 30, 96], [B, C, 80, 92], [B, D, 60, 91]]
    values: {{sigma: 1 mgon}}
stations:
  - {{columns: [id, point, height], rows: [[A, A, 0], [B, B, 0]]}}
""".replace(
        "units: {length: m, angle: deg, deflection_north: arcsec, deflection_east: arcsec}\n",
        "units: {length: m, angle: deg}\n",
        1,
    )


PLACES = {"A": (600000, 5500000, 100), "B": (600300, 5500400, 150), "C": (600000, 5500400, 120)}


def _placed(further: dict[str, str] | None = None) -> str:
    sigma = {"A": "0", "B": "0", "C": '""'}
    rows = [[name, *place, sigma[name]] for name, place in PLACES.items()]
    own = further or {}
    return ", ".join(f"[{', '.join(map(str, row))}{own.get(str(row[0]), '')}]" for row in rows)


def test_a_grid_and_columns_of_the_same_values_give_the_same(tmp_path: Path) -> None:
    """GSB, two grids GTX, and columns; D has no place and takes the mean, which a note says."""
    (tmp_path / "g.gsb").write_bytes(gsb())
    for k, name in enumerate(("n", "xi", "eta")):
        latitude, longitude = np.meshgrid(SOUTH + STEP * np.arange(3), WEST + STEP * np.arange(4), indexing="ij")
        nodes = plane(latitude, longitude)[..., k].astype(">f4").tobytes()
        (tmp_path / f"{name}.gtx").write_bytes(struct.pack(">ddddii", SOUTH, WEST, STEP, STEP, 3, 4) + nodes)
    longitude, latitude = Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True).transform(
        *np.array(list(PLACES.values()), dtype=float).T[:2]
    )
    values = plane(latitude, longitude)
    mean = values.mean(axis=0)
    own = {name: f", {v[0]!r}, {v[1]!r}, {v[2]!r}" for name, v in zip(PLACES, values.tolist(), strict=True)}
    columns = "id,east,north,height,sigma"
    by_columns = _placed(own) + f', [D, "", "", "", "", {mean[0]}, {mean[1]}, {mean[2]}]'
    by_grid = _placed() + ', [D, "", "", "", ""]'
    texts = {
        "columns": _network("", by_columns, f"{columns},geoid,deflection_north,deflection_east"),
        "gsb": _network("geoid: g.gsb, deflections: g.gsb", by_grid, columns),
        "gtx": _network("geoid: n.gtx, deflections: {north: xi.gtx, east: eta.gtx}", by_grid, columns),
    }
    found = {}
    for name, text in texts.items():
        run = mor("adjust", write(tmp_path, text), "-o", tmp_path / name, "--no-html")
        assert run.code in (0, 1), run.err
        assert ("the mean deflection of all others" in run.err) == (name != "columns")
        found[name] = pl.read_csv(tmp_path / name / "places.csv").drop("id", "geoid", "orthometric_height")
    for name in ("gsb", "gtx"):
        ours, theirs = (found[n].drop("height").to_numpy()[:3] for n in (name, "columns"))
        np.testing.assert_allclose(ours, theirs, atol=2e-6)
    again = mor("adjust", tmp_path / "gsb" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert again.code in (0, 1), again.err
    assert mor("check", tmp_path / "gtx" / "adjusted.yaml").code == 0


@pytest.mark.parametrize(
    ("world", "words"),
    [
        ("geoid: g.gsb, deflections: none.gsb", "deflections: none.gsb: this file does not exist"),
        ("geoid: g.gsb, deflections: n.gtx", "deflections: n.gtx: only a GSB grid holds both deflections"),
        ("geoid: g.gsb, deflections: far.gsb", "the grid of deflections far.gsb covers none of these points"),
        ("geoid: bad.gsb", "geoid: bad.gsb: this is not a binary grid of the format NTv2"),
        ("geoid: short.gsb", "geoid: short.gsb: it ends before its 12 nodes do"),
        ("geoid: g.gsb, deflections: {north: n.gtx}", "east"),
    ],
)
def test_mistakes_of_grids_are_told(tmp_path: Path, world: str, words: str) -> None:
    (tmp_path / "g.gsb").write_bytes(gsb())
    (tmp_path / "n.gtx").write_bytes(b"")
    (tmp_path / "bad.gsb").write_bytes(b"no grid")
    (tmp_path / "short.gsb").write_bytes(gsb()[:480])
    far = gsb().replace(struct.pack("<d", 49.0 * 3600), struct.pack("<d", 39.0 * 3600))
    (tmp_path / "far.gsb").write_bytes(far.replace(struct.pack("<d", 50.0 * 3600), struct.pack("<d", 40.0 * 3600)))
    found = mor("check", write(tmp_path, _network(world, _placed(), "id,east,north,height,sigma")))
    assert found.code == 2
    assert words in found.err
    assert len(found.err.splitlines()) <= 3, found.err


def test_a_damaged_grid_is_a_mistake_and_no_crash(tmp_path: Path) -> None:
    """Some are refused in words, of the others every value is one, or said to be none."""
    whole, random, refused, read = gsb(), np.random.default_rng(1), 0, 0
    for k in range(300):
        damaged = bytearray(whole if k % 2 else whole[: random.integers(20, len(whole))])
        for place in random.integers(0, len(damaged), 4):
            damaged[place] = random.integers(0, 256)
        (tmp_path / "g.gsb").write_bytes(bytes(damaged))
        try:
            with np.errstate(all="raise", under="ignore"):
                found = values_at(tmp_path / "g.gsb", np.radians([[49.4, 10.1, 0.0]]))
        except GridError:
            refused += 1
        else:
            assert found.shape == (1, 3)
            assert not np.isinf(found).any()
            read += 1
    assert min(refused, read) > 30


@pytest.mark.parametrize("step", [1e-320, 1e-12, 1e300])
def test_steps_beyond_all_size_are_refused(tmp_path: Path, step: float) -> None:
    whole = bytearray(gsb())
    for record in (11 + 8, 11 + 9):  # LAT_INC, LONG_INC of the only subgrid
        record_at = record * 16 + 8
        whole[record_at : record_at + 8] = struct.pack("<d", step)
    (tmp_path / "g.gsb").write_bytes(bytes(whole))
    with pytest.raises(GridError, match="nodes"):
        values_at(tmp_path / "g.gsb", np.radians([[49.4, 10.1, 0.0]]))
