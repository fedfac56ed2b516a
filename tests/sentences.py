"""Texts of the program's source that a person may read: what a catalogue of another language has to have."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_PLACE = re.compile(r"\{[^{}]*\}")
_WORD = re.compile(r"(?<![\w.<\[{/%\\-])[A-Za-zσ]?[a-zü]{2,}(?![\w=(\[/])")
_COLUMNS = re.compile(r"\w(?:\{\})?:\.\S+[fg]\b")
"""Names of columns with the form of their numbers, as :func:`mor.report.layout.cells` takes them."""
_FIELDS = re.compile(r"\{\w*(?:![rs])?(?::[^{} ][^{}]*)?\}")
_SAID_ELSEWHERE = (
    *("words", "say", "phase", "header", "listed", "compile", "option", "command", "argument"),
    *("cells", "_cells", "split"),
)
"""Calls whose texts are looked up as they stand (other tests look at them), or are no texts."""
_OF_THE_PROGRAM = ("RuntimeError", "TypeError", "AssertionError", "NotImplementedError", "AttributeError")


@cache
def sentences(path: Path) -> set[str]:
    """Templates of all sentences of a module; the values of f-strings are ``{}`` in them."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    parts = set(_parts(tree))
    found = (template(node) for node in ast.walk(tree) if id(node) not in parts)
    return {text for text in found if text is not None and is_sentence(text)}


def is_sentence(text: str) -> bool:
    """Whether a text has two words, or one beside a place for a value."""
    plain = _PLACE.sub(" ", text.replace("{{", "").replace("}}", ""))
    words = _WORD.findall(plain)
    return (
        not _COLUMNS.search(text)
        and "<" not in plain
        and len(words) + bool(_PLACE.search(text)) >= 2
        and " " in text
        and bool(words)
    )


def template(node: ast.AST) -> str | None:
    """The text of a literal, an f-string or a sum of them, with ``{}`` where a value comes in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value if _is_template(node.value) else _doubled(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_doubled(str(part.value)) if isinstance(part, ast.Constant) else "{}" for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        sides = template(node.left), template(node.right)
        return None if sides == (None, None) else "".join(side if side else "{}" for side in sides)
    return None


def _doubled(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")


def _is_template(text: str) -> bool:
    """Whether a text is one that values are put into later: each of its braces is a place."""
    return bool(_FIELDS.search(text)) and not set("{}") & set(_FIELDS.sub("", text).replace("{{", "").replace("}}", ""))


def _parts(tree: ast.AST) -> Iterator[int]:
    """What is no text of its own: parts of f-strings and sums, docstrings, what is said elsewhere."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            yield from (id(line.value) for line in node.body if isinstance(line, ast.Expr))
        elif isinstance(node, ast.JoinedStr):
            yield from (id(part) for part in node.values if isinstance(part, ast.Constant))
            specs = (part.format_spec for part in node.values if isinstance(part, ast.FormattedValue))
            yield from (id(inner) for spec in specs if spec for inner in ast.walk(spec))
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add) and template(node) is not None:
            yield from (id(side) for side in (node.left, node.right) if template(side) is not None)
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name in (*_SAID_ELSEWHERE, *_OF_THE_PROGRAM):
                yield from (id(inner) for inner in ast.walk(node))
        elif isinstance(node, ast.Subscript | ast.AnnAssign) and _is_literal(node):
            yield from (id(inner) for inner in ast.walk(node))


def _is_literal(node: ast.Subscript | ast.AnnAssign) -> bool:
    """``Literal["a b", …]``: values of types, which reports say in their own words."""
    value = node.value if isinstance(node, ast.Subscript) else node.annotation
    return getattr(value, "id", getattr(value, "attr", "")) == "Literal"
