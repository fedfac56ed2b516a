"""``mor covariance``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_of_command
from mor.cli.options import InputPath, coverage_option, output_option
from mor.errors import InputError, Message

if TYPE_CHECKING:
    from mor.quality.solution import Solved
    from mor.report.covariance import Labelled


def joined(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> str | None:
    """The names of an option that was given any number of times; ``None`` if it was not."""
    return ",".join(value) if value else None


@click.command(name="covariance")
@click.argument("results", type=InputPath())
@click.option(
    "--points", metavar="A,B,…", multiple=True, callback=joined, help="All coordinates of these points together."
)
@click.option(
    "--images",
    metavar="A,B,…",
    multiple=True,
    callback=joined,
    help="Positions and attitudes of these images together.",
)
@click.option(
    "--cameras",
    metavar="[A,B,…]",
    is_flag=False,
    flag_value="",
    help="Interior orientations of these cameras, or of all, together.",
)
@click.option("--full", is_flag=True, help="All unknowns together, if they fit into memory.")
@click.option("--blocks", is_flag=True, help="The 3 × 3 block of every point, as .csv.")
@click.option(
    "--relative",
    multiple=True,
    metavar="A,B",
    help="Relative error ellipsoid of a pair of points, as .csv; may be repeated.",
)
@click.option(
    "--relative-pose",
    multiple=True,
    metavar="A,B",
    help="Pose of image B in the axes of image A with its covariance, as .csv; may be repeated.",
)
@click.option(
    "--to",
    "target",
    metavar="DATUM",
    show_default="that of the results",
    help='Datum, as in the project file: free, or "free: [1, 2]".',
)
@output_option("File to write: .npz, .csv or .mtx (Matrix Market).", metavar="FILE", required=True)
@coverage_option
@click.option("-f", "--force", is_flag=True, help="Replace an existing file.")
def command(
    results: Path,
    points: str | None,
    images: str | None,
    cameras: str | None,
    full: bool,
    blocks: bool,
    relative: tuple[str, ...],
    relative_pose: tuple[str, ...],
    target: str | None,
    output: Path,
    coverage: float | None,
    force: bool,
) -> None:
    """Write covariances of RESULTS with labels, in the datum of the results or in another one.

    \b
    Examples:
      mor covariance project.results --points 1,2,7 -o chosen.npz
      mor covariance project.results --points 1,2 --images IMG1,IMG2 --cameras -o joint.npz
      mor covariance project.results --points 1,2 --coverage 2 -o expanded.csv
      mor covariance project.results --relative-pose IMG1,IMG2 -o pose.csv
      mor covariance project.results --full -o all.mtx
      mor covariance project.results --blocks --to free -o blocks.csv
      mor covariance project.results --relative 1,2 --relative 1,7 -o pairs.csv

    RESULTS is a folder of results, or a project. Give one of --full, --blocks, --relative, --relative-pose, or any
    of --points, --images and --cameras. Units are those of the project, squared.

    \b
    Exit codes: 0 done; 2 input, or no solution.
    """
    from mor.api.result import in_datum, reopen, solve
    from mor.linalg.compilation import chosen_by_size
    from mor.output_files import check_file, write_file
    from mor.report.covariance import check_covariance, freedom_of
    from mor.report.language import words_of
    from mor.report.layout import coverage_words

    named = (points, images, cameras)
    if sum((named != (None, None, None), full, blocks, bool(relative), bool(relative_pose))) != 1:
        words = "choose --points, --images, --cameras together, or one of --full, --blocks, --relative, --relative-pose"
        raise InputError([Message(words)])
    check_covariance(output)
    check_file(output, force)
    if (blocks or relative or relative_pose) and output.suffix != ".csv":
        raise InputError([Message("--blocks, --relative and --relative-pose are written as .csv", str(output))])
    project = reopen(results)
    solved = in_datum(project, target, "--to")[1] if target is not None else solve(project)
    with chosen_by_size(solved.network.observations):
        write_file(output, lambda path: _write(path, solved, named, blocks, relative, relative_pose, coverage), force)
    if coverage is not None:
        click.echo(coverage_words(coverage, freedom_of(solved), words_of(language_of_command())), err=True)


def _write(
    output: Path,
    solved: Solved,
    named: tuple[str | None, str | None, str | None],
    blocks: bool,
    relative: tuple[str, ...],
    relative_pose: tuple[str, ...],
    coverage: float | None,
) -> None:
    from mor.report import covariance as report

    if blocks:
        header, rows = report.point_blocks(solved)
    elif relative:
        header, rows = report.relative_rows(solved, [_pair(text, "--relative", "points") for text in relative])
    elif relative_pose:
        pairs = [_pair(text, "--relative-pose", "images") for text in relative_pose]
        header, rows = report.relative_pose_rows(solved, pairs)
    else:
        report.write_covariance(output, _matrix(solved, named), coverage)
        return
    if coverage is not None:
        header, rows = report.with_expanded(header, rows, coverage)
    report.write_rows(output, header, rows)


def _matrix(solved: Solved, named: tuple[str | None, str | None, str | None]) -> Labelled:
    from mor.report.covariance import covariance_of_everything, covariance_of_names

    points, images, cameras = named
    if named == (None, None, None):
        return covariance_of_everything(solved)
    return covariance_of_names(
        solved,
        _names(points, "--points", "points"),
        _names(images, "--images", "images"),
        None if cameras is None else _names(cameras or None, "--cameras", "cameras"),
    )


def _names(text: str | None, option: str, kind: str) -> list[str]:

    names = [name.strip() for name in (text or "").split(",") if name.strip()]
    if text is not None and not names:
        raise InputError([Message(f"{option}: found {text!r}, expected names of {kind} A,B,…")])
    return names


def _pair(text: str, option: str, kind: str) -> tuple[str, str]:

    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or names[0] == names[1]:
        raise InputError([Message(f"{option}: found {text!r}, expected two {kind} A,B")])
    return names[0], names[1]
