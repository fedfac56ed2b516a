"""``mor new``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="new")
@click.argument("project", type=click.Path(path_type=Path))
@click.argument("tables", nargs=-1, type=click.Path(path_type=Path))
@click.option("-t", "--title", default="", help="Title of the project [the name of its file].")
@click.option("--length", default="m", show_default=True, help="Unit of lengths.")
@click.option("--angle", default="gon", show_default=True, help="Unit of angles.")
@click.option("--camera", default="camera", show_default=True, help="Name of the camera.")
@click.option("-c", "--constant", type=float, help="Camera constant, mm.")
@click.option("--size", type=(int, int), help="Image width and height, px.")
@click.option("--pixel", default="0.004 mm", show_default=True, help="Pixel size.")
@click.option("--datum", type=click.Choice(["fixed", "free"]), default="fixed", show_default=True)
@click.option("-f", "--force", is_flag=True, help="Replace files that are there already.")
def command(
    project: Path,
    tables: tuple[Path, ...],
    title: str,
    length: str,
    angle: str,
    camera: str,
    constant: float | None,
    size: tuple[int, int] | None,
    pixel: str,
    datum: str,
    force: bool,
) -> None:
    """Begin PROJECT, a commented project file, from the TABLES there are.

    What a table is is told by the names of its columns: image points (image, point, x, y), distances (from, to,
    distance), directions (station, to, horizontal, zenith), points (id, x, y, z), images (id, x, y, z, omega, phi,
    kappa) and more. Points and images that only observations name are listed; no start values are needed.

    \b
    Examples:
      mor new project.yaml
      mor new project.yaml image_points.csv control.csv -c 28 --size 6000 4000 --pixel "0.006 mm"
      mor new net.yaml directions.csv distances.csv points.csv --angle gon
      mor new field.yaml image_points.csv scale_bars.csv --length mm -c 35 --datum free
    """
    from mor.cli.convert import write_new
    from mor.errors import InputError, Problem, nearest
    from mor.project.beginning import CameraSettings, begin
    from mor.project.recognise import recognise
    from mor.units import ANGLE_UNITS, LENGTH_UNITS

    for unit, known in ((length, LENGTH_UNITS), (angle, ANGLE_UNITS)):
        if unit not in known:
            raise InputError(
                [Problem(f"unknown unit {unit!r}{nearest(unit, known)} (known: {', '.join(known)})")]
            )
    found = [recognise(table) for table in tables]
    settings = CameraSettings(camera, constant, size, pixel)
    texts = begin(project, found, title or project.stem, (length, angle), settings, datum)
    write_new(texts, force)
    for table in found:
        click.echo(f"{table.path}: {table.kind}, {len(table.rows)} rows", err=True)
    click.echo(f"{project} is there: look at the lines marked CHECK, then mor check {project}", err=True)
