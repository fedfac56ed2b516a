"""A few seeds of the generator of orientations: what is called determined is, and σ are those of the errors."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest


def generator():
    path = Path(__file__).parents[1] / "orientations.py"
    spec = importlib.util.spec_from_file_location("orientations", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


G = generator()


@pytest.mark.parametrize("name", ["relative", "planar"])
def test_what_is_called_determined_is(name):
    trials = [getattr(G, name)(seed) for seed in range(60)]
    assert G.wrong(trials) == []
    determined = [trial for trial in trials if trial.errors]
    assert len(determined) > 25
    squares = np.array([np.mean(np.concatenate(list(trial.errors.values())) ** 2) for trial in determined])
    assert np.mean(squares) == pytest.approx(1.0, abs=5 * np.std(squares) / np.sqrt(len(squares)))


def test_one_centre_and_one_normal_are_named():
    trials = [G.planar(seed) for seed in range(30)]
    assert {t.outcome for t in trials if t.kind == "one centre"} == {"NO_BASE"}
    assert {t.outcome for t in trials if t.kind == "one normal"} == {"BASE_ALONG_NORMAL"}
    assert {t.outcome for t in (G.relative(seed) for seed in range(25)) if t.kind == "one centre"} == {
        "NO_BASE"
    }
