"""Plain data of a project as YAML text: numbers as numbers, identifiers as texts, short lists in one line."""

from __future__ import annotations

import re
from typing import Any

import yaml

from mor.escapes import escaped

IDENTIFIERS = frozenset(
    (
        *(
            "id",
            "camera",
            "position",
            "point",
            "leader",
            "pair",
            "set",
            "of",
            "from",
            "to",
            "at",
            "station",
            "image",
        ),
        *("system", "frame", "component", "shared_height", "shared_eccentricity"),
    )
)
"""Columns of names, which stay texts whatever they look like."""
_TEXTS = IDENTIFIERS | {
    "title",
    "name",
    "group",
    "file",
    "columns",
    "instrument",
    "cluster",
    "points",
    "other",
}
_NUMBER = re.compile(r"[-+]?(0|[1-9]\d*)(\.\d+)?([eE][-+]?\d+)?")


def yaml_text(data: dict[str, Any], width: int) -> str:
    """YAML of a project. Texts that are numbers are written without quotes, with all their digits."""
    tables: list[list[str]] = []
    plain = _plain(data, "", tables, width)
    text: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width)
    return _STANDS.sub(lambda found: _rows_text(tables[int(found[3])], found), text) if tables else text


_ROWS = "\ue000"
"""Stands for the rows of a table until they are put in its place: a letter that means nothing."""
_STANDS = re.compile(rf"^( *)(- )?rows: {_ROWS} (\d+)$", re.MULTILINE)
_FEW = 20
"""Rows up to which a table is written as everything else."""
_SIMPLE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_WHOLE = re.compile(r"0|[1-9][0-9]*")
_WORDS = frozenset(("y", "n", "yes", "no", "on", "off", "true", "false", "null"))
"""Texts, in small letters, that YAML takes for something else."""


def _simple_rows(rows: list[list[Any]], width: int) -> list[str] | None:
    """Long tables of numbers and plain names as lines, the same that YAML's writer makes; ``None`` for all others."""
    if len(rows) <= _FEW:
        return None
    lines = []
    for row in rows:
        cells = [_simple(cell) for cell in row]
        if not cells or None in cells:
            return None
        lines.append(f"- [{', '.join(cells)}]")  # type: ignore[arg-type]
    return lines if max(map(len, lines)) < width - 40 else None


def _simple(cell: Any) -> str | None:
    """A cell as YAML has it, where that needs no thought."""
    if cell is None:
        return "null"
    if isinstance(cell, _Plain):
        return str(cell)
    if not isinstance(cell, str):
        return None
    if _WHOLE.fullmatch(cell):
        return f"'{cell}'"
    return cell if _SIMPLE.fullmatch(cell) and cell.lower() not in _WORDS else None


def _rows_text(lines: list[str], found: re.Match[str]) -> str:
    """The key ``rows`` with its lines, indented as it is."""
    blanks = found[1] + "  " * (found[2] is not None)
    return f"{found[1]}{found[2] or ''}rows:\n" + "\n".join(f"{blanks}{line}" for line in lines)


class _Plain(str):
    """A number or truth value, as its text."""

    __slots__ = ()


def _plain(value: Any, key: str, tables: list[list[str]], width: int) -> Any:
    """Data in which the texts that are numbers know it; ``key`` is the one they stand at.

    The rows of long simple tables are added to ``tables``: the writer of YAML takes a millisecond for ten of them.
    """
    if key == "datum":
        return value
    if isinstance(value, dict):
        if isinstance(value.get("rows"), list) and isinstance(value.get("columns"), list):
            columns = [name or "" for name in value["columns"]]
            rows = [
                [_cell(cell, name) for cell, name in zip(row, columns, strict=False)] for row in value["rows"]
            ]
            lines = _simple_rows(rows, width)
            if lines is not None:
                tables.append(lines)
            value = {**value, "rows": rows if lines is None else f"{_ROWS} {len(tables) - 1}"}
            return {k: v if k == "rows" else _plain(v, k, tables, width) for k, v in value.items()}
        return {k: _plain(v, k, tables, width) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(item, key, tables, width) for item in value]
    return _cell(value, key)


def _cell(value: Any, key: str) -> Any:
    """A scalar: as a number where its text is one and names nothing."""
    if not isinstance(value, str) or key in _TEXTS:
        return value
    if key == "snooping" and value.lower() in ("true", "false"):
        return _Plain(value.lower())
    if not _NUMBER.fullmatch(value):
        return value
    mantissa, exponent, power = value.lower().partition("e")
    if exponent:  # YAML wants a point in the mantissa and the sign of the exponent
        mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
        power = power if power[0] in "+-" else f"+{power}"
    return _Plain(mantissa + exponent + power)


class _Dumper(yaml.SafeDumper):
    """Short lists and mappings without lists stand in one line, as a person writes them."""

    def represent_sequence(
        self, tag: str, sequence: Any, flow_style: bool | None = None
    ) -> yaml.SequenceNode:
        simple = all(not isinstance(item, list | dict) for item in sequence)
        return super().represent_sequence(tag, sequence, flow_style=simple)

    def represent_text(self, value: str) -> yaml.ScalarNode:
        """A text; with what breaks lines or is not seen spelled out, for single quotes fold it."""
        style = '"' if escaped(value) != value else None
        return self.represent_scalar("tag:yaml.org,2002:str", value, style)

    def represent_plain(self, value: _Plain) -> yaml.ScalarNode:
        """A scalar without quotes and without a tag."""
        tag: str = self.resolve(yaml.ScalarNode, str(value), (True, False))  # type: ignore[no-untyped-call]
        return self.represent_scalar(tag, str(value))


_Dumper.add_representer(str, _Dumper.represent_text)
_Dumper.add_representer(_Plain, _Dumper.represent_plain)
