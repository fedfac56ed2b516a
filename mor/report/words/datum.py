"""The name of a datum in the language of a report."""

from __future__ import annotations

import re

from mor.report.words.language import Words

_CARRIED = re.compile(r"(.+?) of (\d+) (?:named point or group|named points or groups)(?: and |$)")
_HELD = re.compile(r"(?:^|, )([xyz]{1,3}) of ")


def datum_name(name: str, words: Words) -> str:
    """A datum as a network calls it (``fixed``, ``free, inner constraints over …``, ``minimal, …``), in other words."""
    kind, _, rest = name.partition(", ")
    carried = rest.removeprefix("inner constraints over ")
    if kind == "free" and (found := _CARRIED.findall(carried)):
        said = [
            words(
                "{components} of {count:named point or group|named points or groups}",
                components=components,
                count=count,
            )
            for components, count in found
        ]
        return words("free, inner constraints over {parts}", parts=f" {words('and')} ".join(said))
    if kind == "minimal":
        pieces = _HELD.split(rest)[1:]
        said = [
            words("{components} of {names}", components=components, names=names)
            for components, names in zip(pieces[::2], pieces[1::2], strict=True)
        ]
        return words("minimal, {parts}", parts=", ".join(said))
    return words.listed(name)
