"""``mor plot``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option
from mor.cli.options import InputPath, output_option
from mor.errors import InputError, Message

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mor.report.language import Words
    from mor.report.view import View

KINDS = ("network", "ellipses", "residuals", "camera", "histogram", "overlap")


@click.command(name="plot")
@click.argument("kind", metavar="KIND", type=click.Choice(KINDS))
@click.argument("source", type=InputPath())
@output_option("File to write: .svg, .png or .pdf.", metavar="FILE", required=True)
@click.option(
    "--of",
    "name",
    metavar="NAME",
    show_default="all images; the first camera",
    help="Image (for residuals) or camera (for camera) to plot.",
)
@click.option(
    "--confidence",
    type=click.Choice(["1", "95"]),
    default="1",
    show_default=True,
    help="Ellipses: 1 for one sigma, 95 for 95 % confidence.",
)
@click.option("-f", "--force", is_flag=True, help="Replace an existing file.")
@language_option("the picture")
def command(kind: str, source: Path, output: Path, name: str | None, confidence: str, force: bool, lang: str) -> None:
    """Plot SOURCE: network, ellipses, residuals, camera, histogram or overlap.

    \b
    Examples:
      mor plot network project.results -o network.svg
      mor plot ellipses project.yaml -o ellipses.pdf
      mor plot residuals project.results --of IMG_4711 -o residuals.png
      mor plot camera project.results -o camera.svg
      mor plot histogram project.results -o w.svg
      mor plot overlap project.results -o overlap.png

    SOURCE is a folder of results, or a project, which is adjusted first. The same results give the same bytes, so
    pictures can be compared. Needs matplotlib: pip install 'mor-adjustment[plot]'.

    \b
    Exit codes: 0 done; 2 input, or no solution.
    """
    from mor.output_files import check_file
    from mor.report.language import words_of
    from mor.report.plots import check_picture, save, style

    check_picture(output)
    check_file(output, force)
    with style():
        save(drawn(kind, view_of_source(source), name, words_of(lang, "page"), confidence), output, force)


def view_of_source(source: Path) -> View:
    """The view of results on disk, or of a project adjusted here. Raises :class:`mor.errors.InputError`."""
    from mor.api.result import adjust
    from mor.report.observations import observation_table
    from mor.report.view import view_of, view_of_folder

    if source.is_dir() and (source / "results.json").exists():
        return view_of_folder(source)
    solved = adjust(source).solved
    if solved.quality is None:
        reason = solved.adjustment.reason or solved.adjustment.outcome.value
        raise InputError([Message(f"the adjustment has no solution ({reason}): there is nothing to plot", str(source))])
    return view_of(solved, observation_table(solved))


def drawn(kind: str, view: View, name: str | None, words: Words, confidence: str = "1") -> Figure:
    """The picture of a kind, in a language."""
    from mor.report.plots import camera, ellipses, histogram, network, overlap_and_rays, residuals

    if name is not None and kind not in ("residuals", "camera"):
        raise click.UsageError(f"--of names an image or a camera; a plot of kind {kind!r} shows everything")
    if kind == "residuals":
        return residuals(view, name, words)
    if kind == "camera":
        return camera(view, name, words)
    if kind == "ellipses":
        return ellipses(view, words, confidence)
    simple = {"network": network, "histogram": histogram, "overlap": overlap_and_rays}
    return simple[kind](view, words)
