"""Texts that numbers, names and cells are replaced with: what people mistype, and what breaks programs."""

from __future__ import annotations

import re

import numpy as np

HOSTILE = (
    *(
        "",
        " ",
        "0",
        "-0",
        "1",
        "-1",
        "2",
        "100",
        "200",
        "400",
        "1e3",
        "0.5",
        "1e-16",
        "1e-160",
        "1e-300",
        "1e-320",
    ),
    *(
        "1e16",
        "1e160",
        "-1e160",
        "1e300",
        "1e308",
        "1e999",
        "-1e999",
        "nan",
        "NaN",
        "inf",
        "-inf",
        ".inf",
        "0x10",
    ),
    *(
        "1_000",
        "1,5",
        "1 000",
        "1.2.3",
        "--1",
        "+-1",
        "e5",
        "1e",
        "12-34-56",
        "12-60-00",
        "-0-0-1",
        "35:33:00",
    ),
    *(
        "true",
        "no",
        "null",
        "~",
        "None",
        "[]",
        "{}",
        "*a",
        "&a 1",
        "!!int 3",
        "= 1+1",
        "=1+1",
        "@x",
        "+1",
        "#x",
    ),
    *(
        "1 m",
        "1 mm",
        "1 gon",
        "1 px",
        "3 ppm",
        "1 %",
        "1 furlong",
        "-1 mm",
        "0 mm",
        "9" * 400,
        "0." + "3" * 400,
    ),
    *(
        "x" * 3000,
        "a b",
        "a,b",
        'a"b',
        "a'b",
        "a;b",
        "a\tb",
        "a\nb",
        "a\x00b",
        "a\x1bb",
        "a\x7fb",
        "a\x85b",
        "a\u2028b",
    ),
    *(
        "\u0664\u0665",
        "\u2212" + "1",
        "ä",
        "点",
        "\U0001f600",
        "e\u0301",
        "\u202eabc",
        "\ufeff1",
        "../../x",
        "/dev/null",
        ".",
    ),
)
"""Numbers at the edge, units, YAML and spreadsheet syntax, separators, control characters, scripts."""
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def chosen(rng: np.random.Generator, options: object) -> object:
    """One of the options."""
    listed = list(options)  # type: ignore[call-overload]
    return listed[int(rng.integers(len(listed)))]


def hostile(rng: np.random.Generator) -> str:
    """A text that does not belong there."""
    return str(chosen(rng, HOSTILE))


def changed_number(rng: np.random.Generator, text: str) -> str:
    """Another number in the place of a number: of another sign, size or unit, near it, or its digits mixed up."""
    try:
        value = float(text)
    except ValueError:
        return hostile(rng)
    factor = float(chosen(rng, (-1, 0, 10, 0.1, 1000, 1e-3, 0.9, 10 / 9, 200 / np.pi, np.pi / 200, 1e8, 1e-8)))  # type: ignore[arg-type]
    shaken = value * (1.0 + 10.0 ** rng.uniform(-9, 0) * rng.standard_normal())
    mixed = "".join(rng.permutation(list(text)))
    rounded = f"{value:.{int(rng.integers(1, 6))}g}"
    return str(chosen(rng, (repr(value * factor), repr(value * factor), repr(shaken), mixed, rounded)))


def changed_text(rng: np.random.Generator, text: str) -> str:
    """Another text in the place of one."""
    if rng.random() < 0.5 and NUMBER.match(text):
        return changed_number(rng, text)
    if rng.random() < 0.3 and text:
        at = int(rng.integers(len(text)))
        return str(
            chosen(rng, (text[:at] + text[at + 1 :], text[:at] + text[at] + text[at:], text.swapcase(), text * 2))
        )
    return hostile(rng)
