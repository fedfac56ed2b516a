"""A dam: GNSS baselines, total stations, levelling and images of an aircraft, in a national frame with its geoid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sample_projects.simulate import dam_site as site
from sample_projects.simulate import earth
from sample_projects.simulate.camera import Camera, sees
from sample_projects.simulate.files import camera_table, number, numbers, table
from sample_projects.simulate.geometry import DEGREE, GON, Array, Frame, Mask, incidence
from sample_projects.simulate.rays import measured, seen_points, with_enough_rays
from sample_projects.simulate.survey import Sight, read, sight

SIGMA = 0.0013
"""mm in the image, 0.3 pixels."""
DIRECTION, ZENITH = 0.0003 * GON, 0.0005 * GON
DISTANCE, PPM = 0.0008, 1.0
REFRACTION = (0.13, 0.1)
"""What the project says of the coefficient, and its σ; that of the day is drawn from it."""
LEVELLING = 0.0003
"""σ of one line between two benchmarks, m."""
ANTENNA = np.array([0.012, 0.012, 0.020])
"""σ of the antenna at an image, m."""
BENCHMARK_SIGMA = np.array([0.5, 0.5, 0.0005])
INSTRUMENT = {"P1": 0.2462, "P2": 0.2451, "P3": 0.2478, "P4": 0.2455}
PRISM = 0.1120
"""Of prisms above pillars and bolts, m."""
ANTENNA_HEIGHT = {"P": 0.1855, "K": 0.2310, "R": 0.0}
LINES = (
    ("B1", "P4"),
    ("P4", "P2"),
    ("P2", "K5"),
    ("K5", "K4"),
    ("K4", "K3"),
    ("K3", "K2"),
    ("K2", "K1"),
    ("K1", "P1"),
    ("P1", "P3"),
    ("P3", "P4"),
)
BASELINES = (
    *[(r, p) for r in ("R1", "R2") for p in ("P1", "P2", "P3", "P4", "P5", "K1", "K3", "K5")],
    *[("P1", "P2"), ("P3", "P4"), ("P1", "P5"), ("K1", "K3"), ("K3", "K5"), ("P2", "K5"), ("P5", "K1")],
)
COVARIANCES = ("dx_dx", "dx_dy", "dx_dz", "dy_dy", "dy_dz", "dz_dz")


def simulate(seed: int = 2418) -> dict[str, str | bytes]:
    """Files of the sample; another seed gives other errors of the same measurements."""
    layout = np.random.RandomState(2417)
    marks = {**site.PILLARS, **site.crest(), "B1": site.BENCHMARK}
    plates, images = site.targets(), site.frames(layout)
    natural = site.details(layout)
    on_face = {**plates, **natural}
    drop = np.array([0.15 if name in natural else 0.02 for name in on_face])
    facing = np.stack([site.normal(point) for point in on_face.values()])

    def visible(camera: Camera, frame: Frame) -> Mask:
        kept: Mask = layout.uniform(size=len(on_face)) > drop  # the same with every seed
        return kept & sees(camera, frame, np.stack(list(on_face.values())), facing, 70.0 * DEGREE)

    random = np.random.RandomState(seed)
    refraction = REFRACTION[0] + REFRACTION[1] * np.random.RandomState(seed + 100_000).standard_normal()
    shots = {name: (site.CAMERA, frame) for name, frame in images.items()}
    rays = with_enough_rays(measured(shots, on_face, visible, SIGMA, random, 0.0), 3)
    seen = {**plates, **seen_points(rays, on_face)}
    directions, distances = _total_stations(marks, plates, float(refraction), random)
    return {
        "geoid.gtx": site.geoid().gtx(),
        "reference_stations.csv": _national(site.REFERENCE, 4, 0.0, random),
        "marks.csv": _marks({name: marks[name] for name in marks if name != "B1"}, random),
        "benchmark.csv": _benchmark(random),
        "baselines.csv": _baselines({**marks, **site.REFERENCE}, random),
        "directions.csv": directions,
        "distances.csv": distances,
        "levelling.csv": table("from,to,dz", _levelling(marks, random)),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *numbers(r.xy, 4)] for r in rays)),
        "antennas.csv": _antennas(images, random),
        "face.csv": table("id", ([name] for name in seen)),
        "truth/points.csv": _national({**site.REFERENCE, **marks, **seen}, 5, 0.0, random),
        "truth/cameras.csv": camera_table({"M3": site.CAMERA}),
        "truth/parameters.csv": table(
            "kind,block,component,value", [["refraction", "T2", "refraction", f"{refraction:.4f}"]]
        ),
    }


def _national(points: Mapping[str, Array], decimals: int, error: float, random: np.random.RandomState) -> str:
    places = site.to_national(np.stack(list(points.values())))
    if error:
        places = places + error * random.standard_normal(places.shape)
    rows = ([name, *numbers(place, decimals)] for name, place in zip(points, places, strict=True))
    return table("id,east,north,height", rows)


def _marks(points: Mapping[str, Array], random: np.random.RandomState) -> str:
    """Pillars and bolts to a metre, from a plan, with the deflections of a model."""
    local = np.stack(list(points.values()))
    places = site.to_national(local) + 0.5 * random.standard_normal(local.shape)
    tilts = site.deflection(local) / site.ARCSEC
    rows = (
        [name, *numbers(place, 0), *numbers(tilt, 2)] for name, place, tilt in zip(points, places, tilts, strict=True)
    )
    return table("id,east,north,height,deflection_north,deflection_east", rows)


def _benchmark(random: np.random.RandomState) -> str:
    place = site.to_national(site.BENCHMARK[None])[0] + BENCHMARK_SIGMA * random.standard_normal(3)
    row = ["B1", *numbers(place[:2], 2), number(place[2], 5), *(f"{s:g}" for s in BENCHMARK_SIGMA)]
    return table("id,east,north,height,sigma_east,sigma_north,sigma_up", [row])


def _baselines(points: Mapping[str, Array], random: np.random.RandomState) -> str:
    """Vectors between phase centres: 2 mm + 0.3 ppm level, 4 mm + 0.6 ppm up, in geocentric axes."""
    rows = []
    for one, other in BASELINES:
        ends = site.to_geocentric(np.stack([points[one], points[other]]))
        places = earth.geodetic(ends)
        heights = [ANTENNA_HEIGHT[name[0]] for name in (one, other)]
        lifted = [end + h * earth.horizon(*place[:2])[2] for end, place, h in zip(ends, places, heights, strict=True)]
        vector = lifted[1] - lifted[0]
        length = np.linalg.norm(vector)
        level, up = 0.002 + 0.3e-6 * length, 0.004 + 0.6e-6 * length
        axes = earth.horizon(*places[1, :2])
        errors = np.array([level, level, up])
        Q = axes.T @ np.diag(errors**2) @ axes
        vector = vector + axes.T @ (errors * random.standard_normal(3))
        covariances = [f"{Q[i, j]:.6e}" for i in range(3) for j in range(i, 3)]
        rows.append([one, other, *numbers(vector, 4), *numbers(heights, 4), *covariances])
    columns = "from,to,dx,dy,dz,from_height,to_height," + ",".join(f"cov_{name}" for name in COVARIANCES)
    return table(columns, rows)


def _total_stations(
    marks: Mapping[str, Array], plates: Mapping[str, Array], refraction: float, random: np.random.RandomState
) -> tuple[str, str]:
    """Directions, zenith angles and distances from four pillars to prisms and plates, about the plumb lines."""
    directions, distances = [], []
    prisms = {name: point for name, point in marks.items() if name != "B1"}
    for name, height in INSTRUMENT.items():
        axes = site.plumb_axes(marks[name][None])[0]
        orientation = float(random.uniform(0.0, 400.0)) * GON
        turned = np.array(
            [
                [np.cos(orientation), -np.sin(orientation), 0.0],
                [np.sin(orientation), np.cos(orientation), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        instrument = Frame(marks[name] + height * axes[2], turned @ axes)
        for other, point in {**prisms, **plates}.items():
            above = PRISM if other in prisms else 0.0
            if other == name or not _seen(marks[name], other, point):
                continue
            target = point + above * site.plumb_axes(point[None])[0, 2]
            true = sight(instrument, target)
            level = true.distance * np.sin(true.zenith)
            true = true._replace(zenith=true.zenith - refraction * level / (2.0 * 6_371_000.0))
            along = float(np.hypot(DISTANCE, PPM * 1e-6 * true.distance))
            reading = read(true, Sight(DIRECTION, ZENITH, along), random)
            circles = numbers((reading.horizontal / GON, reading.zenith / GON), 5)
            directions.append([name, other, *circles, number(above, 4)])
            heights = [number(height, 4), number(above, 4)]
            distances.append([name, other, number(reading.distance, 4), *heights])
    return (
        table("station,to,horizontal,zenith,to_height", directions),
        table("from,to,distance,from_height,to_height", distances),
    )


def _seen(pillar: Array, name: str, point: Array) -> bool:
    """Plates are seen at no more than 70° from their normals; from P5 and to it only pillars and the crest."""
    if name[0] != "T":
        return True
    return float(incidence(point[None], site.normal(point)[None], pillar)[0]) < 70.0 * DEGREE


def _levelling(marks: Mapping[str, Array], random: np.random.RandomState) -> list[list[str]]:
    heights = dict(zip(marks, site.to_national(np.stack(list(marks.values())))[:, 2], strict=True))
    return [
        [one, other, number(heights[other] - heights[one] + LEVELLING * random.standard_normal(), 5)]
        for one, other in LINES
    ]


def _antennas(images: Mapping[str, Frame], random: np.random.RandomState) -> str:
    """Antennas at the moments of exposure, in the national frame."""
    places = site.to_national(np.stack([f.position + f.D.T @ site.LEVER for f in images.values()]))
    places = places + ANTENNA * random.standard_normal(places.shape)
    return table("point,east,north,height", ([n, *numbers(p, 4)] for n, p in zip(images, places, strict=True)))
