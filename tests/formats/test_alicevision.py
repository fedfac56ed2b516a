"""AliceVision: blocks computed by the program's own equations come back without residuals, mistakes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.model.rotations import exponential
from mor.types import FloatArray
from tests.reference_data import network_of

SIZE, FOCAL, CENTRE = (4000, 3000), 2884.25, (1990.5, 1511.25)
PARAMETERS = {
    "": [],
    "radial1": [-0.08],
    "radial3": [0.08, -0.1, 0.03],
    "brown": [0.08, -0.1, 0.03, 1e-3, -2e-3],
    "fisheye4": [-0.02, 4e-3, -1e-3, 2e-4],
}


def _poses() -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
    """Rotations (object to camera), centres, points in front of all of them."""
    rng = np.random.default_rng(11)
    R = [exponential(np.array([0.2 * k - 0.4, 0.15 * k, 0.7 * k])) for k in range(5)]
    points = rng.uniform(-1.5, 1.5, (12, 3))
    centres = [-(one.T @ (np.array([0.1, -0.2, 6.0]) + 0.1 * rng.standard_normal(3))) for one in R]
    return R, centres, points


def _seen(kind: str, R: FloatArray, centre: FloatArray, X: FloatArray) -> FloatArray:
    """px: the equations of the program's source."""
    ray = (X - centre) @ R.T
    x, y = ray[:, 0] / ray[:, 2], ray[:, 1] / ray[:, 2]
    p = PARAMETERS[kind]
    r2 = x * x + y * y
    if kind == "fisheye4":
        r = np.sqrt(r2)
        theta = np.arctan(r)
        scale = theta * (1 + sum(k * theta ** (2 * i + 2) for i, k in enumerate(p))) / r
        x, y = x * scale, y * scale
    elif kind:
        radial = 1 + sum(k * r2 ** (i + 1) for i, k in enumerate(p[:3]))
        t1, t2 = p[3:] if kind == "brown" else (0.0, 0.0)
        tx = t2 * (r2 + 2 * x * x) + 2 * t1 * x * y
        ty = t1 * (r2 + 2 * y * y) + 2 * t2 * x * y
        x, y = x * radial + tx, y * radial + ty
    return FOCAL * np.stack([x, y], axis=1) + CENTRE


def _texts(value: Any) -> Any:
    """Every number as a text."""
    if isinstance(value, dict):
        return {key: _texts(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_texts(one) for one in value]
    return value if isinstance(value, str) else repr(value)


def alicevision(kind: str = "radial3", version: tuple[int, ...] = (1, 2, 6)) -> dict[str, Any]:
    """A block as AliceVision writes it: px and corner before 1.2, mm and centre since 1.2.1."""
    R, C, X = _poses()
    camera: dict[str, Any] = {"intrinsicId": 77, "width": SIZE[0], "height": SIZE[1], "serialNumber": "x"}
    camera |= {"type": kind or "pinhole", "distortionParams": PARAMETERS[kind] or "", "locked": 0}
    if version >= (1, 2, 1):
        offset = [c - s / 2 for c, s in zip(CENTRE, SIZE, strict=True)]
        camera |= {
            "sensorWidth": 8.0,
            "focalLength": FOCAL * 8.0 / SIZE[0],
            "pixelRatio": 1,
            "principalPoint": offset,
        }
    else:
        camera |= {"pxFocalLength": FOCAL, "principalPoint": list(CENTRE)}
    seen = [_seen(kind, R[k], C[k], X) for k in range(5)]
    return _texts({
        "version": list(version),
        "featuresFolders": [],
        "views": [
            {"viewId": 100 + k, "poseId": 200 + k, "intrinsicId": 77, "path": f"D:\\a b\\f{k}.jpg",
             "width": SIZE[0], "height": SIZE[1], "metadata": {"Make": "x"}} for k in range(6)
        ],
        "intrinsics": [camera],
        "poses": [
            {"poseId": 200 + k, "pose": {"transform": {
                "rotation": R[k].T.ravel().tolist(), "center": C[k].tolist()}, "locked": 0}} for k in range(5)
        ],
        "structure": [
            {"landmarkId": n, "descType": "sift", "color": [1, 2, 3], "X": X[n].tolist(), "observations": [
                {"observationId": 100 + k, "featureId": n, "x": seen[k][n].tolist(), "scale": 1} for k in range(5)
            ]} for n in range(12)
        ],
    })  # fmt: skip


def _read(folder: Path, name: str, data: dict[str, Any]) -> Path:
    (folder / name).write_text(json.dumps(data, indent=1).replace("/", "\\/"))
    return folder / name


@pytest.mark.parametrize(
    ("version", "kind"),
    [
        *(((1, 2, 6), kind) for kind in PARAMETERS),
        ((1, 0, 0), "brown"),
    ],
)
def test_blocks_have_no_residuals(tmp_path: Path, version: tuple[int, ...], kind: str) -> None:
    path = _read(tmp_path, "sfm.sfm", alicevision(kind, version))
    assert format_of(path) == "alicevision"
    document = read_foreign(path)
    notes = " ".join(map(str, document.notes))
    assert "images without a pose (1)" in notes
    for camera in document.data["cameras"].values():  # as it stands, nothing but the rounding of the file is left
        camera["interior"] = {k: {"fixed": v["free"]} for k, v in camera["interior"].items()}
    solved = solve_network(network_of(document, tmp_path))
    assert len(solved.adjustment.iterations) <= 2
    assert max(float(np.abs(q.v).max()) for q in solved.quality.groups) < 1e-7
    assert [row[0] for row in document.data["images"][0]["rows"]] == [f"f{k}.jpg" for k in range(5)]


def test_a_file_with_cameras_only_says_so(tmp_path: Path) -> None:
    data = alicevision()
    del data["structure"]
    document = read_foreign(_read(tmp_path, "cameras.sfm", data))
    assert "cameras and poses only" in " ".join(map(str, document.notes))
    assert len(document.data["images"][0]["rows"]) == 5


@pytest.mark.parametrize(
    ("make", "old", "new", "words"),
    [
        (alicevision, '"radial3"', '"3deanamorphic4"', r"a\.json:\d+: intrinsic 77: type '3deanamorphic4'"),
        (alicevision, '"pixelRatio": "1"', '"pixelRatio": "2"', "found the pixelRatio 2"),
        (alicevision, '"sensorWidth": "8.0"', '"sensorWidth": "0"', "found the sensorWidth 0 mm"),
        (alicevision, '"locked": "0"', '"locked": "0", "pxFocalLength": ["1", "2"]', "two focal lengths"),
        (alicevision, '"version"', '"versions"', r"a\.json:1: version: found None"),
        (alicevision, '"landmarkId": "3"', '"landmarkId": "2"', r"a\.json:\d+: landmark '2' is there twice"),
    ],
)  # fmt: skip
def test_mistakes_have_their_place(tmp_path: Path, make: Any, old: str, new: str, words: str) -> None:
    path = tmp_path / "a.json"
    text = json.dumps(make(), indent=1)
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=words):
        read_foreign(path, make.__name__)


def test_locked_cameras_are_fixed(tmp_path: Path) -> None:
    data = alicevision()
    data["intrinsics"][0]["locked"] = "true"
    interior = read_foreign(_read(tmp_path, "a.sfm", data)).data["cameras"]["77"]["interior"]
    assert {status for setting in interior.values() for status in setting} == {"fixed"}
