"""Read the settings of a DBAT script: estimated parameters and start values of the camera."""

from __future__ import annotations

from collections.abc import Iterator

from mor.formats.draft import Draft
from mor.formats.xml import Element

INTERIOR = ("c", "xh", "yh", "b1", "b2", "K1", "K2", "K3", "P1", "P2")
EXTERIOR = ("x", "y", "z", "omega", "phi", "kappa")
_NAMES = {
    "cc": ("c",),
    "pp": ("xh", "yh"),
    "px": ("xh",),
    "py": ("yh",),
    "aspect": ("b1",),
    "skew": ("b2",),
    "K": ("K1", "K2", "K3"),
    "P": ("P1", "P2"),
    "all": INTERIOR,
    **{name: (name,) for name in ("K1", "K2", "K3", "P1", "P2")},
}
_OUTSIDE = {
    "all": EXTERIOR,
    "pos": EXTERIOR[:3],
    "angles": EXTERIOR[3:],
    **{axis: (axis,) for axis in "xyz"},
}
_WORDS = ("true", "false", "default")


def operations(root: Element, *names: str) -> Iterator[Element]:
    """Elements of some names anywhere in the operations, in their order."""
    for part in root.all("operations"):
        yield from _inside(part, names)


def _inside(element: Element, names: tuple[str, ...]) -> Iterator[Element]:
    for child in element.children:
        if child.name in names:
            yield child
        elif child.name != "c":
            yield from _inside(child, names)


def free_interior(root: Element, draft: Draft) -> set[str]:
    """Components of the interior orientation that the script estimates; none where it says nothing."""
    free: set[str] = set()
    said = False
    for section, given in _settings(root, "io", _NAMES, draft):
        said = True
        chosen = set(_NAMES[section])
        free = free | chosen if given == "true" else free - chosen
    if not said:
        draft.note("the script sets no estimated parameters of the camera: its interior orientation is fixed")
    return free


def held_exterior(root: Element, draft: Draft) -> set[str]:
    """Components of the poses that the script does not estimate."""
    held: set[str] = set()
    for section, given in _settings(root, "eo", _OUTSIDE, draft):
        chosen = set(_OUTSIDE[section])
        held = held | chosen if given == "false" else held - chosen
    return held


def _settings(
    root: Element, part: str, known: dict[str, tuple[str, ...]], draft: Draft
) -> Iterator[tuple[str, str]]:
    """Section and word of each setting, in their order; ``<io>true</io>`` says all."""
    for block in operations(root, "set_bundle_estimate_params"):
        for group in block.all(part):
            given = [child for child in group.children if child.name != "c"] or [
                Element("all", {}, group.line, text=group.text)
            ]
            for one in given:
                word = one.text.strip()
                if one.name not in known:
                    draft.problem(f"found <{one.name}> in <{part}>, expected {', '.join(known)}", one.line)
                elif word not in _WORDS:
                    draft.problem(
                        f"found {word!r} in <{one.name}>, expected true, false or default", one.line
                    )
                else:
                    yield one.name, word


def initial_values(root: Element) -> dict[str, Element]:
    """Initial values of the interior orientation that the script sets, by DBAT's names; the last of each."""
    found: dict[str, Element] = {}
    for block in operations(root, "set_initial_values", "set_camera_values"):
        groups = block.all("io") if block.name == "set_initial_values" else [block]
        for group in groups:
            children = [child for child in group.children if child.name != "c"]
            if not children:
                found = {"all": Element("all", {}, group.line, text=group.text)}
            for one in children:
                if one.name == "all":
                    found = {}
                found["all" if one.name == "others" else one.name] = one
    return found
