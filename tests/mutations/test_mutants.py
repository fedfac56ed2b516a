"""A few hundred mutants of all projects; ``python -m tests.scenarios.mutations`` runs more and looks at time, too."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from tests.scenarios.mutations.judge import Ended, faults
from tests.scenarios.mutations.material import all_material
from tests.scenarios.mutations.mutant import mutant
from tests.scenarios.mutations.worker import judged
from tests.selection import slow_after

PARTS, TOGETHER, SEED = 12, 25, 2026
OF_TIME_AND_ROOM = ("slow", "large")
"""What depends on the machine and on the tests that ran before."""

material = cache(all_material)


@pytest.mark.parametrize("part", slow_after(0, range(PARTS)))
def test_no_mutant_breaks_the_program(tmp_path: Path, part: int) -> None:
    found = []
    for number in range(part * TOGETHER, (part + 1) * TOGETHER):
        result = judged(mutant(material(), SEED, number), tmp_path / str(number))
        found += [f"{number}: {fault}" for fault in result.faults if not fault.startswith(OF_TIME_AND_ROOM)]
    assert found == []


def test_the_same_number_is_the_same_mutant() -> None:
    assert mutant(material(), 1, 17) == mutant(material(), 1, 17)
    assert mutant(material(), 1, 17).files != mutant(material(), 2, 17).files


def ended(code: int, said: str, **other: object) -> Ended:
    return Ended(("adjust",), code, said, **{"seconds": 0.1, "peak": 0.1, **other})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("end", "kind"),
    [
        (ended(70, "internal error"), "exit 70"),
        (ended(1, ""), "exit 1"),
        (ended(2, "a number is wrong"), "no place"),
        (ended(0, "x.py:3: RuntimeWarning: overflow"), "warning"),
        (ended(0, "point \x1b[2J"), "control characters"),
        (ended(0, "line\n" * 100), "long"),
        (ended(0, "", seconds=21.0), "slow"),
        (ended(0, "", peak=2.1), "large"),
    ],
)
def test_the_judge_sees_what_is_wrong(tmp_path: Path, end: Ended, kind: str) -> None:
    assert [fault.split(":")[0] for fault in faults(end, tmp_path, tmp_path / "results")] == [kind]


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ('"redundancy_sum": 3.1', "redundancy"),
        ('"redundancy_sum": NaN', "not finite"),
        ('"outcome": "diverged"', "outcome"),
        ('"points": [{"id": "P", "status": "free", "sx": 0.0, "sy": 0.1, "sz": 0.1}]', "sigma"),
        ('"cameras": [{"id": "K", "components": {"c": {"status": "free", "sigma": 0.0}}}]', "sigma"),
        ("", None),
    ],
)
def test_the_judge_sees_wrong_results(tmp_path: Path, change: str, kind: str | None) -> None:
    content = '{"outcome": "converged", "redundancy": 3, "redundancy_sum": 3.0, "observations": 9, "datum": "fixed", '
    content += (
        '"sigma0": {"used_for_sigma": 1.0}, "defect": 0, "points": [], "cameras": []'
        + (f", {change}" if change else "")
        + "}"
    )
    (tmp_path / "results.json").write_text(content)
    found = faults(ended(0, ""), tmp_path, tmp_path)
    assert [fault.split(":")[0] for fault in found] == ([kind] if kind else [])
