"""What goes into a file of the state and comes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.adjustment.domains.store import FileStore
from mor.observations import IMAGE_TYPES


@pytest.mark.parametrize(
    "array",
    [
        np.broadcast_to(np.array([1.0, 2.0]), (100_000, 2)),
        np.broadcast_to(np.arange(3)[:, None], (3, 100_000)),
        np.broadcast_to(np.float32(7.0), (100, 1000)),
    ],
)
def test_repeated_rows_are_kept_once_and_come_back_as_they_were(array: np.ndarray, tmp_path: Path) -> None:
    store = FileStore(tmp_path)
    store.save("thing/0", {"array": array})
    found = store.load("thing/0")["array"]
    assert (tmp_path / "thing" / "0.pickle").stat().st_size < 1000
    assert found.dtype == array.dtype
    assert found.strides == array.strides
    np.testing.assert_array_equal(found, array)


def test_arrays_without_rows(tmp_path: Path) -> None:
    store = FileStore(tmp_path)
    store.save("thing/0", np.broadcast_to(np.array([1.0, 2.0]), (0, 2)))
    assert store.load("thing/0").shape == (0, 2)


def test_observation_types_are_the_same_ones(tmp_path: Path) -> None:
    store = FileStore(tmp_path)
    kind = next(iter(IMAGE_TYPES.values()))
    store.save("thing/0", (kind,))
    assert store.load("thing/0")[0] is kind
