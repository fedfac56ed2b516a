"""The project file as a model: every key there is, its type and what it means. The JSON Schema is made from it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from mor.project.file.earth import Curvature, World
from mor.project.file.model_instruments import Centring, Instrument, Setting
from mor.project.file.model_trajectories import LineTimes, Trajectory
from mor.project.file.motions import Epochs, Motion
from mor.project.file.plans import Require, Variant
from mor.project.file.scalars import Measure, Name, Strict, Text
from mor.project.file.table import Table
from mor.project.file.visibility import Visibility, Visible


class Units(Strict):
    """Units of all values that carry none of their own."""

    length: Literal["m", "dm", "cm", "mm", "um", "km", "ft", "us-ft", "in"] = Field(
        default="m", description="Unit of lengths and coordinates"
    )
    angle: Literal["gon", "deg", "dms", "rad", "mrad", "mgon"] = Field(
        default="gon", description="Unit of angles"
    )


class Axes(Strict):
    """Axes of the object system: compass directions of x and y, and how horizontal angles and bearings count."""

    xy: Literal["en", "nw", "ws", "se", "ne", "sw", "es", "wn"] = Field(
        default="en", description="Directions of the x and y axes: en is x east, y north"
    )
    angles: Literal["clockwise", "counterclockwise"] = Field(
        default="clockwise", description="How directions, horizontal angles and bearings count"
    )
    bearings_from: Literal["north", "east", "south", "west"] = Field(
        default="north", description="Where bearings and orientations count from"
    )


class ImageFormat(Strict):
    """Size of the image and of a pixel; needed where image coordinates come in pixels."""

    width: Measure = Field(description="Image width in px")
    height: Measure = Field(description="Image height in px")
    pixel: Measure | None = Field(default=None, description="Size of one, e.g. 4.14 um; px need none")


class Camera(Strict):
    """A camera: its model, its interior orientation, and the coordinates it is measured in."""

    model: Literal[
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
    ] = Field(default="mor", description="Camera model: how distortion is described")
    unit: Literal["mm", "um", "px", "m"] = Field(
        default="mm", description="Unit of interior orientation and residuals"
    )
    image: ImageFormat | None = Field(default=None, description="Size of image and pixel")
    coordinates: Literal["centred", "corner"] = Field(
        default="centred",
        description="centred: origin in the image centre, y up; corner: origin in the upper left corner, y down",
    )
    r0: Measure | None = Field(
        default=None, description="Second zero crossing of the radial distortion (model mor)"
    )
    interior: dict[str, Setting] = Field(
        description="c, xh, yh and distortion; a plain number is fixed", default_factory=dict
    )
    focal_length: Measure | None = Field(
        default=None, description="As in EXIF, e.g. 28 mm: a start value of c where interior gives none"
    )
    focal_length_35mm: float | None = Field(
        default=None,
        gt=0.0,
        description="35 mm equivalent as in EXIF; needs image; a start value of c as well",
    )
    eccentricity: dict[str, Setting] = Field(
        default_factory=dict,
        description="rx, ry, rz from the projection centre to the rotation centre, image axes",
    )
    readout: Setting | None = Field(
        default=None,
        description="Time from the first row to the last of a rolling shutter, e.g. 30 ms; a plain number is fixed, "
        "0 (the default) is a global shutter",
    )
    readout_direction: Literal["down", "up", "right", "left"] = Field(
        default="down",
        description="Where the readout goes in the image: down is from the top row to the bottom",
    )
    line_time: Measure | None = Field(
        default=None,
        description="Of a line scanner: time from one line to the next, with its unit, e.g. 2 ms; a row of the image "
        "is a line, and x counts along it",
    )
    line: Measure | None = Field(
        default=None,
        description="y of the line of a scanner in the axes of the camera, e.g. 9.1 mm; default 0",
    )
    image_variant: list[Text] | dict[str, Measure | None] = Field(
        default_factory=list,
        description="Components that every image has of its own, with the σ of their difference from the camera's",
    )


class Points(Table):
    """Points: id, x, y, z; sigma columns make components observed."""

    fixed: list[Literal["x", "y", "z"]] = Field(
        default_factory=list, description="Components held as they are"
    )
    group: Text | None = Field(
        default=None, description="Name of this class of points, to refer to in the datum"
    )


_POSE = Literal["x", "y", "z", "omega", "phi", "kappa"]


_SET_UP = Literal["height", "rx", "ry", "rz", "vx", "vy", "vz", "rate_x", "rate_y", "rate_z"]


class Images(Table):
    """Images: id, camera, x, y, z, omega, phi, kappa; sigma columns make components observed."""

    fixed: list[_POSE | _SET_UP] = Field(default_factory=list, description="Components held as they are")
    free: list[_SET_UP] = Field(
        default_factory=list,
        description="Height, eccentricity and motion, constants without a σ, that are unknowns in this table",
    )


class Stations(Table):
    """Theodolite stations or sets: id, point, height, set-up orientation."""

    level: Literal["fixed", "free"] | Measure = Field(
        default="fixed", description="fixed: exactly levelled; a σ: level observed; free: full orientation"
    )
    fixed: list[_POSE | Literal["height"]] = Field(
        default_factory=list, description="Components held as they are"
    )
    free: list[Literal["height"]] = Field(
        default_factory=list,
        description="[height]: instrument heights, constants without a σ, are unknowns here",
    )


class Systems(Table):
    """Local systems: id, x, y, z, omega, phi, kappa, scale; rx, ry, rz, the local coordinates of the origin."""

    fixed: list[_POSE | Literal["scale", "rx", "ry", "rz"]] = Field(
        default_factory=list, description="Components held as they are"
    )
    free: list[Literal["rx", "ry", "rz"]] = Field(
        default_factory=list, description="Offsets, constants without a σ, that are unknowns in this table"
    )


class Feature(Strict):
    """A plane, a line or a right angle that points lie on, with the σ of their distances from it."""

    type: Literal["plane", "line", "right angle"] = Field(description="What the points lie on")
    id: Name = Field(description="Its name")
    points: list[Name] = Field(description="Points on the plane, on the line, or on the first plane")
    other: list[Name] = Field(default_factory=list, description="Points on the second plane of a right angle")
    sigma: Measure = Field(description="σ of the distances of the points from it")


class Pairs(Table):
    """Relative orientations of stereo pairs: id, bx, by, bz, omega, phi, kappa."""

    fixed: list[Literal["bx", "by", "bz", "omega", "phi", "kappa"]] = Field(
        default_factory=list, description="Components held as they are"
    )


class Observations(Table):
    """A group of observations of one type."""

    type: Text = Field(description="Type of the observations: image, distance, directions and more")
    instrument: Name | None = Field(
        default=None, description="Name of the instrument they were measured with"
    )
    ppm: float = Field(default=0.0, ge=0.0, le=1e50, description="σ² = σ² + (ppm · 10⁻⁶ · distance)²")
    centring: Centring | None = Field(
        default=None, description="Errors of the set-up of instrument and target"
    )
    factor: float = Field(default=1.0, gt=0.0, le=1e50, description="Factor on every σ of this group")
    covariance: Text | list[list[float]] | None = Field(
        default=None,
        description="Full covariance matrix over the observations of this group, or a CSV file with it",
    )
    cluster: Text | None = Field(
        default=None, description="Groups of one cluster name share one covariance matrix"
    )
    projection: Text | None = Field(
        default=None,
        description="Projection that projected_bearing refers to, where it is not that of world: EPSG code or WKT",
    )
    visible: Visible | None = Field(
        default=None,
        description="In place of a file or rows, for plans: everything that can be seen is observed",
    )

    @property
    def sources(self) -> dict[str, object]:
        """What the rows may come from, by its key; ``None`` if it is not given."""
        return {**super().sources, "visible": self.visible}


class Datum(Strict):
    """Datum of a free or partly free network."""

    free: Literal["all"] | list[Name] | dict[Literal["x", "y", "z", "xy", "xz", "yz", "xyz"], list[Name]] = (
        Field(
            default="all",
            description="Points (or groups of points) whose coordinates carry the datum; "
            "by components where they differ: {xy: [1, 2], z: [3]}",
        )
    )
    minimal: dict[Literal["x", "y", "z", "xy", "xz", "yz", "xyz"], Name | list[Name]] | None = Field(
        default=None,
        description="As many coordinates as the network has free movements, held at their start values: "
        "{xyz: A, xy: B, z: C}",
    )
    components: list[Literal["x", "y", "z"]] = Field(
        default=["x", "y", "z"], description="Components that carry it, where free names none"
    )
    movements: Literal["adjusted", "reference"] = Field(
        default="adjusted",
        description="Coordinates at which shifts, rotations and scale of the inner constraints are taken",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Datum:
        if self.minimal is not None and "free" in self.model_fields_set:
            raise ValueError("give either free or minimal")
        return self


class Settings(Strict):
    """How to solve and to test."""

    max_iterations: int = Field(default=50, ge=1, description="Most iterations without progress")
    sigma0: float = Field(
        default=1.0, gt=0.0, le=1e50, description="A-priori standard deviation of unit weight, as reported"
    )
    undeclared_points: Literal["mistake", "free"] = Field(
        default="mistake",
        description="Points that observations name and no table of points has: a mistake, or free points",
    )
    dimensions: Literal["xyz", "xy", "z"] = Field(default="xyz", description="Coordinates that are estimated")
    undetermined: Literal["refuse", "leave_out"] = Field(
        default="refuse",
        description="What becomes of things that nothing determines: they stop the adjustment, or are left out of it. "
        "Points at infinity take part with their direction, or are left out as well",
    )
    snooping_level: float = Field(
        default=0.001, gt=0.0, lt=1.0, description="α0 of the test of single observations"
    )
    familywise_level: float | None = Field(
        default=None,
        gt=0.0,
        lt=1.0,
        description="Level of the tests of all observations together (Šidák); it takes the place of snooping_level",
    )
    power: float = Field(default=0.8, gt=0.0, lt=1.0, description="β0, power of that test")
    global_level: float = Field(default=0.05, gt=0.0, lt=1.0, description="Level of global and group tests")
    least_redundancy: float = Field(default=0.01, gt=0.0, lt=1.0, description="Least r that is a control")
    sigma: Literal["aposteriori", "apriori"] = Field(
        default="aposteriori", description="Which σ0 the reported standard deviations are multiplied with"
    )
    snooping: bool = Field(
        default=False, description="Take flagged observations out one by one until the rest is clean"
    )
    robust: Literal["l1", "danish"] | None = Field(
        default=None, description="Robust solution to compare with, and to start data snooping from"
    )
    variance_components: Literal["report", "iterate"] = Field(
        default="report",
        description="Estimated factors of the σ of each group: reported, or taken into the weights",
    )
    variance_method: Literal["simplified", "helmert"] = Field(
        default="simplified",
        description="How they are estimated: each group by itself (Förstner), or by Helmert's full system, which tells "
        "groups apart that mix, up to 3 000 unknowns",
    )


class Report(Strict):
    """Who and what stands on the reports; nothing of it changes a result."""

    operator: Text | None = Field(default=None, description="Who measured or adjusted")
    client: Text | None = Field(default=None, description="Whom it was done for")
    remarks: str | None = Field(default=None, description="Anything else, of several lines where wanted")
    relative: list[tuple[Name, Name]] = Field(
        default_factory=list,
        description="Pairs of points whose distance, with σ, and relative error ellipse are reported",
    )


class Project(Strict):
    """A project file of mor, version 1."""

    mor: Literal["1"] = Field(description="Version of the project file")
    title: str = Field(default="", description="Heads the reports")
    date: Text | None = Field(
        default=None,
        description="When the observations were made: a day, or a span of days; stands on the reports",
    )
    report: Report = Field(
        default=Report.model_construct(), description="Operator, client and remarks that stand on the reports"
    )
    units: Units = Field(
        default=Units.model_construct(), description="Units of all values that carry none of their own"
    )
    axes: Axes = Field(
        default=Axes.model_construct(), description="Axes of the object system, senses and zeros of angles"
    )
    world: World | None = Field(
        default=None,
        description="Where on the earth the network is; without it its system is a plane of its own",
    )
    curvature: bool | Curvature = Field(
        default=False,
        description="true: heights are above a sphere with the radius of the earth, and verticals differ from place to "
        "place; false: verticals are parallel. Not with world, where they are those of the ellipsoid",
    )
    cameras: dict[Name, Camera] = Field(default_factory=dict, description="Cameras by name")
    trajectories: list[Trajectory] = Field(
        default_factory=list, description="Tables of knots: poses as a function of time"
    )
    images: list[Images] = Field(default_factory=list, description="Tables of images")
    line_times: list[LineTimes] = Field(
        default_factory=list, description="Tables of the times of lines of scanners: image, row, time"
    )
    pairs: list[Pairs] = Field(
        default_factory=list, description="Tables of relative orientations of stereo images"
    )
    points: list[Points] = Field(default_factory=list, description="Tables of points")
    stations: list[Stations] = Field(default_factory=list, description="Tables of theodolite stations")
    systems: list[Systems] = Field(default_factory=list, description="Tables of local systems")
    features: list[Feature] = Field(
        default_factory=list, description="Planes, lines and right angles that points lie on"
    )
    epochs: Epochs = Field(
        default=Epochs.model_construct(), description="Times of what is measured at several of them"
    )
    motions: list[Motion] = Field(default_factory=list, description="How points move between epochs")
    instruments: dict[Name, Instrument] = Field(default_factory=dict, description="Instruments by name")
    observations: list[Observations] = Field(default_factory=list, description="Tables of observations")
    checks: list[Observations] = Field(
        default_factory=list,
        description="Observations kept out of the adjustment: check points (type coordinates), check distances",
    )
    candidates: list[Observations] = Field(
        default_factory=list,
        description="Observations that a plan might have besides; mor design ranks them, no adjustment has them",
    )
    require: Require = Field(
        default=Require.model_construct(), description="What a plan has to reach, for mor design"
    )
    variants: dict[Name, Variant] = Field(
        default_factory=dict, description="What-if variants of a plan, which mor design puts side by side"
    )
    visibility: Visibility = Field(
        default=Visibility.model_construct(),
        description="What stands in the way of sights, and where targets look, for plans",
    )
    datum: Literal["fixed", "free"] | Datum = Field(
        default="fixed", description="What holds the coordinates where the observations leave them free"
    )
    settings: Settings = Field(default=Settings.model_construct(), description="How to solve and to test")
