"""Covariance matrices with labels, in project axes and units, as npz, CSV or Matrix Market."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.linalg

from mor.errors import InputError, Message
from mor.model.parameters import moves_by_angles, tangents
from mor.model.rotations import angles_by_tangent, angles_from_rotation, cross_matrix
from mor.project.document import guarded
from mor.project.entities import unknown_name
from mor.quality.assessment import Quality, joint_cofactors, relative_ellipsoid
from mor.quality.solution import Solved
from mor.quality.test_statistics import coverage_probability
from mor.report.units import angle_unit, unit_of
from mor.types import FloatArray, IntArray
from mor.units import ANGLE_UNITS

HeadedRows = tuple[list[str], list[list[object]]]
"""Names of the columns of a table, and its rows."""


class Labelled(NamedTuple):
    """A covariance matrix (k, k) with labels ``kind id component``, units and values of the unknowns."""

    matrix: FloatArray
    labels: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    datum: str
    sigma0: float
    """What the cofactors were multiplied with (squared), a priori 1."""
    freedom: float
    """Degrees of freedom of σ0: the redundancy, infinite for σ0 a priori."""

    def expanded(self, factor: float = 2.0) -> FloatArray:
        """Return the expanded uncertainties U = k σ (k,) in ``units`` (JCGM 100:2008, 6.2)."""
        return factor * np.sqrt(np.maximum(np.diagonal(self.matrix), 0.0))

    def coverage_probability(self, factor: float = 2.0) -> float:
        """Return the probability that value ± U contains the true value: Student's t with ``freedom``."""
        return coverage_probability(factor, self.freedom)


def covariance_of_names(
    solved: Solved, points: Sequence[str], images: Sequence[str], cameras: Sequence[str] | None
) -> Labelled:
    """Return the joint covariance of coordinates of points, poses of images and interior orientations.

    An empty sequence ``cameras`` stands for all cameras, ``None`` for no camera. Raises :class:`InputError` for unknown
    names, and for images whose pose is not an unknown of its own.
    """
    blocks = [("point", number) for number in point_numbers(solved, points)]
    blocks += [block for name in images for block in _pose_blocks(solved, name)]
    if cameras is not None:
        blocks += _interior_blocks(solved, cameras)
    return _labelled(solved, blocks)


class RelativePose(NamedTuple):
    """Pose of an image in the axes of another one, with the covariance (6, 6)."""

    values: FloatArray
    """(6,) base in project lengths, and ω, φ, κ in the angle unit of the project."""
    covariance: FloatArray


def relative_pose(solved: Solved, first: str, second: str) -> RelativePose:
    """Return base b = D₁ (X₂ − X₁) and rotation R = D₂ D₁ᵀ of two images with their covariance.

    dδ_R = dδ₂ − R dδ₁ and db = D₁ (dX₂ − dX₁) + [b]× dδ₁, with rotations updated by D ← exp(−[δ]×) D. Raises
    :class:`InputError` for unknown names.
    """
    quality = _quality(solved)
    problem, values = solved.adjustment.problem, solved.adjustment.values
    blocks = [_pose_blocks(solved, name) for name in (first, second)]
    columns = np.concatenate([problem.index.columns[kind][number] for pair in blocks for kind, number in pair])
    (X1, X2), (D1, D2) = ([values[kind][number] for kind, number in pair] for pair in zip(*blocks, strict=True))
    turns = tangents(problem.index.blocks["rotation"], values["rotation"])
    T1, T2 = (np.eye(3) if turns is None else turns[pair[1][1]] for pair in blocks)
    b, R = D1 @ (X2 - X1), D2 @ D1.T
    unit = ANGLE_UNITS[angle_unit(solved)]
    angles = angles_from_rotation(R[None])
    to_angles = angles_by_tangent(angles)[0] / unit
    A = np.zeros((6, 12))
    A[:3, :3], A[:3, 3:6], A[:3, 6:9] = -D1, cross_matrix(b) @ T1, D1
    A[3:, 3:6], A[3:, 9:] = -to_angles @ R @ T1, to_angles @ T2
    covariance = A @ joint_cofactors(quality, columns) @ A.T * quality.sigma_factor**2
    return RelativePose(np.concatenate([b, angles[0] / unit]), 0.5 * (covariance + covariance.T))


def covariance_of_everything(solved: Solved) -> Labelled:
    """Covariance of all unknowns. Raises :class:`InputError` if there are too many."""
    index = solved.adjustment.problem.index
    # Unknowns up to which the whole matrix is worked out.
    largest = 6000
    if index.count > largest:
        words = f"{index.count} unknowns: the full matrix is written up to {largest}; choose --points or --blocks"
        raise InputError([Message(words)])
    blocks = [
        (kind, int(number))
        for kind, columns in index.columns.items()
        for number in np.flatnonzero(_own(solved, kind, columns).any(axis=1))
    ]
    return _labelled(solved, blocks)


def _own(solved: Solved, kind: str, columns: IntArray) -> np.ndarray:
    """(n, size) free components that are not another block's."""
    owner = solved.adjustment.problem.index.blocks[kind].owner
    return np.asarray((columns >= 0) & (owner == np.arange(len(owner))[:, None]))


def _pose_blocks(solved: Solved, name: str) -> list[tuple[str, int]]:
    images = solved.network.things["image"]
    if name not in images.numbers:
        raise InputError([Message(unknown_name("image", name, images.ids))])
    blocks = [("point", images.part(name, "position")), ("rotation", images.part(name, "rotation"))]
    derived = images.part(name, "trajectory") >= 0 or images.part(name, "relative rotation") >= 0
    if derived or any(number < 0 for _, number in blocks):
        words = f"image {name!r} has no pose of its own: it follows from a trajectory or from another image"
        raise InputError([Message(words)])
    return blocks


def _interior_blocks(solved: Solved, names: Sequence[str]) -> list[tuple[str, int]]:
    cameras = solved.network.things["camera"]
    problems = [Message(unknown_name("camera", name, cameras.ids)) for name in names if name not in cameras.numbers]
    if problems:
        raise InputError(problems)
    wanted = names or cameras.ids
    return [
        (kind, block.ids.index(name))
        for name in wanted
        for kind, block in solved.network.blocks.items()
        if kind.startswith("interior/") and name in block.ids
    ]


def relative_pose_rows(solved: Solved, pairs: Sequence[tuple[str, str]]) -> HeadedRows:
    """Rows from, to, the six values, their σ, and the upper triangle of their covariance."""
    names, upper = ("bx", "by", "bz", "omega", "phi", "kappa"), np.triu_indices(6)
    of_covariance = (f"cov_{names[i]}_{names[j]}" for i, j in zip(*upper, strict=True))
    rows: list[list[object]] = []
    for one, other in pairs:
        found = relative_pose(solved, one, other)
        sigma = np.sqrt(np.maximum(np.diagonal(found.covariance), 0.0))
        rows.append([one, other, *found.values.tolist(), *sigma.tolist(), *found.covariance[upper].tolist()])
    return ["from", "to", *names, *(f"s{name}" for name in names), *of_covariance], rows


def point_numbers(solved: Solved, names: Sequence[str]) -> list[int]:
    """Blocks of named points. Raises :class:`InputError`."""
    points = solved.network.things["point"]
    problems = [Message(unknown_name("point", name, points.ids)) for name in names if name not in points.numbers]
    if problems:
        raise InputError(problems)
    return [points.part(name, "position") for name in names]


def _labelled(solved: Solved, blocks: list[tuple[str, int]]) -> Labelled:
    quality = _quality(solved)
    index = solved.adjustment.problem.index
    columns = [index.columns[kind][number] for kind, number in blocks]
    turns = [_outwards(solved, kind, number) for kind, number in blocks]
    T = scipy.linalg.block_diag(*turns) if turns else np.zeros((0, 0))
    q = joint_cofactors(quality, np.concatenate(columns) if columns else np.zeros(0, dtype=np.int64))
    matrix = T @ q @ T.T * quality.sigma_factor**2
    matrix = 0.5 * (matrix + matrix.T)
    labels, units, values, kept = [], [], [], []
    for (kind, number), own, turn in zip(blocks, columns, turns, strict=True):
        block = index.blocks[kind]
        for k, component in enumerate(block.kind.components):
            kept.append(bool((turn[k] != 0.0) @ (own >= 0)))
            labels.append(f"{kind} {block.ids[number]} {component.name}")
            units.append(unit_of(solved, component.quantity))
        values.append(_values(solved, kind, number))
    keep = np.flatnonzero(kept)
    return Labelled(
        matrix[np.ix_(keep, keep)],
        tuple(labels[k] for k in keep),
        tuple(units[k] for k in keep),
        np.concatenate(values)[keep] if values else np.zeros(0),
        solved.adjustment.problem.datum.name,
        quality.sigma_factor,
        freedom_of(solved),
    )


def freedom_of(solved: Solved) -> float:
    """Degrees of freedom of the σ0 that standard deviations refer to; infinite a priori."""
    quality = _quality(solved)
    return float(quality.redundancy) if quality.sigma_factor != 1.0 else np.inf


def _outwards(solved: Solved, kind: str, number: int) -> FloatArray:
    """(size, size) from the unknowns of a block to what is said of it."""
    network = solved.network
    if kind == "point":
        return np.asarray(network.edge.matrix.T)
    if kind != "rotation":
        return np.eye(len(network.blocks[kind].kind.components))
    if moves_by_angles(network.blocks["rotation"])[number]:
        return np.eye(3) / ANGLE_UNITS[angle_unit(solved)]
    D = _turned(solved, number)
    return np.asarray(angles_by_tangent(angles_from_rotation(D))[0] / ANGLE_UNITS[angle_unit(solved)])


def _turned(solved: Solved, number: int) -> FloatArray:
    edge = solved.network.edge
    D = solved.adjustment.values["rotation"][[number]]
    return D @ edge.matrix if edge.right_handed else D


def _values(solved: Solved, kind: str, number: int) -> FloatArray:
    if kind == "rotation":
        return np.asarray(angles_from_rotation(_turned(solved, number))[0] / ANGLE_UNITS[angle_unit(solved)])
    values: FloatArray = solved.adjustment.values[kind][number]
    return values @ solved.network.edge.matrix if kind == "point" else values


def _quality(solved: Solved) -> Quality:
    if solved.quality is None:
        raise InputError([Message("there is no solution, and therefore no covariance matrix")])
    return solved.quality


def point_blocks(solved: Solved) -> HeadedRows:
    """Rows id, xx, xy, xz, yy, yz, zz of all points, in project axes."""
    quality, M = _quality(solved), solved.network.edge.matrix
    points = solved.network.things["point"]
    q = quality.cofactors["point"][points.parts["position"]] * quality.sigma_factor**2
    turned = M.T @ q @ M
    upper = [(i, j) for i in range(3) for j in range(i, 3)]
    rows: list[list[object]] = [
        [name, *(float(turned[n, i, j]) for i, j in upper)] for n, name in enumerate(points.ids)
    ]
    return ["id", "xx", "xy", "xz", "yy", "yz", "zz"], rows


def relative_rows(solved: Solved, pairs: Sequence[tuple[str, str]]) -> HeadedRows:
    """Rows from, to, dx, dy, dz, σ of them, distance, its σ, semi-axes a b c, in project axes."""
    quality, M = _quality(solved), solved.network.edge.matrix
    rows: list[list[object]] = []
    for one, other in pairs:
        first, second = point_numbers(solved, [one, other])
        found = relative_ellipsoid(quality, first, second)
        sigma = np.sqrt(np.maximum(np.diagonal(M.T @ found.covariance @ M), 0.0))
        length = float(np.linalg.norm(found.difference))
        along = found.difference / length if length > 0.0 else np.zeros(3)
        of_length = float(np.sqrt(max(float(along @ found.covariance @ along), 0.0)))
        numbers = np.concatenate([found.difference @ M, sigma, [length, of_length], found.axes])
        rows.append([one, other, *numbers.tolist()])
    return ["from", "to", "dx", "dy", "dz", "sdx", "sdy", "sdz", "distance", "sdistance", "a", "b", "c"], rows


def write_rows(path: Path, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write rows as CSV; floats with all their digits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([[repr(c) if isinstance(c, float) else guarded(str(c)) for c in row] for row in rows])


def check_covariance(path: Path) -> None:
    """Raise :class:`InputError` for a file whose suffix names no format of covariances."""
    suffixes = (".npz", ".csv", ".mtx")
    if path.suffix not in suffixes:
        raise InputError([Message(f"expected one of {', '.join(suffixes)}", str(path))])


def with_expanded(header: Sequence[str], rows: Sequence[Sequence[object]], factor: float) -> HeadedRows:
    """Header and rows with a column U for every column of σ (``sdx``) or variances (``xx``): U = k σ."""
    of = [(k, name[1:], 1.0) for k, name in enumerate(header) if name.startswith("s")]
    of = of or [(k, name[0], 0.5) for k, name in enumerate(header) if name in ("xx", "yy", "zz")]
    wider = [[*row, *(factor * float(str(row[k])) ** power for k, _, power in of)] for row in rows]
    return [*header, *(f"U{name}" for _, name, _ in of)], wider


def write_covariance(path: Path, found: Labelled, factor: float | None) -> None:
    """Write a matrix in the format its suffix names, with U = k σ if a coverage factor is given.

    Raises :class:`InputError` for any other suffix.
    """
    check_covariance(path)
    expanded = {} if factor is None else {"U": found.expanded(factor)}
    if path.suffix == ".npz":
        np.savez(
            path,
            covariance=found.matrix,
            values=found.values,
            labels=np.array(found.labels),
            units=np.array(found.units),
            datum=np.array(found.datum),
            sigma0=np.array(found.sigma0),
            **expanded,  # type: ignore[arg-type]
        )
    elif path.suffix == ".csv":
        header = ["label", "unit", "value", *expanded, *found.labels]
        numbers = np.column_stack([found.values, *expanded.values(), found.matrix])
        rows = [
            [label, unit, *row] for label, unit, row in zip(found.labels, found.units, numbers.tolist(), strict=True)
        ]
        write_rows(path, header, rows)
    else:
        size = len(found.labels)
        lines = ["%%MatrixMarket matrix array real symmetric", f"% datum: {found.datum}"]
        lines += [
            f"% {k + 1}: {label} [{unit}]" + "".join(f", {name} = {float(u[k])!r}" for name, u in expanded.items())
            for k, (label, unit) in enumerate(zip(found.labels, found.units, strict=True))
        ]
        lines.append(f"{size} {size}")
        lines += [repr(float(found.matrix[i, j])) for j in range(size) for i in range(j, size)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
