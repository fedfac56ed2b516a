"""``mor verify`` finds an error of 1e-6 wherever it is planted: places, and the checks that find it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mor.quality.assessment as assessment
import mor.quality.test_statistics as test_statistics
from mor.api.verification import carried_out, tasks
from mor.linalg import selected_inverse
from mor.machine import processors
from mor.model import contract, lens, rotations
from mor.quality import precision
from mor.solve import datum, normals
from mor.start import killian, relative_orientation

FACTOR = 1.0 + 1e-6


def _everywhere(monkeypatch, function: Callable[..., Any], planted: Callable[..., Any]) -> None:
    """Replace a function in all modules of mor that have imported it by name."""
    for name, module in list(sys.modules.items()):
        if name.startswith("mor.") and getattr(module, function.__name__, None) is function:
            monkeypatch.setattr(module, function.__name__, planted)


def _first_scaled(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with the first of its results too large, as the value beside its derivatives."""

    def planted(*given: Any, **named: Any) -> Any:
        found = function(*given, **named)
        changed = (found[0] * FACTOR, *found[1:])
        return found._replace(**{found._fields[0]: changed[0]}) if hasattr(found, "_fields") else changed

    return planted


def _scaled(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *given, **named: function(*given, **named) * FACTOR


def _property(monkeypatch, owner: type, name: str) -> None:
    of = getattr(owner, name).fget
    monkeypatch.setattr(owner, name, property(lambda one: of(one) * FACTOR))


def _function(function: Callable[..., Any], change: Callable[..., Any]) -> Callable[[Any], None]:
    return lambda monkeypatch: _everywhere(monkeypatch, function, change(function))


def _distance(monkeypatch) -> None:
    """The distance types hold their function, so the type itself computes too long."""
    from mor.model import terrestrial

    original = terrestrial.horizontal_length
    _everywhere(monkeypatch, original, _scaled(original))
    _everywhere(monkeypatch, contract.between, lambda blocks, of=contract.between: of(blocks) * FACTOR)


def _sigma(function: Callable[..., Any]) -> Callable[..., Any]:
    def planted(group: Any, values: Any) -> Any:
        found = function(group, values)
        return replace(found, sigma=found.sigma * FACTOR)

    return planted


def _matrix(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with a block matrix whose values are too large."""

    def planted(*given: Any) -> Any:
        found = function(*given)
        return found._replace(values=found.values * FACTOR)

    return planted


def _normals(build: Callable[..., Any]) -> Callable[..., Any]:
    def planted(*given: Any) -> Any:
        found = build(*given)
        return found._replace(matrix=found.matrix._replace(values=found.matrix.values * FACTOR))

    return planted


def _lost_in_threads(in_lanes: Callable[..., Any]) -> Callable[..., Any]:
    """The last of several threads adds too much to the normal equations."""

    def planted(*given: Any, **more: Any) -> Any:
        found = in_lanes(*given, **more)
        if len(found) > 1 and processors() == 2 and isinstance(found[-1], tuple):
            for array in found[-1][0]:
                array *= FACTOR
        return found

    return planted


PLACES: dict[str, tuple[Callable[[Any], None], str]] = {
    "vector between two points (distances)": (_distance, "textbook networks"),
    "computed directions": (_function(contract.bearing, _first_scaled), "textbook networks"),
    "computed vertical angles": (_function(contract.elevation, _first_scaled), "textbook networks"),
    "image coordinates": (_function(lens.project_ideally, _first_scaled), "closed forms"),
    "distortion": (_function(lens.distort, _first_scaled), "closed forms"),
    "rotation from angles": (
        _function(rotations.rotation_from_angles, lambda of: lambda angles: of(np.asarray(angles) * FACTOR)),
        "closed forms",
    ),
    "standard deviations of observations (weights)": (
        _function(contract.with_sigma_model, _sigma),
        "textbook networks",
    ),
    "redundancy numbers": (
        lambda monkeypatch: _property(monkeypatch, test_statistics.ObservationQuality, "r"),
        "closed forms",
    ),
    "σ0": (_function(assessment.sigma_of_unit_weight, _scaled), "textbook networks"),
    "normal quantile": (
        lambda monkeypatch: monkeypatch.setattr(test_statistics, "ndtri", _scaled(test_statistics.ndtri)),
        "closed forms",
    ),
    "cofactors of the unknowns": (
        lambda monkeypatch: monkeypatch.setattr(precision, "block_cofactors", _scaled(precision.block_cofactors)),
        "textbook networks",
    ),
    "normal equations": (
        _function(normals.build_normals, _normals),
        "textbook networks",
    ),
    "sum over the threads": (_function(normals.in_lanes, _lost_in_threads), "threads"),
    "selected inverse": (
        _function(selected_inverse.selected_inverse, _matrix),
        "textbook networks",
    ),
    "transformation into the datum": (
        _function(
            datum.s_transformation,
            lambda of: lambda *given: replace(of(*given), through=of(*given).through * FACTOR),
        ),
        "textbook networks",
    ),
    "Rinner's triad": (_function(relative_orientation.triad, _scaled), "start values"),
    "Killian's cubic": (
        _function(killian.cubic, lambda of: lambda link: of(link) * [1, 1, FACTOR, 1]),
        "start values",
    ),
}


def _failed(group: str) -> dict[str, set[str]]:
    """Names of data sets that failed by group; Monte Carlo, which a millionth cannot move, is left out."""
    found: dict[str, set[str]] = {}
    for task in tasks():
        if task.about.group == "Monte Carlo" or group not in ("", task.about.group):
            continue
        for check in carried_out(task):
            if not check.passed and np.isfinite(check.found):  # a number is wrong: nothing was raised
                found.setdefault(check.group, set()).add(f"{check.name}: {check.quantity}")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("place", [pytest.param(name, id=name) for name in PLACES])
def test_a_planted_error_is_found(place, monkeypatch):
    plant, group = PLACES[place]
    plant(monkeypatch)
    assert _failed(group), f"no check of {group} sees an error of 1e-6 in: {place}"


def main() -> None:
    """Print which checks find which planted error."""
    for place, (plant, _) in PLACES.items():
        with pytest.MonkeyPatch.context() as monkeypatch:
            plant(monkeypatch)
            found = _failed("")
        print(f"{place}: {sum(map(len, found.values()))} checks")
        for group, names in found.items():
            print(f"    {group}: {len(names)}, e.g. {sorted(names)[0]}")


if __name__ == "__main__":
    main()
