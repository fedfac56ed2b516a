"""A building measured from all sides: images, total station, levelling, scale bars in one adjustment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sample_projects.simulate.building_site import (
    BARS,
    BOLTS,
    CAMERA,
    NETWORK,
    OBSTACLES,
    details,
    frames,
    targets,
)
from sample_projects.simulate.camera import Camera, sees
from sample_projects.simulate.files import (
    IMAGE_HEADER,
    camera_table,
    image_row,
    number,
    numbers,
    parameter_table,
    point_table,
    table,
)
from sample_projects.simulate.geometry import GON, Array, Frame, Mask, disturbed, hidden_by_post, incidence
from sample_projects.simulate.rays import measured, seen_points, with_enough_rays
from sample_projects.simulate.survey import Sight, read, sight, theodolite, with_centring

SIGMA = 0.0021
"""mm in the image, 0.35 pixels."""
DIRECTION, DISTANCE, PPM = 0.0005 * GON, 0.002, 2.0
CENTRING = 0.0007
ZERO_OFFSET = -0.0134
"""The instrument was used with the constant of another prism: s_obs = s − a."""
LEVELLING = 0.0006
"""σ of a levelled height difference, one line."""
BAR_SIGMA = 0.0001


class Setup(NamedTuple):
    """A set-up of the total station."""

    mark: Array
    height: float
    orientation: float
    tilt: tuple[float, float]
    two_faces: bool


SETUPS = {
    "S1": Setup(np.array([13.4, -15.8, 100.3]), 0.0, 57.3121 * GON, (0.0, 0.0), False),
    "S2": Setup(np.array([11.9, 34.6, 100.9]), 0.0, 371.0442 * GON, (0.0312 * GON, -0.0447 * GON), False),
    "S3": Setup(NETWORK["N2"], 1.612, 214.8090 * GON, (0.0, 0.0), True),
}
POLES = {"N1": 1.500, "N2": 1.500, "N3": 1.625, "N4": 1.500}
"""Heights of the prisms above the network points."""
SEEN_FROM = {"S1": ("N1", "N4", "N3"), "S2": ("N2", "N3", "N1"), "S3": ("N3", "N4")}
LEVEL_LINES = (
    ("BM", "N1"),
    ("N1", "HB1"),
    ("HB1", "N4"),
    ("N4", "N2"),
    ("N2", "HB2"),
    ("HB2", "N3"),
    ("N3", "BM"),
)
BENCHMARK = np.array([-25.0, -20.0, 99.4820])


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2404)
    plates, normals = targets()
    natural, natural_normals = details(random)
    on_building = {**plates, **BOLTS[0], **BARS[0], **natural}
    facing = np.concatenate([normals, BOLTS[1], BARS[1], natural_normals])
    images = frames(random)

    def visible(camera: Camera, frame: Frame) -> Mask:
        points = np.stack(list(on_building.values()))
        seen = sees(camera, frame, points, facing, 75.0 * GON)
        for post in OBSTACLES:
            seen &= ~hidden_by_post(points, frame.position, post)
        return seen

    drop = np.array([0.08 if name in natural else 0.0 for name in on_building])
    rays = measured({n: (CAMERA, f) for n, f in images.items()}, on_building, visible, SIGMA, random, drop)
    seen = seen_points(with_enough_rays(rays, 3), on_building)
    rays = [ray for ray in rays if ray.point in seen]
    survey = _survey(plates, normals, random)
    start = {n: p + 0.05 * random.standard_normal(3) for n, p in seen.items()}
    stations = {"S1": SETUPS["S1"].mark, "S2": SETUPS["S2"].mark}
    network = {n: NETWORK[n] + np.array([0.003, 0.003, 0.05]) * random.standard_normal(3) for n in NETWORK}
    return {
        "images.csv": table(
            IMAGE_HEADER,
            [image_row(n, "N24", disturbed(f, random, 0.2, GON), 2, GON, 1) for n, f in images.items()],
        ),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *numbers(r.xy, 4)] for r in rays)),
        "network.csv": point_table(network, 3),
        "building.csv": point_table(start, 2),
        **survey,
        "levelling.csv": table("from,to,dz,sigma", _levelling(random)),
        "scale_bars.csv": table("from,to,distance,sigma", _bars(random)),
        "truth/points.csv": point_table({**NETWORK, "BM": BENCHMARK, **seen}, 5),
        "truth/stations.csv": point_table(stations, 5),
        "truth/images.csv": table(IMAGE_HEADER, [image_row(n, "N24", f, 5, GON, 7) for n, f in images.items()]),
        "truth/cameras.csv": camera_table({"N24": CAMERA}),
        "truth/parameters.csv": parameter_table({("distance meter", "prism", "offset"): ZERO_OFFSET}),
    }


def _survey(plates: dict[str, Array], normals: Array, random: np.random.RandomState) -> dict[str, str]:
    """Readings to prisms over network points, with target heights, and without reflector to the plates."""
    to_network, to_plates, over_network, over_plates = [], [], [], []
    plain = Sight(DIRECTION, DIRECTION, DISTANCE)
    for name, setup in SETUPS.items():
        instrument = theodolite(setup.mark, setup.height, setup.orientation, setup.tilt)
        faces = (False, True) if setup.two_faces else (False,)
        for point in SEEN_FROM[name]:
            true = sight(instrument, NETWORK[point] + np.array([0.0, 0.0, POLES[point]]))
            sigma = with_centring(plain, true.distance, PPM, CENTRING, CENTRING)
            readings = [read(true, sigma, random, face) for face in faces]
            heights = [number(POLES[point], 3)]
            to_network += [[name, point, *_circles(reading), *heights] for reading in readings]
            over_network.append([name, point, number(readings[0].distance - ZERO_OFFSET, 4), *heights])
        steep = incidence(np.stack(list(plates.values())), normals, instrument.position)
        for (point, xyz), angle in zip(plates.items(), steep, strict=True):
            if angle > 76.0 * GON:
                continue
            true = sight(instrument, xyz)
            sigma = with_centring(plain, true.distance, PPM, 0.0, 0.0)
            readings = [read(true, sigma, random, face) for face in faces]
            to_plates += [[name, point, *_circles(reading)] for reading in readings]
            over_plates.append([name, point, number(readings[0].distance, 4)])
    return {
        "directions_network.csv": table("station,to,horizontal,zenith,to_height", to_network),
        "directions_plates.csv": table("station,to,horizontal,zenith", to_plates),
        "distances_network.csv": table("from,to,distance,to_height", over_network),
        "distances_plates.csv": table("from,to,distance", over_plates),
    }


def _circles(reading: Sight) -> list[str]:
    return numbers((reading.horizontal / GON, reading.zenith / GON), 4)


def _levelling(random: np.random.RandomState) -> list[list[str]]:
    heights = {"BM": BENCHMARK, **NETWORK, **BOLTS[0]}
    rows = []
    for one, other in LEVEL_LINES:
        difference = heights[other][2] - heights[one][2] + LEVELLING * random.standard_normal()
        rows.append([one, other, number(difference, 4), f"{LEVELLING:g}"])
    return rows


def _bars(random: np.random.RandomState) -> list[list[str]]:
    names, ends = list(BARS[0]), list(BARS[0].values())
    rows = []
    for k in (0, 2):
        length = float(np.linalg.norm(ends[k + 1] - ends[k])) + BAR_SIGMA * random.standard_normal()
        rows.append([names[k], names[k + 1], number(length, 5), f"{BAR_SIGMA:g}"])
    return rows
