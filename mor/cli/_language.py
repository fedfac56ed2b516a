"""The option ``--lang``: one language for what people read, told once by ``MOR_LANG`` or each time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

LANGUAGES = ("en", "de")
"""As :data:`mor.report.words.language.LANGUAGES`, which ``--help`` need not import."""
VARIABLE = "MOR_LANG"


def language_option(what: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``--lang`` of a command, with what it is the language of."""
    return click.option(
        "--lang",
        type=click.Choice(LANGUAGES),
        default="en",
        envvar=VARIABLE,
        show_default=f"{VARIABLE}, or en",
        help=f"Language of {what}.",
    )
