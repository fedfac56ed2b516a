"""A network that does not converge although it fits far better than its σ has no suspects."""

from __future__ import annotations

from pathlib import Path

import pytest

import mor
from mor.quality import outliers
from mor.quality.outliers import without_suspects
from mor.solve.iterate import Outcome

PROJECT = Path(__file__).parents[2] / "sample_projects" / "test_field" / "project.yaml"


@pytest.mark.parametrize(("part", "searched"), [(0.009, False), (1.0, True)])
def test_suspects_are_searched_for_only_where_residuals_are_not_small(
    part: float, searched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved = mor.adjust(str(PROJECT)).solved
    assert solved.quality is not None
    normals = solved.adjustment.normals._replace(objective=part * solved.quality.redundancy)
    plain = solved.adjustment._replace(outcome=Outcome.NOT_CONVERGED, normals=normals)
    asked = []

    def repaired(*given: object) -> outliers.Attempt:
        asked.append(given)
        return outliers.Attempt(plain)

    monkeypatch.setattr(outliers, "_repaired", repaired)
    assert without_suspects(plain).suspects is None
    assert bool(asked) is searched
