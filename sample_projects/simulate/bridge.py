"""A bridge in its valley: pillars and bolts by directions and zenith angles, distances between the pillars."""

from __future__ import annotations

import numpy as np

from sample_projects.simulate.files import number, numbers, point_table, table
from sample_projects.simulate.geometry import GON, Array
from sample_projects.simulate.survey import Sight, read, sight, theodolite

DIRECTION, ZENITH = 0.0003 * GON, 0.0005 * GON
"""σ of the mean of two sets in both faces."""
DISTANCE, PPM = 0.0008, 1.0
HEIGHT = 0.0003
"""σ of the height of a target above its bolt, put up anew for every sight."""

PILLARS = {
    "P1": np.array([1000.0, 500.0, 220.4]),
    "P2": np.array([1148.0, 468.0, 223.9]),
    "P3": np.array([1212.0, 560.0, 231.2]),
    "P4": np.array([1102.0, 640.0, 218.7]),
    "P5": np.array([984.0, 598.0, 226.5]),
}
INSTRUMENT = {"P1": 0.2462, "P2": 0.2451, "P3": 0.2478, "P4": 0.2455, "P5": 0.2449}
"""Trunnion axis above the bolt of the pillar."""
TARGET = {"P1": 0.2120, "P2": 0.2115, "P3": 0.2131, "P4": 0.2122, "P5": 0.2118}
"""Prism and target mark above the bolt of the pillar."""
PIERS = {"N": (1072.0, 585.0), "S": (1106.0, 532.0)}
UNSEEN = {("P1", "NE"), ("P3", "SW"), ("P2", "NW"), ("P4", "SE"), ("P5", "SE"), ("P5", "NE"), ("P1", "SE")}
"""Sides of the piers that a pillar does not see."""


def bolts() -> dict[str, Array]:
    """Bolts east and west in the piers N and S, at three heights."""
    result = {}
    for pier, (x, y) in PIERS.items():
        for side, off in (("E", 1.6), ("W", -1.6)):
            for k, z in enumerate((222.5, 232.0, 241.5), start=1):
                result[f"{pier}{side}{k}"] = np.array([x + off, y + 0.2 * off - 0.1 * k, z + 0.01 * off])
    return result


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2412)
    objects = bolts()
    directions, distances = [], []
    plain = Sight(DIRECTION, ZENITH, DISTANCE)
    for name, mark in PILLARS.items():
        instrument = theodolite(mark, INSTRUMENT[name], float(random.uniform(0.0, 400.0)) * GON)
        for other in PILLARS:
            if other == name:
                continue
            above = TARGET[other] + HEIGHT * random.standard_normal()
            true = sight(instrument, PILLARS[other] + np.array([0.0, 0.0, above]))
            along = float(np.hypot(DISTANCE, PPM * 1e-6 * true.distance))
            reading = read(true, Sight(DIRECTION, ZENITH, along), random)
            directions.append([name, other, *_circles(reading), number(TARGET[other], 4)])
            if other > name:
                heights = [number(INSTRUMENT[name], 4), number(TARGET[other], 4)]
                distances.append([name, other, number(reading.distance, 4), *heights])
        for bolt, xyz in objects.items():
            if (name, bolt[:2]) not in UNSEEN:
                put_up = xyz + np.array([0.0, 0.0, HEIGHT * random.standard_normal()])
                reading = read(sight(instrument, put_up), plain, random)
                directions.append([name, bolt, *_circles(reading), number(0.0, 4)])
    about = {n: p + 0.3 * random.standard_normal(3) for n, p in PILLARS.items()}
    return {
        "pillars.csv": point_table(about, 1),
        "stations.csv": table("id,point,height", ([n, n, number(h, 4)] for n, h in INSTRUMENT.items())),
        "directions.csv": table("station,to,horizontal,zenith,to_height", directions),
        "distances.csv": table("from,to,distance,from_height,to_height", distances),
        "truth/points.csv": point_table({**PILLARS, **objects}, 5),
        "truth/cameras.csv": table("camera,component,value", []),
    }


def _circles(reading: Sight) -> list[str]:
    return numbers((reading.horizontal / GON, reading.zenith / GON), 4)
