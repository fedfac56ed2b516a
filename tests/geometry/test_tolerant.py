"""A singular or infinite member of a stack gives NaN, the others what NumPy gives; start values use nothing else."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from mor.model import rotations as tolerant

MOR = Path(tolerant.__file__).parents[1]
GOOD = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.1], [0.0, 0.1, 3.0]])
REFERENCES = {
    "solve": (lambda A: tolerant.solve(A, np.ones((3, 2))), lambda A: np.linalg.solve(A, np.ones((3, 2)))),
    "inv": (tolerant.inv, np.linalg.inv),
    "cholesky": (tolerant.cholesky, np.linalg.cholesky),
    "pinv": (tolerant.pinv, np.linalg.pinv),
    "eigh": (tolerant.eigh, np.linalg.eigh),
    "eigvalsh": (tolerant.eigvalsh, np.linalg.eigvalsh),
    "eig": (tolerant.eig, np.linalg.eig),
    "eigvals": (tolerant.eigvals, np.linalg.eigvals),
    "svd": (tolerant.svd, np.linalg.svd),
    "singular values": (tolerant.singular_values, lambda A: np.linalg.svd(A, compute_uv=False)),
}


def _parts(result):
    return list(result) if isinstance(result, tuple) else [result]


@pytest.mark.parametrize("name", REFERENCES)
@pytest.mark.parametrize("bad", [np.zeros((3, 3)), -np.eye(3), np.full((3, 3), np.nan), np.full((3, 3), np.inf)])
def test_one_degenerate_member_leaves_the_others_as_they_are(name, bad):
    ours, numpy = REFERENCES[name]
    with np.errstate(all="ignore"):
        found = _parts(ours(np.stack([GOOD, bad, 2.0 * GOOD])))
    for part, first, last in zip(found, _parts(numpy(GOOD)), _parts(numpy(2.0 * GOOD)), strict=True):
        np.testing.assert_array_equal(part[0], first)
        np.testing.assert_array_equal(part[2], last)
    if np.isnan(bad).any():
        assert all(np.isnan(part[1]).any() for part in found)


@pytest.mark.parametrize("name", REFERENCES)
def test_a_single_matrix_is_no_stack(name):
    ours, numpy = REFERENCES[name]
    for part, expected in zip(_parts(ours(GOOD)), _parts(numpy(GOOD)), strict=True):
        np.testing.assert_array_equal(part, expected)


def test_singular_systems_and_infinite_least_squares_have_no_solution():
    assert np.isnan(tolerant.solve(np.zeros((3, 3)), np.ones(3))).all()
    assert np.isnan(tolerant.lstsq(np.full((4, 3), np.nan), np.ones(4))).all()
    np.testing.assert_array_equal(tolerant.lstsq(GOOD, np.ones(3)), np.linalg.lstsq(GOOD, np.ones(3), None)[0])


def test_start_values_and_diagnosis_call_no_function_that_raises():
    bare = re.compile(r"np\.linalg\.(solve|inv|svd|cholesky|eigh|eig|pinv|lstsq|eigvalsh|eigvals|matrix_rank)\b")
    folders = [MOR / name for name in ("approximate", "geometry", "quality")]
    compiled = MOR / "approximate" / "growth" / "compiled" / "poses.py"  # guarded: kernels cannot catch
    allowed = {Path(tolerant.__file__), compiled}
    files = [file for folder in folders for file in folder.rglob("*.py") if file not in allowed]
    assert [str(file) for file in files if bare.search(file.read_text(encoding="utf-8"))] == []
