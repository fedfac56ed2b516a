"""Plain data of a project as YAML text: numbers as numbers, identifiers as texts, short lists in one line."""

from __future__ import annotations

import re
from typing import Any

import yaml

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
    plain = _plain(data, "")
    text: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width)
    return text


class _Plain(str):
    """A number or truth value, as its text."""

    __slots__ = ()


def _plain(value: Any, key: str) -> Any:
    """Data in which the texts that are numbers know it; ``key`` is the one they stand at."""
    if key == "datum":
        return value
    if isinstance(value, dict):
        if isinstance(value.get("rows"), list) and isinstance(value.get("columns"), list):
            columns = [name or "" for name in value["columns"]]
            rows = [
                [_cell(cell, name) for cell, name in zip(row, columns, strict=False)] for row in value["rows"]
            ]
            value = {**value, "rows": rows}
            return {k: v if k == "rows" else _plain(v, k) for k, v in value.items()}
        return {k: _plain(v, k) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(item, key) for item in value]
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

    def represent_plain(self, value: _Plain) -> yaml.ScalarNode:
        """A scalar without quotes and without a tag."""
        tag: str = self.resolve(yaml.ScalarNode, str(value), (True, False))  # type: ignore[no-untyped-call]
        return self.represent_scalar(tag, str(value))


_Dumper.add_representer(_Plain, _Dumper.represent_plain)
