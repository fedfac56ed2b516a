"""Read DBAT scripts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from mor.errors import InputError, Message, counted, nearest
from mor.formats.draft import Draft, Element, Row, parse_number, parse_xml, read_lines
from mor.input_files import PROJECT, read_bytes
from mor.project.document import Document

# ---- Cameras of DBAT as cameras of models ``brown``: one square pixel, its height; aspect and skew as b1, b2.
#
# DBAT's files count y of the principal point upwards from the upper left corner (it is negative), and carry K
# and P with the signs of its functions, the opposite of those it reports (and of PhotoModeler's, which
# ``brown`` has).


class LineReference(NamedTuple):
    """A line of a file."""

    line: int
    file: str


class CameraError(ValueError):
    """A mistake in a camera, with its location."""

    def __init__(self, words: str, place: LineReference) -> None:
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

    def at(self, element: Element) -> LineReference:
        """Return the location of an element of the camera."""
        return LineReference(element.line, self.file)

    def find(self, name: str) -> tuple[str, LineReference]:
        """Text that counts, ``default`` and empty ones included, and its place."""
        given = self.initial.get(name) or self.initial.get("all")
        if given is not None and given.text.strip() != "loaded":
            return given.text.strip(), LineReference(given.line, self.script)
        loaded = self.own.get(name) or self.own.get("all")
        return (loaded.text.strip(), self.at(loaded)) if loaded is not None else ("", self.at(self.camera))

    def model(self) -> tuple[str, LineReference]:
        """Number of the model, and where it stands; ``all`` does not set it."""
        given = self.initial.get("model")
        if given is not None:
            return given.text.strip(), LineReference(given.line, self.script)
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


def numbers(text: str, name: str, place: LineReference) -> list[float]:
    """Numbers between commas. Raises :class:`CameraError`."""
    try:
        found = [parse_number(word.strip()) for word in text.split(",") if word.strip()]
    except ValueError as error:
        raise CameraError(f"{name}: {error}", place) from None
    if any(abs(value) > 1e30 for value in found):
        raise CameraError(f"{name}: found {text!r}, a number beyond 1e30", place)
    return found


def put_cameras(elements: list[tuple[Element, str]], initial: dict[str, Element], free: set[str], draft: Draft) -> None:
    """The section ``cameras`` of elements and the files they are in; every mistake is told."""
    cameras: dict[str, Any] = {}
    for element, file in elements:
        own = {child.name: child for child in element.children}
        name = own["id"].text.strip() if "id" in own else str(len(cameras) + 1)
        for child in element.children:
            if child.name not in (
                *("id", "name", "unit", "sensor", "image", "aspect", "nK", "nP", "focal", "model"),
                *("cc", "pp", "K", "P", "skew", "all", "calibrated", "c"),
            ):
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
    # mor's models by DBAT's numbers; 1 and 2 are 3 without an affinity.
    models = {"1": "brown", "2": "brown", "3": "brown", "4": "brown-4", "5": "brown-5", "-1": "brown-forward"}
    if model not in models:
        raise CameraError(f"found the model {model!r}, expected one of {', '.join(models)}", where)
    unit = own["unit"].text.strip() if "unit" in own else "mm"
    units = ("mm", "um", "m")
    if unit not in units:
        raise CameraError(f"found the unit {unit!r}, expected one of {', '.join(units)}", texts.at(own["unit"]))
    columns, rows, width, height, b1 = _format(texts, name, draft)
    pixel = height / rows
    text, place = texts.find("cc")
    if text in ("", "focal", "default"):
        given = texts.own.get("focal")
        if given is None:
            raise CameraError("found neither cc nor focal", place)
        text, place = given.text.strip(), texts.at(given)
    found = numbers(text, "cc", place)
    if len(found) != 1 or found[0] <= 0.0:
        raise CameraError(f"found the camera constant {text!r}, expected a number above 0", place)
    c = found[0]
    px, py = texts.numbers("pp", [width / 2.0, -height / 2.0], 2)[:2]
    if py > 0.0:
        draft.note(f"camera {name}: y of pp is above 0, so it is counted downwards", *texts.find("pp")[1])
        py = -py
    affine = ("3", "4", "5")
    if model not in affine:
        free = free - {"b1", "b2"}
    across = columns * pixel * (1.0 + b1 if model == "5" else 1.0)
    values = {"c": c, "xh": px - across / 2.0, "yh": height / 2.0 + py}
    if model in affine:
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
    return {"model": models[model], "unit": unit, "coordinates": "corner", "image": image, "interior": interior}


def _format(texts: Texts, name: str, draft: Draft) -> tuple[float, float, float, float, float]:
    """Columns and rows of the image, width and height of the sensor, b1 (width of a pixel / height − 1)."""
    own = texts.own
    for key in ("image", "sensor"):
        if key not in own:
            raise CameraError(f"found no <{key}>", texts.at(texts.camera))
    size = numbers(own["image"].text, "image", texts.at(own["image"]))
    if len(size) != 2 or min(size) < 1.0:
        raise CameraError(f"image: found {own['image'].text!r}, expected width,height in px", texts.at(own["image"]))
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
        said = f"pixels are {ratio:.6g} times as wide as high by the sensor, {1.0 + b1:.6g} times by the aspect"
        draft.note(f"camera {name}: {said}, which is taken", *place)
    return size[0], size[1], square, height, b1


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


# ---- Read the settings of a DBAT script: estimated parameters and start values of the camera.

EXTERIOR = ("x", "y", "z", "omega", "phi", "kappa")


def operations(root: Element, *names: str) -> Iterator[Element]:
    """Elements of some names anywhere in the operations, in their order."""
    for part in root.all("operations"):
        yield from part.inside(*names, but="c")


def free_interior(root: Element, draft: Draft) -> set[str]:
    """Components of the interior orientation that the script estimates; none where it says nothing."""
    free: set[str] = set()
    said = False
    interior = ("c", "xh", "yh", "b1", "b2", "K1", "K2", "K3", "P1", "P2")
    names_of_kind = {
        "cc": ("c",),
        "pp": ("xh", "yh"),
        "px": ("xh",),
        "py": ("yh",),
        "aspect": ("b1",),
        "skew": ("b2",),
        "K": ("K1", "K2", "K3"),
        "P": ("P1", "P2"),
        "all": interior,
        **{name: (name,) for name in ("K1", "K2", "K3", "P1", "P2")},
    }
    for section, given in _settings(root, "io", names_of_kind, draft):
        said = True
        chosen = set(names_of_kind[section])
        free = free | chosen if given == "true" else free - chosen
    if not said:
        draft.note("the script sets no estimated parameters of the camera: its interior orientation is fixed")
    return free


def held_exterior(root: Element, draft: Draft) -> set[str]:
    """Components of the poses that the script does not estimate."""
    held: set[str] = set()
    outside = {"all": EXTERIOR, "pos": EXTERIOR[:3], "angles": EXTERIOR[3:], **{axis: (axis,) for axis in "xyz"}}
    for section, given in _settings(root, "eo", outside, draft):
        chosen = set(outside[section])
        held = held | chosen if given == "false" else held - chosen
    return held


def _settings(root: Element, part: str, known: dict[str, tuple[str, ...]], draft: Draft) -> Iterator[tuple[str, str]]:
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
                elif word not in ("true", "false", "default"):
                    draft.problem(f"found {word!r} in <{one.name}>, expected true, false or default", one.line)
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


# ---- Text tables of a DBAT project: where they are, columns by their declared format, ids that a filter leaves.


class TableLine(NamedTuple):
    """A line of a table: cells by their column, and where it stands."""

    cells: dict[str, str]
    line: int
    file: str


def table_of(
    given: Element, folder: Path, columns: tuple[str, ...], required: tuple[str, ...], draft: Draft
) -> list[TableLine]:
    """Lines of the file that a ``<file format="…">`` names; mistakes are told with the line they are in."""
    path = path_of(given, folder, draft)
    form = [name.strip() for name in given.attributes.get("format", "").split(",")]
    skipped = ("ignored", "dummy")
    known = (*columns, *skipped)
    wrong = [name for name in form if name not in known]
    missing = [name for name in required if name not in form]
    if wrong or missing:
        words = f"found the format {given.attributes.get('format', '')!r}: "
        if wrong:
            words += f"{wrong[0]!r} is not a column{nearest(wrong[0], known)} (known: {', '.join(known)})"
        else:
            words += f"expected {', '.join(missing)} in it"
        draft.problem(words, given.line)
    if path is None or wrong or missing:
        return []
    rows = []
    for count, text in enumerate(read_lines(path, draft), start=1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in text.split(",")]
        if len(cells) != len(form):
            words = f"found {len(cells)} columns, expected {len(form)}: {', '.join(form)}"
            draft.problem(words, count, str(path))
            continue
        row = {name: cell for name, cell in zip(form, cells, strict=True) if name not in skipped}
        if _plain(row, count, str(path), draft):
            rows.append(TableLine(row, count, str(path)))
    return rows


def _plain(row: dict[str, str], line: int, file: str, draft: Draft) -> bool:
    """Return True if names are there and the rest are numbers."""
    texts = ("id", "im", "cam", "label", "path")
    try:
        for name, cell in row.items():
            if name in ("id", "im") and not cell:
                raise ValueError(f"found no {name}")
            if name not in texts and parse_number(cell) < 0.0 and name.startswith("s"):
                raise ValueError(f"found the σ {cell}, expected 0 or more")
    except ValueError as error:
        draft.problem(str(error), line, file)
        return False
    return True


def path_of(given: Element, folder: Path, draft: Draft) -> Path | None:
    """The file an element names, from the folder of the input; a missing one is a mistake."""
    name = given.text.strip()
    if not name:
        draft.problem("found no name of a file", given.line)
        return None
    path = folder / name.replace("\\", "/")
    if path.is_file():
        return path
    draft.problem(f"the file {name} does not exist (looked for in {folder})", given.line)
    return None


def base_folder(given: Element, project: Path, draft: Draft) -> Path:
    """The folder that names of files count from: ``base_dir``, with $HERE for the folder of the project."""
    text = given.attributes.get("base_dir", "").strip()
    for word in ("$DBAT", "$HOME"):
        if text.startswith(word):
            words = f"base_dir {text!r}: {word} is known to DBAT only; files are looked for beside the project"
            draft.note(words, given.line)
            return project.parent
    text = text.replace("$HERE", ".", 1).replace("\\", "/")
    return project.parent / text if text else project.parent


def filtered(rows: list[TableLine], section: Element, draft: Draft) -> list[TableLine]:
    """Rows that the filters of a section keep."""
    for given in section.all("filter"):
        ids = {word.strip() for word in given.attributes.get("id", "").split(",")}
        what = given.text.strip()
        if what not in ("keep", "remove"):
            draft.problem(f"found the filter {what!r}, expected keep or remove", given.line)
            continue
        rows = [row for row in rows if (row.cells["id"] in ids) == (what == "keep")]
    return rows


def sigmas(row: TableLine) -> list[str | None]:
    """σ of x, y, z: its own column, that of the plane, that of all; ``None`` if there is none."""
    cells = row.cells
    plane = cells.get("sxy", cells.get("sxyz"))
    return [cells.get("sx", plane), cells.get("sy", plane), cells.get("sz", cells.get("sxyz"))]


# ---- A project of DBAT, the Damped Bundle Adjustment Toolbox: an XML script with the tables it names.
#
# Metres, pixels from the upper left corner; ω, φ, κ as here. Source: N. Börlin, P. Grussenmeyer, *Damped Bundle
# Adjustment Toolbox*, its demonstration scripts and the descriptions of its input.

_CONTROL = ("id", "label", "x", "y", "z", "sx", "sy", "sz", "sxy", "sxyz")


def read_dbat(path: Path) -> Document:
    """The project of a DBAT script. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    root = parse_xml(read_bytes(path, PROJECT), draft.file)
    given = next(iter(root.all("input")), None)
    if given is None:
        words = f"found <{root.name}> without <input>, expected a DBAT script"
        raise InputError([Message(words, draft.file, root.line)])
    folder = base_folder(given, path, draft)
    sections = {child.name: child for child in given.children}
    read = ("ctrl_pts", "check_pts", "images", "image_pts", "cameras", "prior_eo", "c")
    for child in given.children:
        if child.name not in read:
            draft.note(f"<{child.name}> is not read", child.line)
    names = [name.text.strip() for meta in root.all("meta") for name in meta.all("name")]
    draft.put("title", next((name for name in names if name), path.stem))
    draft.put("units", {"length": "m", "angle": _angle_unit(sections.get("prior_eo"), draft)})
    elements = _camera_elements(sections, folder, draft)
    put_cameras(elements, initial_values(root), free_interior(root, draft), draft)
    images = _put_images(sections, root, folder, draft)
    control = _put_control(sections, folder, draft)
    _put_marks(given, folder, images, control, draft)
    _put_checks(sections, folder, draft)
    _put_datum(root, bool(control), draft)
    return draft.finish()


def _file(section: Element | None, draft: Draft) -> Element | None:
    if section is None:
        return None
    files = section.all("file")
    if not files:
        draft.problem(f"found no <file> in <{section.name}>", section.line)
        return None
    for more in files[1:]:
        draft.problem(f"found a second <file> in <{section.name}>, expected one", more.line)
    return files[0]


def _angle_unit(section: Element | None, draft: Draft) -> str:
    given = next(iter(section.all("file")), None) if section is not None else None
    if given is None:
        return "deg"
    text = given.attributes.get("units", "")
    turned = any(name in given.attributes.get("format", "") for name in EXTERIOR[3:])
    angles = {"degrees": "deg", "gon": "gon", "radian": "rad"}
    if text in angles or (not text and not turned):
        return angles.get(text, "deg")
    draft.problem(f"found units={text!r} of the angles, expected one of {', '.join(angles)}", given.line)
    return "deg"


def _camera_elements(sections: dict[str, Element], folder: Path, draft: Draft) -> list[tuple[Element, str]]:
    """Cameras in the script, or in the file it names, each with the file it is in."""
    section = sections.get("cameras")
    if section is None:
        draft.problem("found no <cameras> in <input>")
        return []
    found = [(camera, draft.file) for camera in section.all("camera")]
    for given in section.all("file"):
        path = path_of(given, folder, draft)
        if path is None:
            continue
        inner = parse_xml(read_bytes(path, PROJECT), str(path))
        mine = [(camera, str(path)) for part in inner.all("cameras") for camera in part.all("camera")]
        if not mine:
            draft.problem("found no <camera> in <cameras>", 1, str(path))
        found += mine
    if not found and not draft.problems:
        draft.problem("found neither <camera> nor <file> in <cameras>", section.line)
    return found


def _put_images(sections: dict[str, Element], root: Element, folder: Path, draft: Draft) -> dict[str, str]:
    """Images by their names; returns name by id. Priors with a σ are observed, others are start values."""
    given = _file(sections.get("images"), draft)
    if given is None:
        draft.problem("found no <images> in <input>") if "images" not in sections else None
        return {}
    rows = table_of(given, folder, ("id", "label", "path", "cam"), ("id",), draft)
    prior = _file(sections.get("prior_eo"), draft)
    columns_of_poses = ("id", "x", "y", "z", "sx", "sy", "sz", "sxy", "sxyz", "omega", "phi", "kappa", "so", "sp", "sk")
    poses = {row.cells["id"]: row for row in table_of(prior, folder, columns_of_poses, ("id",), draft)} if prior else {}
    names = _names(rows, draft)
    single = next(iter(draft.data["cameras"])) if len(draft.data["cameras"]) == 1 else "1"
    table = []
    for row in rows:
        camera = row.cells.get("cam") or single
        if camera not in draft.data["cameras"]:
            known = ", ".join(draft.data["cameras"])
            draft.problem(f"camera {camera!r} does not exist (known: {known})", row.line, row.file)
        pose = poses.get(row.cells["id"])
        table.append(Row([names[row.cells["id"]], camera, *_pose(pose)], row.line))
    lost = [row for name, row in poses.items() if name not in names]
    if lost:
        words = f"{counted(len(lost), 'prior pose')} of no image not used: the first is {lost[0].cells['id']}"
        draft.note(words, lost[0].line, lost[0].file)
    held = held_exterior(root, draft)
    if held and len(poses) < len(names):
        words = f"{', '.join(c for c in EXTERIOR if c in held)} of the images are not estimated, but there are images"
        draft.problem(f"{words} without a prior pose", next(operations(root, "set_bundle_estimate_params")).line)
    if table and not draft.problems:
        columns = ("id", "camera", *EXTERIOR, *(f"sigma_{name}" for name in EXTERIOR))
        fixed = [name for name in EXTERIOR if name in held] or None
        draft.table("images", columns, table, rows[0].file, fixed=fixed)
    return names


def _names(rows: list[TableLine], draft: Draft) -> dict[str, str]:
    """Names of images by their ids: labels, names of their files, or ids where these are not unique."""
    wanted = []
    names: dict[str, str] = {}
    for row in rows:
        path = row.cells.get("path", "").replace("\\", "/").rpartition("/")[2]
        wanted.append(row.cells.get("label") or path or row.cells["id"])
        if row.cells["id"] in names:
            draft.problem(f"image {row.cells['id']!r} is there already", row.line, row.file)
        names[row.cells["id"]] = wanted[-1]
    if len(set(wanted)) < len(wanted):
        return {name: name for name in names}
    return names


def _pose(row: TableLine | None) -> list[str | None]:
    """Pose and its σ; a σ of 0 says nothing: what is held, the operations say."""
    if row is None:
        return [None] * 12
    values = [row.cells.get(name) for name in EXTERIOR]
    given = [*sigmas(row), *(row.cells.get(name) for name in ("so", "sp", "sk"))]
    return [*values, *(s if s is not None and float(s) > 0.0 else None for s in given)]


def _put_control(sections: dict[str, Element], folder: Path, draft: Draft) -> set[str]:
    """Control points: observed with their σ, fixed without one or where it is 0."""
    section = sections.get("ctrl_pts")
    given = _file(section, draft)
    if section is None or given is None:
        return set()
    rows = filtered(table_of(given, folder, _CONTROL, ("id", "x", "y", "z"), draft), section, draft)
    table = []
    for row in rows:
        place = [row.cells[axis] for axis in "xyz"]
        table.append(Row([row.cells["id"], *place, *(s or "0" for s in sigmas(row))], row.line))
    if table:
        columns = ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
        draft.table("points", columns, table, rows[0].file, group="control")
        labelled = [row for row in rows if row.cells.get("label")]
        if labelled:
            words = f"labels of control points are not carried: they keep their ids ({labelled[0].cells['id']}"
            draft.note(f"{words} is {labelled[0].cells['label']})", labelled[0].line, labelled[0].file)
    return {row.cells["id"] for row in rows}


def _put_marks(given: Element, folder: Path, images: dict[str, str], control: set[str], draft: Draft) -> None:
    """Image points of every file, and the points that are in no other table."""
    seen: dict[str, TableLine] = {}
    files = [file for section in given.all("image_pts") for file in section.all("file")]
    if not files:
        draft.problem("found no <image_pts> with a <file> in <input>")
    columns_of_marks = ("id", "im", "x", "y", "sx", "sy", "sxy")
    for file in files:
        rows = table_of(file, folder, columns_of_marks, ("id", "im", "x", "y"), draft)
        used = [row for row in rows if row.cells["im"] in images]
        if len(used) < len(rows):
            first = next(row for row in rows if row.cells["im"] not in images)
            words = f"{counted(len(rows) - len(used), 'image point')} of no image not used"
            draft.note(f"{words}: the first is in {first.cells['im']}", first.line, first.file)
        for row in used:
            seen.setdefault(row.cells["id"], row)
        table = [_mark(row, file, images, draft) for row in used]
        if table:
            columns = ("image", "point", "x", "y", "sigma_x", "sigma_y")
            draft.table("observations", columns, table, used[0].file, type="image", units="px")
    others = [row for name, row in seen.items() if name not in control]
    if others:
        rows_ = [Row([row.cells["id"]], row.line) for row in others]
        draft.table("points", ("id",), rows_, others[0].file)


def _mark(row: TableLine, file: Element, images: dict[str, str], draft: Draft) -> Row:
    """Image, point, x, y and σ: those of the script where it has them, else those of the table."""
    plane = file.attributes.get("sxy")
    given = [file.attributes.get(name, plane) for name in ("sx", "sy")]
    own = sigmas(row)[:2]
    sigma = [a if a is not None else b for a, b in zip(given, own, strict=True)]
    # σ of image coordinates, px, where the script and its tables have none.
    usual_sigma = "1"
    for k, text in enumerate(sigma):
        try:
            good = text is not None and float(text) > 0.0
        except ValueError:
            good = False
        if not good:
            sigma[k] = usual_sigma
            words = f"image points without a σ above 0 have σ = {usual_sigma} px"
            if not any(note.message == words and note.line == file.line for note in draft.notes):
                draft.note(words, file.line)
    cells = row.cells
    return Row([images[cells["im"]], cells["id"], cells["x"], cells["y"], *sigma], row.line)


def _put_checks(sections: dict[str, Element], folder: Path, draft: Draft) -> None:
    """Check points that are measured in images, compared with what comes out."""
    section = sections.get("check_pts")
    given = _file(section, draft)
    if section is None or given is None:
        return
    rows = filtered(table_of(given, folder, _CONTROL, ("id", "x", "y", "z"), draft), section, draft)
    known = {cells[0] for table in draft.data.get("points", []) for cells in table["rows"]}
    lost = [row for row in rows if row.cells["id"] not in known]
    if lost:
        words = f"{counted(len(lost), 'check point')} in no image not used: the first is {lost[0].cells['id']}"
        draft.note(words, lost[0].line, lost[0].file)
    used = [row for row in rows if row.cells["id"] in known]
    # σ of check points, m, where their table has none.
    sigma_check = "0.001"
    given_ = [[s if s is not None and float(s) > 0.0 else sigma_check for s in sigmas(row)] for row in used]
    bare = [row for row in used if any(s is None or float(s) == 0.0 for s in sigmas(row))]
    if bare:
        words = f"{counted(len(bare), 'check point')} without a σ above 0: σ = {sigma_check} m"
        draft.note(f"{words}; what is compared is the difference, not its test", bare[0].line, bare[0].file)
    table = [
        Row([row.cells["id"], *(row.cells[axis] for axis in "xyz"), *sigma], row.line)
        for row, sigma in zip(used, given_, strict=True)
    ]
    if table:
        columns = ("point", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
        draft.table("checks", columns, table, rows[0].file, type="coordinates", name="check points")


def _put_datum(root: Element, control: bool, draft: Draft) -> None:
    """A free network where there is no control; DBAT's dependent datum is another minimal one."""
    if control:
        return
    draft.put("datum", "free")
    for given in operations(root, "set_datum"):
        words = "the datum by a reference image is not carried: the network is free, all points carry it"
        draft.note(f"{words}; residuals and σ0 do not depend on it", given.line)
