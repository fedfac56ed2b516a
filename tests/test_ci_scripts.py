"""The scripts in ``.ci`` name only tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("script", ["run", "variants"])
def test_every_path_of_a_test_exists(script: str) -> None:
    text = (ROOT / ".ci" / script).read_text(encoding="utf-8")
    named = re.findall(r"\btests/[\w/.]*\w", text)
    assert named or script == "run"
    assert [path for path in named if not (ROOT / path).exists()] == []
