"""The examples of docs/how-to/batch.md do what the page says, in a shell and step by step as a CI runs them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.scenarios.small_projects import LEVELLING

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "batch.md").read_text(encoding="utf-8")
PLAN = LEVELLING.replace("[from, to, dz, sigma]", "[from, to, sigma]")
PLAN = re.sub(r", -?\d\.\d+, 0\.001\]", ", 0.001]", PLAN)


@pytest.fixture
def place(tmp_path):
    """Two blocks, a plan, and mor on the path."""
    for name in ("one", "two"):
        folder = tmp_path / "blocks" / name
        folder.mkdir(parents=True)
        (folder / "project.yaml").write_text(LEVELLING, encoding="utf-8")
    (tmp_path / "plans" / "next").mkdir(parents=True)
    (tmp_path / "plans" / "next" / "project.yaml").write_text(PLAN, encoding="utf-8")
    program = tmp_path / "bin" / "mor"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m mor "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    return tmp_path


def _bash(script: str, place: Path) -> subprocess.CompletedProcess[str]:
    path = f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        ["bash", "-e", "-c", script],
        cwd=place,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def _block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]


def _moved(place: Path) -> None:
    """A benchmark that is another one now."""
    project = place / "blocks" / "two" / "project.yaml"
    project.write_text(LEVELLING.replace("1.001", "1.003"), encoding="utf-8")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the page is for a shell")
def test_the_shell_example(place):
    lines = _block("sh").splitlines()
    first = next(k for k, line in enumerate(lines) if "-o kept" in line)
    kept = "\n".join(lines[: first + 1])
    later = "\n".join(lines[:first] + lines[first + 1 :])
    run = _bash(kept, place)
    assert run.returncode == 0, run.stderr
    assert (place / "kept" / "batch.json").is_file()
    run = _bash(later, place)
    assert run.returncode == 0, run.stderr
    assert run.stdout == ""
    _moved(place)
    run = _bash(later, place)
    assert run.returncode == 1, run.stderr
    assert "two: global_test.accepted: True | False" in run.stdout


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the page is for a shell")
def test_the_steps_of_the_ci_example(place):
    assert _bash("mor batch 'blocks/**/project.yaml' -o kept --quiet", place).returncode == 0
    steps = [step["run"] for step in yaml.safe_load(_block("yaml"))["jobs"]["adjust"]["steps"] if "run" in step]
    install, *ours = steps
    assert install.startswith("pip install 'mor-adjustment")
    assert '\n[project]\nname = "mor-adjustment"' in "\n" + (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for step in ours:
        run = _bash(step, place)
        assert run.returncode == 0, f"{step}: {run.stderr}"
    assert (place / "now" / "junit.xml").is_file()
    assert (place / "plans" / "next" / "project.design" / "design.json").is_file()
    _moved(place)
    assert _bash(ours[0], place).returncode == 1
    plan = place / "plans" / "next" / "project.yaml"
    plan.write_text(PLAN + "require: {reliability: {r: 0.9}}\n", encoding="utf-8")
    assert _bash(ours[1], place).returncode == 1
