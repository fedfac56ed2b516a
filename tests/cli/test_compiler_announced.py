"""The first run says that it compiles; a large project without compiler says that it is slower."""

from __future__ import annotations

import pytest
from mor.cli._compiler import FIRST_RUN, PLAIN, compiler_announced

from mor import compilation, kernel_cache


def test_compiling_is_announced_once_and_only_then(monkeypatch, tmp_path):
    pytest.importorskip("numba")
    monkeypatch.setattr(kernel_cache, "_folder", lambda: tmp_path)
    one, other = (compilation.Kernel(function) for function in (lambda x: x + 1.0, lambda x: x - 1.0))
    said: list[str] = []
    with compiler_announced(said.append):
        assert said == []
        one(1.0), other(1.0)
        assert said == [FIRST_RUN]
    with compiler_announced(said.append):
        one(2.0)  # compiled already
    assert said == [FIRST_RUN]


def test_a_machine_without_compiler_is_told(monkeypatch):
    monkeypatch.setattr(compilation, "available", False)
    said: list[str] = []
    with compiler_announced(said.append):
        with compilation.chosen_by_size(compilation.WORTH_COMPILING - 1):
            assert said == []
        for _ in range(2):
            with compilation.chosen_by_size(compilation.WORTH_COMPILING):
                assert said == [PLAIN]


def test_a_compiler_that_is_loaded_ahead_is_there_once(monkeypatch, tmp_path):
    numba = pytest.importorskip("numba")
    monkeypatch.setattr(kernel_cache, "_folder", lambda: tmp_path)
    compilation._loaded.cache_clear()
    one, said = compilation.Kernel(lambda x: x + 2.0), []
    with compiler_announced(said.append):
        compilation.load_ahead()
        assert one(1.0) == 3.0
    assert isinstance(one.compiled, numba.core.dispatcher.Dispatcher)
    assert said == [FIRST_RUN]
    assert compilation._loaded.cache_info().misses == 1
