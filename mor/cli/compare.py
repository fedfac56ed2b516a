"""``mor compare``."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mor.cli.console import language_option
from mor.cli.options import InputPath, OutputPath, kernels_option, quiet_option
from mor.errors import ExitCode, InputError, Message, nearest
from mor.input_files import TABLE, read_text
from mor.output_files import check_file, write_file

if TYPE_CHECKING:
    from collections.abc import Sequence

    import polars as pl

    from mor.quality.deformation import EpochComparison
    from mor.quality.solution import Solved

SCHEMA = "mor-results"
"""As :data:`mor.report.summary.SCHEMA`, which takes long to import."""


@click.command(name="compare")
@click.argument("results", nargs=-1, required=True, type=InputPath())
@click.option(
    "--tol",
    default=1e-9,
    show_default=True,
    metavar="NUMBER",
    help="Allowed difference: absolute, or relative for numbers above 1.",
)
@click.option("--epochs", is_flag=True, help="Compare two epochs: congruence test over their common points.")
@click.option(
    "--pairs",
    metavar="FILE",
    type=InputPath(),
    help="CSV with a header and two columns of points: test whether these pairs of one adjustment have moved apart.",
)
@click.option(
    "--between",
    nargs=2,
    metavar="EPOCH EPOCH",
    help="Two epochs of one adjustment: congruence test over the moving points seen in both.",
)
@click.option("--level", default=0.001, show_default=True, metavar="NUMBER", help="Level α of the tests of movements.")
@click.option("--known-sigma0", is_flag=True, help="Test with σ0 a priori, not with the estimated one.")
@click.option(
    "--page",
    metavar="FILE",
    type=OutputPath(),
    help=(
        "With --epochs or --between: write a page with both epochs side by side and "
        "the movements with ellipses and tests."
    ),
)
@click.option("-f", "--force", is_flag=True, help="Replace an existing page.")
@language_option("the page and the messages")
@kernels_option
@quiet_option
def command(
    results: tuple[Path, ...],
    tol: float,
    epochs: bool,
    pairs: Path | None,
    between: tuple[str, str] | None,
    level: float,
    known_sigma0: bool,
    page: Path | None,
    force: bool,
    lang: str,
    quiet: bool,
) -> int:
    """Compare RESULTS: two folders number by number, two epochs, or pairs of points of one adjustment.

    \b
    Examples:
      mor compare before.results after.results --tol 1e-6
      mor compare spring.results autumn.results --epochs
      mor compare spring.results autumn.results --epochs --page movements.html --quiet
      mor compare both.results --pairs pairs.csv
      mor compare dam.results --between 2015-04 2024-04

    RESULTS are folders of results; for the comparison number by number also results.json files. The other comparisons
    print movements as CSV on standard output, in the length unit of the project.

    \b
    Exit codes: 0 equal, nothing moved; 1 different, something moved; 2 input.
    """
    if not 0.0 < level < 1.0:
        raise InputError([Message(f"--level: found {level:g}, expected a number between 0 and 1")])
    if tol < 0.0:
        raise InputError([Message(f"--tol: found {tol:g}, expected 0 or more")])
    if epochs + (pairs is not None) + (between is not None) > 1:
        raise InputError([Message("choose one of --epochs, --pairs, --between")])
    written = (page, force) if page is not None else None
    check_page(page, epochs or between is not None, force)
    alone = "--pairs" if pairs is not None else "--between" if between is not None else ""
    if len(results) != (1 if alone else 2):
        expected = f"one folder of results with {alone}" if alone else "two to compare"
        raise InputError([Message(f"found {len(results)}, expected {expected}")])
    if pairs is not None:
        table, words = _pairs(results[0], pairs, level, known_sigma0, lang)
    elif between is not None:
        table, words = _between(results[0], between, level, known_sigma0, written, lang)
    elif epochs:
        table, words = _epochs(results[0], results[1], level, known_sigma0, written, lang)
    else:
        return _regression(results[0], results[1], tol, lang, quiet)
    from mor.project.document import csv_lines

    click.echo(bytes(csv_lines(table)).decode(), nl=False)
    if not quiet:
        click.echo("\n".join(words), err=True)
    return ExitCode.REJECTED if table["moved"].any() else ExitCode.DONE


def check_page(page: Path | None, epochs: bool, force: bool) -> None:
    """Raise :class:`InputError` where a page cannot be written before anything is computed."""
    if page is None:
        return
    if not epochs:
        raise InputError([Message("--page is for --epochs and --between")])
    check_file(page, force)


def _regression(one: Path, other: Path, tol: float, lang: str, quiet: bool) -> ExitCode:
    from mor.report.comparison import differences, said_value
    from mor.report.language import words_of

    words = words_of(lang)

    found = differences(_content(one), _content(other), tol)
    shown = 20
    if not quiet:
        for difference in found[:shown]:
            values = (words.listed(said_value(value)) for value in (difference.one, difference.other))
            click.echo(f"{difference.place}: {' | '.join(values)}")
        if len(found) > shown:
            click.echo(words("and {count} more", count=len(found) - shown))
        said = "{count:difference|differences} beyond {tol}" if found else "equal within {tol}"
        click.echo(words(said, count=len(found), tol=f"{tol:g}"), err=True)
    return ExitCode.REJECTED if found else ExitCode.DONE


def _content(path: Path) -> Any:
    file = path / "results.json" if path.is_dir() else path
    try:
        content = json.loads(read_text(file, TABLE))
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError([Message("expected a folder of results, or its results.json", str(file))])
    return content


def _folder(path: Path) -> Path:
    return path.parent if path.name == "results.json" else path


def _epochs(
    one: Path, other: Path, level: float, known: bool, page: tuple[Path, bool] | None, lang: str
) -> tuple[pl.DataFrame, list[str]]:
    from mor.api.result import reopen, solve
    from mor.linalg.compilation import chosen_by_size
    from mor.quality.deformation import blocks_of, common_points, compare_epochs, over_points
    from mor.report.epochs import movement_table, verdict
    from mor.report.language import words_of

    first, second = reopen(_folder(one)), reopen(_folder(other))
    if first.network.edge != second.network.edge:
        raise InputError([Message("the two epochs have different units or axes", str(other))])
    names = common_points(first.network, second.network)
    if not names:
        raise InputError([Message("the two epochs have no points in common", str(other))])
    coordinates = first.network.start["point"][blocks_of(first.network, names)]
    solved = [
        solve(replace(epoch, network=over_points(epoch.network, names, coordinates))) for epoch in (first, second)
    ]
    assessed = [(s.quality, blocks_of(s.network, names)) for s in solved if s.quality is not None]
    with chosen_by_size(max(s.network.observations for s in solved)):
        found = compare_epochs(names, assessed[0], assessed[1], level, known)
    table = movement_table(names, found.result.points, first.network.edge.matrix, level, known)
    if page is not None:
        _write_page((one, other), solved, found, table, level, known, page, lang)
    return table, verdict(found, level, known, words_of(lang))


def _between(
    path: Path, wanted: tuple[str, str], level: float, known: bool, page: tuple[Path, bool] | None, lang: str
) -> tuple[pl.DataFrame, list[str]]:
    from mor.api.result import reopen, solve
    from mor.linalg.compilation import chosen_by_size
    from mor.quality.deformation import compare_within
    from mor.report.epochs import movement_table, verdict
    from mor.report.language import words_of

    solved = solve(reopen(_folder(path)))
    first, second = _epoch_numbers(solved, wanted, path)
    with chosen_by_size(solved.network.observations):
        found = compare_within(solved, first, second, level, known)
    if not found.names:
        raise InputError([Message("no point that moves was seen in both epochs", str(path))])
    table = movement_table(found.names, found.result.points, solved.network.edge.matrix, level, known)
    if page is not None:
        _write_page((path, path), (solved, solved), found, table, level, known, page, lang)
    return table, verdict(found, level, known, words_of(lang))


def _epoch_numbers(solved: Solved, wanted: tuple[str, str], path: Path) -> tuple[int, int]:
    from mor.project.entities import decimal_year

    motion, numbers = solved.network.motion, []
    for text in wanted:
        try:
            time = decimal_year(text)
        except ValueError as error:
            raise InputError([Message(f"--between: {error}")]) from None
        if time not in motion.times:
            known = [motion.labels[k] for k in motion.in_order]
            words = f"--between: no epoch {text!r}{nearest(text, known)}; there are {', '.join(known) or 'none'}"
            raise InputError([Message(words, str(path))])
        numbers.append(motion.times.index(time))
    if numbers[0] == numbers[1]:
        raise InputError([Message("--between: found one epoch twice, expected two")])
    return numbers[0], numbers[1]


def _write_page(
    results: tuple[Path, Path],
    solved: Sequence[Solved],
    found: EpochComparison,
    table: pl.DataFrame,
    level: float,
    known: bool,
    page: tuple[Path, bool],
    lang: str,
) -> None:
    from mor.report.epochs import comparison_page, epoch, moved, verdict
    from mor.report.language import words_of

    both = epoch(results[0], solved[0]), epoch(results[1], solved[1])
    words = words_of(lang, "page")
    said = verdict(found, level, known, words)
    write_file(page[0], comparison_page(both, moved(solved[0], found, table), table, said, known, words), page[1])


def _pairs(path: Path, pairs: Path, level: float, known: bool, lang: str) -> tuple[pl.DataFrame, list[str]]:
    from mor.api.result import reopen, solve
    from mor.quality.deformation import pair_movement
    from mor.report.covariance import point_numbers
    from mor.report.epochs import movement_table
    from mor.report.language import words_of

    solved = solve(reopen(_folder(path)))
    assert solved.quality is not None
    names, tests = [], []
    reader = csv.reader(read_text(pairs, TABLE).splitlines(keepends=True))
    rows = [(reader.line_num, row[:2]) for row in reader if row][1:]
    if not rows or any(len(row) < 2 for _, row in rows):
        raise InputError([Message("expected two columns of points below a header", str(pairs))])
    for line, (one, other) in rows:
        try:
            tests.append(pair_movement(solved.quality, *point_numbers(solved, (one, other))))
        except InputError as error:
            raise InputError(p._replace(file=str(pairs), line=line) for p in error.problems) from None
        names.append(f"{one} - {other}")
    table = movement_table(names, tests, solved.network.edge.matrix, level, known)
    moved = int(table["moved"].sum())
    sentence = "{moved} of {count:pair|pairs} moved (level {level})."
    return table, [words_of(lang)(sentence, moved=moved, count=len(names), level=f"{level:g}")]
