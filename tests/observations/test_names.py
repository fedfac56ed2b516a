"""Names of rows as numbers: they read like the texts they stand for."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.model.contract import Names, coded, names_of, one_name, places, places_of

TEXTS = ["b", "a", "b", "", "é", "a"]


def test_they_read_like_texts() -> None:
    names = coded(pl.Series(TEXTS)).names()
    assert names.known == ("b", "a", "", "é")
    assert list(names) == TEXTS
    assert [names[k] for k in range(len(names))] == TEXTS
    assert np.array(names).tolist() == TEXTS
    assert names.texts().to_list() == TEXTS
    assert list(names.take(slice(1, 3))) == TEXTS[1:3]
    assert list(names.take(np.array([4, 0]))) == ["é", "b"]
    assert list(names_of(TEXTS)) == TEXTS
    assert list(one_name("x", 3)) == ["x"] * 3


def test_places() -> None:
    known = pl.Series(["a", "c", "a", "b"])
    assert places(pl.Series(TEXTS), known).tolist() == [3, 2, 3, -1, -1, 2]
    shared = ("p", "q", "r")
    names = Names(np.array([2, 0], dtype=np.int32), shared)
    assert places_of(names, shared).tolist() == [2, 0]
    assert places_of(names, ("r", "q", "p")).tolist() == [0, 2]
