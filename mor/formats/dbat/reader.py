"""A project of DBAT, the Damped Bundle Adjustment Toolbox: an XML script with the tables it names.

Metres, pixels from the upper left corner; ω, φ, κ as here. Source: N. Börlin, P. Grussenmeyer, *Damped Bundle
Adjustment Toolbox*, its demonstration scripts and the descriptions of its input.
"""

from __future__ import annotations

from pathlib import Path

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.dbat.cameras import put_cameras
from mor.formats.dbat.estimation import EXTERIOR, free_interior, held_exterior, initial_values, operations
from mor.formats.dbat.tables import Line, base_folder, filtered, path_of, sigmas, table_of
from mor.formats.draft import Draft, Row
from mor.formats.xml import Element, parse_xml
from mor.input_files import PROJECT, read_bytes
from mor.project.file.nodes import Document

_CONTROL = ("id", "label", "x", "y", "z", "sx", "sy", "sz", "sxy", "sxyz")
_MARKS = ("id", "im", "x", "y", "sx", "sy", "sxy")
_POSES = ("id", "x", "y", "z", "sx", "sy", "sz", "sxy", "sxyz", "omega", "phi", "kappa", "so", "sp", "sk")
_ANGLES = {"degrees": "deg", "gon": "gon", "radian": "rad"}
_READ = ("ctrl_pts", "check_pts", "images", "image_pts", "cameras", "prior_eo", "c")
SIGMA = "1"
"""σ of image coordinates, px, where the script and its tables have none."""

SIGMA_CHECK = "0.001"
"""σ of check points, m, where their table has none."""


def read_dbat(path: Path) -> Document:
    """The project of a DBAT script. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    root = parse_xml(read_bytes(path, PROJECT), draft.file)
    given = next(iter(root.all("input")), None)
    if given is None:
        words = f"found <{root.name}> without <input>, expected a DBAT script"
        raise InputError([Problem(words, draft.file, root.line)])
    folder = base_folder(given, path, draft)
    sections = {child.name: child for child in given.children}
    for child in given.children:
        if child.name not in _READ:
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
    """The one ``<file>`` of a section; a mistake where there is none."""
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
    if text in _ANGLES or (not text and not turned):
        return _ANGLES.get(text, "deg")
    draft.problem(f"found units={text!r} of the angles, expected one of {', '.join(_ANGLES)}", given.line)
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
    poses = {row.cells["id"]: row for row in table_of(prior, folder, _POSES, ("id",), draft)} if prior else {}
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
        draft.problem(
            f"{words} without a prior pose", next(operations(root, "set_bundle_estimate_params")).line
        )
    if table and not draft.problems:
        columns = ("id", "camera", *EXTERIOR, *(f"sigma_{name}" for name in EXTERIOR))
        fixed = [name for name in EXTERIOR if name in held] or None
        draft.table("images", columns, table, rows[0].file, fixed=fixed)
    return names


def _names(rows: list[Line], draft: Draft) -> dict[str, str]:
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


def _pose(row: Line | None) -> list[str | None]:
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
        _note_labels(rows, draft)
    return {row.cells["id"] for row in rows}


def _note_labels(rows: list[Line], draft: Draft) -> None:
    labelled = [row for row in rows if row.cells.get("label")]
    if labelled:
        words = f"labels of control points are not carried: they keep their ids ({labelled[0].cells['id']}"
        draft.note(f"{words} is {labelled[0].cells['label']})", labelled[0].line, labelled[0].file)


def _put_marks(given: Element, folder: Path, images: dict[str, str], control: set[str], draft: Draft) -> None:
    """Image points of every file, and the points that are in no other table."""
    seen: dict[str, Line] = {}
    files = [file for section in given.all("image_pts") for file in section.all("file")]
    if not files:
        draft.problem("found no <image_pts> with a <file> in <input>")
    for file in files:
        rows = table_of(file, folder, _MARKS, ("id", "im", "x", "y"), draft)
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


def _mark(row: Line, file: Element, images: dict[str, str], draft: Draft) -> Row:
    """Image, point, x, y and σ: those of the script where it has them, else those of the table."""
    plane = file.attributes.get("sxy")
    given = [file.attributes.get(name, plane) for name in ("sx", "sy")]
    own = sigmas(row)[:2]
    sigma = [a if a is not None else b for a, b in zip(given, own, strict=True)]
    for k, text in enumerate(sigma):
        try:
            good = text is not None and float(text) > 0.0
        except ValueError:
            good = False
        if not good:
            sigma[k] = SIGMA
            words = f"image points without a σ above 0 have σ = {SIGMA} px"
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
        words = (
            f"{counted(len(lost), 'check point')} in no image not used: the first is {lost[0].cells['id']}"
        )
        draft.note(words, lost[0].line, lost[0].file)
    used = [row for row in rows if row.cells["id"] in known]
    given_ = [[s if s is not None and float(s) > 0.0 else SIGMA_CHECK for s in sigmas(row)] for row in used]
    bare = [row for row in used if any(s is None or float(s) == 0.0 for s in sigmas(row))]
    if bare:
        words = f"{counted(len(bare), 'check point')} without a σ above 0: σ = {SIGMA_CHECK} m"
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
