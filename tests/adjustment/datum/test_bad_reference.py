"""Free networks whose start values are as wrong as the network is large come to rest in their datum."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenarios.mixtures.ingredients import mixture
from tests.scenarios.mixtures.trial import tried


@pytest.mark.slow
@pytest.mark.parametrize("seed", [80044, 80298])
def test_free_network_comes_to_rest_far_from_its_reference(seed: int, tmp_path: Path) -> None:
    # By the first derivatives alone they swing about their datum, at the minimum to all digits.
    trial = tried(mixture(seed), tmp_path)
    assert trial.counts
    assert trial.reached, trial.words
