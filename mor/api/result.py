"""Results in Python: adjust, tables, plots, reopening."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from importlib.util import find_spec
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mor.api.project import Project, Source, read
from mor.errors import InputError, Message, NoSolutionError
from mor.input_files import note_input

if TYPE_CHECKING:
    import polars as pl

    from mor.project.network import Network
    from mor.quality.assessment import Quality
    from mor.quality.redundancy import Done
    from mor.quality.solution import Solved
    from mor.report.covariance import Labelled, RelativePose
    from mor.report.identity import RunIdentity
    from mor.report.view import View
    from mor.solve.iterate import Watcher


# ---- Tables of results: data frames that know their units.


@dataclass(frozen=True)
class Table:
    """A data frame and the units of its columns.

    Attributes:
        frame: the polars data frame, in axes and units of the project.
        units: unit of each column that has one; ``"unit"`` where each row has its own, in the column ``unit``.
    """

    frame: pl.DataFrame
    units: Mapping[str, str]

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return self.frame.columns

    def __len__(self) -> int:
        return self.frame.height

    def __getitem__(self, column: str) -> pl.Series:
        return self.frame[column]

    def row(self, name: str) -> dict[str, Any]:
        """The row of a thing by its name. Raises ``KeyError``, with the nearest name."""
        from mor.errors import nearest

        found = self.frame.filter(self.frame["id"] == name)
        if found.height == 0:
            raise KeyError(f"unknown name {name!r}{nearest(name, self.frame['id'].to_list())}")
        return found.row(0, named=True)

    def to_pandas(self) -> Any:
        """The table as a pandas data frame, with the units in its ``attrs``; pandas must be installed."""
        import pandas

        result = pandas.DataFrame({name: self.frame[name].to_list() for name in self.frame.columns})
        result.attrs["units"] = dict(self.units)
        return result

    def __str__(self) -> str:
        return str(self.frame)

    def _repr_html_(self) -> str:
        shown = self.frame.head(20)
        heads = "".join(f"<th>{escape(self._head(name))}</th>" for name in shown.columns)
        rows = "".join(
            f"<tr>{''.join(f'<td>{escape(_cell(value))}</td>' for value in row)}</tr>" for row in shown.rows()
        )
        more = self.frame.height - shown.height
        rest = f"<p>… {more} more rows</p>" if more > 0 else ""
        return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>{rest}"

    def _head(self, name: str) -> str:
        unit = self.units.get(name)
        return name if unit is None or unit == "unit" else f"{name} [{unit}]"


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.7g}" if isinstance(value, float) else str(value)


# ---- Results opened again: a project solved where it stands, in its datum or in another one.


def reopen(path: Path) -> Project:
    """The project behind a results folder, or a project file.

    The datum of results refers to the coordinates that stand with them. Raises :class:`InputError`.
    """
    adjusted_file = "adjusted.yaml"
    file = path / adjusted_file if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        raise InputError([Message(f"no {adjusted_file} in this folder; expected the results of mor adjust", str(path))])
    project = read(file)
    reference = path / "reference.csv"
    if not path.is_dir() or not reference.is_file():
        return project
    note_input(reference)
    return replace(project, network=_with_reference(project.network, reference))


def solve(project: Project) -> Solved:
    """The solution of a project. Raises :class:`InputError` if there is none."""
    from mor.api.pipeline import solve_network
    from mor.report.language import ENGLISH
    from mor.report.text_findings import undetermined_section

    solved = solve_network(project.network)
    if solved.quality is None:
        explained = undetermined_section(solved, ENGLISH)
        words = "\n".join(part for part in (solved.adjustment.reason, explained) if part)
        raise InputError([Message(f"no solution: {words}", project.document.file)])
    return solved


def in_datum(project: Project, target: str, said: str) -> tuple[Project, Solved]:
    """The project with another datum, written as in a project file, and its solution; ``said``: where it was said.

    Fixed coordinates are released where the other datum is free. Raises :class:`InputError` if they strain the
    network: then its residuals depend on them, and only a new adjustment can do without.
    """
    from mor.api.pipeline import read_network
    from mor.project.document import read_yaml
    from mor.quality.deformation import released, strained

    data = read_yaml(f"datum: {{{target}}}" if ":" in target else f"datum: {target}", said).data
    document = replace(
        project.document,
        data={**project.document.data, **data},
        lines={**project.document.lines, ("datum",): 0},
        files={**project.document.files, ("datum",): said},
    )
    datum = read_network(document, project.folder).datum._replace(reference=project.network.datum.reference)
    other = replace(project, document=document, network=replace(project.network, datum=datum))
    if not other.network.datum.free:
        return other, solve(other)
    before = solve(project)
    free = released(before)
    if free is project.network:
        return other, solve(other)
    other = replace(other, network=replace(free, datum=other.network.datum))
    after = solve(other)
    if strained(before, after):
        words = "the fixed coordinates strain the network: another datum needs a new adjustment without them"
        raise InputError([Message(words, project.document.file)])
    return other, after


def _with_reference(network: Network, path: Path) -> Network:
    import polars as pl

    from mor.model.contract import places
    from mor.project.document import plain_column

    reference = network.start["point"].copy()
    points = network.things["point"]
    table = pl.read_csv(path, schema={"id": pl.String, **dict.fromkeys("xyz", pl.Float64)})
    table = table.with_columns(plain_column(table["id"]))
    place = places(table["id"].fill_null(""), pl.Series(points.ids, dtype=pl.String))
    known = place >= 0
    given = table.select("x", "y", "z").fill_null(np.nan).to_numpy()[known]
    reference[points.parts["position"][place[known]]] = given @ network.edge.matrix.T
    return replace(network, datum=network.datum._replace(reference=reference))


# ---- The result of an adjustment: verdict, tables with units, covariances, other datums, files.


@dataclass(frozen=True, eq=False)
class Result:
    """The result of an adjustment, in the axes and units of its project.

    Attributes:
        project: what was adjusted.
        solved: the adjustment itself with all arrays, in internal units and axes; it may change between versions.
    """

    project: Project
    solved: Solved

    @property
    def outcome(self) -> str:
        """``converged``, ``not converged``, ``diverged`` or ``singular``."""
        return self.solved.adjustment.outcome.value

    @property
    def reason(self) -> str:
        """Why there is no solution; empty if there is one."""
        return self.solved.adjustment.reason

    @property
    def converged(self) -> bool:
        """True if there is a solution, and tables and covariances can be asked for."""
        return self.solved.quality is not None

    @property
    def accepted(self) -> bool:
        """True if the global test accepts the solution, no observation is flagged, and the result is determined."""
        quality, judged = self.solved.quality, self.solved.verdict
        if quality is None or judged is None:
            return False
        if judged.determined is not None and not judged.determined.as_a_whole:
            return False
        return quality.global_test.accepted and not any(flags.any() for flags in quality.flagged)

    @property
    def sigma0(self) -> float | None:
        """σ0 a posteriori, in units of the one a priori times that; nothing without redundancy."""
        quality = self._quality
        apriori = self.solved.network.project.settings.sigma0
        return apriori * quality.sigma0 if quality.redundancy > 0 else None

    @property
    def redundancy(self) -> int:
        """Degrees of freedom: observations − unknowns + datum defect."""
        return self._quality.redundancy

    @property
    def datum(self) -> str:
        """The datum that coordinates and their σ hold in."""
        return self.solved.adjustment.problem.datum.name

    @cached_property
    def points(self) -> Table:
        """Object points: coordinates, σ, error ellipsoid, correlations, rays, control."""
        from mor.report.estimates import point_table

        return self._table("Point", point_table(self._solution))

    @cached_property
    def images(self) -> Table:
        """Images: projection centre (of the rotation centre, where there is an eccentricity), ω φ κ, σ."""
        from mor.report.estimates import image_table

        return self._table("Image", image_table(self._solution))

    @cached_property
    def stations(self) -> Table:
        """Theodolite stations: position, ω φ κ, orientation of the circle, σ."""
        from mor.report.estimates import station_table

        return self._table("Station", station_table(self._solution))

    @cached_property
    def cameras(self) -> Table:
        """Interior orientations: a row for each component of each camera, with its unit."""
        import polars as pl

        from mor.model.cameras import CAMERA_MODELS
        from mor.report.estimates import interior_rows

        rows = [
            {
                "id": camera["id"],
                "model": camera["model"],
                "component": component.name,
                **camera["components"][component.name],
                "unit": component.quantity.unit(self._length, "rad", camera["unit"]),
            }
            for camera in interior_rows(self._solution)
            for component in CAMERA_MODELS[camera["model"]].components
        ]
        return Table(pl.DataFrame(rows, infer_schema_length=None), dict.fromkeys(("value", "sigma"), "unit"))

    @cached_property
    def features(self) -> Table:
        """Planes, lines and other shapes: direction, place and sizes with σ, mean distance, form deviation."""
        from mor.report.estimates import feature_table

        return self._table("Feature", feature_table(self._solution))

    @cached_property
    def groups(self) -> Table:
        """Groups of observations: number, Σ r, part of vᵀPv, σ0 of the group."""
        from mor.report.estimates import group_table

        return Table(group_table(self._solution), {})

    @cached_property
    def observations(self) -> Table:
        """All observations: observed, adjusted, v = adjusted − observed, σ, r, tests, reliability."""
        from mor.report.observations import observation_table

        return self._table("Residual", observation_table(self._solution))

    def covariance(self, *points: str, images: Sequence[str] = (), cameras: Sequence[str] | None = None) -> Labelled:
        """Return the joint covariance of named points, images and cameras, or of all unknowns if none is named.

        An empty sequence ``cameras`` stands for all cameras. Labelled with names and units, in the datum of the result
        and with its σ0. Raises :class:`mor.InputError` for unknown names, :class:`mor.NoSolutionError`.
        """
        from mor.linalg.compilation import chosen_by_size
        from mor.report.covariance import covariance_of_everything, covariance_of_names

        solved = self._solution
        with chosen_by_size(solved.network.observations):
            if points or images or cameras is not None:
                return covariance_of_names(solved, points, images, cameras)
            return covariance_of_everything(solved)

    def relative_pose(self, first: str, second: str) -> RelativePose:
        """Return the pose of the second image in the axes of the first one, with its covariance (6, 6).

        Raises :class:`mor.InputError` for unknown names, :class:`mor.NoSolutionError`.
        """
        from mor.linalg.compilation import chosen_by_size
        from mor.report.covariance import relative_pose

        solved = self._solution
        with chosen_by_size(solved.network.observations):
            return relative_pose(solved, first, second)

    def cofactor(self, *points: str) -> Labelled:
        """Return the cofactor matrix Q, which is the covariance matrix for σ0 = 1."""
        found = self.covariance(*points)
        return found._replace(matrix=found.matrix / found.sigma0**2, sigma0=1.0)

    def in_datum(self, datum: str) -> Result:
        """The result in another datum, written as in a project file (``"free: [1, 2, 7]"``), by S-transformation.

        Residuals and redundancy numbers stay as they are. Raises :class:`mor.InputError` where fixed coordinates
        strain the network, :class:`mor.NoSolutionError`.
        """

        adjustment = self._solution.adjustment
        here = self.solved.network.datum._replace(reference=adjustment.problem.datum.reference["point"])
        network = replace(self.solved.network, start=adjustment.values, datum=here)
        return Result(*in_datum(replace(self.project, network=network), datum, "in_datum"))

    def report(self, language: Literal["en", "de"] = "en") -> str:
        """The text report."""
        from mor.report.language import words_of
        from mor.report.text import text_report

        return text_report(self.solved, words_of(language), self._identity)

    def protocol(
        self, standard: str, *, against: Result | None = None, permissible: tuple[float, float] | None = None
    ) -> dict[str, Any]:
        """Return the protocol of a test (``iso17123-4``, …) as plain data, like ``mor report --protocol``.

        ``against`` is another test to compare with, ``permissible`` (A, K) of VDI/VDE 2634 part 1 in mm and mm/m.
        Raises :class:`mor.InputError` if the results are not of the full procedure.
        """
        from mor.report.protocol import protocol

        return protocol(self._view, standard, None if against is None else against._view, permissible)

    def certificate(
        self,
        camera: str,
        *,
        coverage: float | None = None,
        administration: str | PathLike[str] | None = None,
        language: Literal["en", "de"] = "en",
    ) -> str:
        """Return the certificate of a camera as text; as XML (DCC 3.2.0) with a YAML file of administrative data.

        ``coverage`` is the factor k of the expanded uncertainties. Raises :class:`mor.InputError` for an unknown
        camera, one without image points, and mistakes in the file.
        """
        from mor.input_files import read_text
        from mor.project.document import read_yaml
        from mor.report.certificate import certificate, certificate_text
        from mor.report.digital_certificate import administration as read_administration
        from mor.report.digital_certificate import digital_certificate
        from mor.report.language import words_of

        one = certificate(self._view, camera, coverage)
        if administration is None:
            return certificate_text(one, words_of(language))
        who = read_administration(read_yaml(read_text(Path(administration)), str(administration)))
        return digital_certificate(one, who, words_of(language, "page"))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``results.json`` as plain data."""
        from mor.report.results import results

        return results(self.solved, {}, self._identity)

    def write(
        self,
        folder: str | PathLike[str],
        *,
        force: bool = False,
        language: Literal["en", "de"] = "en",
        html: bool = True,
        tables: Literal["none", "worst", "all"] = "all",
        table_format: Literal["csv", "parquet"] | None = None,
    ) -> None:
        """Write report, page, ``results.json``, tables and the adjusted project, as the command does.

        Raises :class:`mor.InputError` where results are there already and ``force`` was not said.
        """
        from mor.report.output_folder import reserve
        from mor.report.results import Choice, write_results

        choice = Choice(tables=tables, kind=table_format, html=html, language=language)
        with reserve(Path(folder), force) as place:
            write_results(self.solved, self.project.document, self._identity, place, choice)

    def __str__(self) -> str:
        from mor.report.text import screen

        return screen(self.solved)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """HTML for notebooks: the summary, and below it the network in plan if Matplotlib is installed."""
        return f"<pre>{escape(str(self))}</pre>{self._network()}"

    def _network(self) -> str:
        if self.solved.quality is None or find_spec("matplotlib") is None:
            return ""
        from mor.report.observations import SHOWN, observation_table
        from mor.report.plots import network, style
        from mor.report.view import view_of

        text = StringIO()
        with style():
            network(view_of(self.solved, observation_table(self.solved, SHOWN))).savefig(text, format="svg")
        drawing = text.getvalue()
        return drawing[drawing.index("<svg") :]

    @property
    def _identity(self) -> RunIdentity:
        from mor.report.identity import RunIdentity

        return RunIdentity(self.project.files, self.project.folder)

    @property
    def _view(self) -> View:
        from mor.report.view import view_of_rows

        return view_of_rows(self.to_dict(), self.points.frame, self.images.frame, self.observations.frame)

    @property
    def _solution(self) -> Solved:
        _ = self._quality
        return self.solved

    @property
    def _quality(self) -> Quality:
        if self.solved.quality is None:
            raise NoSolutionError(f"there is no solution: {self.outcome} ({self.reason})")
        return self.solved.quality

    @property
    def _length(self) -> str:
        return self.solved.network.project.units.length

    def _table(self, part: str, frame: pl.DataFrame) -> Table:
        from mor.report.schema import units_of
        from mor.report.units import angle_unit

        units = units_of(part, self._length, angle_unit(self.solved))
        return Table(frame, {name: unit for name, unit in units.items() if name in frame.columns})


# ---- From a project to its result.


def adjust(
    source: Source | Project,
    snoop: bool = False,
    watch: Watcher | None = None,
    assessing: Callable[[int], Done] | None = None,
) -> Result:
    """Adjust a project and assess the outcome; start values that are missing are worked out.

    Args:
        source: a :class:`Project`, or what :func:`read` takes.
        snoop: take flagged observations out one by one until nothing else is flagged (data snooping).
        watch: called after every iteration.
        assessing: called between the solution and its statistics with the effort ahead; what it returns is told how
            much more is done.

    Raises:
        InputError: the project has mistakes, or start values cannot be found. That an adjustment does not converge, or
            that the network is singular, is no error: the result says so.
    """
    from mor.api.pipeline import snooped, solve_network

    project = source if isinstance(source, Project) else read(source)
    return Result(project, solve_network(snooped(project.network) if snoop else project.network, watch, assessing))
