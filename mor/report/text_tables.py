"""Tables of the text report."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.model.parameters import IMAGE_VELOCITY, INTERIORS, KINDS, ROTATION_RATE
from mor.project.schema import Settings
from mor.quality.precision import confidence_factor
from mor.quality.solution import Solved
from mor.report import estimates
from mor.report.estimates import POSE, found_movements
from mor.report.language import ENGLISH, Words, datum_name
from mor.report.layout import (
    ANGLE_DIGITS,
    DIGITS,
    cells,
    correlation_table,
    digits_worth,
    fixed,
    heading,
    short,
    small_unit,
    table,
)
from mor.report.observations import (
    check_rows,
    largest_length_error,
    observation_table,
    uncontrolled_residuals,
    worst_residuals,
)
from mor.report.units import angle_unit, angle_unit_of, other_rows, unit_of

# ---- Interior orientations with σ and correlations.


def camera_section(solved: Solved, words: Words) -> str:
    """One part for each camera."""
    length = solved.network.project.units.length
    parts = [_camera(row, length, words) for row in estimates.interior_rows(solved)]
    return "\n\n".join(parts)


def _camera(row: dict[str, Any], length: str, words: Words) -> str:
    unit = row["unit"]
    quantities = {c.name: c.quantity for c in INTERIORS[row["model"]].components}
    rows = [
        [
            name,
            quantities[name].unit(length, "rad", unit),
            short(c["value"], digits_worth(c["value"], c["sigma"])),
            short(c["sigma"], 4),
            fixed(c.get("t"), 1) if name != "c" else "-",
            c["status"],
        ]
        for name, c in row["components"].items()
    ]
    title = heading(words("Camera {id} (model {model})", id=row["id"], model=row["model"]))
    lines = [title, table(["component", "unit", "value", "sigma", "value/sigma", "status"], rows, 2, words)]
    if row["r0"] is not None:
        lines.append(f"r0 = {words.number(format(row['r0'], '.6g'))} {unit}")
    names, matrix = row["correlations"]["components"], row["correlations"]["matrix"]
    if matrix is not None and len(names) > 1:
        lines += ["", words("Correlations [1]"), correlation_table(names, matrix, words)]
    return "\n".join(lines)


# ---- Check points and check distances.


def check_section(solved: Solved, words: Words) -> str:
    """Deviations of what was kept out, by group and component."""
    checks, unit = check_rows(solved), solved.network.project.units.length
    rows = [cells(row, "group component unit count mean:.4g rms:.4g largest:.4g exceeding") for row in checks]
    if not rows:
        return ""
    headers = ["checks", "component", "unit", "n", "mean", "rms", "largest", "beyond test"]
    lines = [heading(words("Checks, not used in the adjustment (adjusted - known)")), table(headers, rows, 3, words)]
    error = largest_length_error(checks)
    if error is not None:
        said = "Largest length measurement error (in the manner of VDI/VDE 2634): {error} {unit}"
        lines.append(words(said, error=short(error, 4), unit=unit))
    return "\n".join(lines)


# ---- Error ellipses of points and of pairs of points.


def ellipse_section(solved: Solved, words: Words) -> str:
    """One line for each point with unknowns: the ellipse in plan; in three dimensions also the ellipsoid."""
    dimensions = solved.network.project.settings.dimensions
    if len(estimates.free_points(solved)) == 0 or dimensions == "z":
        return ""
    rows = estimates.ellipse_table(solved).to_dicts()
    length, angle = solved.network.project.units.length, angle_unit(solved)
    d = DIGITS[length]
    headers = ["point", f"a [{length}]", f"b [{length}]", f"azimuth of a [{angle}]"]
    plan = table(headers, [cells(row, f"id a:.{d}f b:.{d}f azimuth:.1f") for row in rows], words=words)
    lines = [heading(words("Error ellipses")), _explained(solved, words), plan]
    if dimensions == "xyz":
        headers = ["point", "axis 1", "azimuth 1", "elevation 1", "axis 2", "azimuth 2", "elevation 2"]
        headers += ["axis 3", "azimuth 3", "elevation 3"]
        numbers = " ".join(f"axis{k}:.{d}f azimuth{k}:.1f elevation{k}:.1f" for k in (1, 2, 3))
        units = words("Ellipsoids: axes in {length}, azimuths and elevations in {angle}.", length=length, angle=angle)
        lines += ["", f"{units}\n{table(headers, [cells(row, f'id {numbers}') for row in rows], words=words)}"]
    return "\n".join(lines)


def relative(solved: Solved, words: Words = ENGLISH, neighbours: bool = False) -> str:
    """One line for each pair of points asked for; where none is, for ``neighbours`` if wanted."""
    pairs = estimates.chosen_pairs(solved)
    neighbours = neighbours and len(pairs) == 0
    # Points of which a full report pairs each with its nearest.
    rows = estimates.relative_rows(solved, estimates.neighbouring_pairs(solved, 2000) if neighbours else pairs)
    if not rows:
        return ""
    length, angle = solved.network.project.units.length, angle_unit(solved)
    d = DIGITS[length]
    headers = [
        *("from", "to", f"distance [{length}]", f"sdistance [{length}]"),
        *(f"a [{length}]", f"b [{length}]", f"azimuth [{angle}]", f"sdz [{length}]"),
    ]
    columns = f"from to distance:.{d}f sdistance:.{d}f a:.{d}f b:.{d}f azimuth:.1f sdz:.{d}f"
    lines = [cells(row, columns) for row in rows]
    title = words("Distances and relative error ellipses")
    which = words("Every point with its nearest neighbour.") if neighbours else ""
    said = [heading(title), which, table(headers, lines, 2, words)]
    return "\n".join(line for line in said if line)


def _explained(solved: Solved, words: Words) -> str:
    quality = solved.quality
    assert quality is not None
    estimated = solved.network.project.settings.sigma == "aposteriori" and quality.redundancy > 0
    redundancy = float(quality.redundancy) if estimated else None
    factors = [f"{confidence_factor(k, redundancy):.2f}" for k in (2, 3)]
    said = "Semi-axes at 1 sigma; times {plan} the ellipse holds the point with 95 %, times {space} the ellipsoid."
    return words(said, plan=words.number(factors[0]), space=words.number(factors[1]))


# ---- Planes, lines and right angles.


def feature_section(solved: Solved, words: Words) -> str:
    """Two tables with one line for each feature, two for a right angle: place and direction, and their σ."""
    frame = estimates.feature_table(solved)
    if frame.height == 0 or solved.quality is None:
        return ""
    unit, angle = solved.network.project.units.length, angle_unit(solved)
    d = DIGITS[unit]
    places, sigmas = [], []
    for row in frame.to_dicts():
        name = f"{words.listed(row['type'])} {row['id']}"
        name += f", {words.listed(row['part'])}" if row["part"] else ""
        places.append([name, *cells(row, f"dx:.7f dy:.7f dz:.7f distance:.{d}f x:.{d}f y:.{d}f z:.{d}f")])
        numbers = f"sd:.{ANGLE_DIGITS[angle]}f sx:.{d}f sy:.{d}f sz:.{d}f rms:.{d}f form:.{d}f"
        sigmas.append([name, *cells(row, numbers)])
    headers = ["feature", *(f"{n} [1]" for n in ("dX", "dY", "dZ"))]
    headers += [f"{name} [{unit}]" for name in ("distance", "X", "Y", "Z")]
    units = {"sd": angle, **dict.fromkeys(("sX", "sY", "sZ", "rms", "form"), unit)}
    of_sigmas = ["feature", *(f"{name} [{of}]" for name, of in units.items())]
    note = words(
        "d: normal of a plane, direction of a line or axis; X Y Z: centre, apex, or mean of the points on it; "
        "sd: largest sigma of d"
    )
    tables = (table(headers, places, words=words), table(of_sigmas, sigmas, words=words))
    return "\n".join([heading(words("Planes, lines and shapes")), "\n\n".join(tables), note])


# ---- Observation groups with their estimated σ0.


def group_section(solved: Solved, words: Words) -> str:
    """One line for each group."""
    if solved.quality is None:
        return ""
    groups = estimates.group_table(solved).to_dicts()
    columns = "name type observations redundancy:.3f vtpv:.3f sigma0:.4f flagged"
    headers = ["group", "type", "n", "sum r", "vTPv", "sigma0 [1]", "flagged"]
    factors = components_in_words(estimates.variance_components(solved), groups, solved.network.project.settings, words)
    rows = [cells(row, columns) for row in groups]
    return "\n".join([heading(words("Observation groups")), table(headers, rows, 2, words), *factors])


def components_in_words(
    data: dict[str, Any] | None, groups: list[dict[str, Any]], settings: Settings, words: Words
) -> list[str]:
    """Factors of σ where the project asks for more than the table of groups has."""
    if data is None or (settings.variance_components == "report" and settings.variance_method == "simplified"):
        return []
    which = "Helmert's full system" if data["method"] == "helmert" else "simplified, group by group"
    how = "iterated into the weights" if data["iterated"] else "not taken into the weights"
    lines = [words("Variance components ({which}; {how}): factors of sigma", which=words(which), how=words(how))]
    if data["method"] != settings.variance_method:
        lines.append(words("Helmert's system is too large here, or cannot tell the groups apart."))
    for row in groups:
        if row["sigma_factor"] is not None:
            factor, sigma = fixed(row["sigma_factor"], 3), fixed(row["sigma_of_factor"], 3)
            lines.append(words("  {group}: {factor} +- {sigma}", group=row["name"], factor=factor, sigma=sigma))
    return lines


# ---- Images: exterior orientation with σ, number of points, residuals.


def image_section(solved: Solved, words: Words) -> str:
    """Tables of positions, of attitudes and of motions."""
    frame, project = estimates.image_table(solved), solved.network.project
    if frame.height == 0:
        return ""
    unit, angle = project.units.length, angle_unit_of(project)
    d, a = DIGITS[unit], ANGLE_DIGITS[angle]
    units = {name: scale.coordinate_unit for name, scale in solved.network.scales.items()}
    rows, turns = frame.to_dicts(), ("omega", "phi", "kappa", "somega", "sphi", "skappa")
    place = " ".join(f"{name}:.{d}f" for name in ("x", "y", "z", "sx", "sy", "sz"))
    positions = [[*cells(row, f"id camera {place} points rms:.5f"), units[row["camera"]]] for row in rows]
    turned = " ".join(f"{name}:.{a}f" for name in turns)
    headers = ["image", "camera", *(f"{n} [{unit}]" for n in ("X0", "Y0", "Z0", "sX0", "sY0", "sZ0")), "points"]
    lines = [
        heading(words("Images")),
        table([*headers, "rms v", "unit"], positions, 2, words, last_left=True),
        "",
        table(["image", *(f"{n} [{angle}]" for n in turns)], [cells(r, f"id {turned}") for r in rows], words=words),
    ]
    return "\n".join([*lines, *_motions(frame, unit, angle, words)])


def _motions(frame: pl.DataFrame, unit: str, angle: str, words: Words) -> list[str]:
    """Tables of velocity and rate of rotation of the images that move while they are read out."""
    if IMAGE_VELOCITY.names[0] not in frame.columns:
        return []
    rows, lines = frame.filter(pl.col(IMAGE_VELOCITY.names[0]).is_not_null()).to_dicts(), []
    for kind, of in ((IMAGE_VELOCITY, unit), (ROTATION_RATE, angle)):
        headings = [text for name in kind.names for text in (f"{name} [{of}/s]", f"s{name}")]
        numbers = " ".join(f"{name}:.3f s{name}:.3f" for name in kind.names)
        lines += ["", table(["image", *headings], [cells(row, f"id {numbers}") for row in rows], words=words)]
    return lines


# ---- Instruments, heights, eccentricities and image-variant interiors that were estimated.


def section_of_others(solved: Solved, words: Words) -> str:
    """One line for each component."""
    rows = []
    for other in other_rows(solved):
        units = {c.name: unit_of(solved, c.quantity) for c in KINDS[other["kind"]].components}
        for name, component in other["components"].items():
            rows.append([other["kind"], other["id"], name, units[name], *cells(component, "value:.9g sigma:.4g")])
    if not rows:
        return ""
    headers = ["kind", "block", "component", "unit", "value", "sigma"]
    return f"{heading(words('Other parameters'))}\n{table(headers, rows, 4, words)}"


# ---- Points with σ, error ellipsoids and rays.


def point_section(solved: Solved, words: Words = ENGLISH, full: bool = False) -> str:
    """One line for each point, or for the first of many."""
    count, found = len(solved.network.things["point"].ids), estimates.point_summary(solved)
    if count == 0:
        return ""
    frame = estimates.point_table(solved) if full else found.shown
    unit = solved.network.project.units.length
    d = DIGITS[unit]
    datum = datum_name(solved.adjustment.problem.datum.name, words)
    numbers = " ".join(f"{name}:.{DIGITS[unit]}f" for name in ("x", "y", "z", "sx", "sy", "sz", "ellipsoid_a"))
    rows = [cells(row, f"id {numbers} rays others status") for row in frame.to_dicts()]
    names = ("X", "Y", "Z", "sX", "sY", "sZ", "ellipsoid a")
    headers = ["point", *(f"{name} [{unit}]" for name in names), "rays", "others", "status"]
    lines = [heading(words("Points (datum: {datum})", datum=datum)), table(headers, rows, words=words)]
    if count > frame.height:
        more = count - frame.height
        lines.append(words("{count:more point is|more points are} in the table of points.", count=more))
    if solved.quality is not None and found.weakest is not None:
        rms = zip("XYZ", found.rms, strict=True)
        numbers = ", ".join(f"{name} {words.number(fixed(value, d))}" for name, value in rms)
        lines.append(words("Root mean square sigma [{unit}]: ", unit=unit) + numbers)
    return "\n".join(lines)


# ---- The worst residuals first.

SHOWN_RESIDUALS = 40


def residual_section(solved: Solved, words: Words) -> str:
    """The observations with the largest |w|, and those that hardly anything controls."""
    if solved.quality is None:
        return ""
    limit, least = fixed(solved.quality.critical, 2), f"{solved.quality.levels.least_redundancy:g}"
    parts = [
        heading(words("Worst residuals first (|w| > {limit} is flagged)", limit=limit)),
        rows_of(worst_residuals(solved, SHOWN_RESIDUALS), words),
    ]
    loose, count = uncontrolled_residuals(solved, SHOWN_RESIDUALS)
    if count:
        parts += [
            "",
            heading(words("Observations that hardly anything controls (r < {limit})", limit=least)),
            rows_of(loose, words),
        ]
        if count > SHOWN_RESIDUALS:
            parts.append(words("and {count} more in the table of residuals", count=count - SHOWN_RESIDUALS))
    return "\n".join(parts)


def listed_residuals(solved: Solved, words: Words) -> str:
    """All observations in the order of the input, those that were kept out among them."""
    if solved.quality is None:
        return ""
    return "\n".join([heading(words("All observations")), rows_of(observation_table(solved), words)])


def rows_of(frame: pl.DataFrame, words: Words) -> str:
    """Rows of the table of residuals.

    Residuals below 1e-9 of their σ are round-off, which differs from machine to machine: they are written as 0.
    """
    rows = []
    for row in frame.to_dicts():
        v, sigma = row["v"], row["sigma"]
        row["v"] = 0.0 if v is not None and sigma and abs(v) < 1e-9 * sigma else v
        numbers = cells(row, "component unit observed:.9g v:.4g sigma:.3g r:.3f w:.2f flag")
        rows.append([row["type"], " ".join(part for part in (row["at"], row["from"], row["to"]) if part), *numbers])
    headers = ["type", "between", "component", "unit", "observed", "v", "sigma", "r [1]", "w [1]", "flag"]
    return table(headers, rows, 4, words)


# ---- Theodolite stations, local systems and stereo pairs.


def station_section(solved: Solved, words: Words) -> str:
    """One table for each kind that occurs."""
    parts = []
    unit, angle = solved.network.project.units.length, angle_unit(solved)
    units = dict.fromkeys(("omega", "phi", "kappa", "orientation"), (angle, f".{ANGLE_DIGITS[angle]}f"))
    units["scale"] = ("1", ".9g")
    for title, frame, names in (
        ("Theodolite stations", estimates.station_table(solved), ("x", "y", "z", "orientation", "height")),
        ("Local systems", estimates.system_table(solved), ("x", "y", "z", "omega", "phi", "kappa", "scale")),
        ("Stereo pairs", estimates.pair_table(solved), ("bx", "by", "bz", "omega", "phi", "kappa")),
    ):
        if frame.height:
            said: dict[str, tuple[str, str]] = {}
            for name in names:
                form = units.get(name, (unit, f".{DIGITS[unit]}f"))
                said |= {column: form for column in (name, f"s{name}") if column in frame.columns}
            headers = ["id", *(f"{name} [{of}]" for name, (of, _) in said.items())]
            columns = " ".join(["id", *(f"{name}:{form}" for name, (_, form) in said.items())])
            rows = [cells(row, columns) for row in frame.to_dicts()]
            parts.append(f"{heading(words(title))}\n{table(headers, rows, words=words)}")
    return "\n\n".join(parts)


# ---- Movements of points: what moves them, with tests, and how far each has moved from its first to its last epoch.


class Listed(NamedTuple):
    """A table as texts."""

    headers: list[str]
    rows: list[list[str]]
    left: int
    """Columns of texts at the beginning."""
    left_out: str
    """Words for the rows that stand elsewhere."""


def motion_section(solved: Solved, words: Words = ENGLISH, shown: int = 200) -> str:
    """Return the motion models of the points and the estimated movements as text: ``shown`` rows of each table."""
    if found_movements(solved) is None:
        return ""
    length = solved.network.project.units.length
    lines = [heading(words("Movements of points")), *statements(solved, words)]
    for part in (
        listed_parameters(solved, words, shown),
        listed_movements(estimates.movement_rows(solved), length, words, shown),
    ):
        if part.rows:
            lines += ["", table(part.headers, part.rows, part.left, words, last_left=True)]
            lines += [part.left_out] if part.left_out else []
    return "\n".join(lines)


def statements(solved: Solved, words: Words) -> list[str]:
    """Return the tests and their results as text."""
    found, motion = found_movements(solved), solved.network.motion
    assert found is not None
    order, parameters, between = motion.in_order, found.parameters, found.between
    lines = [
        words(
            "{count:epoch|epochs} from {first} to {last}; coordinates of points with a velocity or an oscillation are "
            "those of {reference}.",
            count=len(order),
            first=motion.labels[order[0]],
            last=motion.labels[order[-1]],
            reference=f"{motion.reference:.4f}",
        )
    ]
    if parameters.names:
        lines.append(
            words(
                "{count:test|tests} of velocities, oscillations and steps; all together reject by mistake with "
                "{overall}, each with {level} (Sidak): {moved} significant.",
                count=len(parameters.names),
                overall=f"{solved.network.project.settings.global_level:g}",
                level=f"{found.level:.2g}",
                moved=int(parameters.significant.sum()),
            )
        )
    if between.names:
        lines.append(
            words(
                "{count:test|tests} of movements since the first epoch of each point, each with {level}: {moved} "
                "significant.",
                count=len(between.names),
                level=f"{found.level_between:.2g}",
                moved=int(between.significant.sum()),
            )
        )
    if found.unlisted:
        said = (
            "Movements of {count:point|points} with coordinates of each epoch are not computed here; mor compare "
            "--between computes them for two epochs."
        )
        lines.append(words(said, count=found.unlisted))
    return lines


def listed_parameters(solved: Solved, words: Words, shown: int) -> Listed:
    """A line for each velocity and step, two for an annual oscillation."""
    frame = estimates.motion_table(solved)
    headers = ["point", "parameter", "unit", "X", "Y", "Z", "sX", "sY", "sZ", "test [1]", "p", "nabla", "verdict"]
    if frame.height == 0:
        return Listed(headers, [], 3, "")
    said, factor = _unit(solved.network.project.units.length, frame)
    rows = []
    for row in _most_first(frame, shown):
        waves = row["parameter"] == "annual oscillation"
        name = words("annual" if waves else row["parameter"])
        name = words("step at {time}", time=row["time"]) if row["time"] else name
        unit = f"{said}{estimates.PER[row['parameter']]}"
        nabla = "-" if row["smallest"] is None else short(row["smallest"] * factor, 3)
        tests = [fixed(row["test"], 2), _p(row["p"]), nabla, words("moves") if row["moved"] else ""]
        rows.append([row["point"], f"{name} sin" if waves else name, unit, *_cells(row, "", factor), *tests])
        if waves:
            rows.append([row["point"], f"{name} cos", unit, *_cells(row, "cos_", factor), "", "", "", ""])
    return Listed(headers, rows, 3, _left_out(frame.height, shown, "motions", words))


def listed_movements(frame: pl.DataFrame, length: str, words: Words, shown: int) -> Listed:
    """A line for each point of the table of movements: from its first to its last epoch."""
    if frame.height == 0:
        return Listed([], [], 3, "")
    last = frame.group_by("point", maintain_order=True).last()
    said, factor = _unit(length, last)
    rows = []
    for row in _most_first(last, shown):
        tests = [fixed(row["test"], 2), _p(row["p"]), words("moved") if row["moved"] else ""]
        rows.append([row["point"], row["from"], row["to"], *_cells(row, "", factor), *tests])
    units = [f"{name} [{said}]" for name in ("dX", "dY", "dZ", "sdX", "sdY", "sdZ")]
    headers = ["point", "from", "to", *units, "test [1]", "p", "verdict"]
    return Listed(headers, rows, 3, _left_out(last.height, shown, "movements", words))


def _left_out(count: int, shown: int, name: str, words: Words) -> str:
    if count <= shown:
        return ""
    return words("{count:more row is|more rows are} in the table {name}.", count=count - shown, name=name)


def _most_first(frame: pl.DataFrame, shown: int) -> list[dict[str, Any]]:
    """Rows as they stand; of many, the most significant ones."""
    if frame.height <= shown:
        return frame.to_dicts()
    return frame.sort("p", nulls_last=True, maintain_order=True).head(shown).to_dicts()


def _unit(length: str, frame: pl.DataFrame) -> tuple[str, float]:
    sizes = [float(frame[name].abs().max() or 0.0) for name in ("x", "y", "z")]  # type: ignore[arg-type]
    said, factor = small_unit(length, max(sizes) or 1.0)
    return said.replace("µ", "u"), factor


def _cells(row: dict[str, Any], part: str, factor: float) -> list[str]:
    values = [row[f"{s}{part}{axis.lower()}"] for s in ("", "s") for axis in "XYZ"]
    return ["-" if value is None else fixed(value * factor, 3) for value in values]


def _p(value: float | None) -> str:
    return "-" if value is None else "<0.0001" if value < 1e-4 else fixed(value, 4)


# ---- Points of a network on the earth: coordinates in its reference system, heights, σ east, north, up.


def place_section(solved: Solved, words: Words = ENGLISH, shown: int = estimates.SHOWN_POINTS) -> str:
    """One line for each point, and what the coordinates refer to; nothing if the network is nowhere on the earth."""
    world, frame = solved.network.world, estimates.place_table(solved)
    if world is None or frame.height == 0:
        return ""
    unit, angle = solved.network.project.units.length, angle_unit(solved)
    d = DIGITS[unit]
    own = list(world.system.coordinates)
    heights = [name for name in ("ellipsoidal_height", "orthometric_height") if frame[name].count()]
    columns = [name for name in own if name != "height"] + heights + ["seast", "snorth", "sup"]
    short_names = {"ellipsoidal_height": "h", "orthometric_height": "H", "seast": "sE", "snorth": "sN", "sup": "sU"}
    units = {name: angle if name in estimates.ANGULAR else unit for name in columns}
    headers = ["point", *(f"{short_names.get(name, name)} [{units[name]}]" for name in columns)]
    # Decimals of latitudes and longitudes: a tenth of a millimetre.
    digits = [
        {"gon": 9, "deg": 9, "rad": 11, "mrad": 8, "mgon": 6}[angle] if name in estimates.ANGULAR else d
        for name in columns
    ]
    rows = [
        [row["id"], *(fixed(row[name], k) for name, k in zip(columns, digits, strict=True))]
        for row in frame.head(shown).to_dicts()
    ]
    datum = datum_name(solved.adjustment.problem.datum.name, words)
    title = words("Points in {system} (datum: {datum})", system=world.system.name, datum=datum)
    lines = [heading(title), table(headers, rows, words=words)]
    if frame.height > shown:
        lines.append(words("{count:more point is|more points are} in the table of places.", count=frame.height - shown))
    latitude, longitude = np.degrees([world.horizon.latitude, world.horizon.longitude])
    said = (
        "sigma: east, north, up in the horizon of each point. X, Y, Z elsewhere in this report are east, north, up in "
        "the horizon of the middle of the network, latitude {latitude}°, longitude {longitude}°, height 0."
    )
    lines.append(words(said, latitude=words.number(f"{latitude:.4f}"), longitude=words.number(f"{longitude:.4f}")))
    return "\n".join(lines)


# ---- Trajectories: how they are interpolated, their knots with σ, misalignments of inertial systems.


def trajectory_section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN_RESIDUALS) -> str:
    """A line for each trajectory, tables of the knots and of the misalignments."""
    trajectories = solved.network.trajectories
    if not trajectories:
        return "\n".join(_boresights(solved, words)[1:])
    lines = [heading(words("Trajectories"))]
    for name, found in trajectories.items():
        said = words("cubic interpolation") if found.cubic else words("linear interpolation")
        lines.append(
            words(
                "{name}: {said}, {count:knot|knots} from {first} s to {last} s",
                name=name,
                said=said,
                count=len(found.times),
                first=f"{found.times[0]:.12g}",
                last=f"{found.times[-1]:.12g}",
            )
        )
        stretches = int(found.stretch[-1]) + 1
        if stretches > 1:
            lines[-1] += ", " + words("{count:stretch|stretches} with gaps between them", count=stretches)
    frame = estimates.knot_table(solved)
    unit, angle = solved.network.project.units.length, angle_unit(solved)
    tables = []
    for names, of, digits in ((POSE[:3], unit, DIGITS[unit]), (POSE[3:], angle, ANGLE_DIGITS[angle])):
        columns = [*names, *(f"s{name}" for name in names)]
        numbers = " ".join(f"{name}:.{digits}f" for name in columns)
        rows = [cells(row, f"trajectory time:.3f {numbers}") for row in frame.head(shown).to_dicts()]
        tables += [table(["trajectory", "time [s]", *(f"{c} [{of}]" for c in columns)], rows, words=words), ""]
    lines += ["", *tables[:-1]]
    if frame.height > shown:
        said = "The first {shown} of {count} knots; trajectories.csv has all."
        lines.append(words(said, shown=shown, count=frame.height))
    return "\n".join([*lines, *_boresights(solved, words)])


def _boresights(solved: Solved, words: Words) -> list[str]:
    rows = estimates.boresight_rows(solved)
    if not rows:
        return []
    angle = angle_unit(solved)
    columns = [*POSE[3:], *(f"s{name}" for name in POSE[3:])]
    numbers = " ".join(f"{name}:.{ANGLE_DIGITS[angle]}f" for name in columns)
    body = [cells(row, f"instrument {numbers}") for row in rows]
    title = words("Misalignment of inertial systems (boresight):")
    return ["", title, table(["instrument", *(f"{c} [{angle}]" for c in columns)], body, words=words)]
