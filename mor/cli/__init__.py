"""The command line: one file for each command, loaded when it is called."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

import click

from mor import __version__
from mor.cli.console import Context, in_all_languages, language_of, show, tell, told, told_problem
from mor.errors import MOST_TOLD, ExitCode, InputError, MorError, nearest, shortened
from mor.input_files import inputs_of_run

COMMANDS = {
    "adjust": "Adjust a project and write reports, results and tables.",
    "diagnose": "Search for mistakes in a rejected project by trying hypotheses.",
    "check": "Read and check a project without adjusting it.",
    "new": "Create a commented project file from tables.",
    "convert": "Convert files of other programs to projects, and back.",
    "approximate": "Compute start values and write a project with them.",
    "orient": "Orient images without start values: two images (Rinner), a plane object (Killian).",
    "design": "Predict precision and reliability of a planned project; rank observations.",
    "simulate": "Simulate the observations of a project once, or many times (Monte Carlo).",
    "batch": "Adjust many projects and write one table of verdicts.",
    "report": "Print the report as PDF, or write report.html in another language.",
    "certificate": "Write the certificate of a camera, or its calibration for another program.",
    "plot": "Plot results: network, ellipses, residuals, camera, histogram or overlap.",
    "datum": "Transform results to another datum without a new adjustment.",
    "covariance": "Write covariances of points, or of all unknowns, with labels.",
    "compare": "Compare two results: number by number, as epochs, or by pairs of points.",
    "explain": "Explain a term, a column or an exit code, and what to do about it.",
    "examples": "List the sample projects, or copy one of them.",
    "compile": "Compile the kernels for large projects before they are first used.",
    "verify": "Check that this installation computes correctly, and write a report.",
    "schema": "Print the JSON Schema of project files, or of results.json.",
}


WIDTH = 100
"""Columns of help texts, where the terminal has them."""


class _Lazy(click.Group):
    """Commands are imported when they are called: ``mor --help`` imports nothing heavy."""

    context_class = Context

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        from mor.machine import check_address_space

        check_address_space()
        command: click.Command = importlib.import_module(f"mor.cli.{name}").command
        return in_all_languages(command)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            raise click.UsageError(f"there is no command {args[0]!r}{nearest(args[0], COMMANDS)}", ctx)
        return super().resolve_command(ctx, args)


INTERRUPTED, ENDED, LEFT = 130, 143, 129
"""Exit codes after Ctrl-C, SIGTERM and SIGHUP, as shells have them: 128 and the number of the signal."""


@click.group(cls=_Lazy, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": WIDTH})
@click.version_option(__version__, "-V", "--version", prog_name="mor", message="%(prog)s %(version)s")
def group() -> None:
    """One least-squares adjustment for everything measured around an object.

    \b
    Examples:
      mor examples facade && mor adjust facade/project.yaml
      mor new project.yaml image_points.csv control.csv -c 28 --size 6000 4000
      mor check project.yaml
      mor adjust project.yaml
      mor explain w

    \b
    Exit codes: 0 done; 1 rejected or different; 2 input; 3 not converged; 4 singular; 5 memory;
    70 internal (MOR_DEBUG=1 shows where); 130 interrupted, 143 terminated.
    Data go to standard output, messages to standard error.
    """


def run(arguments: Sequence[str] | None = None, signals: Sequence[int] = ()) -> int:
    """Run the command line; returns the exit code instead of leaving the process.

    ``signals`` are those that have interrupted it so far: libraries put an error of their own around an interruption.
    """
    given = list(arguments) if arguments is not None else sys.argv[1:]
    language = language_of(given)
    try:
        with inputs_of_run():
            result = group.main(args=given, prog_name="mor", standalone_mode=False, obj=language)
    except click.exceptions.Exit as leaving:
        return leaving.exit_code
    except click.ClickException as error:
        show(error, language)
        return ExitCode.INPUT
    except (KeyboardInterrupt, click.Abort) as error:
        # Exit code after the signal that interrupted; click puts an interruption behind an error of its own.
        interruption = error.__cause__ if isinstance(error, click.Abort) else error
        number = next((one for one in getattr(interruption, "args", ()) if isinstance(one, int)), None)
        return _interrupted(INTERRUPTED if number is None else 128 + int(number), language)
    except MorError as error:
        _tell(error, language)
        return error.exit_code
    except (SystemExit, BrokenPipeError):  # click leaves so where a pipe is closed, and only there
        return ExitCode.DONE
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        words = error.strerror or str(error).partition(" (os")[0]  # "(os error 28)" is what polars adds
        click.echo(f"{place}{told(words, language)}", err=True)
        return ExitCode.INPUT
    except MemoryError as error:
        what = f" ({error})" if str(error) else ""
        out_of_memory = (
            "Use --no-html and --tables worst, adjust fewer observations at a time, or use a machine with more memory."
        )
        tell(f"not enough memory{what}; nothing was written. {out_of_memory}", language)
        return ExitCode.MEMORY
    except Exception as error:  # noqa: BLE001 - the last resort: one line, and how to see more
        return _interrupted(128 + signals[-1], language) if signals else _internal(error, language)
    return int(result) if isinstance(result, int) else ExitCode.DONE


def _tell(error: MorError, language: str) -> None:
    """Print the mistakes, at most one screen of them, and say how to see the rest."""

    lines = [shortened(line) for line in _said(error, language).splitlines()]
    more = len(lines) - MOST_TOLD
    if more > 0:
        words = f"… and {more} more mistakes; {getattr(error, 'told_by', 'mor check --all')} lists all of them"
        lines = [*lines[: MOST_TOLD - 1], told(words, language), lines[-1]]
    for line in lines:
        click.echo(line, err=True)


def _said(error: MorError, language: str) -> str:

    if isinstance(error, InputError):
        return "\n".join(told_problem(one, language) for one in error.problems)
    return told(str(error), language)


def _interrupted(code: int, language: str) -> int:
    tell("interrupted; no file was left incomplete", language)
    return code


def _internal(error: Exception, language: str) -> int:
    import os
    import traceback

    if os.environ.get("MOR_DEBUG"):
        traceback.print_exception(error)
    name = type(error).__name__
    tell(f"internal error: {name}: {error} (MOR_DEBUG=1 shows where; please report it)", language)
    return ExitCode.INTERNAL
