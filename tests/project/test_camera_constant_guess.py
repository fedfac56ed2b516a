"""Camera constants that nobody gave: from EXIF-like entries, or a stated first guess, and free in either case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_network
from mor.errors import InputError
from mor.project.document import read_yaml
from mor.project.network import Network

PROJECT = """
mor: 1
cameras:
  C:
    image: {{width: 6000, height: 4000, pixel: 4 um}}
    {entries}
images:
  - columns: [id, camera, x, y, z, omega, phi, kappa]
    rows: [[1, C, 0, 0, 10, 0, 0, 0]]
points:
  - {{columns: [id, x, y, z], rows: [[P, 0, 0, 0]]}}
observations:
  - {{type: image, columns: [image, point, x, y], rows: [[1, P, 0, 0]], values: {{sigma: 1 um}}}}
"""


def network_of(entries: str) -> Network:
    return read_network(read_yaml(PROJECT.format(entries=entries), "p.yaml"), Path())


@pytest.mark.parametrize(
    ("entries", "expected", "words"),
    [
        ("focal_length: 28 mm", 28.0, "from focal_length"),
        (
            "focal_length_35mm: 42",
            42.0 * np.hypot(24.0, 16.0) / np.hypot(36.0, 24.0),
            "from focal_length_35mm",
        ),
        ("unit: mm", 24.0, "a first guess"),
        ("unit: px", 6000.0, "a first guess"),
        ("model: opencv", 24.0, "a first guess"),
    ],
)
def test_first_guess_is_free_and_said(entries: str, expected: float, words: str) -> None:
    network = network_of(entries)
    kind = next(key for key in network.blocks if key.startswith("interior/"))
    assert network.start[kind][0, 0] == pytest.approx(expected, rel=1e-12)
    assert network.blocks[kind].free[0, 0]
    assert words in network.notes[0].message


def test_a_given_constant_is_left_alone() -> None:
    network = network_of("interior: {c: 25}\n    focal_length: 28 mm")
    assert network.start["interior/mor"][0, 0] == 25.0
    assert not network.blocks["interior/mor"].free[0, 0]
    assert network.notes == ()


def test_without_anything_to_guess_from_it_is_required() -> None:
    text = PROJECT.format(entries="unit: mm").replace("    image: {width: 6000, height: 4000, pixel: 4 um}\n", "")
    with pytest.raises(InputError, match=r"c \(camera constant\) is required"):
        read_network(read_yaml(text, "p.yaml"), Path())
