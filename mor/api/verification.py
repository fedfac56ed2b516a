"""Checks of this installation against numbers that other programs, books, agencies or closed forms give."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import atan, log, nan, pi, sqrt
from pathlib import Path
from statistics import NormalDist
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.polynomial import Chebyshev, Polynomial, chebyshev
from scipy.spatial.transform import Rotation

import mor
from mor.api.pipeline import read_document, read_network, solve_network
from mor.api.simulation import CHUNK, SimulationTask, chunk_of, prepared
from mor.api.workers import Task, done_alone
from mor.errors import InputError, Message
from mor.linalg.compilation import chosen_by_size, kernels_used
from mor.machine import processors_used
from mor.model.contract import Computed, ObservationGroup, ObservationType, Slot
from mor.model.parameters import HEIGHT, Blocks, index_unknowns, moves_by_angles
from mor.model.rotations import angles_from_rotation
from mor.plan.simulation import findings
from mor.project.document import read_yaml
from mor.project.network import Network
from mor.quality.assessment import Quality, assess, joint_cofactors
from mor.quality.precision import angle_cofactors
from mor.quality.solution import Solved
from mor.quality.test_statistics import chi2_level, critical_value, global_test, log_p_f, log_p_student, noncentrality
from mor.report.observations import observation_table
from mor.report.simulation import NAMES
from mor.report.verification import ReferenceCheck
from mor.solve.iterate import SolverSettings, adjust
from mor.solve.problem import DatumDefinition, Problem
from mor.start.bundle import image_bundle
from mor.start.image_pair import robust_relative_orientation
from mor.start.killian import solutions_of_homography, solve_quadrilateral
from mor.start.relative_orientation import adjust_coplanarity, coplanarity_rows, four_candidates, homogeneous_unknowns
from mor.start.resection import resect
from mor.types import FloatArray
from mor.units import NUMBER, Component

Number = tuple[str, float, float, float]
"""Place, value found, reference value, limit of the difference."""


class About(NamedTuple):
    """Name of the data set or scene, and the source of its reference values."""

    group: str
    name: str
    source: str

    def check(self, quantity: str, numbers: Iterable[Number]) -> Iterator[ReferenceCheck]:
        """One check of all numbers; none if there are no numbers."""
        found = [
            ReferenceCheck(self.group, self.name, quantity, self.source, place, 0, *map(float, (wanted, value, limit)))
            for place, value, wanted, limit in numbers
        ]
        if found:
            yield max(found, key=lambda one: one.share)._replace(numbers=len(found))


class VerificationTask(NamedTuple):
    """A data set or scene, and the function that checks it."""

    about: About
    run: Callable[[About], Iterable[ReferenceCheck]]


def verify(progress: Callable[[int], None] = lambda _: None) -> list[ReferenceCheck]:
    """Return all checks of this installation; ``progress`` is called with 1 after each data set.

    A check has ``found``, ``reference``, ``limit``, ``source`` and ``passed``. A check that raises has failed, and its
    ``place`` says why. It takes about half a minute. Raises :class:`InputError` if the reference data are missing.
    """
    found: list[ReferenceCheck] = []
    for task in tasks():
        found += carried_out(task)
        progress(1)
    return found


def carried_out(task: VerificationTask) -> list[ReferenceCheck]:
    """Return the checks of a data set, made in NumPy. If they raise, one failed check with the error."""
    try:
        with kernels_used(False):
            return list(task.run(task.about))
    except Exception as error:  # noqa: BLE001 - whatever goes wrong is the finding of the check
        words = f"{type(error).__name__}: {error}"
        return [ReferenceCheck(*task.about[:2], "result", task.about.source, words, 0, np.nan, np.nan, 0.0)]


def tasks() -> list[VerificationTask]:
    """Return all data sets and scenes. Raises :class:`InputError` if the installation has no reference data."""
    folder = reference_data()
    regressions = json.loads((folder / "nist" / "regression.json").read_text(encoding="utf-8"))
    small = json.loads((folder / "worked-examples" / "small-computations.json").read_text(encoding="utf-8"))
    found = [
        VerificationTask(About("NIST linear regression", name, data["source"]), partial(_regression, data))
        for name, data in regressions.items()
    ]
    for path in sorted(folder.glob("*/*.yaml")):
        source = str(expected_values(path)["source"])
        about = About(_GROUPS[path.parent.name], f"{path.parent.name}/{path.stem}", source)
        found.append(VerificationTask(about, partial(network_checks, path)))
    about = About(
        "closed forms", "quantiles and p-values", "closed forms; Python's statistics.NormalDist (Wichura 1988)"
    )
    found.append(VerificationTask(about, _quantiles))
    found += [VerificationTask(About("start values", name, source), run) for name, source, run in _START_VALUES]
    for key, (name, run) in _WORKED_START_VALUES.items():
        found.append(VerificationTask(About("start values", name, small[key]["source"]), partial(run, small[key])))
    about = About("threads", "block of two images", "the same adjustment by one thread")
    found.append(VerificationTask(about, _threads))
    simulated = ("worked-examples/levelling-free", "textbook/ghilani-16-2-distance-angle-azimuth-fix")
    about = About("processes", simulated[0], "the same simulation by one process")
    found.append(VerificationTask(about, partial(_processes, folder / f"{simulated[0]}.yaml")))
    for network in simulated:
        about = About("Monte Carlo", network, "theory of least squares; limits of chance, level 0.001")
        found.append(VerificationTask(about, partial(_monte_carlo, folder / f"{network}.yaml")))
    return found


_GROUPS = {
    "textbook": "textbook networks",
    "worked-examples": "worked examples",
    "closed-forms": "closed forms",
    "gama": "GNU Gama networks",
    "jag3d": "JAG3D networks",
    "calibration": "calibration block",
    "aerial": "aerial block",
}


def reference_data() -> Path:
    """Folder of the reference data: of the installed package, or of the source tree. Raises :class:`InputError`."""
    package = Path(mor.__file__).parent
    for folder in (package / "verification", package.parent / "tests" / "reference" / "networks"):
        if (folder / "nist").is_dir():
            return folder
    raise InputError([Message("this installation does not include the reference data")])


# ---- NIST StRD: linear regression as observation equations y = Σ a_k b_k of equal weight.
#
# The solver forms normal equations and refines their solution with misclosures of the true equations, so most data
# sets are solved as they are. The columns of Filip and Longley are dependent to the digits of normal equations. They
# are solved for other parameters of the same model: of Chebyshev polynomials over the range of x, and of columns
# reduced to their means. The parameters that NIST certifies are linear functions of these.


def _regression(data: dict[str, Any], about: About) -> Iterator[ReferenceCheck]:
    x, y = np.array(data["x"], dtype=float), np.array(data["y"], dtype=float)
    A, back = _columns(data, x)
    quality = linear_regression(A, y)
    values = back @ quality.adjustment.values["height"][:, 0]
    Q = joint_cofactors(quality, quality.adjustment.problem.index.columns["height"][:, 0])
    scale = np.sqrt(np.einsum("ij,jk,ik->i", back, Q, back))
    # Digits to which parameters and their standard deviations must agree; those of other data sets must to 9.
    part = 10.0 ** -{"Wampler3": 8, "Wampler4": 7, "Wampler5": 5}.get(about.name, 9)
    residual = float(data["residual_standard_deviation"])
    # Wampler1 and Wampler2 fit exactly: the certified σ are 0, and those found are round-off of y.
    floor = 0.0 if residual else 1e-13 * float(np.abs(y).max())
    names = [f"b{k}" for k in range(len(values))]
    columns = (values, data["parameters"], names)
    yield from about.check("parameters", ((n, v, r, part * abs(r)) for v, r, n in zip(*columns, strict=True)))
    rows = zip(names, quality.sigma0 * scale, data["standard_deviations"], scale, strict=True)
    yield from about.check("standard deviations", ((n, s, r, max(part * r, floor * q)) for n, s, r, q in rows))
    yield from about.check(
        "residual standard deviation", [("", quality.sigma0, residual, max(1e-10 * residual, floor))]
    )
    yield from about.check("sum of redundancy numbers", [_redundancy(quality)])


def _columns(data: dict[str, Any], x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns (n, p) of the equations, and the matrix (p, p) from their parameters to the certified ones."""
    if data["model"] == "proportional":
        return x[:, None], np.eye(1)
    if data["model"] == "multilinear":
        mean = x.mean(axis=0)
        back = np.eye(x.shape[1] + 1)
        back[0, 1:] = -mean
        return np.column_stack([np.ones(len(x)), x - mean]), back
    degree = data["degree"]
    # Degree from which on a polynomial is expressed in Chebyshev polynomials.
    if degree < 6:
        return x[:, None] ** np.arange(degree + 1), np.eye(degree + 1)
    domain = [float(x.min()), float(x.max())]
    mapped = (2.0 * x - sum(domain)) / (domain[1] - domain[0])
    back = np.zeros((degree + 1, degree + 1))
    plain = [-1.0, 1.0]
    for k in range(degree + 1):
        coefficients = Chebyshev.basis(k, domain=domain).convert(kind=Polynomial, domain=plain, window=plain).coef
        back[: len(coefficients), k] = coefficients
    return np.asarray(chebyshev.chebvander(mapped, degree), dtype=float), back


def linear_regression(A: FloatArray, y: FloatArray) -> Quality:
    """Adjust y (n,) = A (n, p) b with equal weights by the solver, and assess it."""
    n, p = A.shape

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        values = np.einsum("kni,nk->ni", np.stack(blocks), constants)
        return Computed(values, tuple(constants[:, k, None, None].copy() for k in range(p)))

    # each parameter is a block of one component; heights are the plain kind
    slots = tuple(Slot(HEIGHT.key, f"b{k}", "value") for k in range(p))
    type_ = ObservationType("regression", (Component("y", NUMBER),), (), slots, equation)
    group = ObservationGroup("y", type_, tuple(np.full(n, k) for k in range(p)), y[:, None], np.ones((n, 1)), A, ())
    names = tuple(slot.of for slot in slots)
    blocks = {HEIGHT.key: Blocks(HEIGHT, names, np.ones((p, 1), dtype=bool), np.arange(p)[:, None])}
    problem = Problem(index_unknowns(blocks), (group,), (), DatumDefinition("none", False, {}, {}))
    with chosen_by_size(n):
        return assess(adjust(problem, {HEIGHT.key: np.zeros((p, 1))}, SolverSettings()))


def _redundancy(quality: Quality) -> Number:
    return "", quality.redundancy_sum, quality.redundancy, 1e-7


# ---- Reference networks: results by name, in the axes and units of the project, against the expected values beside it.


class AdjustedObservation(NamedTuple):
    """One adjusted observation, in the axes and senses of the project; σ of the adjusted value for σ0 = 1."""

    line: int
    type: str
    component: str
    references: tuple[str, ...]
    observed: float
    v: float
    r: float
    s: float
    w: float

    @property
    def name(self) -> str:
        """Type, component and references, as in the tables of expected values."""
        return " ".join((self.type.split("/")[0], self.component, *self.references))


def observations(solved: Solved) -> list[AdjustedObservation]:
    """All observations in the order of their lines."""
    assert solved.quality is not None
    rows = []
    for group, quality, w in zip(solved.network.groups, solved.quality.groups, solved.quality.w, strict=True):
        T = group.external.transform if group.external else np.eye(len(group.type.components))
        offset = group.external.offset if group.external else 0.0
        observed, v, w_given = (np.nan_to_num(a) @ T for a in (group.observed - offset, quality.v, w))
        r, q = (np.nan_to_num(a) @ np.abs(T) for a in (quality.r, quality.q_adjusted))
        here = (group.mask @ np.abs(T)) > 0.5
        for i, k in zip(*np.nonzero(here), strict=True):
            names = tuple(reference[i] for reference in group.references)
            values = (observed[i, k], v[i, k], r[i, k], np.sqrt(max(q[i, k], 0.0)), w_given[i, k])
            component = group.type.components[k].name
            rows.append(AdjustedObservation(group.line(i), group.type.key, component, names, *map(float, values)))
    return sorted(rows, key=lambda row: row.line)


Estimates = dict[str, tuple[FloatArray, FloatArray]]
"""Values and standard deviations for σ0 = 1 by name."""


def point_results(solved: Solved) -> Estimates:
    """Coordinates and standard deviations for σ0 = 1 of every point, in the axes of the project."""
    assert solved.quality is not None
    points, M = solved.network.things["point"], solved.network.edge.matrix
    blocks = points.parts["position"]
    coordinates = solved.adjustment.values["point"][blocks] @ M
    variances = np.diagonal(solved.quality.cofactors["point"][blocks], axis1=1, axis2=2) @ np.abs(M)
    sigma = np.sqrt(np.maximum(variances, 0.0))
    return {name: (coordinates[i], sigma[i]) for i, name in enumerate(points.ids)}


def image_results(solved: Solved) -> Estimates:
    """X, Y, Z, ω, φ, κ (rad) and standard deviations for σ0 = 1 of every image."""
    assert solved.quality is not None
    images = solved.network.things["image"]
    position, rotation = images.parts["position"], images.parts["rotation"]
    values, cofactors = solved.adjustment.values, solved.quality.cofactors
    pose = np.concatenate([values["point"][position], angles_from_rotation(values["rotation"][rotation])], axis=1)
    by_angles = moves_by_angles(solved.network.blocks["rotation"])
    angles = angle_cofactors(cofactors["rotation"], values["rotation"], by_angles)
    blocks = (cofactors["point"][position], angles[rotation])
    variances = np.concatenate([np.diagonal(q, axis1=1, axis2=2) for q in blocks], axis=1)
    return {name: (pose[i], np.sqrt(variances[i])) for i, name in enumerate(images.ids)}


def interior_results(solved: Solved, camera: str) -> dict[str, tuple[float, float]]:
    """Interior orientation of a camera: value and standard deviation for σ0 = 1 of every component."""
    assert solved.quality is not None
    model = f"interior/{solved.network.project.cameras[camera].model}"
    block = solved.network.things["camera"].part(camera, "interior")
    names = solved.network.blocks[model].kind.names
    values = solved.adjustment.values[model][block]
    sigma = np.sqrt(np.diagonal(solved.quality.cofactors[model][block]))
    return {name: (float(v), float(s)) for name, v, s in zip(names, values, sigma, strict=True)}


def expected_values(path: Path) -> dict[str, Any]:
    """Return the expected values that stand beside a project file of a reference network."""
    return dict(json.loads(path.with_suffix(".expected.json").read_text(encoding="utf-8")))


def table(expected: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Rows of one table of expected values, by column."""
    rows = expected[name]["rows"] if name in expected else []
    return [dict(zip(expected[name]["columns"], row, strict=True)) for row in rows]


def network_checks(path: Path, about: About, solved: Solved | None = None) -> Iterator[ReferenceCheck]:
    """Compare all expected values of a reference network with its adjustment.

    The tolerances of the expected values are described in ``tests/reference/networks/README.md``.
    """
    expected = expected_values(path)
    solved = solved or solve_network(read_network(read_document(path), path.parent))
    quality, tolerance = solved.quality, expected["tolerance"]
    if quality is None:
        raise ValueError(f"{solved.adjustment.outcome.value}: {solved.adjustment.reason}")
    factor = quality.sigma0 if expected["sigmas"] == "a posteriori" else 1.0
    problem = quality.adjustment.problem
    sizes = {
        "n": problem.observations,
        "u": problem.index.count,
        "defect": quality.adjustment.defect.datum.shape[1],
        "dof": quality.redundancy,
    }
    yield from about.check("size", ((key, value, expected[key], 0.0) for key, value in sizes.items()))
    yield from about.check("sum of redundancy numbers", [_redundancy(quality)])
    limit = max(tolerance["sigma0"] * expected["sigma0"], 1e-9)
    yield from about.check("sigma0", [("", quality.sigma0, expected["sigma0"], limit)])
    points = point_results(solved)
    for name, kind in (("points", ""), ("published", " as printed")):
        found = [(f"{row['point']} {row['component']}", *_component(points, row), row) for row in table(expected, name)]
        if not found:
            continue
        own = tolerance if name == "points" else expected["published"]["tolerance"]
        part, least = (own["sigma"], 1e-12) if name == "points" else (0.0, own["sigma"])
        yield from about.check(
            f"coordinates{kind}", ((at, value, row["value"], own["coordinate"]) for at, value, _, row in found)
        )
        yield from about.check(
            f"σ of coordinates{kind}",
            ((at, factor * s, row["sigma"], max(part * row["sigma"], least)) for at, _, s, row in found),
        )
    yield from _image_checks(solved, expected, about, factor)
    yield from _observation_checks(solved, expected, about, factor)


def _component(points: Estimates, row: dict[str, Any]) -> tuple[float, float]:
    k = "xyz".index(row["component"])
    values, sigma = points[row["point"]]
    return float(values[k]), float(sigma[k])


def _image_checks(solved: Solved, expected: dict[str, Any], about: About, factor: float) -> Iterator[ReferenceCheck]:
    tolerance, images = expected["tolerance"], table(expected, "images")
    results = image_results(solved) if images else {}
    places: list[Number] = []
    angles: list[Number] = []
    sigmas: list[Number] = []
    for row in images:
        pose, sigma = results[row["image"]]
        for k, name in enumerate(("x", "y", "z", "omega", "phi", "kappa")):
            at, value, s = f"{row['image']} {name}", float(pose[k]), factor * float(sigma[k])
            if k < 3:
                places.append((at, value, row[name], tolerance["position"]))
            else:
                value, s = float(row[name] + (np.degrees(value) - row[name] + 180.0) % 360.0 - 180.0), np.degrees(s)
                angles.append((at, value, row[name], tolerance["angle"]))
            if row[f"s{name}"] is not None:
                sigmas.append((at, s, row[f"s{name}"], max(tolerance["sigma"] * row[f"s{name}"], 1e-15)))
    values: list[Number] = []
    for row in table(expected, "cameras"):
        value, s = interior_results(solved, row["camera"])[row["component"]]
        at = f"{row['camera']} {row['component']}"
        values.append((at, value, row["value"], tolerance["camera"] * row["sigma"]))
        sigmas.append((at, factor * s, row["sigma"], tolerance["sigma"] * row["sigma"]))
    yield from about.check("projection centres", places)
    yield from about.check("attitudes", angles)
    yield from about.check("interior orientation", values)
    yield from about.check("σ of images and cameras", sigmas)


_QUANTITIES = {
    "v": "residuals",
    "r": "redundancy numbers",
    "s": "σ of adjusted observations",
    "w": "normalised residuals",
    "mdb": "detectable errors",
    "error": "estimated errors",
    "influence": "influence on points",
    "t_prio": "test values, σ0 a priori",
    "t_post": "test values, σ0 a posteriori",
    "log_p_prio": "ln p, σ0 a priori",
    "log_p_post": "ln p, σ0 a posteriori",
}


def _observation_checks(
    solved: Solved, expected: dict[str, Any], about: About, factor: float
) -> Iterator[ReferenceCheck]:
    """Compare the observations; the tables of JAG3D also have test values, p-values and reliability."""
    tolerance, rows, found = expected["tolerance"], table(expected, "observations"), observations(solved)
    names = [one.name for one in found]
    if names != [f"{row['type']} {row['component']} {row['names']}" for row in rows]:
        raise ValueError("other observations than expected")
    columns: dict[str, Sequence[float]] = {key: [getattr(one, key) for one in found] for key in "vrw"}
    columns["s"] = [factor * one.s for one in found]
    if rows and "mdb" in rows[0]:
        outcome = observation_table(solved)
        columns |= {
            "mdb": outcome["nabla"].to_list(),
            "error": outcome["error"].to_list(),
            "influence": outcome["influence"].to_list(),
            "t_prio": [w**2 for w in outcome["w"]],
            "t_post": outcome["t2"].to_list(),
            "log_p_prio": [log(p) for p in outcome["p"]],
            "log_p_post": [nan if p is None else log(p) for p in outcome["p_t"]],
        }
    for key, values in columns.items():
        numbers = [
            (name, value, row[key], _limit(key, row[key], tolerance))
            for name, value, row in zip(names, values, rows, strict=True)
            if row.get(key) is not None
        ]
        yield from about.check(_QUANTITIES[key], numbers)
    assert solved.quality is not None
    limits: list[Number] = []
    for row in table(expected, "levels"):
        above, below = row["test"][2:-1].split(",")
        if below == "inf" and "." not in above:  # the others are tests of variance components, or no tests of mor
            limit = chi2_level(float(above), solved.quality.noncentrality, solved.quality.levels.power)
            limits.append((row["test"], limit.critical / float(above), row["quantile"], 1e-7 * row["quantile"]))
            limits.append((row["test"], limit.level, row["alpha"], 1e-6 * row["alpha"]))
    yield from about.check("quantiles and levels", limits)


def _limit(key: str, reference: float, tolerance: dict[str, float]) -> float:
    # Columns whose tolerance is relative, and the least difference that is allowed.
    relative = {"s": 1e-12, "w": 1e-6, "mdb": 0.0, "error": 1e-13, "influence": 1e-13, "t_prio": 1e-12, "t_post": 1e-12}
    if key in relative:
        return max(tolerance[key] * abs(reference), min(tolerance[key], relative[key]))
    return float(tolerance[key])


# ---- Closed forms: quantiles and p-values. Scenes whose solution can be written down are reference networks.


def _quantiles(about: About) -> Iterator[ReferenceCheck]:
    """Distributions with closed forms: χ² with 2, t with 1 and 2, F with 2 and n degrees of freedom."""
    normal = NormalDist()
    levels = (0.05, 0.01, 0.001)
    yield from about.check(
        "quantiles of the normal distribution",
        ((f"α = {a}", critical_value(a), normal.inv_cdf(1.0 - 0.5 * a), 1e-11) for a in levels),
    )
    tests = {a: global_test(1.0, 2, a) for a in levels}
    numbers = [(f"α = {a}, upper", one.upper, -2.0 * log(0.5 * a), 1e-11) for a, one in tests.items()]
    numbers += [(f"α = {a}, lower", one.lower, -2.0 * log(1.0 - 0.5 * a), 1e-11) for a, one in tests.items()]
    yield from about.check("quantiles of χ² with 2 degrees of freedom", numbers)
    students = [(t, f, float(log_p_student(np.array([t**2]), f)[0])) for t in (0.5, 3.0, 40.0) for f in (1.0, 2.0)]
    yield from about.check(
        "ln p of Student's t with 1 and 2 degrees of freedom",
        (
            (f"t = {t}, f = {f:g}", p, log(2.0 / pi * atan(1.0 / t) if f == 1.0 else _student_2(t)), 1e-10)
            for t, f, p in students
        ),
    )
    ratios = [(F, f) for F in (0.5, 4.0, 30.0) for f in (3.0, 10.0, 250.0)]
    yield from about.check(
        "ln p of F with 2 and f degrees of freedom",
        (
            (f"F = {F}, f = {f:g}", float(log_p_f(np.array([F]), 2.0, f)[0]), -0.5 * f * np.log1p(2.0 * F / f), 1e-9)
            for F, f in ratios
        ),
    )
    powers: list[Number] = []
    for level in levels:
        k, delta = normal.inv_cdf(1.0 - 0.5 * level), sqrt(noncentrality(level, 0.8))
        power = 1.0 - normal.cdf(k - delta) + normal.cdf(-k - delta)
        powers.append((f"α0 = {level}", power, 0.8, 1e-9))
    yield from about.check("power at the non-centrality", powers)


def _student_2(t: float) -> float:
    """P(|T| ≥ t) for two degrees of freedom, 1 − t/√(2 + t²), without cancellation."""
    root = sqrt(2.0 + t**2)
    return 2.0 / (root * (root + t))


# ---- Start values: Rinner, Killian and resection, against scenes that are known and published examples.


def _numbers(name: str, found: FloatArray, reference: FloatArray, limit: float) -> Iterator[Number]:
    pairs = zip(np.ravel(found), np.ravel(reference), strict=True)
    return ((f"{name} {k + 1}", float(value), float(wanted), limit) for k, (value, wanted) in enumerate(pairs))


def _rinner(about: About) -> Iterator[ReferenceCheck]:
    random = np.random.default_rng(1956)
    turn = Rotation.from_euler("XYZ", [0.2, -0.1, 0.4]).inv().as_matrix()
    base = np.array([0.9, 0.1, np.sqrt(1.0 - 0.82)])
    a = random.normal(size=(14, 3)) + np.array([0.0, 0.0, -6.0])
    b = (a - base) @ turn.T
    candidates = four_candidates(homogeneous_unknowns(coplanarity_rows(a, b)).ik)
    closed = min(candidates, key=lambda one: float(np.abs(one[0] - base).sum() + np.abs(one[1] - turn).sum()))
    yield from about.check("closed form, base", _numbers("base", closed[0], base, 1e-11))
    yield from about.check("closed form, rotation", _numbers("D*", closed[1], turn, 1e-11))
    first, second = (image_bundle(-28.8 * one / one[:, 2:], 0.001) for one in (a, b))
    found = robust_relative_orientation(first, second).orientation
    yield from about.check("adjusted, base", _numbers("base", found.base, base, 1e-9))
    yield from about.check("adjusted, rotation", _numbers("D*", found.rotation, turn, 1e-9))


def _killian(about: About) -> Iterator[ReferenceCheck]:
    halves, alpha = np.array([0.9, 0.5, 0.7, 0.6]), 1.1
    one, two = np.array([1.0, 0.0, 0.0]), np.array([np.cos(alpha), np.sin(alpha), 0.0])
    corners = np.array([halves[0] * one, -halves[1] * one, halves[2] * two, -halves[3] * two])
    places = [np.array([0.4, 0.3, 2.5]), np.array([-1.2, 0.5, 2.2])]
    turns = [Rotation.from_euler("XYZ", angles).inv() for angles in ([-0.1, 0.15, 0.3], [-0.2, -0.5, 1.0])]
    images = [turn.apply(corners - place) for turn, place in zip(turns, places, strict=True)]
    unit = float(np.linalg.norm(places[0]))
    solutions = [s for s in solve_quadrilateral(images[0], images[1]) if s.admissible]
    best = min(solutions, key=lambda s: float(np.abs(s.halves - halves / unit).sum()))
    yield from about.check("halves of the diagonals", _numbers("half", best.halves * unit, halves, 1e-10))
    yield from about.check("angle of the diagonals", [("cos α", best.cos_alpha, float(np.cos(alpha)), 1e-10)])
    ratio = float(np.linalg.norm(places[1])) / unit
    yield from about.check("distances to the crossing", [("r_b / r_a", best.r_b, ratio, 1e-10)])


_START_VALUES: tuple[tuple[str, str, Callable[[About], Iterable[ReferenceCheck]]], ...] = (
    ("relative orientation of two images", "Rinner (1956); a scene without errors", _rinner),
    ("plane quadrilateral in two images", "Killian; a scene without errors", _killian),
)


def _homography(example: dict[str, Any], about: About) -> Iterator[ReferenceCheck]:
    K, published = np.array(example["K"]), example["published"]
    H = np.linalg.solve(K, np.array(example["H"]) @ K)
    axes = np.diag([1.0, -1.0, -1.0])
    H = axes @ H @ axes * np.sign(np.linalg.det(H))
    normal = axes @ np.array(published["n"])
    rays = normal + 0.2 * np.random.default_rng(0).normal(size=(6, 3))  # any rays that meet the plane
    R, plane = np.array(published["R"]), np.outer(axes @ published["t"], normal)
    solutions = solutions_of_homography(H, rays, rays @ H.T)
    best = min(solutions, key=lambda one: float(np.abs(axes @ R @ axes - one.rotation).max()))
    yield from about.check("rotation", _numbers("R", axes @ best.rotation @ axes, R, 1e-9))
    shift = -best.rotation @ best.base
    yield from about.check("plane", _numbers("t nᵀ", np.outer(shift, best.normal), plane, 1e-9))


def _dewitt(example: dict[str, Any], about: About) -> Iterator[ReferenceCheck]:
    xy, result = np.array(example["observations_mm"]), example["result"]
    c = np.full((len(xy), 1), -example["f_mm"])
    a, b = image_bundle(np.hstack([xy[:, :2], c]), 1.0), image_bundle(np.hstack([xy[:, 2:], c]), 1.0)
    found = adjust_coplanarity(a, b, np.array([1.0, 0.0, 0.0]), np.eye(3))
    base = np.array([example["XL_mm"], result["YL_ZL_mm"][0], result["YL_ZL_mm"][1] - example["f_mm"]])
    turn = Rotation.from_euler("XYZ", result["omega_phi_kappa_right_deg"], degrees=True).inv().as_matrix()
    yield from about.check("base", _numbers("base", found.base, base / np.linalg.norm(base), 1e-7))
    yield from about.check("rotation", _numbers("D*", found.rotation, turn, 1e-7))
    sigma0 = result["sigma0_mm"]
    yield from about.check("sigma0", [("", float(np.sqrt(found.objective)), sigma0, 1e-6 * sigma0)])


def _resection(example: dict[str, Any], about: About) -> Iterator[ReferenceCheck]:
    xy, points, result = (np.array(example["image_xy_mm"]), np.array(example["object_XYZ_m"]), example["result"])
    rays = np.column_stack([xy, np.full(len(xy), -example["f_mm"])])
    found = resect(image_bundle(rays, 0.003), points)
    yield from about.check("projection centre", _numbers("X0", found.position, np.array(result["X0_m"]), 1e-5))
    angles = np.degrees(found.angles)
    yield from about.check("attitude", _numbers("angle", angles, np.array(result["omega_phi_kappa_deg"]), 1e-7))
    sigma0 = result["sigma0_mm"]
    yield from about.check("sigma0", [("", found.sigma0 * 0.003, sigma0, 1e-6 * sigma0)])


_WORKED_START_VALUES: dict[str, tuple[str, Callable[[dict[str, Any], About], Iterable[ReferenceCheck]]]] = {
    "homography": ("decomposition of a collineation", _homography),
    "relative_orientation": ("relative orientation of six points", _dewitt),
    "resection_wolf_dewitt": ("resection from four points", _resection),
}


# ---- Threads and processes: a block large enough to be shared among threads, with one thread and with two, and
# simulated measurements by one process and by two. The order of sums does not depend on their number, so no digit
# differs.


_POSES = (
    (0.3, -0.2, 6.0, 0.05, 0.03, 0.4),
    (4.0, 0.5, 4.5, -0.08, 0.72, -1.2),
    (-3.8, 0.9, 4.2, -0.15, -0.75, 2.1),
    (0.4, -4.5, 3.9, 0.85, 0.06, 3.0),
)
_INTERIOR = {"c": 30.0, "xh": 0.1, "yh": -0.2, "K1": 1e-4, "K2": -2e-7, "K3": 1e-10, "P1": 3e-5, "P2": -2e-5}


def _brown(pose: Sequence[float], points: FloatArray) -> FloatArray:
    """Image coordinates (n, 2) of the camera model ``brown-forward``; the rotation is SciPy's."""
    c, xh, yh, K1, K2, K3, P1, P2 = _INTERIOR.values()
    star = Rotation.from_euler("XYZ", pose[3:]).inv().apply(points - np.array(pose[:3]))
    x, y = -c * star[:, 0] / star[:, 2], -c * star[:, 1] / star[:, 2]
    r2 = x**2 + y**2
    radial = K1 * r2 + K2 * r2**2 + K3 * r2**3
    dx = x * radial + P1 * (r2 + 2.0 * x**2) + 2.0 * P2 * x * y
    dy = y * radial + P2 * (r2 + 2.0 * y**2) + 2.0 * P1 * x * y
    return np.column_stack([xh + x - dx, yh + y - dy])


def _threads(about: About) -> Iterator[ReferenceCheck]:
    random = np.random.default_rng(46)
    # Points in two images from which on the rays are shared between two threads.
    shared_points = 25_000
    points = random.uniform(-1.0, 1.0, (shared_points, 3))
    names = pl.Series(range(shared_points))
    images, rays = [], []
    for i, pose in enumerate(_POSES[:2]):
        images.append(f"[I{i}, C, {', '.join(map(repr, pose))}]")
        measured = _brown(pose, points) + random.normal(0.0, 0.001, (shared_points, 2))
        rays.append(pl.DataFrame({"image": f"I{i}", "point": names, "x": measured[:, 0], "y": measured[:, 1]}))
    interior = ", ".join(f"{key}: {value!r}" for key, value in _INTERIOR.items())
    lines = [
        "mor: 1",
        "units: {length: m, angle: rad}",
        f"cameras: {{C: {{model: brown-forward, interior: {{{interior}}}}}}}",
        f"images: [{{columns: [id, camera, x, y, z, omega, phi, kappa], rows: [{', '.join(images)}]}}]",
        "points: [{file: points.csv, columns: [id, x, y, z]}]",
        "observations: [{type: image, file: rays.csv, columns: [image, point, x, y], values: {sigma: 0.001}}]",
        "datum: free",
    ]
    with TemporaryDirectory(prefix="mor", ignore_cleanup_errors=True) as folder:
        starts = pl.DataFrame(points).insert_column(0, names.alias("point"))
        starts.write_csv(Path(folder) / "points.csv", include_header=False)
        pl.concat(rays).write_csv(Path(folder) / "rays.csv", include_header=False)
        network = read_network(read_yaml("\n".join(lines), "verification"), Path(folder))
    one, two = (_by_threads(network, count) for count in (1, 2))
    for quantity, reference in one.items():
        yield from about.check(quantity, _numbers("value", two[quantity], reference, 0.0))


def _by_threads(network: Network, count: int) -> dict[str, FloatArray]:
    with processors_used(count):
        solved = solve_network(network)
    quality = solved.quality
    assert quality is not None
    diagonals = np.diagonal(quality.cofactors["point"], axis1=1, axis2=2)
    return {
        "coordinates": solved.adjustment.values["point"],
        "attitudes": solved.adjustment.values["rotation"],
        "sigma0": np.array([quality.sigma0]),
        "σ of coordinates": np.sqrt(diagonals),
        "redundancy numbers": quality.groups[0].r,
    }


def _processes(path: Path, about: About) -> Iterator[ReferenceCheck]:
    with TemporaryDirectory(prefix="mor", ignore_cleanup_errors=True) as folder, ThreadPoolExecutor(2) as pool:
        chunks = [(0, CHUNK), (CHUNK, CHUNK)]
        shared = [Task((str(path.resolve()), str(first), str(count)), Path(f"{first}.log")) for first, count in chunks]
        begin = partial(done_alone, _write_tally, folder=Path(folder))
        for task, done in zip(shared, pool.map(begin, range(2), shared), strict=True):
            if done.code != 0:
                raise RuntimeError(done.death or (Path(folder) / task.log).read_text(encoding="utf-8"))
        numbers: list[Number] = []
        ready = prepared(SimulationTask(path, "", _SEED))
        for first, count in chunks:
            with np.load(Path(folder) / f"{first}.npz") as found:
                for name, reference in chunk_of(ready, first, count).arrays().items():
                    numbers += _numbers(name, found[name], reference, 0.0)
    yield from about.check("sums over simulated measurements", numbers)


def _write_tally(path: str, first: str, count: str) -> int:
    with kernels_used(False):
        tally = chunk_of(prepared(SimulationTask(Path(path), "", _SEED)), int(first), int(count))
    np.savez(f"{first}.npz", **tally.arrays())  # type: ignore[arg-type]
    return 0


# ---- Monte Carlo: σ, coverage, and levels and power of the tests, against what theory promises.

_RUNS, _SEED = 200, 1


def _monte_carlo(path: Path, about: About) -> Iterator[ReferenceCheck]:
    ready = prepared(SimulationTask(path, "", _SEED))
    if ready.truth is None:
        raise ValueError("the network has no solution")
    for one in findings(ready.truth, chunk_of(ready, 0, _RUNS)):
        limit = one.upper - one.expected if one.found >= one.expected else one.expected - one.lower
        yield from about.check(NAMES[one.name], [("", one.found, one.expected, limit)])
