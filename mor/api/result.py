"""The result of an adjustment: verdict, tables with units, covariances, other datums, files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mor.api.table import Table
from mor.errors import NoSolutionError

if TYPE_CHECKING:
    import polars as pl

    from mor.api.project import Project
    from mor.quality.assess import Quality
    from mor.quality.solved import Solved
    from mor.report.identity import Identity
    from mor.report.results.covariance import Labelled, RelativePose


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
        from mor.report.tables.estimates import point_table

        return self._table(point_table(self._solution))

    @cached_property
    def images(self) -> Table:
        """Images: projection centre (of the rotation centre, where there is an eccentricity), ω φ κ, σ."""
        from mor.report.tables.estimates import image_table

        return self._table(image_table(self._solution))

    @cached_property
    def stations(self) -> Table:
        """Theodolite stations: position, ω φ κ, orientation of the circle, σ."""
        from mor.report.tables.estimates import station_table

        return self._table(station_table(self._solution))

    @cached_property
    def cameras(self) -> Table:
        """Interior orientations: a row for each component of each camera, with its unit."""
        import polars as pl

        from mor.geometry.cameras import CAMERA_MODELS
        from mor.report.tables.estimates import interior_rows

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
        units = dict.fromkeys(("value", "sigma"), "unit")
        return Table(pl.DataFrame(rows, infer_schema_length=None), units)

    @cached_property
    def groups(self) -> Table:
        """Groups of observations: number, Σ r, part of vᵀPv, σ0 of the group."""
        from mor.report.tables.estimates import group_table

        return Table(group_table(self._solution), {})

    @cached_property
    def observations(self) -> Table:
        """All observations: observed, adjusted, v = adjusted − observed, σ, r, tests, reliability."""
        from mor.report.tables.observations import observation_table

        frame = observation_table(self._solution)
        units = dict.fromkeys(
            ("observed", "adjusted", "v", "sigma", "sigma_adjusted", "error", "nabla"), "unit"
        )
        return Table(frame, {**units, "influence": self._length})

    def covariance(
        self, *points: str, images: Sequence[str] = (), cameras: Sequence[str] | None = None
    ) -> Labelled:
        """Return the joint covariance of named points, images and cameras, or of all unknowns if none is named.

        An empty sequence ``cameras`` stands for all cameras. Labelled with names and units, in the datum of the result
        and with its σ0. Raises :class:`mor.InputError` for unknown names, :class:`mor.NoSolutionError`.
        """
        from mor.compilation import chosen_by_size
        from mor.report.results.covariance import covariance_of_everything, covariance_of_names

        solved = self._solution
        with chosen_by_size(solved.network.observations):
            if points or images or cameras is not None:
                return covariance_of_names(solved, points, images, cameras)
            return covariance_of_everything(solved)

    def relative_pose(self, first: str, second: str) -> RelativePose:
        """Return the pose of the second image in the axes of the first one, with its covariance (6, 6).

        Raises :class:`mor.InputError` for unknown names, :class:`mor.NoSolutionError`.
        """
        from mor.compilation import chosen_by_size
        from mor.report.results.covariance import relative_pose

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
        from mor.api.reopened import in_datum

        adjustment = self._solution.adjustment
        here = self.solved.network.datum._replace(reference=adjustment.problem.datum.reference["point"])
        network = replace(self.solved.network, start=adjustment.values, datum=here)
        return Result(*in_datum(replace(self.project, network=network), datum, "in_datum"))

    def report(self, language: Literal["en", "de"] = "en") -> str:
        """The text report."""
        from mor.report.text_report import text_report
        from mor.report.words.language import words_of

        return text_report(self.solved, words_of(language), self._identity)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``results.json`` as plain data."""
        from mor.report.results.json import results

        return results(self.solved, {}, self._identity)

    def write(
        self,
        folder: str | PathLike[str],
        *,
        force: bool = False,
        language: Literal["en", "de"] = "en",
        html: bool = True,
        tables: Literal["none", "worst", "all"] = "all",
        table_format: Literal["csv", "parquet"] = "csv",
    ) -> None:
        """Write report, page, ``results.json``, tables and the adjusted project, as the command does.

        Raises :class:`mor.InputError` where results are there already and ``force`` was not said.
        """
        from mor.report.results.reservation import reserve
        from mor.report.results.writing import Choice, write_results

        choice = Choice(tables=tables, kind=table_format, html=html, language=language)
        with reserve(Path(folder), force) as place:
            write_results(self.solved, self.project.document, self._identity, place, choice)

    def __str__(self) -> str:
        from mor.report.text.screen import screen

        return screen(self.solved)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """Return the summary, and a plan of the network if matplotlib is installed, for notebooks."""
        from mor.api.notebook import summary_and_network

        return summary_and_network(self.solved)

    @property
    def _identity(self) -> Identity:
        from mor.report.identity import Identity

        return Identity(self.project.files, self.project.folder)

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

    def _table(self, frame: pl.DataFrame) -> Table:
        from mor.report.edge import angle_unit

        units: Mapping[str, str] = {
            **dict.fromkeys(_LENGTHS, self._length),
            **dict.fromkeys(_ANGLES, angle_unit(self.solved)),
        }
        return Table(frame, {name: units[name] for name in frame.columns if name in units})


_LENGTHS = (
    "x",
    "y",
    "z",
    "sx",
    "sy",
    "sz",
    "height",
    "ellipsoid_a",
    "ellipsoid_b",
    "ellipsoid_c",
    "ellipse_a",
    "ellipse_b",
)
_ANGLES = (
    "omega",
    "phi",
    "kappa",
    "somega",
    "sphi",
    "skappa",
    "orientation",
    "sorientation",
    "ellipse_azimuth",
)
