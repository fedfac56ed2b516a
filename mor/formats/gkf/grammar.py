"""Elements and attributes of GNU Gama XML input, and the errors for others."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

from mor.errors import nearest
from mor.formats.draft import Draft, number
from mor.formats.xml import Element
from mor.units import parse_dms

Check = Callable[[str], object]
_DMS = re.compile(r"^\s*[-+]?\d+-\d+-\d+(\.\d*)?\s*$")
_SIXTY = re.compile(r"^\s*(?P<sign>[-+]?)(?P<d>\d+)-(?P<m>\d+)-(?P<s>\d+(?:\.\d*)?)\s*$")
_COMPONENTS = ("xy", "XY", "z", "Z", "xyz", "XYZ", "XYz", "xyZ")


def is_dms(text: str) -> bool:
    """True for angles written d-m-s; all others are gon."""
    return _DMS.match(text) is not None


def carried(text: str) -> str:
    """An angle; d-m-s whose minutes or seconds were rounded up to 60 as degrees."""
    match = _SIXTY.match(text)
    if match is None:
        return text
    minutes, seconds = float(match["m"]), float(match["s"])
    if minutes > 60.0 or seconds > 60.0 or (minutes < 60.0 and seconds < 60.0):
        return text
    value = float(match["d"]) + minutes / 60.0 + seconds / 3600.0
    degrees = int(value)
    rest = round((value - degrees) * 60.0, 9)
    sign = "-" if match["sign"] == "-" else ""
    return f"{sign}{degrees + int(rest // 60)}-{int(rest % 60)}-0"


def _angle(text: str) -> None:
    if is_dms(text):
        parse_dms(carried(text))
        return
    try:
        number(text)
    except ValueError:
        raise ValueError(f"found {text!r}, expected an angle in gon or d-m-s") from None


def _positive(text: str) -> None:
    if not number(text) > 0.0:
        raise ValueError(f"found {text!r}, expected a number > 0")


def _count(text: str) -> None:
    if not text.strip().isdigit():
        raise ValueError(f"found {text!r}, expected a whole number ≥ 0")


def _distance_sigma(text: str) -> None:
    parts = [number(part) for part in text.split()]
    if not 1 <= len(parts) <= 3 or not parts[0] > 0.0:
        raise ValueError(f"found {text!r}, expected a [b [c]] with a > 0, for σ = a + b·D^c")


def _identifier(text: str) -> None:
    if not text.strip():
        raise ValueError("the identifier is empty")


def _anything(text: str) -> None:
    return None


def _one_of(*choices: str) -> Check:
    def check(text: str) -> None:
        if text.strip() not in choices:
            raise ValueError(f"found {text!r}, expected {', '.join(choices)}{nearest(text, choices)}")

    return check


class Rule(NamedTuple):
    """Child elements and attributes, required and optional, of an element."""

    children: tuple[str, ...] = ()
    required: Mapping[str, Check] | None = None
    optional: Mapping[str, Check] | None = None

    @property
    def attributes(self) -> dict[str, Check]:
        """All attributes."""
        return {**(self.required or {}), **(self.optional or {})}


_SIGHT = {"from": _identifier, "stdev": _positive, "from_dh": number, "to_dh": number, "extern": _anything}
_LENGTH = Rule((), {"to": _identifier, "val": _positive}, _SIGHT)
_ANGULAR = Rule((), {"to": _identifier, "val": _angle}, _SIGHT)
_MEASURED = ("direction", "distance", "angle", "s-distance", "z-angle", "azimuth", "dh")
RULES = {
    "gama-local": Rule(("network",), {}, {"xmlns": _anything, "version": _anything}),
    "network": Rule(
        ("description", "parameters", "points-observations"),
        {},
        {
            "axes-xy": _one_of("ne", "sw", "es", "wn", "en", "nw", "se", "ws"),
            "angles": _one_of("left-handed", "right-handed"),
            "epoch": number,
        },
    ),
    "description": Rule(),
    "parameters": Rule(
        (),
        {},
        {
            "sigma-apr": _positive,
            "conf-pr": _positive,
            "tol-abs": _positive,
            "sigma-act": _one_of("aposteriori", "apriori"),
            **dict.fromkeys(
                ("update-constrained-coordinates", "algorithm", "language", "encoding", "angles", "latitude"),
                _anything,
            ),
            **dict.fromkeys(("ellipsoid", "cov-band", "iterations"), _anything),
        },
    ),
    "points-observations": Rule(
        ("point", "obs", "coordinates", "height-differences", "vectors"),
        {},
        {
            "distance-stdev": _distance_sigma,
            **dict.fromkeys(
                ("direction-stdev", "angle-stdev", "zenith-angle-stdev", "azimuth-stdev"), _positive
            ),
        },
    ),
    "point": Rule(
        (),
        {"id": _identifier},
        {
            **dict.fromkeys("xyz", number),
            "fix": _one_of(*_COMPONENTS),
            "adj": _one_of(*_COMPONENTS),
            "extern": _anything,
        },
    ),
    "obs": Rule(
        (*_MEASURED, "cov-mat"),
        {},
        {"from": _identifier, "orientation": _angle, "from_dh": number, "extern": _anything},
    ),
    "direction": _ANGULAR,
    "azimuth": _ANGULAR,
    "z-angle": _ANGULAR,
    "distance": _LENGTH,
    "s-distance": _LENGTH,
    "angle": Rule(
        (),
        {"bs": _identifier, "fs": _identifier, "val": _angle},
        {
            "from": _identifier,
            "stdev": _positive,
            **dict.fromkeys(("from_dh", "bs_dh", "fs_dh"), number),
            "extern": _anything,
        },
    ),
    "height-differences": Rule(("dh", "cov-mat"), {}, {"extern": _anything}),
    "dh": Rule(
        (),
        {"from": _identifier, "to": _identifier, "val": number},
        {"stdev": _positive, "dist": _positive, "extern": _anything},
    ),
    "coordinates": Rule(("point", "cov-mat"), {}, {"extern": _anything}),
    "vectors": Rule(("vec", "cov-mat"), {}, {"extern": _anything}),
    "vec": Rule(
        (),
        {"from": _identifier, "to": _identifier, **dict.fromkeys(("dx", "dy", "dz"), number)},
        {"from_dh": number, "to_dh": number, "extern": _anything},
    ),
    "cov-mat": Rule((), {"dim": _count, "band": _count}),
}


def check(element: Element, draft: Draft) -> None:
    """Report unknown elements and attributes, missing attributes and bad values, all the way down."""
    rule = RULES[element.name]
    known = rule.attributes
    for name, text in element.attributes.items():
        if name not in known:
            words = f"<{element.name}>: unknown attribute {name!r}{nearest(name, known)}"
            draft.problem(f"{words} (known here: {', '.join(known) or 'none'})", element.line)
            continue
        try:
            known[name](text)
        except ValueError as error:
            draft.problem(f"<{element.name}> {name}: {error}", element.line)
    for name in rule.required or {}:
        if name not in element.attributes:
            draft.problem(f"<{element.name}>: attribute {name!r} is missing", element.line)
    for child in element.children:
        if child.name not in rule.children:
            words = f"unknown element <{child.name}> in <{element.name}>{nearest(child.name, rule.children)}"
            draft.problem(f"{words} (known here: {', '.join(rule.children) or 'none'})", child.line)
        else:
            check(child, draft)
