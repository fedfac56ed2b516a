"""The observation equations of a problem, dense: what the sparse program is held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.model.contract import wrap
from mor.model.parameters import Values, moves_by_angles
from mor.model.rotations import angles_from_rotation, tangent_of_angles
from mor.solve.problem import Problem
from mor.types import FloatArray


@dataclass(frozen=True)
class Dense:
    """Observation equations of a problem, dense: every entry that is observed, in order."""

    entries: FloatArray
    A: FloatArray
    l: FloatArray  # noqa: E741 - the misclosure vector's name everywhere
    covariance: FloatArray

    @property
    def weights(self) -> FloatArray:
        return np.linalg.inv(self.covariance)

    @property
    def normal(self) -> FloatArray:
        return self.A.T @ self.weights @ self.A

    def redundancy_numbers(self) -> FloatArray:
        """diag(Q_vv P), by way of the pseudo-inverse of the whitened A."""
        lower = np.linalg.cholesky(self.covariance)
        white = np.linalg.solve(lower, self.A)
        white = white / np.linalg.norm(white, axis=0)
        projector = np.eye(len(white)) - white @ np.linalg.pinv(white, rcond=1e-9)
        return np.diagonal(lower @ projector @ np.linalg.inv(lower)).copy()


def dense_system(problem: Problem, values: Values) -> Dense:
    """A, l and Σ row by row and slot by slot, sharing nothing with the program but the equations."""
    index = problem.index
    entries, rows, misclosures, variances = [], [], [], []
    number = 0
    for group in problem.groups:
        for i in range(group.count):
            blocks = [
                values[slot.kind][b[i] : b[i] + 1] for slot, b in zip(group.type.slots, group.blocks, strict=True)
            ]
            computed = group.type.equation(blocks, group.constants[i : i + 1])
            row = np.zeros((group.observed.shape[1], index.count))
            for slot, b, jacobian in zip(group.type.slots, group.blocks, computed.jacobians, strict=True):
                part = jacobian[0]
                table = index.blocks[slot.kind]
                if table.kind.is_rotation and moves_by_angles(table)[b[i]]:
                    part = part @ tangent_of_angles(angles_from_rotation(values[slot.kind][b[i]]))
                for component, column in enumerate(index.columns[slot.kind][b[i]]):
                    if column >= 0:
                        row[:, column] += part[:, component]
            difference = group.observed[i] - computed.values[0]
            difference = np.where(group.type.wraps, wrap(difference), difference)
            for component in range(len(row)):
                if np.isfinite(group.observed[i, component]):
                    entries.append(number)
                    rows.append(row[component])
                    misclosures.append(difference[component])
                    variances.append(group.sigma[i, component] ** 2)
                number += 1
    covariance = np.diag(variances)
    for cluster in problem.clusters:
        place = np.searchsorted(entries, cluster.entries)
        covariance[place, :] = 0.0
        covariance[:, place] = 0.0
        covariance[np.ix_(place, place)] = cluster.covariance
    return Dense(np.array(entries), np.array(rows), np.array(misclosures), covariance)
