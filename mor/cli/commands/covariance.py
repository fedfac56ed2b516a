"""``mor covariance``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli._output import InputPath, OutputPath

if TYPE_CHECKING:
    from mor.quality.solved import Solved


@click.command(name="covariance")
@click.argument("results", type=InputPath())
@click.option("--points", metavar="A,B,…", help="All coordinates of these points together.")
@click.option("--full", is_flag=True, help="All unknowns together, where they fit into memory.")
@click.option("--blocks", is_flag=True, help="The 3 × 3 block of every point, as .csv.")
@click.option(
    "--relative",
    multiple=True,
    metavar="A,B",
    help="Relative error ellipsoid of a pair of points, as .csv; may be repeated.",
)
@click.option(
    "--to",
    "target",
    metavar="DATUM",
    show_default="that of the results",
    help='Datum, as the project file writes it: free, or "free: [1, 2]".',
)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    type=OutputPath(),
    required=True,
    help="File to write: .npz, .csv or .mtx (Matrix Market).",
)
@click.option("-f", "--force", is_flag=True, help="Replace a file that is there already.")
def command(
    results: Path,
    points: str | None,
    full: bool,
    blocks: bool,
    relative: tuple[str, ...],
    target: str | None,
    output: Path,
    force: bool,
) -> None:
    """Write covariances of RESULTS with labels, in the datum of the results or in another one.

    \b
    Examples:
      mor covariance project.results --points 1,2,7 -o chosen.npz
      mor covariance project.results --full -o all.mtx
      mor covariance project.results --blocks --to free -o blocks.csv
      mor covariance project.results --relative 1,2 --relative 1,7 -o pairs.csv

    RESULTS is a folder of results, or a project. Give one of --points, --full, --blocks, --relative. Units are those
    of the project, squared.

    \b
    Exit codes: 0 done; 2 input, or no solution.
    """
    from mor.api.reopened import in_datum, reopen, solve
    from mor.compilation import chosen_by_size
    from mor.errors import InputError, Problem
    from mor.output_files import check_file, write_file
    from mor.report.results.covariance import check_covariance

    if sum((points is not None, full, blocks, bool(relative))) != 1:
        raise InputError([Problem("choose one of --points, --full, --blocks, --relative")])
    check_covariance(output)
    check_file(output, force)
    if (blocks or relative) and output.suffix != ".csv":
        raise InputError([Problem("--blocks and --relative are written as .csv", str(output))])
    project = reopen(results)
    solved = in_datum(project, target, "--to")[1] if target is not None else solve(project)
    with chosen_by_size(solved.network.observations):
        write_file(output, lambda path: _write(path, solved, points, blocks, relative), force)


def _write(output: Path, solved: Solved, points: str | None, blocks: bool, relative: tuple[str, ...]) -> None:
    from mor.errors import InputError, Problem
    from mor.report.results import covariance as report

    if blocks:
        report.write_rows(output, report.POINT_BLOCK_HEADER, report.point_blocks(solved))
    elif relative:
        rows = report.relative_rows(solved, [_pair(text) for text in relative])
        report.write_rows(output, report.RELATIVE_HEADER, rows)
    elif points is not None:
        names = [name.strip() for name in points.split(",") if name.strip()]
        if not names:
            raise InputError([Problem(f"--points: found {points!r}, expected names of points A,B,…")])
        report.write_covariance(output, report.covariance_of_points(solved, names))
    else:
        report.write_covariance(output, report.covariance_of_everything(solved))


def _pair(text: str) -> tuple[str, str]:
    from mor.errors import InputError, Problem

    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or names[0] == names[1]:
        raise InputError([Problem(f"--relative: found {text!r}, expected two points A,B")])
    return names[0], names[1]
