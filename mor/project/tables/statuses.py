"""Free, fixed or observed: from columns and settings to values, free flags and σ of components."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Problem, nearest
from mor.project.edge import Edge, ImageScale, UnitError
from mor.project.file.model_instruments import Value
from mor.project.file.nodes import Path
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Column, Place, Rows
from mor.units import ANGLE, Component, Quantity


class Statuses(NamedTuple):
    """Components of n blocks: value, free or fixed, σ where observed, start value where it differs; (n, size) each."""

    values: FloatArray
    free: BoolArray
    sigma: FloatArray
    start: FloatArray

    def rows(self, chosen: IntArray) -> Statuses:
        """Some of the blocks."""
        return Statuses(self.values[chosen], self.free[chosen], self.sigma[chosen], self.start[chosen])


def number_column(
    name: str, quantity: Quantity, edge: Edge, image: ImageScale | None = None, required: bool = False
) -> Column:
    """A column of numbers of a quantity, converted to internal units."""
    return Column(
        name,
        parse=lambda text, unit: edge.number(text, quantity, unit, image),
        factor=None
        if quantity == ANGLE and edge.units.angle == "dms"
        else lambda unit: edge.factor(quantity, unit, image),
        required=required,
    )


def component_columns(components: Iterable[Component], edge: Edge) -> list[Column]:
    """For each component a column for its value, its σ, and a start value that differs from an observed one."""
    columns = []
    for component in components:
        columns.append(number_column(component.name, component.quantity, edge))
        columns.append(number_column(f"sigma_{component.name}", component.quantity, edge))
        columns.append(number_column(f"start_{component.name}", component.quantity, edge))
    return columns


def component_rows(
    rows: Rows,
    components: Sequence[Component],
    fixed: Sequence[str],
    problems: list[Problem],
    common_sigma: FloatArray | None = None,
) -> Statuses:
    """Statuses of n blocks: no σ is free, σ = 0 is fixed, σ > 0 is observed."""
    values = np.stack([rows.number(c.name) for c in components], axis=1)
    sigma = np.stack([rows.number(f"sigma_{c.name}") for c in components], axis=1)
    if common_sigma is not None:
        sigma = np.where(np.isnan(sigma), common_sigma[:, None], sigma)
    if common_sigma is not None:
        tell_rows(problems, common_sigma < 0.0, rows, "sigma: found a negative σ, expected a σ ≥ 0")
        sigma[common_sigma < 0.0] = np.nan
    for k, component in enumerate(components):
        _check_sigma(rows, component.name, values[:, k], sigma[:, k], problems)
    held = np.array([c.name in fixed for c in components])
    sigma[:, held] = np.nan
    free = ~held[None, :] & ~(sigma == 0.0)
    for k, component in enumerate(components):
        missing = ~free[:, k] & np.isnan(values[:, k])
        tell_rows(problems, missing, rows, f"{component.name} is fixed but has no value")
    start = np.stack([rows.number(f"start_{c.name}") for c in components], axis=1)
    return Statuses(values, free, np.where(sigma > 0.0, sigma, np.nan), np.where(free, start, np.nan))


def _check_sigma(
    rows: Rows, name: str, values: FloatArray, sigma: FloatArray, problems: list[Problem]
) -> None:
    tell_rows(problems, sigma < 0.0, rows, f"sigma_{name}: found a negative σ, expected a σ ≥ 0")
    tell_rows(problems, ~np.isnan(sigma) & np.isnan(values), rows, f"{name} has a σ but no value")


def settings(
    given: dict[str, str | Value],
    components: Sequence[Component],
    edge: Edge,
    place: Place,
    path: Path,
    problems: list[Problem],
    image: ImageScale | None = None,
) -> Statuses:
    """Statuses (1, size) of one block from settings by component; a plain number is fixed."""
    values = np.array([[component.default for component in components]])
    free = np.zeros(values.shape, dtype=bool)
    sigma = np.full(values.shape, np.nan)
    start = np.full(values.shape, np.nan)
    names = [component.name for component in components]
    for name, setting in given.items():
        at = Place(place.document, (*path, name), place.folder)
        if name not in names:
            problems.append(
                at.problem(f"unknown component {name!r}{nearest(name, names)} (known: {', '.join(names)})")
            )
            continue
        k = names.index(name)
        quantity = components[k].quantity
        try:
            text = (
                setting
                if isinstance(setting, str)
                else setting.free or setting.fixed or setting.observed or ""
            )
            values[0, k] = edge.number(text, quantity, "", image)
            if isinstance(setting, Value) and setting.sigma is not None:
                sigma[0, k] = edge.number(setting.sigma, quantity, "", image)
            if isinstance(setting, Value) and setting.start is not None:
                start[0, k] = edge.number(setting.start, quantity, "", image)
        except UnitError as error:
            problems.append(at.problem(f"{name}: {error}"))
            continue
        if sigma[0, k] < 0.0:
            problems.append(at.problem(f"{name}: found a negative σ, expected a σ ≥ 0"))
        free[0, k] = isinstance(setting, Value) and setting.fixed is None and sigma[0, k] != 0.0
    return Statuses(values, free, np.where(sigma > 0.0, sigma, np.nan), start)
