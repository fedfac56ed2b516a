"""Memory is estimated from sizes, what will not fit is refused in words, and running out of it is no internal error."""

from __future__ import annotations

import pytest

import mor.machine
from mor.errors import OutOfMemoryError
from tests.memory.__main__ import measured, project_of
from tests.scenarios.small_projects import LEVELLING, write, write_block
from tests.scenarios.small_projects import mor as command


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--no-html",)])
def test_estimate_of_a_small_network_is_the_measured_peak_to_a_fifth(tmp_path, options):
    found = measured(project_of(("grid", (25, 0), "csv"), tmp_path), *options)
    assert found["code"] == 0
    assert found["estimated"] == pytest.approx(found["measured"], rel=0.2)


def test_what_does_not_fit_is_refused_with_what_would_help(tmp_path, monkeypatch):
    monkeypatch.setenv("MOR_MEMORY_MB", "1")
    run = command("adjust", write_block(tmp_path))
    assert run.code == 5
    assert "memory" in run.err
    assert "What helps" in run.err
    assert not (tmp_path / "project.results").exists()


def test_the_least_of_all_limits_counts(monkeypatch):
    monkeypatch.delenv("MOR_MEMORY_MB", raising=False)
    for name, size in (("_of_machine", 3e9), ("_of_group", 2e9), ("_of_address_space", 5e9)):
        monkeypatch.setattr(mor.machine, name, lambda size=size: size)
    assert mor.machine.available() == 2e9
    mor.machine.check_room(1.9e9, "this", "less")
    with pytest.raises(OutOfMemoryError, match=r"2\.1 GB .* 2\.0 GB"):
        mor.machine.check_room(2.1e9, "this", "less")


def test_limits_that_nobody_tells_refuse_nothing(monkeypatch):
    monkeypatch.delenv("MOR_MEMORY_MB", raising=False)
    for name in ("_of_machine", "_of_group", "_of_address_space"):
        monkeypatch.setattr(mor.machine, name, lambda: None)
    mor.machine.check_room(1e18, "this", "less")


def test_running_out_of_memory_is_told_as_that(tmp_path, monkeypatch):
    def fails(*_):
        raise MemoryError("Unable to allocate 9.00 TiB")

    monkeypatch.setattr("mor.solve.iterate.make_plan", fails)
    run = command("adjust", write(tmp_path, LEVELLING))
    assert run.code == 5
    assert "not enough memory" in run.err
    assert "9.00 TiB" in run.err
    assert "internal" not in run.err


def test_libraries_are_not_loaded_into_too_little_address_space(tmp_path, monkeypatch):
    """OpenBLAS would wait for ever (ulimit -v 400000), or end the process."""
    monkeypatch.setattr(mor.machine, "_of_address_space", lambda: 0.38e9)
    run = command("adjust", write(tmp_path, LEVELLING))
    assert run.code == 5
    assert "1.6 GB of address space, and 380 MB are left" in run.err
    assert command("--help").code == 0
