"""Cameras of DBAT as cameras of models ``brown``: one square pixel, its height; aspect and skew as b1, b2.

DBAT's files count y of the principal point upwards from the upper left corner (it is negative), and carry K and P with
the signs of its functions, the opposite of those it reports (and of PhotoModeler's, which ``brown`` has).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from mor.formats.draft import Draft, number
from mor.formats.xml import Element

_MODELS = {
    "1": "brown",
    "2": "brown",
    "3": "brown",
    "4": "brown-4",
    "5": "brown-5",
    "-1": "brown-forward",
}
"""mor's models by DBAT's numbers; 1 and 2 are 3 without an affinity."""
_AFFINE = ("3", "4", "5")
_UNITS = ("mm", "um", "m")
_KNOWN = (
    *("id", "name", "unit", "sensor", "image", "aspect", "nK", "nP", "focal", "model"),
    *("cc", "pp", "K", "P", "skew", "all", "calibrated", "c"),
)


class Place(NamedTuple):
    """A line of a file."""

    line: int
    file: str


class CameraError(ValueError):
    """A mistake in a camera, with its location."""

    def __init__(self, words: str, place: Place) -> None:
        super().__init__(words)
        self.place = place


@dataclass
class Texts:
    """Texts of a camera element, with what the script sets in their place."""

    camera: Element
    own: dict[str, Element]
    initial: dict[str, Element]
    file: str
    """Of the camera."""
    script: str

    def at(self, element: Element) -> Place:
        """Return the location of an element of the camera."""
        return Place(element.line, self.file)

    def find(self, name: str) -> tuple[str, Place]:
        """Text that counts, ``default`` and empty ones included, and its place."""
        given = self.initial.get(name) or self.initial.get("all")
        if given is not None and given.text.strip() != "loaded":
            return given.text.strip(), Place(given.line, self.script)
        loaded = self.own.get(name) or self.own.get("all")
        return (loaded.text.strip(), self.at(loaded)) if loaded is not None else ("", self.at(self.camera))

    def model(self) -> tuple[str, Place]:
        """Number of the model, and where it stands; ``all`` does not set it."""
        given = self.initial.get("model")
        if given is not None:
            return given.text.strip(), Place(given.line, self.script)
        own = self.own.get("model", self.camera)
        return ("" if own is self.camera else own.text.strip()), self.at(own)

    def numbers(self, name: str, default: list[float], least: int) -> list[float]:
        """Numbers behind a name, ``default`` where it says so or nothing. Raises :class:`CameraError`."""
        text, place = self.find(name)
        if text in ("", "default"):
            return default
        found = numbers(text, name, place)
        if len(found) < least:
            raise CameraError(f"{name}: found {text!r}, expected {least} numbers", place)
        return found


def numbers(text: str, name: str, place: Place) -> list[float]:
    """Numbers between commas. Raises :class:`CameraError`."""
    try:
        found = [number(word.strip()) for word in text.split(",") if word.strip()]
    except ValueError as error:
        raise CameraError(f"{name}: {error}", place) from None
    if any(abs(value) > 1e30 for value in found):
        raise CameraError(f"{name}: found {text!r}, a number beyond 1e30", place)
    return found


def put_cameras(
    elements: list[tuple[Element, str]], initial: dict[str, Element], free: set[str], draft: Draft
) -> None:
    """The section ``cameras`` of elements and the files they are in; every mistake is told."""
    cameras: dict[str, Any] = {}
    for element, file in elements:
        own = {child.name: child for child in element.children}
        name = own["id"].text.strip() if "id" in own else str(len(cameras) + 1)
        for child in element.children:
            if child.name not in _KNOWN:
                draft.note(f"<{child.name}> of camera {name} is not read", child.line, file)
        if name in cameras:
            draft.problem(f"camera {name!r} is there already", element.line, file)
            continue
        try:
            cameras[name] = _camera(Texts(element, own, initial, file, draft.file), free, name, draft)
        except CameraError as error:
            draft.problem(f"camera {name}: {error}", *error.place)
            cameras[name] = {}
        draft.lines["cameras", name] = element.line
        draft.files["cameras", name] = file
    draft.put("cameras", cameras)


def _camera(texts: Texts, free: set[str], name: str, draft: Draft) -> dict[str, Any]:
    own = texts.own
    model, where = texts.model()
    if model not in _MODELS:
        raise CameraError(f"found the model {model!r}, expected one of {', '.join(_MODELS)}", where)
    unit = own["unit"].text.strip() if "unit" in own else "mm"
    if unit not in _UNITS:
        raise CameraError(
            f"found the unit {unit!r}, expected one of {', '.join(_UNITS)}", texts.at(own["unit"])
        )
    columns, rows, width, height, b1 = _format(texts, name, draft)
    pixel = height / rows
    c = _constant(texts)
    px, py = texts.numbers("pp", [width / 2.0, -height / 2.0], 2)[:2]
    if py > 0.0:
        words = f"pp: found {py:g} for y, expected it below 0: y counts upwards from the upper left corner"
        raise CameraError(words, texts.find("pp")[1])
    if model not in _AFFINE:
        free = free - {"b1", "b2"}
    across = columns * pixel * (1.0 + b1 if model == "5" else 1.0)
    values = {"c": c, "xh": px - across / 2.0, "yh": height / 2.0 + py}
    if model in _AFFINE:
        values |= {"b1": b1, "b2": texts.numbers("skew", [0.0], 1)[0]}
    elif b1 or texts.numbers("skew", [0.0], 1)[0]:
        words = f"camera {name}: model {model} has no affinity; its aspect and skew are not used"
        draft.note(words, *texts.at(texts.camera))
    known = _distortion(texts, values)
    interior = {
        key: {"free" if key in free and key in known else "fixed": repr(value)}
        for key, value in values.items()
        if key in known
    }
    image = {"width": f"{columns:.0f}", "height": f"{rows:.0f}", "pixel": f"{pixel!r} {unit}"}
    return {
        "model": _MODELS[model],
        "unit": unit,
        "coordinates": "corner",
        "image": image,
        "interior": interior,
    }


def _format(texts: Texts, name: str, draft: Draft) -> tuple[float, float, float, float, float]:
    """Columns and rows of the image, width and height of the sensor, b1 (width of a pixel / height − 1)."""
    own = texts.own
    for key in ("image", "sensor"):
        if key not in own:
            raise CameraError(f"found no <{key}>", texts.at(texts.camera))
    size = numbers(own["image"].text, "image", texts.at(own["image"]))
    if len(size) != 2 or min(size) < 1.0:
        raise CameraError(
            f"image: found {own['image'].text!r}, expected width,height in px", texts.at(own["image"])
        )
    words = [word.strip() for word in own["sensor"].text.split(",")]
    sensor = numbers(",".join(word for word in words if word != "auto"), "sensor", texts.at(own["sensor"]))
    if len(words) != 2 or words[1] == "auto" or not sensor or min(sensor) <= 1e-30:
        form = "width,height or auto,height"
        raise CameraError(f"sensor: found {own['sensor'].text!r}, expected {form}", texts.at(own["sensor"]))
    height, square = sensor[-1], sensor[-1] / size[1] * size[0]
    ratio = sensor[0] / square if len(sensor) == 2 else 1.0
    aspect, place = texts.find("aspect")
    if aspect == "auto":
        return size[0], size[1], square, height, ratio - 1.0
    b1 = 1.0 - texts.numbers("aspect", [1.0], 1)[0]
    if len(sensor) == 2 and abs(ratio - 1.0 - b1) > 1e-4:
        said = (
            f"pixels are {ratio:.6g} times as wide as high by the sensor, {1.0 + b1:.6g} times by the aspect"
        )
        draft.note(f"camera {name}: {said}, which is taken", *place)
    return size[0], size[1], square, height, b1


def _constant(texts: Texts) -> float:
    text, place = texts.find("cc")
    if text in ("", "focal", "default"):
        given = texts.own.get("focal")
        if given is None:
            raise CameraError("found neither cc nor focal", place)
        text, place = given.text.strip(), texts.at(given)
    found = numbers(text, "cc", place)
    if len(found) != 1 or found[0] <= 0.0:
        raise CameraError(f"found the camera constant {text!r}, expected a number above 0", place)
    return found[0]


def _distortion(texts: Texts, values: dict[str, float]) -> set[str]:
    """Put K and P among the values; returns all components the camera has."""
    known = set(values)
    for letter, most in (("K", 3), ("P", 2)):
        counted_, given = texts.own.get(f"n{letter}"), texts.numbers(letter, [], 1)
        count = len(given)
        if counted_ is not None:
            text = counted_.text.strip()
            if not text.isdecimal() or len(text) > 3:
                raise CameraError(f"n{letter}: found {text!r}, expected a count", texts.at(counted_))
            count = int(text)
        if any(given[most:]) or count > most:
            words = f"found {max(count, len(given))} coefficients {letter}, mor's models have {most}"
            raise CameraError(words, texts.find(letter)[1])
        for k in range(max(count, len(given))):
            values[f"{letter}{k + 1}"] = -given[k] if k < len(given) and given[k] else 0.0
            known.add(f"{letter}{k + 1}")
    return known
