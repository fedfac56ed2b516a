"""``mor orient``."""

from __future__ import annotations

from math import inf, isfinite
from pathlib import Path

import click

from mor.cli.console import language_option
from mor.cli.options import InputPath
from mor.errors import ExitCode

_constant_option = click.option(
    "-c", "--constant", "constants", metavar="NUMBER", type=float, multiple=True, required=True,
    help="Camera constant, in the unit of the image coordinates; once for all images, or once for each.",
)  # fmt: skip
_sigma_option = click.option(
    "--sigma", metavar="NUMBER", type=click.FloatRange(min=0.0, min_open=True), default=0.001, show_default=True,
    help="σ of the image coordinates, in their unit.",
)  # fmt: skip
_unit_option = click.option(
    "--angles", type=click.Choice(["gon", "deg", "rad"]), default="gon", show_default=True,
    help="Unit of the printed angles.",
)  # fmt: skip
_json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


@click.group(name="orient")
def command() -> None:
    """Orient images without start values: two images or a chain (Rinner), a plane object (Killian).

    \b
    Examples:
      mor orient relative pairs.csv -c 28.8
      mor orient planar corners.csv -c 50 --length A B 2.500 --wall

    \b
    Exit codes: 0 done; 2 input; 4 no solution.
    """


@command.command(name="relative", short_help="Two images or a chain, from 8 or more homologous points (Rinner).")
@click.argument("pairs", type=InputPath())
@_constant_option
@_sigma_option
@_unit_option
@click.option(
    "--attitude",
    type=(float, float, float),
    metavar="OMEGA PHI KAPPA",
    help="Attitude of the first image, in the unit of --angles; the model is then in the object system.",
)
@language_option("the text")
@_json_option
def relative_command(
    pairs: Path,
    constants: tuple[float, ...],
    sigma: float,
    angles: str,
    attitude: tuple[float, float, float] | None,
    lang: str,
    as_json: bool,
) -> int:
    """Relative orientation of two images from 8 or more homologous points (Rinner 1956), or of a chain of images.

    \b
    Examples:
      mor orient relative pairs.csv -c 28.8
      mor orient relative pairs.csv -c 28.8 -c 35.1 --sigma 0.003 --angles deg
      mor orient relative strip.csv -c 153.2 --attitude 0.25 -1.1 98.7
      mor orient relative pairs.csv -c 28.8 --json | jq .

    PAIRS has the columns id, x1, y1, x2, y2 (x3, y3 …): image coordinates relative to the principal point, x right, y
    up, in the unit of the camera constant; leave cells of unseen points empty. Each image is oriented relative to
    the previous one, common points transfer the scale, and a joint adjustment follows. Degenerate data are reported.

    \b
    Exit codes: 0 done; 2 input; 4 no solution.
    """
    import numpy as np

    from mor.model.rotations import rotation_from_angles
    from mor.report.language import words_of
    from mor.report.orientation import read_homologous, relative, relative_data, relative_text
    from mor.report.output_folder import to_json
    from mor.units import ANGLE_UNITS

    _check_sigma(sigma)
    if attitude is not None and not all(isfinite(angle) for angle in attitude):
        raise click.UsageError("--attitude takes three angles")
    measured = read_homologous(pairs)
    found = relative(measured, _of_images(constants, measured.coordinates.shape[1]), sigma)
    given = None if attitude is None else rotation_from_angles(np.array(attitude) * ANGLE_UNITS[angles])
    data = relative_data(measured, found, angles, given)
    click.echo(to_json(data) if as_json else relative_text(data, words_of(lang, "orientation")), nl=False)
    return ExitCode.SINGULAR if found.model is None else ExitCode.DONE


@command.command(name="planar", short_help="A plane object, from two or more images of 4 or more points (Killian).")
@click.argument("points", type=InputPath())
@_constant_option
@_sigma_option
@_unit_option
@click.option(
    "--length",
    type=(str, str, float),
    metavar="A B LENGTH",
    help="Two points and the distance between them, which gives the scale.",
)
@click.option(
    "--length-sigma", metavar="NUMBER", type=click.FloatRange(min=0.0), default=0.0, show_default=True,
    help="σ of that distance.",
)  # fmt: skip
@click.option(
    "--off", metavar="ID", multiple=True, help="A point off the plane; by default such points are searched for."
)
@click.option("--wall", is_flag=True, help="The plane is a wall; the default is a level plane.")
@language_option("the text")
@_json_option
def planar_command(
    points: Path,
    constants: tuple[float, ...],
    sigma: float,
    angles: str,
    length: tuple[str, str, float] | None,
    length_sigma: float,
    off: tuple[str, ...],
    wall: bool,
    lang: str,
    as_json: bool,
) -> int:
    """Shape of a plane object from two or more images of 4 or more of its points (Killian).

    \b
    Examples:
      mor orient planar corners.csv -c 50
      mor orient planar corners.csv -c 50 --length A B 2.500 --wall
      mor orient planar corners.csv -c 50 --length A B 2.500 --length-sigma 0.002 --off TOWER

    POINTS has the columns id, x1, y1, x2, y2 (x3, y3 …), as for relative orientation; leave cells of unseen points
    empty. Points off the plane get heights. All admissible solutions are printed.

    \b
    Exit codes: 0 done; 2 input; 4 no solution.
    """
    from mor.report.language import words_of
    from mor.report.orientation import ObjectSystem, planar, planar_data, planar_text, read_homologous
    from mor.report.output_folder import to_json

    if length is not None and (length[0] == length[1] or not 0.0 < length[2] < inf):
        raise click.UsageError("--length takes two different points and a positive length")
    _check_sigma(sigma, length_sigma)
    measured = read_homologous(points)
    of_images = _of_images(constants, measured.coordinates.shape[1])
    shape = planar(measured, of_images, sigma, off)
    data = planar_data(measured, shape, of_images, ObjectSystem(length, length_sigma, wall, angles))
    click.echo(to_json(data) if as_json else planar_text(data, words_of(lang, "orientation")), nl=False)
    return ExitCode.DONE if shape.outcome.usable else ExitCode.SINGULAR


def _check_sigma(*sigmas: float) -> None:
    """click lets nan and inf pass as numbers in range."""
    if not all(isfinite(sigma) for sigma in sigmas):
        raise click.UsageError("a standard deviation must be a number")


def _of_images(constants: tuple[float, ...], images: int):  # type: ignore[no-untyped-def]
    import numpy as np

    if len(constants) not in (1, images):
        raise click.UsageError(f"give --constant once, or once for each of the {images} images")
    if not all(0.0 < constant < inf for constant in constants):
        raise click.UsageError("the camera constant must be positive")
    return np.array(constants * images if len(constants) == 1 else constants, dtype=float)
