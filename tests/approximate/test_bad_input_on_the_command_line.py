"""Bad image measurements as a user meets them: one clear message, the documented exit code, no traceback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.cli import run
from tests.selection import slow_but

WORDS = {
    "four": ("fewer than eight homologous points", "share 4 points, relative orientation needs 8"),
    "collinear": ("the points are collinear", "the points are collinear"),
    "identical": ("the same image twice", "the same image twice"),
    "mirrored": ("one bundle is mirrored", "one bundle is mirrored"),
    "mismatched": (
        "the rays do not meet within their precision",
        "the rays do not meet within their precision",
    ),
}
"""What is said by ``mor orient relative``, and by ``mor approximate`` and ``mor adjust``."""


def mirrored_pair(scenes):
    """A pair whose points lie on both sides of the base: only then can two images show that one is mirrored."""
    for seed in range(50):
        made = scenes.scene(seed, 0.001, n=25)
        (x1, _), (x2, _) = made.cameras
        base = (x2 - x1) / np.linalg.norm(x2 - x1)
        away = [(made.points - x) @ base / np.linalg.norm(made.points - x, axis=1) for x in (x1, x2)]
        if 0.2 < np.mean(np.arccos(away).sum(axis=0) < np.pi) < 0.8:
            return made.rays[0], made.rays[1] * [-1.0, 1.0, 1.0]
    raise RuntimeError("no such scene")


def bad(scenes, name):
    """Rays of two images that something is wrong with."""
    rng = np.random.default_rng(5)
    made = scenes.scene(8, 0.001, n=25)
    a, b = made.rays
    if name == "four":
        return scenes.scene(1, 0.001, n=4).rays
    if name == "collinear":
        points = np.linspace(-1, 1, 15)[:, None] * [0.3, 0.8, -0.4]
        return [scenes.image(points, *scenes.camera(rng, points), 0.001, rng) for _ in range(2)]
    if name == "identical":
        return a, a
    if name == "mirrored":
        return mirrored_pair(scenes)
    if name == "behind":
        # Half of the points: those that the second camera would have to see at its back.
        return a, np.where((np.arange(25) % 2 == 0)[:, None], b, b * [-1.0, -1.0, 1.0])
    if name == "mismatched":
        return a, b[rng.permutation(25)]
    return a * [1 / 1.3, 1 / 1.3, 1.0], b * [1 / 1.3, 1 / 1.3, 1.0]


def pairs_table(path: Path, rays) -> str:
    a, b = (one[:, :2].tolist() for one in rays)
    rows = [f"p{k},{x!r},{y!r},{u!r},{v!r}" for k, ((x, y), (u, v)) in enumerate(zip(a, b, strict=True))]
    path.write_text("\n".join(["id,x1,y1,x2,y2", *rows]) + "\n")
    return str(path)


def project(folder: Path, rays, c: float) -> str:
    rows = [
        f"{name},p{k},{x!r},{y!r}"
        for name, one in zip("AB", rays, strict=True)
        for k, (x, y) in enumerate(one[:, :2].tolist())
    ]
    (folder / "observations.csv").write_text("\n".join(["image,point,x,y", *rows]) + "\n")
    (folder / "images.csv").write_text("id,camera\nA,c\nB,c\n")
    (folder / "points.csv").write_text("\n".join(["id", *(f"p{k}" for k in range(len(rays[0])))]) + "\n")
    (folder / "project.yaml").write_text(
        "mor: 1\n"
        f"cameras: {{c: {{interior: {{c: {c}, xh: 0, yh: 0}}}}}}\n"
        "images: [{file: images.csv}]\n"
        "points: [{file: points.csv}]\n"
        "observations: [{type: image, file: observations.csv, values: {sigma: 1 um}}]\n"
        "datum: free\n"
    )
    return str(folder / "project.yaml")


@pytest.mark.parametrize("name", WORDS)
def test_bad_pairs_are_named_by_the_orientation(scenes, tmp_path, capsys, name):
    table = pairs_table(tmp_path / "pairs.csv", bad(scenes, name))
    assert run(["orient", "relative", table, "-c", str(scenes.c)]) == 4
    printed = capsys.readouterr()
    assert WORDS[name][0] in printed.out
    assert "Traceback" not in printed.out + printed.err


@pytest.mark.parametrize("name", slow_but(["four", "identical"], WORDS))
def test_bad_pairs_are_named_by_a_project(scenes, tmp_path, capsys, name):
    path = project(tmp_path, bad(scenes, name), scenes.c)
    assert run(["approximate", path, "-o", str(tmp_path / "start")]) == 2
    printed = capsys.readouterr()
    assert WORDS[name][1] in printed.out
    said = [line for line in printed.out.splitlines() if not line.startswith(("point ", "image ", " "))]
    assert len(said) < 25
    assert run(["adjust", path, "-o", str(tmp_path / "results")]) == 2
    printed = capsys.readouterr()
    assert WORDS[name][1] in printed.err
    assert "Traceback" not in printed.out + printed.err
    written = {path.name for path in (tmp_path / "results").glob("*")}
    assert written <= {"undetermined.csv", "files.json"}  # where more than a screenful has no start values


@pytest.mark.parametrize("name", ["behind", "wrong constant"])
def test_what_half_of_the_points_contradict_is_doubted(scenes, tmp_path, capsys, name):
    """Points behind a camera, and a camera constant wrong by 30 %: either nothing fits, or it is said what does not."""
    table = pairs_table(tmp_path / "pairs.csv", bad(scenes, name))
    code = run(["orient", "relative", table, "-c", str(scenes.c)])
    out = capsys.readouterr().out
    assert code in (0, 4)
    if code == 0:
        assert "points do not agree" in out
        assert "a wrong camera constant" in out
    else:
        assert "do not meet" in out or "in front" in out


def test_a_constant_wrong_by_a_third_is_not_taken_for_good(scenes, tmp_path, capsys):
    path = project(tmp_path, bad(scenes, "wrong constant"), scenes.c)
    run(["approximate", path, "-o", str(tmp_path / "start")])
    said = " ".join(capsys.readouterr().out.split())  # lines are broken
    assert "camera constant, distortion or identities may be wrong" in said
    assert run(["adjust", path, "-o", str(tmp_path / "results"), "--strict"]) == 1
    assert "Global test REJECTED" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["three", "collinear", "identical", "mismatched"])
def test_bad_plane_objects_are_named(scenes, tmp_path, capsys, name):
    made = scenes.plane_scene(8, 0.001, n=12)
    a, b = made.rays
    rays, words = {
        "three": ((a[:3], b[:3]), "fewer than four points"),
        "collinear": (bad(scenes, "collinear"), "are collinear"),
        "identical": ((a, a), "no base"),
        "mismatched": ((a, b[np.random.default_rng(1).permutation(12)]), "mismatched"),
    }[name]
    assert run(["orient", "planar", pairs_table(tmp_path / "p.csv", rays), "-c", str(scenes.c)]) == 4
    printed = capsys.readouterr()
    assert words in printed.out
    assert "Traceback" not in printed.out + printed.err


def test_a_constant_that_nobody_gave_is_guessed_said_and_freed(scenes, tmp_path, capsys):
    """Four images, the constant only by its EXIF entry and 4 % off: said in a note, and adjusted to the truth."""
    rng = np.random.default_rng(2)
    points = scenes.box(rng, 40)
    rays = [scenes.image(points, *scenes.camera(rng, points), 0.001, rng) for _ in range(4)]
    path = Path(project(tmp_path, rays[:2], scenes.c))
    rows = [
        f"I{number},p{k},{x!r},{y!r}" for number, one in enumerate(rays) for k, (x, y) in enumerate(one[:, :2].tolist())
    ]
    (tmp_path / "observations.csv").write_text("\n".join(["image,point,x,y", *rows]) + "\n")
    (tmp_path / "images.csv").write_text("\n".join(["id,camera", *(f"I{k},c" for k in range(4))]) + "\n")
    text = path.read_text().replace(f"interior: {{c: {scenes.c}, xh: 0, yh: 0}}", "focal_length: 30 mm")
    path.write_text(text)
    assert run(["adjust", str(path), "-o", str(tmp_path / "results"), "--json"]) == 0
    printed = capsys.readouterr()
    assert "from focal_length" in printed.out + printed.err + (tmp_path / "results" / "report.txt").read_text()
    assert run(["adjust", str(path), "-o", str(tmp_path / "again"), "--quiet"]) == 0
    report = (tmp_path / "again" / "report.txt").read_text()
    assert "28.8" in report or "28.79" in report


def test_directions_that_count_the_other_way_contradict_known_points(tmp_path, capsys):
    places = {"A": (0.0, 0.0), "B": (100.0, 0.0), "C": (90.0, 70.0), "D": (10.0, 80.0)}
    here = np.array([40.0, 30.0])
    rows = [
        f"S,{name},{np.arctan2(y - here[1], x - here[0]) * 200.0 / np.pi % 400.0:.6f}"
        for name, (x, y) in places.items()
    ]
    (tmp_path / "rows.csv").write_text("\n".join(["station,to,horizontal", *rows]) + "\n")
    project = tmp_path / "project.yaml"
    project.write_text(f"""\
mor: 1
settings: {{dimensions: xy}}
points:
  - {{columns: [id, x, y], rows: {[[name, *xy] for name, xy in places.items()]}, fixed: [x, y]}}
stations: [{{columns: [id], rows: [[S]]}}]
observations:
  - {{type: directions, file: rows.csv, values: {{sigma: 1 mgon}}}}
""")
    assert run(["adjust", str(project)]) == 2
    said = capsys.readouterr().err
    assert "station S: its observations contradict the known coordinates of its points" in said
    assert "too few points" not in said
    assert "mor diagnose searches for mistakes" in said
