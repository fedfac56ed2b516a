"""Mistakes in small mixtures, of which ``mor diagnose`` once found no cause."""

from __future__ import annotations

import pytest

from tests.scenarios.planted_mistakes.trial import mixture_trial


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(15017, id="names exchanged in an image: only some sights of the two points do not fit"),
        pytest.param(15047, id="names exchanged in one of two images: no sight of the two points fits"),
        pytest.param(15149, id="names exchanged in an image, whose pose they spoil: score tests name them"),
        pytest.param(15024, id="one height of control is wrong, and without the point the datum is not defined"),
    ],
)
def test_the_right_cause_is_first(seed: int) -> None:
    assert mixture_trial(seed).place == 0
