"""What the command line says about projects that are wrong, as a list of mistakes without the folder they are in."""

from __future__ import annotations

from pathlib import Path

from tests.scenarios.small_projects import BLOCK, LEVELLING, mor, write, write_block

TRIANGLE = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 100, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[C, 50, 80, 5]]}
observations:
  - {type: distance, columns: [from, to, distance, sigma], rows: [[A, C, 94.472, 0.01], [B, C, 94.472, 0.01]]}
"""
VECTOR = "  - {type: vector, columns: [from, to, dx, dy, dz], rows: [[A, C, 50, 80, 5]], covariance: "


def mistakes(project: Path) -> list[str]:
    """What the command line says about a project that is wrong: and it does nothing else than that."""
    before = sorted(project.parent.iterdir())
    run = mor("adjust", project)
    assert run.code == 2
    assert run.out == ""
    assert "Traceback" not in run.err
    assert "internal" not in run.err
    assert sorted(project.parent.iterdir()) == before
    checked = mor("check", project)
    assert (checked.code, checked.out) == (2, "")
    assert checked.err == run.err
    return run.err.replace(f"{project.parent}/", "").splitlines()


def wrong(folder: Path, old: str, new: str, text: str = LEVELLING, **files: str) -> list[str]:
    """Mistakes of a project after one change."""
    assert text.count(old) == 1
    return mistakes(write(folder, text.replace(old, new), **files))


def wrong_block(folder: Path, text: str = BLOCK, **files: str) -> list[str]:
    return mistakes(write_block(folder, text, **files))


def with_observations(folder: Path, *entries: str) -> list[str]:
    """Mistakes of the triangle with further observations, which begin in line 7."""
    return mistakes(write(folder, TRIANGLE + "\n".join(entries) + "\n"))
