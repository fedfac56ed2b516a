"""The project file as pydantic models: its validation and its JSON Schema."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator
from pydantic_core import ErrorDetails

from mor.errors import InputError, Message, nearest
from mor.project.document import Document, KeyPath

# ---- What stands at the leaves of a project file: texts, names, measures, delimiters; and the base of all sections.


def _one_line(text: str) -> str:
    if any(sign in text for sign in "\n\r\0"):
        raise ValueError(f"found {text!r}, expected a text without line breaks")
    return text


Text = Annotated[str, Field(min_length=1), AfterValidator(_one_line)]
Measure = Annotated[
    str,
    Field(
        pattern=r"^\s*[-+]?(\d+-\d+(-\d+\.?\d*)?|(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?(\s*[A-Za-zµμ%°/\-]+[0-9^]*)?)\s*$",
        description="A number, with or without a unit: 28.8, 0.5 um, 3 mgon; an angle in dms: 12-34-56.7",
    ),
]
Name = Annotated[
    str,
    Field(min_length=1, description="An identifier; always text, whatever it looks like"),
    AfterValidator(_one_line),
]


def one_sign(sign: str) -> str:
    """A sign that can stand between the cells of a table; ValueError where it cannot."""
    if not re.fullmatch(r"[\t !$%&'()*,/:;<=>?@\[\\\]^_`{|}~]", sign):
        raise ValueError(f"found {sign!r}, expected a character that no number or name contains, such as ; or a tab")
    return sign


def required(description: str) -> Any:
    """A key that must be there."""
    return Field(description=description)


def optional(description: str, **limits: Any) -> Any:
    """A key that need not be there: ``None`` by default."""
    return Field(None, description=description, **limits)


def several(description: str, of: type[list[Any]] | type[dict[str, Any]] = list) -> Any:
    """A key with any number of entries: none by default."""
    return Field(default_factory=of, description=description)


Model = TypeVar("Model", bound=BaseModel)


class Strict(BaseModel):
    """Unknown keys are errors, nothing changes after reading.

    Validators are built by their first use, which most sections of a file never see; so a section that stands for one
    that is missing is made by ``model_construct``, which needs none.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, str_strip_whitespace=True, defer_build=True
    )


# ---- A table of a project file: its rows, or the file they stand in, its columns and units.


class TableEntry(Strict):
    """Rows, here or in a file beside the project."""

    name: Text | None = optional("Name in reports; default the file or the type")
    file: Text | None = optional("CSV (may be .gz), Parquet or spreadsheet (.xlsx, .ods), relative to the project file")
    rows: list[list[str | None]] | None = optional("Rows in place, in the order of columns")
    columns: list[Text | None] | dict[str, Text | None] | None = optional(
        "A list declares the columns of rows or of a file without header (null skips one); "
        "a mapping renames columns of a file with header (null skips one)"
    )
    values: dict[str, Text] = several("Columns with the same value in every row", of=dict)
    units: Text | dict[str, Text] = several("Units by column, or one for all", of=dict)
    delimiter: (
        Annotated[str, StringConstraints(strip_whitespace=False, min_length=1, max_length=1), AfterValidator(one_sign)]
        | None
    ) = optional("Between columns of a CSV file; a blank stands for any number of blanks")
    decimal: Literal[".", ","] = Field(".", description="Decimal sign of the numbers in the file")
    sheet: Text | None = optional("Sheet of a spreadsheet; needed if several sheets hold something")

    @model_validator(mode="after")
    def _one_source(self) -> TableEntry:
        given = [key for key, value in self.sources.items() if value is not None]
        if len(given) != 1:
            said = {"file": "a file", "direction": "a direction", "surface": "a surface"}
            *others, last = (said.get(key, key) for key in self.sources)
            raise ValueError(f"give either {', '.join(others)} or {last}")
        if self.rows is not None and not isinstance(self.columns, list):
            raise ValueError("rows need a list of columns")
        if given[0] not in ("file", "rows") and (self.columns is not None or self.delimiter is not None):
            raise ValueError(f"columns and delimiter belong to a file or rows, not to {given[0]}")
        if self.file is None and (self.decimal != "." or self.sheet is not None):
            raise ValueError("decimal and sheet belong to a file")
        if self.decimal == "," and self.delimiter in (None, ","):
            raise ValueError("numbers with a decimal comma need another delimiter than a comma: set delimiter: ;")
        return self

    @property
    def sources(self) -> dict[str, object]:
        """Sources of the rows by key; ``None`` if one is not given."""
        return {"file": self.file, "rows": self.rows}

    def unit_of(self, *names: str) -> str:
        """Unit of the first of some columns that has one, or the one of all; empty if there is none."""
        if isinstance(self.units, str):
            return self.units
        return next((self.units[name] for name in names if name in self.units), "")


# ---- The sections ``world`` and ``curvature`` of the project file: where on the earth the network is, or on a sphere.


class DeflectionGrids(Strict):
    """Grids of the deflections of the vertical, arc seconds."""

    north: Text = required("Grid of ξ, north positive (GTX, GeoTIFF; arc seconds)")
    east: Text = required("Grid of η, east positive (GTX, GeoTIFF; arc seconds)")


class Origin(Strict):
    """Origin of the object system in the horizon, at height 0."""

    latitude: Measure = required("Latitude, in the unit of angles or with one of its own (49.6412 deg)")
    longitude: Measure = required("Longitude, likewise")


class World(Strict):
    """Position of the network on the earth: its points are given in a coordinate reference system."""

    crs: Text = required(
        "Coordinate reference system of the points: EPSG code (EPSG:25832, compound EPSG:25832+7837) or WKT"
    )
    heights: Literal["ellipsoidal", "orthometric"] | None = optional(
        "What heights of points are above: the ellipsoid or the geoid; where crs does not say it"
    )
    geoid: Text | None = optional(
        "Grid of geoid heights (GTX, GeoTIFF, GSB) for points without a value in their column geoid"
    )
    deflections: Text | DeflectionGrids | None = optional(
        "Grid of deflections of the vertical for points without values in their columns: a GSB file with "
        "geoid heights and deflections, or one grid each for north and east"
    )
    origin: Origin | None = optional(
        "Origin of the object system; by itself it is the middle of the points, rounded to 0.0001°"
    )


class SphereOrigin(Strict):
    """Position of the sphere: plan coordinates of a point, and the height at which distances are those of the plan."""

    x: Measure = required("x in the axes of the project")
    y: Measure = required("y in the axes of the project")
    z: Measure = required("Height of the sphere: distances at this height are those between coordinates")


class Curvature(Strict):
    """The sphere under a local network; true alone is the mean radius of the earth, 6371 km."""

    radius: Measure | None = optional("Radius, e.g. 6381 km; default 6371 km")
    latitude: Measure | None = optional(
        "In place of the radius: latitude, whose Gaussian mean radius on GRS80 is taken (48 deg)"
    )
    origin: SphereOrigin | None = optional(
        "Origin of the sphere; by itself the median of the given coordinates, rounded to a metre"
    )


# ---- What a project file says of time: its reference, and how points move.

_Component = Literal["vx", "vy", "vz", "sin_x", "sin_y", "sin_z", "cos_x", "cos_y", "cos_z", "dx", "dy", "dz"]


class Epochs(Strict):
    """Reference epoch of moving points."""

    reference: Text | None = optional(
        "Time at which points with a velocity have their coordinates: 2015-05-12 or 2015.36; default the first epoch"
    )


class MotionEntry(TableEntry):
    """Points that move alike: all that are named, or those of a table with a column id."""

    model: Literal["velocity", "seasonal", "steps", "epochs"] = required(
        "velocity: vx, vy, vz in a year; seasonal: an annual oscillation sin_x … cos_z; "
        "steps: dx, dy, dz at a time; epochs: coordinates of its own in every epoch"
    )
    points: list[Name] | None = optional("In place of a table: names, groups of points, or patterns such as D*")
    fixed: list[_Component] = several("Components held as they are")

    @property
    def sources(self) -> dict[str, object]:
        """Sources of the rows by key; ``None`` if one is not given."""
        return {**super().sources, "points": self.points}

    @model_validator(mode="after")
    def _no_components(self) -> MotionEntry:
        if self.model == "epochs" and self.fixed:
            raise ValueError("coordinates of every epoch are fixed among the points: D1@2015-05-12")
        return self


# ---- What a project file says of a plan: requirements it has to reach, and variants of it.


class RequiredSigma(Strict):
    """Largest standard deviations that points may have."""

    points: list[Name] = Field(
        ["*"], description="Names, groups of points, or patterns of names: P* is all that begin with P"
    )
    x: Measure | None = optional("Largest σ of x")
    y: Measure | None = optional("Largest σ of y")
    z: Measure | None = optional("Largest σ of z")
    xy: Measure | None = optional("Largest σ of x, and of y")
    xyz: Measure | None = optional("Largest σ of x, of y and of z")
    ellipsoid: Measure | None = optional("Longest semi-axis of the error ellipsoid: no direction has a larger σ")

    @model_validator(mode="after")
    def _something(self) -> RequiredSigma:
        if all(getattr(self, key) is None for key in ("x", "y", "z", "xy", "xyz", "ellipsoid")):
            raise ValueError("give at least one of x, y, z, xy, xyz, ellipsoid")
        return self


class RequiredReliability(Strict):
    """Required reliability of observations."""

    groups: list[Name] = Field(["*"], description="Names of groups of observations, or patterns of them")
    r: float | None = optional("Least redundancy number", gt=0.0, lt=1.0)
    external: float | None = optional("Largest external reliability δ̄0: effect of an undetected error, in σ", gt=0.0)

    @model_validator(mode="after")
    def _something(self) -> RequiredReliability:
        if self.r is None and self.external is None:
            raise ValueError("give r, external, or both")
        return self


class Require(Strict):
    """Requirements of a plan, which mor design checks."""

    sigma: RequiredSigma | list[RequiredSigma] = several("Largest σ of points, a priori, in the datum of the project")
    reliability: RequiredReliability | list[RequiredReliability] = several(
        "Least redundancy numbers, largest external reliability"
    )


class Without(Strict):
    """Things that a variant leaves out with every observation that refers to them; names or patterns."""

    points: list[Name] = several("Points")
    images: list[Name] = several("Images")
    stations: list[Name] = several("Stations of theodolites, and their sets")
    groups: list[Name] = several("Groups of observations, by their names")


class Variant(Strict):
    """Variant of a project: something left out, other σ, or more observations."""

    without: Without = Field(Without.model_construct(), description="What is left out")
    factor: dict[Name, Annotated[float, Field(gt=0.0, le=1e50)]] = several(
        "Factors on the σ of groups of observations, by names or patterns", of=dict
    )
    candidates: list[Name] = several("Tables of candidates that take part, by names or patterns")
    cameras: dict[Name, dict[str, Any]] = several("Keys of cameras that differ: another lens", of=dict)


# ---- What a project file says of who sees what: surfaces in the way, normals of targets, limits of sights.

_Place = Name | Annotated[list[Measure], Field(min_length=3, max_length=3)]


class Surface(Strict):
    """Something that no sight goes through: a plane polygon, or the faces of a mesh."""

    name: Name | None = optional("Its name, for normals that are its own")
    polygon: Annotated[list[_Place], Field(min_length=3)] | None = optional(
        "Its corners in turn: names of points, or coordinates [x, y, z]"
    )
    file: Text | None = optional("A mesh in the coordinates of the project: PLY or OBJ; may be .gz")
    unit: Literal["m", "dm", "cm", "mm", "um", "km", "ft", "us-ft", "in"] | None = optional(
        "Unit of the coordinates of the file; default that of the project"
    )

    @model_validator(mode="after")
    def _one_source(self) -> Surface:
        if (self.polygon is None) == (self.file is None):
            raise ValueError("give either a polygon or a file")
        if self.unit is not None and self.file is None:
            raise ValueError("unit belongs to a file; coordinates of polygons may have units of their own")
        return self


class Normals(TableEntry):
    """Normals of targets, which point to where they can be seen from: a table id, nx, ny, nz, or one for many."""

    points: list[Name] = several("Names, groups of points, or patterns, that direction or surface is for")
    direction: Annotated[list[float], Field(min_length=3, max_length=3)] | None = optional(
        "Their common normal [nx, ny, nz], of any length"
    )
    surface: Name | None = optional("The surface they are on: each has the normal of its face")

    @property
    def sources(self) -> dict[str, object]:
        """Sources of the normals by key; ``None`` if one is not given."""
        return {**super().sources, "direction": self.direction, "surface": self.surface}

    @model_validator(mode="after")
    def _points_of_one(self) -> Normals:
        if bool(self.points) == (self.file is not None or self.rows is not None):
            raise ValueError("points belong to a direction or a surface, which need them")
        return self


class Visibility(Strict):
    """Surfaces that block sights, and normals of targets."""

    surfaces: list[Surface] = several("What no sight goes through")
    normals: list[Normals] = several("Normals of targets; of a point that is named twice the last one")
    clearance: Measure = Field(
        "1 mm",
        description="A surface whose plane is as close to either end of a sight is not in its way: targets are on it",
    )


class Visible(Strict):
    """Everything that can be seen is observed: the limits of it."""

    at: list[Name] = Field(
        ["*"], description="Where sights begin: images, stations, systems or points, by the type; names or patterns"
    )
    to: list[Name] = Field(["*"], description="Targets: names, groups of points, or patterns")
    nearest: Measure | None = optional("Shortest sight")
    farthest: Measure | None = optional("Longest sight")
    incidence: Measure = Field(
        "100 gon", description="Largest angle between the normal of a target and the sight to it, where it has a normal"
    )
    border: Measure | None = optional("Margin of the image format that is left empty, image unit")
    steepest: Measure | None = optional("Largest angle of a sight of an instrument above or below the horizon")
    both_ways: bool = Field(False, description="Between points: each pair from either end, not only from the first one")


# ---- What a project file says of values with a status, and of the instruments that groups of observations share.


class Value(Strict):
    """A component with its status: exactly one of free, fixed, observed."""

    free: Measure | None = optional("Unknown, starting at this value")
    fixed: Measure | None = optional("Constant")
    observed: Measure | None = optional("Unknown, observed with sigma")
    sigma: Measure | None = optional("σ of an observed value; 0 means fixed")
    start: Measure | None = optional("Start value, where it differs from the observed one")

    @model_validator(mode="after")
    def _one_status(self) -> Value:
        given = [key for key in ("free", "fixed", "observed") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of free, fixed, observed")
        if (self.observed is not None) != (self.sigma is not None):
            raise ValueError("sigma belongs to an observed value, and an observed value needs one")
        return self


Setting = Measure | Value
"""A plain number (with the status its section says) or a value with its status."""


class Atmosphere(Strict):
    """Constants of the first velocity correction, which is computed from columns of the air."""

    C: float = required("Reference refractivity (n - 1) · 10⁶ of the instrument")
    D: float | None = optional("Constant of its carrier wavelength, K/hPa · 10⁶")
    wavelength: Measure | None = optional("Its carrier wavelength in place of D: 0.658 um")

    @model_validator(mode="after")
    def _one_of_both(self) -> Atmosphere:
        if (self.D is None) == (self.wavelength is None):
            raise ValueError("give either D or wavelength")
        return self


class Instrument(Strict):
    """Parameters that a group of distances or vertical angles shares; a plain number is fixed."""

    scale: Setting | None = optional("Distance scale m, s_obs = (s - a)/m")
    offset: Setting | None = optional("Zero offset a")
    refraction: Setting | None = optional("Refraction coefficient k")
    atmosphere: Atmosphere | None = optional(
        "C, and D or wavelength: distances with columns temperature (°C), pressure (hPa), humidity (%) or "
        "vapour_pressure (hPa) get their first velocity correction"
    )
    frame: dict[str, Setting] = several(
        "shift_x, shift_y, shift_z, turn_x, turn_y, turn_z and scale of the frame of a GNSS solution "
        "against that of the points, geocentric axes, about the middle of the network",
        of=dict,
    )
    lever_arm: dict[str, Setting] = several("rx, ry, rz from the trajectory to the antenna, its own axes", of=dict)
    boresight: dict[str, Setting] = several(
        "omega, phi, kappa from the axes of the trajectory to those of an inertial system", of=dict
    )
    position: dict[str, Setting] = several(
        "shift_x, shift_y, shift_z, drift_x, drift_y, drift_z of positions, of each strip its own", of=dict
    )
    attitude: dict[str, Setting] = several(
        "turn_x, turn_y, turn_z, turn_drift_x, turn_drift_y, turn_drift_z of attitudes, of each strip its own", of=dict
    )
    time_offset: Setting | None = optional("What is to be added to the times of the instrument, e.g. 20 ms")


class Centring(Strict):
    """Set-up errors of instrument and target, added to the σ of an observation as far as they act on it."""

    instrument: Measure = Field("0", description="σ of its horizontal position, in either coordinate")
    target: Measure = Field("0", description="The same of the target")
    instrument_height: Measure = Field("0", description="σ of the measured height of the instrument")
    target_height: Measure = Field("0", description="σ of the measured height of the target")


# ---- What a project file says of trajectories: their knots, how poses lie between them, how steady they are.


class Steadiness(Strict):
    """σ of differences of neighbouring knots, which are observed as 0."""

    position: Measure | None = optional("σ of x, y, z each, e.g. 0.5 m/s^2")
    attitude: Measure | None = optional("σ about each axis, e.g. 0.1 deg/s^2")


class TrajectoryEntry(TableEntry):
    """Knots of trajectories: trajectory, time, x, y, z, omega, phi, kappa; sigma columns make components observed."""

    fixed: list[Literal["x", "y", "z", "omega", "phi", "kappa"]] = several("Components held as they are")
    interpolation: Literal["linear", "cubic"] = Field("linear", description="Between two knots, or through four")
    spacing: Measure | None = optional(
        "Rows are no knots: there is one every so many seconds, free, starting between the rows"
    )
    gap: Measure | None = optional(
        "Knots (or rows) further apart than this belong to different stretches; nothing is in between"
    )
    constancy: Steadiness = Field(
        Steadiness.model_construct(), description="σ of velocity and rate of rotation between knots, observed as 0"
    )
    smoothness: Steadiness = Field(
        Steadiness.model_construct(), description="σ of acceleration and change of the rate of rotation, observed as 0"
    )


class LineTimes(TableEntry):
    """Table of line times of scanners whose rate is not steady: image, row, time; linear in between."""

    name: Text | None = optional("Name in messages; default the file")


# ---- The project file as a model: every key there is, its type and what it means. The JSON Schema is made from it.


class Units(Strict):
    """Units of all values that carry none of their own."""

    length: Literal["m", "dm", "cm", "mm", "um", "km", "ft", "us-ft", "in"] = Field(
        "m", description="Unit of lengths and coordinates"
    )
    angle: Literal["gon", "deg", "dms", "rad", "mrad", "mgon"] = Field("gon", description="Unit of angles")


class Axes(Strict):
    """Axes of the object system: compass directions of x and y, and how horizontal angles and bearings count."""

    xy: Literal["en", "nw", "ws", "se", "ne", "sw", "es", "wn"] = Field(
        "en", description="Directions of the x and y axes: en is x east, y north"
    )
    angles: Literal["clockwise", "counterclockwise"] = Field(
        "clockwise", description="How directions, horizontal angles and bearings count"
    )
    bearings_from: Literal["north", "east", "south", "west"] = Field(
        "north", description="Where bearings and orientations count from"
    )


class ImageFormat(Strict):
    """Size of the image and of a pixel; needed where image coordinates come in pixels."""

    width: Measure = required("Image width in px")
    height: Measure = required("Image height in px")
    pixel: Measure | None = optional("Size of one, e.g. 4.14 um; px need none")


class Camera(Strict):
    """A camera: its model, its interior orientation, and the coordinates it is measured in."""

    lens: Literal[
        "mor",
        "brown",
        "brown-4",
        "brown-5",
        "brown-forward",
        "opencv",
        "fisheye",
        "metashape",
        "thin-prism-fisheye",
        "rad-tan-thin-prism-fisheye",
        "fov",
        "panorama",
    ] = Field("mor", description="Camera model: how distortion is described", alias="model")
    medium: Literal["flat-port", "dome-port"] | None = optional(
        "Port of an underwater housing; its parameters belong to interior: tilt_x, tilt_y, distance, or "
        "centre_x, centre_y, centre_z, radius; glass, n_air, n_glass, n_water"
    )
    unit: Literal["mm", "um", "px", "m"] = Field("mm", description="Unit of interior orientation and residuals")
    image: ImageFormat | None = optional("Size of image and pixel")
    coordinates: Literal["centred", "corner"] = Field(
        "centred",
        description="centred: origin in the image centre, y up; corner: origin in the upper left corner, y down",
    )
    r0: Measure | None = optional("Second zero crossing of the radial distortion (model mor)")
    interior: dict[str, Setting] = several("c, xh, yh and distortion; a plain number is fixed", of=dict)
    focal_length: Measure | None = optional("As in EXIF, e.g. 28 mm: a start value of c where interior gives none")
    focal_length_35mm: float | None = optional(
        "35 mm equivalent as in EXIF; needs image; a start value of c as well", gt=0.0
    )
    eccentricity: dict[str, Setting] = several(
        "rx, ry, rz from the projection centre to the rotation centre, image axes", of=dict
    )
    readout: Setting | None = optional(
        "Time from the first row to the last of a rolling shutter, e.g. 30 ms; a plain number is fixed, "
        "0 (the default) is a global shutter"
    )
    readout_direction: Literal["down", "up", "right", "left"] = Field(
        "down", description="Where the readout goes in the image: down is from the top row to the bottom"
    )
    line_time: Measure | None = optional(
        "Of a line scanner: time from one line to the next, with its unit, e.g. 2 ms; a row of the image "
        "is a line, and x counts along it"
    )
    line: Measure | None = optional("y of the line of a scanner in the axes of the camera, e.g. 9.1 mm; default 0")
    image_variant: list[Text] | dict[str, Measure | None] = several(
        "Components that every image has of its own, with the σ of their difference from the camera's"
    )

    @property
    def model(self) -> str:
        """Key of the camera model: that of the lens, and of the port it is behind."""
        return f"{self.lens}+{self.medium}" if self.medium else self.lens

    @model_validator(mode="after")
    def _through_port(self) -> Camera:
        if self.medium and self.lens == "panorama":
            raise ValueError("medium: a panorama has no single projection centre and cannot be behind a port")
        return self


class Points(TableEntry):
    """Points: id, x, y, z; sigma columns make components observed."""

    fixed: list[Literal["x", "y", "z"]] = several("Components held as they are")
    group: Text | None = optional("Name of this class of points, to refer to in the datum")


_POSE = Literal["x", "y", "z", "omega", "phi", "kappa"]


_SET_UP = Literal["height", "rx", "ry", "rz", "vx", "vy", "vz", "rate_x", "rate_y", "rate_z"]


class Images(TableEntry):
    """Images: id, camera, x, y, z, omega, phi, kappa; sigma columns make components observed."""

    fixed: list[_POSE | _SET_UP] = several("Components held as they are")
    free: list[_SET_UP] = several(
        "Height, eccentricity and motion, constants without a σ, that are unknowns in this table"
    )


class Stations(TableEntry):
    """Theodolite stations or sets: id, point, height, set-up orientation."""

    level: Literal["fixed", "free"] | Measure = Field(
        "fixed", description="fixed: exactly levelled; a σ: level observed; free: full orientation"
    )
    fixed: list[_POSE | Literal["height"]] = several("Components held as they are")
    free: list[Literal["height"]] = several("[height]: instrument heights, constants without a σ, are unknowns here")


class Systems(TableEntry):
    """Local systems: id, x, y, z, omega, phi, kappa, scale; rx, ry, rz, the local coordinates of the origin."""

    fixed: list[_POSE | Literal["scale", "rx", "ry", "rz"]] = several("Components held as they are")
    free: list[Literal["rx", "ry", "rz"]] = several("Offsets, constants without a σ, that are unknowns in this table")


class Feature(Strict):
    """A geometric element that points lie on, with the σ of their distances from it."""

    type: Literal["plane", "line", "right angle", "circle", "sphere", "cylinder", "cone", "torus"] = required(
        "What the points lie on"
    )
    id: Name = required("Its name")
    points: list[Name] = required("Points on it, or on the first plane of a right angle")
    other: list[Name] = several("Points on the second plane of a right angle")
    sigma: Measure = required("σ of the distances of the points from it")
    radius: Setting | None = optional("Radius; of a torus that of its centre line; an unknown if not given")
    minor_radius: Setting | None = optional("Radius of the tube of a torus; an unknown if not given")
    semi_angle: Setting | None = optional("Angle between axis and surface of a cone; an unknown if not given")
    parallel: Name | None = optional("Feature above whose axis or normal is exactly parallel to the axis of this one")
    perpendicular: Name | None = optional(
        "Feature above whose axis or normal is exactly perpendicular to the axis of this one"
    )
    coaxial: Name | None = optional("Feature above that has exactly the same axis as this one")
    coplanar: Name | None = optional("Feature above whose plane this circle or torus lies in, exactly")


class Pairs(TableEntry):
    """Relative orientations of stereo pairs: id, bx, by, bz, omega, phi, kappa."""

    fixed: list[Literal["bx", "by", "bz", "omega", "phi", "kappa"]] = several("Components held as they are")


class Observations(TableEntry):
    """A group of observations of one type."""

    type: Text = required("Type of the observations: image, distance, directions and more")
    instrument: Name | None = optional("Name of the instrument they were measured with")
    ppm: float = Field(0.0, description="σ² = σ² + (ppm · 10⁻⁶ · distance)²", ge=0.0, le=1e50)
    centring: Centring | None = optional("Errors of the set-up of instrument and target")
    factor: float = Field(1.0, description="Factor on every σ of this group", gt=0.0, le=1e50)
    covariance: Text | list[list[float]] | None = optional(
        "Full covariance matrix over the observations of this group, or a CSV file with it"
    )
    cluster: Text | None = optional("Groups of one cluster name share one covariance matrix")
    projection: Text | None = optional(
        "Projection that projected_bearing refers to, where it is not that of world: EPSG code or WKT"
    )
    visible: Visible | None = optional("In place of a file or rows, for plans: everything that can be seen is observed")

    @property
    def sources(self) -> dict[str, object]:
        """Sources of the rows by key; ``None`` if one is not given."""
        return {**super().sources, "visible": self.visible}


class Datum(Strict):
    """Datum of a free or partly free network."""

    free: Literal["all"] | list[Name] | dict[Literal["x", "y", "z", "xy", "xz", "yz", "xyz"], list[Name]] = Field(
        "all",
        description="Points (or groups of points) whose coordinates carry the datum; "
        "by components where they differ: {xy: [1, 2], z: [3]}",
    )
    minimal: dict[Literal["x", "y", "z", "xy", "xz", "yz", "xyz"], Name | list[Name]] | None = optional(
        "As many coordinates as the network has free movements, held at their start values: {xyz: A, xy: B, z: C}"
    )
    components: list[Literal["x", "y", "z"]] = Field(
        ["x", "y", "z"], description="Components that carry it, where free names none"
    )
    movements: Literal["adjusted", "reference"] = Field(
        "adjusted", description="Coordinates at which shifts, rotations and scale of the inner constraints are taken"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Datum:
        if self.minimal is not None and "free" in self.model_fields_set:
            raise ValueError("give either free or minimal")
        return self


class Settings(Strict):
    """Settings of the solution and of the tests."""

    max_iterations: int = Field(50, description="Most iterations without progress; twice as many in all", ge=1)
    sigma0: float = Field(1.0, description="A-priori standard deviation of unit weight, as reported", gt=0.0, le=1e50)
    undeclared_points: Literal["mistake", "free"] = Field(
        "mistake", description="Points that observations name and no table of points has: a mistake, or free points"
    )
    dimensions: Literal["xyz", "xy", "z"] = Field("xyz", description="Coordinates that are estimated")
    undetermined: Literal["refuse", "leave_out"] = Field(
        "refuse",
        description="What becomes of things that nothing determines: they stop the adjustment, or are left out of it. "
        "Points at infinity take part with their direction, or are left out as well",
    )
    snooping_level: float = Field(0.001, description="α0 of the test of single observations", gt=0.0, lt=1.0)
    familywise_level: float | None = optional(
        "Level of the tests of all observations together (Šidák); it takes the place of snooping_level", gt=0.0, lt=1.0
    )
    power: float = Field(0.8, description="β0, power of that test", gt=0.0, lt=1.0)
    global_level: float = Field(0.05, description="Level of global and group tests", gt=0.0, lt=1.0)
    least_redundancy: float = Field(0.01, description="Least r that is a control", gt=0.0, lt=1.0)
    sigma: Literal["aposteriori", "apriori"] = Field(
        "aposteriori", description="Which σ0 the reported standard deviations are multiplied with"
    )
    snooping: bool = Field(False, description="Take flagged observations out one by one until nothing else is flagged")
    robust: Literal["l1", "danish"] | None = optional(
        "Robust solution to compare with, and to start data snooping from"
    )
    variance_components: Literal["report", "iterate"] = Field(
        "report", description="Estimated factors of the σ of each group: reported, or taken into the weights"
    )
    variance_method: Literal["simplified", "helmert"] = Field(
        "simplified",
        description="How they are estimated: each group by itself (Förstner), or by Helmert's full system, which tells "
        "groups apart that mix, up to 3 000 unknowns",
    )


class Report(Strict):
    """Names and remarks on the reports; they change no result."""

    operator: Text | None = optional("Who measured or adjusted")
    client: Text | None = optional("Whom it was done for")
    remarks: str | None = optional("Anything else, of several lines where wanted")
    relative: list[tuple[Name, Name]] = several(
        "Pairs of points whose distance, with σ, and relative error ellipse are reported"
    )


class ProjectFile(Strict):
    """A project file of mor, version 1."""

    model_config = ConfigDict(title="Project")

    mor: Literal["1"] = required("Version of the project file")
    title: str = Field("", description="Heads the reports")
    date: Text | None = optional("When the observations were made: a day, or a span of days; stands on the reports")
    report: Report = Field(
        Report.model_construct(), description="Operator, client and remarks that stand on the reports"
    )
    units: Units = Field(Units.model_construct(), description="Units of all values that carry none of their own")
    axes: Axes = Field(Axes.model_construct(), description="Axes of the object system, senses and zeros of angles")
    world: World | None = optional("Where on the earth the network is; without it its system is a plane of its own")
    curvature: bool | Curvature = Field(
        False,
        description="true: heights are above a sphere with the radius of the earth, and verticals differ from place to "
        "place; false: verticals are parallel. Not with world, where they are those of the ellipsoid",
    )
    cameras: dict[Name, Camera] = several("Cameras by name", of=dict)
    trajectories: list[TrajectoryEntry] = several("Tables of knots: poses as a function of time")
    images: list[Images] = several("Tables of images")
    line_times: list[LineTimes] = several("Tables of the times of lines of scanners: image, row, time")
    pairs: list[Pairs] = several("Tables of relative orientations of stereo images")
    points: list[Points] = several("Tables of points")
    stations: list[Stations] = several("Tables of theodolite stations")
    systems: list[Systems] = several("Tables of local systems")
    features: list[Feature] = several("Planes, lines, right angles and other shapes that points lie on")
    epochs: Epochs = Field(Epochs.model_construct(), description="Times of what is measured at several of them")
    motions: list[MotionEntry] = several("How points move between epochs")
    instruments: dict[Name, Instrument] = several("Instruments by name", of=dict)
    observations: list[Observations] = several("Tables of observations")
    checks: list[Observations] = several(
        "Observations kept out of the adjustment: check points (type coordinates), check distances"
    )
    candidates: list[Observations] = several(
        "Observations that a plan might have besides; mor design ranks them, no adjustment has them"
    )
    require: Require = Field(Require.model_construct(), description="What a plan has to reach, for mor design")
    variants: dict[Name, Variant] = several("What-if variants of a plan, which mor design puts side by side", of=dict)
    visibility: Visibility = Field(
        Visibility.model_construct(), description="What stands in the way of sights, and where targets look, for plans"
    )
    datum: Literal["fixed", "free"] | Datum = Field(
        "fixed", description="What holds the coordinates where the observations leave them free"
    )
    settings: Settings = Field(Settings.model_construct(), description="How to solve and to test")


# ---- JSON Schema of the project file.


def project_schema() -> str:
    """JSON Schema (2020-12) of the project file as text.

    Numbers may be written as numbers or as texts, as YAML has them.
    """
    lenient = _lenient(ProjectFile.model_json_schema())
    assert isinstance(lenient, dict)
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:mor:schema:project:1", **lenient}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _lenient(node: object) -> object:
    """Let numbers stand where texts are expected: YAML editors see 28.8 as a number, and version 1 as one."""
    if isinstance(node, list):
        return [_lenient(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: _lenient(value) for key, value in node.items()}
    if node.get("type") == "string":
        node["type"] = ["string", "number"]
    if node.get("const") == "1":
        node = {key: value for key, value in node.items() if key not in ("const", "type")} | {"enum": ["1", 1]}
    return node


# ---- From plain data to the model: all mistakes of a file at once, each with its line and the nearest known name.


def validate(document: Document) -> ProjectFile:
    """The model of a project. Raises :class:`InputError` with every mistake found."""
    known = _known_keys((), ProjectFile)
    if "mor" not in document.data and any(key not in known for key in document.data):
        # Keys that are named of a file that is no project.
        keys = ", ".join(map(str, list(document.data)[:8]))
        words = f"this is YAML, but no project file, which has the key mor (mor: 1); found the keys {keys}"
        raise InputError([Message(words, document.file, 1)])
    return validated(document, ProjectFile)


def validated(document: Document, model: type[Model]) -> Model:
    """The data of a document as a model. Raises :class:`InputError` with every mistake found."""
    try:
        found = model.model_validate(document.data)
    except ValidationError as error:
        details = _telling(document, error.errors(include_url=False))
        problems = dict.fromkeys([*document.problems, *_problems(document, details, model)])
        raise InputError(sorted(problems, key=lambda problem: problem.line)) from None
    if document.problems:
        raise InputError(document.problems)
    return found


def without_empty_keys(document: Document) -> Document:
    """The document without keys that have nothing behind them (``settings:``), where they are keys of the model.

    What is empty elsewhere has a meaning, as in ``columns``, or is a mistake, as a camera without any word.
    """
    return replace(document, data=_without_empty(document.data, ()))


def _without_empty(data: Any, path: KeyPath) -> Any:
    if isinstance(data, list):
        return [_without_empty(entry, (*path, k)) if isinstance(entry, dict) else entry for k, entry in enumerate(data)]
    if not isinstance(data, dict):
        return data
    known = set(_known_keys(path, ProjectFile))
    kept = {key: value for key, value in data.items() if value is not None or key not in known}
    return {key: _without_empty(value, (*path, key)) for key, value in kept.items()}


def _telling(document: Document, details: list[ErrorDetails]) -> list[ErrorDetails]:
    """Errors of a value that fits none of several types, for the type that it resembles only."""
    paths = [_data_path(document.data, detail) for detail in details]
    return [
        detail
        for detail, path in zip(details, paths, strict=True)
        if not _of_another_kind(detail)
        or not any(
            other is not detail
            and beneath[: len(path)] == path
            and (len(beneath) > len(path) or not _of_another_kind(other))
            for other, beneath in zip(details, paths, strict=True)
        )
    ]


def _of_another_kind(detail: ErrorDetails) -> bool:
    structured = isinstance(detail.get("input"), (dict, list))
    other_kind = {"string_type", "dict_type", "list_type", "model_type", "model_attributes_type"}
    return detail["type"] in other_kind or (detail["type"] == "literal_error" and structured)


def _problems(document: Document, details: list[ErrorDetails], model: type[BaseModel]) -> list[Message]:
    """One problem for every place; what a value may be instead is told together."""
    by_path: dict[KeyPath, list[ErrorDetails]] = {}
    for detail in details:
        by_path.setdefault(_data_path(document.data, detail), []).append(detail)
    problems = []
    for path, found in by_path.items():
        where = " → ".join(str(part + 1) if isinstance(part, int) else part for part in path)
        words = dict.fromkeys(_words(detail, path, where, model) for detail in found)
        opening = f"{where}: found {_short(found[0].get('input'))}, expected "
        if len(words) > 1 and all(text.startswith(opening) for text in words):
            words = {opening + ", or ".join(text.removeprefix(opening) for text in words): None}
        problems += [Message(text, document.file_of(path), document.line(path)) for text in words]
    return problems


def _words(detail: ErrorDetails, path: KeyPath, where: str, whole: type[BaseModel]) -> str:
    kind, given = detail["type"], detail.get("input")
    if kind == "extra_forbidden":
        known = _known_keys(path[:-1], whole)
        return f"unknown key {path[-1]!r}{nearest(str(path[-1]), known)} (known here: {', '.join(known)})"
    if kind == "missing":
        return f"{where or 'the project'}: this key is required"
    if kind == "value_error":
        return f"{where}: {detail['ctx']['error']}"
    context = detail.get("ctx", {})
    if kind == "literal_error":
        expected = context["expected"]
        choices = [choice.strip("' ") for choice in expected.replace(" or ", ", ").split(",")]
        return f"{where}: found {_short(given)}, expected {expected}{nearest(str(given), choices)}"
    message = detail["msg"]
    expected = _EXPECTED[kind].format(**context) if kind in _EXPECTED else message[0].lower() + message[1:]
    return f"{where}: found {_short(given)}, expected {expected}"


_EXPECTED = {
    **dict.fromkeys(("bool_parsing", "bool_type"), "true or false"),
    **dict.fromkeys(("dict_type", "model_attributes_type", "model_type"), "keys and values"),
    **dict.fromkeys(("float_parsing", "float_type"), "a number"),
    **dict.fromkeys(("int_from_float", "int_parsing", "int_type"), "a whole number"),
    "date_from_datetime_parsing": "a date such as 2026-03-01",
    "finite_number": "a finite number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "{le:g} or less",
    "list_type": "a list",
    "string_pattern_mismatch": "a number, with or without a unit",
    "string_too_long": "a single character",
    "string_too_short": "a text that is not empty",
    "string_type": "a single value",
}
"""Expected values by type of error of pydantic, in the words of a project file."""


def _short(given: Any) -> str:
    if given is None:
        return "nothing"
    if isinstance(given, (dict, list)):
        return "keys and values" if isinstance(given, dict) else "a list"
    text = repr(given)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _data_path(data: Any, detail: ErrorDetails) -> KeyPath:
    """The part of pydantic's location that is a path in the data: names of union members are dropped."""
    path: list[str | int] = []
    for number, part in enumerate(detail["loc"]):
        missing = detail["type"] == "missing" and number == len(detail["loc"]) - 1
        if isinstance(data, dict) and (part in data or missing):
            data = data.get(part)
            path.append(part)
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
            path.append(part)
    return tuple(path)


def _known_keys(path: KeyPath, whole: type[BaseModel]) -> list[str]:
    model: Any = whole
    for part in path:
        if isinstance(model, type) and issubclass(model, BaseModel) and part in model.model_fields:
            model = model.model_fields[str(part)].annotation
        model = _model_within(model)
        if model is None:
            return []
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        return []
    return [field.alias or name for name, field in model.model_fields.items()]


def _model_within(annotation: Any) -> Any:
    """The model an annotation such as ``list[Points]`` or ``str | Datum`` leads to."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in get_args(annotation):
        found = _model_within(argument)
        if found is not None:
            return found
    return None
