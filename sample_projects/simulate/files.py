"""Texts of CSV tables, the same on every machine: fixed decimals, Unix line ends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from sample_projects.simulate.camera import Camera
from sample_projects.simulate.geometry import Array, Frame, angles


def number(value: float, decimals: int) -> str:
    """A number with fixed decimals; never a negative zero."""
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


def numbers(values: Iterable[float], decimals: int) -> list[str]:
    """Several numbers with the same decimals."""
    return [number(value, decimals) for value in values]


def table(header: str, rows: Iterable[Sequence[str]]) -> str:
    """Text of a CSV table; the header as one text with commas."""
    return "\n".join([header, *(",".join(row) for row in rows)]) + "\n"


def point_table(points: Mapping[str, Array], decimals: int, sigma: Sequence[float] = ()) -> str:
    """Points id, x, y, z, and where given their σ, the same for all."""
    header = ",".join(["id", "x", "y", "z", *("sigma_x", "sigma_y", "sigma_z")[: len(sigma)]])
    extra = [f"{s:g}" for s in sigma]
    return table(header, ([name, *numbers(xyz, decimals), *extra] for name, xyz in points.items()))


def image_row(name: str, camera: str, frame: Frame, decimals: int, angle: float, angle_decimals: int) -> list[str]:
    """Row id, camera, x, y, z, omega, phi, kappa; ``angle`` is the unit of the angles in radians."""
    turns = numbers(angles(frame.D) / angle, angle_decimals)
    return [name, camera, *numbers(frame.position, decimals), *turns]


IMAGE_HEADER = "id,camera,x,y,z,omega,phi,kappa"


def camera_table(cameras: Mapping[str, Camera]) -> str:
    """True interior orientations: camera, component, value."""
    rows = [[name, part, f"{value:.9g}"] for name, camera in cameras.items() for part, value in camera.components()]
    return table("camera,component,value", rows)


def parameter_table(parameters: Mapping[tuple[str, str, str], float]) -> str:
    """True values of further parameters by kind, block and component."""
    return table("kind,block,component,value", ([*key, f"{value:.9g}"] for key, value in parameters.items()))
