"""A dam over ten epochs: theodolites, distances and levelling every five months, images in the first and the last."""

from __future__ import annotations

import numpy as np

from sample_projects.simulate import dam_site as site
from sample_projects.simulate.camera import Camera, sees
from sample_projects.simulate.files import camera_table, number, numbers, point_table, table
from sample_projects.simulate.geometry import DEGREE, GON, Array, Frame, Mask, incidence
from sample_projects.simulate.rays import measured
from sample_projects.simulate.survey import Sight, read, sight, theodolite

EPOCHS = (
    *("2019-04", "2019-09", "2020-02", "2020-07", "2020-12"),
    *("2021-05", "2021-10", "2022-03", "2022-08", "2023-01"),
)
FLIGHTS = (EPOCHS[0], EPOCHS[-1])
SLIDE = ("P4", "2021-07", np.array([0.0028, -0.0041, -0.0022]))
"""A pillar on the slope that slid, when, and how far (m)."""
DIRECTION, ZENITH = 0.0003 * GON, 0.0005 * GON
DISTANCE, PPM = 0.0008, 1.0
LEVELLING = 0.0003
SIGMA = 0.0013
"""mm in the image."""
LINES = (
    ("P4", "P2"),
    ("P2", "K5"),
    ("K5", "K4"),
    ("K4", "K3"),
    ("K3", "K2"),
    ("K2", "K1"),
    ("K1", "P1"),
    ("P1", "P3"),
)
_MIDDLE = ("03", "04", "05")
"""Images of a row that see most of the plates."""
INSTRUMENTS = ("P1", "P2", "P3", "P4")


def year(epoch: str) -> float:
    """Years at the first day of a month, counted by days."""
    first = np.datetime64(f"{epoch}-01", "D")
    begin, end = (np.datetime64(f"{int(epoch[:4]) + k}-01-01", "D") for k in (0, 1))
    return int(epoch[:4]) + float((first - begin) / np.timedelta64(1, "D")) / float(
        (end - begin) / np.timedelta64(1, "D")
    )


def bend(point: Array) -> float:
    """How much of the movement of the middle of the crest a place of the dam has."""
    angle = np.arctan2(point[0], point[1] + site.RADIUS)
    return float((point[2] / site.HEIGHT) ** 2 * np.cos(2.1 * angle) ** 2)


def velocity(name: str, point: Array) -> Array:
    """Metres in a year: the arch yields downstream; the two lower rows of plates, near the abutments, hardly."""
    if name[0] not in "KT":
        return np.zeros(3)
    return 0.0011 * bend(point) * site.normal(point) + np.array([0.0, 0.0, -0.0002 * bend(point)])


def oscillation(name: str, point: Array) -> tuple[Array, Array]:
    """Sine and cosine (m) of the year: full reservoir in autumn, warm concrete in summer; crest and upper plates."""
    if not name.startswith(("K", "T3", "T4")):
        return np.zeros(3), np.zeros(3)
    out = bend(point) * site.normal(point)
    up = np.array([0.0, 0.0, point[2] / site.HEIGHT])
    return -0.0042 * out - 0.0003 * up, 0.0021 * out - 0.0012 * up


def place(name: str, point: Array, epoch: str) -> Array:
    """Where a point is in an epoch; its coordinates are those of the first one."""
    t, turn = year(epoch) - year(EPOCHS[0]), 2.0 * np.pi * year(epoch)
    sine, cosine = oscillation(name, point)
    moved = point + t * velocity(name, point) + np.sin(turn) * sine + np.cos(turn) * cosine
    return moved + (SLIDE[2] if name == SLIDE[0] and year(epoch) >= year(SLIDE[1]) else 0.0)


def simulate(seed: int = 2420) -> dict[str, str]:
    """Files of the sample; another seed gives other errors of the same measurements."""
    layout, random = np.random.RandomState(2419), np.random.RandomState(seed)
    points = {**site.PILLARS, **site.crest(), **site.targets()}
    directions, distances, heights = [], [], []
    for epoch in EPOCHS:
        now = {name: place(name, point, epoch) for name, point in points.items()}
        for row in _theodolites(now, random):
            directions.append([epoch, row[0], epoch, *row[1:4]])
            distances.append([epoch, row[0], row[1], row[4]])
        for one, other in LINES:
            rise = now[other][2] - now[one][2] + LEVELLING * random.standard_normal()
            heights.append([epoch, one, other, number(rise, 5)])
    images = _images(points, layout, random)
    start = {name: site.PILLARS[name] + 0.5 * layout.standard_normal(3) for name in site.PILLARS}
    after = {f"{SLIDE[0]}@{SLIDE[1]}": site.PILLARS[SLIDE[0]] + SLIDE[2]}
    return {
        "pillars.csv": point_table(start, 1),
        "marks.csv": table("id", ([name] for name in points if name not in site.PILLARS)),
        "directions.csv": table("epoch,station,set,to,horizontal,zenith", directions),
        "distances.csv": table("epoch,from,to,distance", distances),
        "levelling.csv": table("epoch,from,to,dz", heights),
        **images,
        "truth/points.csv": point_table({**points, **after}, 6),
        "truth/motions.csv": _true_motions(points),
        "truth/cameras.csv": camera_table({"M3": site.CAMERA}),
    }


def _theodolites(now: dict[str, Array], random: np.random.RandomState) -> list[list[str]]:
    """Station, target, circles and distance of one epoch; prisms stand as high above their bolts as instruments."""
    rows = []
    for name in INSTRUMENTS:
        instrument = theodolite(now[name], 0.0, float(random.uniform(0.0, 400.0)) * GON)
        for other, point in now.items():
            if other == name or (other[0] == "T" and not _faces(point, now[name])):
                continue
            true = sight(instrument, point)
            along = float(np.hypot(DISTANCE, PPM * 1e-6 * true.distance))
            reading = read(true, Sight(DIRECTION, ZENITH, along), random)
            circles = numbers((reading.horizontal / GON, reading.zenith / GON), 5)
            rows.append([name, other, *circles, number(reading.distance, 4)])
    return rows


def _faces(point: Array, place: Array) -> bool:
    return float(incidence(point[None], site.normal(point)[None], place)[0]) < 60.0 * DEGREE


def _images(points: dict[str, Array], layout: np.random.RandomState, random: np.random.RandomState) -> dict[str, str]:
    """Images of the plates by an aircraft in two of the epochs."""
    plates = {name: point for name, point in points.items() if name[0] == "T"}
    facing = np.stack([site.normal(point) for point in plates.values()])
    rows, names = [], []
    for epoch in FLIGHTS:
        now = {name: place(name, point, epoch) for name, point in plates.items()}
        places = np.stack(list(now.values()))

        def visible(camera: Camera, frame: Frame, places: Array = places) -> Mask:
            return sees(camera, frame, places, facing, 70.0 * DEGREE)

        flown = {name: frame for name, frame in site.frames(layout).items() if name[0] in "23" and name[1:] in _MIDDLE}
        shots = {f"{epoch[2:4]}{epoch[5:]}_{name}": (site.CAMERA, frame) for name, frame in flown.items()}
        rays = measured(shots, now, visible, SIGMA, random, 0.05)
        rows += [[ray.image, ray.point, *numbers(ray.xy, 4)] for ray in rays]
        names += [[name, "M3", epoch] for name in shots]
    return {"images.csv": table("id,camera,epoch", names), "image_points.csv": table("image,point,x,y", rows)}


def _true_motions(points: dict[str, Array]) -> str:
    rows = []
    for name, point in points.items():
        vectors = {"velocity": velocity(name, point)}
        vectors |= dict(zip(("sine", "cosine"), oscillation(name, point), strict=True))
        rows += [[name, key, *numbers(v, 7)] for key, v in vectors.items() if np.abs(v).max() > 0.0]
    return table("point,parameter,x,y,z", rows)
