"""``mor certificate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option
from mor.cli.options import InputPath, coverage_option, output_option
from mor.errors import InputError, Message

if TYPE_CHECKING:
    from mor.output_files import Content

FORMS = ("opencv", "metashape", "colmap", "aicon", "photomodeler")
"""As :data:`mor.formats.calibration.FORMS`, which ``--help`` need not import."""


@click.command(name="certificate")
@click.argument("results", type=InputPath())
@click.argument("camera")
@output_option(
    "File to write: .html, .txt or .pdf, or the calibration of --to.",
    "certificate_CAMERA.html in RESULTS",
    metavar="FILE",
)
@click.option("--to", "form", type=click.Choice(FORMS), help="Write the calibration for another program instead.")
@click.option(
    "--dcc",
    "admin",
    metavar="FILE",
    type=InputPath(),
    help="Write a digital calibration certificate (DCC 3.2.0) as XML, with the administrative data of this YAML file.",
)
@click.option(
    "--paper", type=click.Choice(["A4", "Letter"]), default="A4", show_default=True, help="Paper size of a PDF."
)
@coverage_option
@click.option("-f", "--force", is_flag=True, help="Replace an existing file.")
@language_option("the certificate")
def command(
    results: Path,
    camera: str,
    output: Path | None,
    form: str | None,
    admin: Path | None,
    paper: str,
    coverage: float | None,
    force: bool,
    lang: str,
) -> None:
    """Write the one-page certificate of a CAMERA in RESULTS, or its calibration for another program.

    \b
    Examples:
      mor certificate project.results D7
      mor certificate project.results D7 -o d7.pdf --lang de
      mor certificate project.results D7 --coverage 2
      mor certificate project.results D7 --dcc laboratory.yaml
      mor certificate project.results D7 --to metashape -o d7.xml

    RESULTS is a folder of results. The certificate contains the parameters with sigma, correlations, the distortion
    and the radius up to which it was measured, datum and test. mor refuses to write a calibration that the other
    program's camera model cannot represent.

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.output_files import check_file, write_file

    if form is not None and admin is not None:
        raise InputError([Message("choose one of --to and --dcc")])
    target = output or results / _name(camera, form, ".html" if admin is None else ".xml")
    check_file(target, force)
    if form is not None:
        content: Content = _exported(results, camera, form, target)
    elif admin is not None:
        from mor.input_files import read_text
        from mor.project.document import read_yaml
        from mor.report.certificate import certificate
        from mor.report.digital_certificate import administration, digital_certificate
        from mor.report.language import words_of
        from mor.report.view import view_of_folder

        who = administration(read_yaml(read_text(admin), str(admin)))
        content = digital_certificate(
            certificate(view_of_folder(results), camera, coverage), who, words_of(lang, "page")
        )
    else:
        content = _certified(results, camera, target, paper, coverage, lang)
    write_file(target, content, force)
    click.echo(str(target), err=True)


def _name(camera: str, form: str | None, suffix: str) -> str:
    import re

    from mor.formats.calibration import SUFFIXES

    plain = re.sub(r'[\x00-\x1f/\\:*?"<>|]', "_", camera)
    return f"certificate_{plain}{suffix}" if form is None else f"{plain}_{form}{SUFFIXES[form]}"


def _exported(results: Path, camera: str, form: str, target: Path) -> bytes:
    from mor.api.pipeline import read_document
    from mor.formats.calibration import write_calibration

    adjusted = results / "adjusted.yaml"
    if not adjusted.is_file():
        raise InputError([Message("no adjusted.yaml in this folder; expected the results of mor adjust", str(results))])
    return write_calibration(read_document(adjusted), results, camera, form, target)


def _certified(results: Path, camera: str, target: Path, paper: str, coverage: float | None, lang: str) -> Content:
    from mor.report.certificate import certificate, certificate_on_paper, certificate_page, certificate_text
    from mor.report.language import words_of
    from mor.report.view import view_of_folder

    suffix = target.suffix.lower()
    if suffix not in (".html", ".txt", ".pdf"):
        raise InputError([Message("expected a name that ends in .html, .txt or .pdf", str(target))])
    one = certificate(view_of_folder(results), camera, coverage)
    if suffix == ".html":
        return certificate_page(one, words_of(lang, "page"))
    if suffix == ".txt":
        return certificate_text(one, words_of(lang))
    return certificate_on_paper(one, paper, words_of(lang, "page")).write
