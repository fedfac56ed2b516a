"""gama-local (GNU Gama) on the geodetic networks: input as it reads it, the run, and how far its result is from mor's.

It is a program of its own that is merely run. Nothing heavy is imported on top: what runs other programs has to stay
small, see ``measure.run``.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from measure import run
from peers import ONE_THREAD, NotAvailableError

if TYPE_CHECKING:
    from scenes import Scene

LIMIT = 600.0
"""Wall seconds after which it is stopped."""
_OPTIONS = ("--algorithm", "envelope", "--cov-band", "0", "--language", "en")
"""Its sparse solver; and the diagonal of the covariance matrix, for all of it would be 450 million numbers."""
_GON = 63.66197723675814
"""Gon per radian."""


def available_gama(program: str | None) -> str:
    """The program, as named or on the path. Raises :class:`NotAvailableError` where there is none."""
    found = shutil.which(program or "gama-local")
    if found is None:
        raise NotAvailableError(f"{program or 'gama-local'} is not there")
    return found


def write_gkf(scene: Scene, path: Path) -> None:
    """A network as gama-local reads it: x north, y east, azimuths clockwise in gon, σ in mm and 10⁻⁴ gon."""
    import numpy as np
    from scenes import SIGMA_BEARING, SIGMA_DISTANCE, SIGMA_HEIGHT, Grid

    if not isinstance(scene, Grid):
        raise ValueError("only geodetic networks are adjusted by gama-local")
    held = np.isin(np.arange(len(scene.point)), scene.control)
    places = np.where(held[:, None], scene.point, scene.start).tolist()
    points = [
        f'<point id="P{k}" x="{y!r}" y="{x!r}" z="{z!r}" {"fix" if fixed else "adj"}="xyz" />'
        for k, ((x, y, z), fixed) in enumerate(zip(places, held.tolist(), strict=True))
    ]
    ends = [f'from="P{a}" to="P{b}"' for a, b in zip(scene.one.tolist(), scene.other.tolist(), strict=True)]
    sights = [
        *_elements("s-distance", ends, scene.distance.tolist(), 1e3 * SIGMA_DISTANCE),
        *_elements("azimuth", ends, (scene.bearing * _GON).tolist(), 1e4 * SIGMA_BEARING * _GON),
    ]
    heights = _elements("dh", ends, scene.height_difference.tolist(), 1e3 * SIGMA_HEIGHT)
    path.write_text(
        "\n".join(
            [
                '<?xml version="1.0" ?>',
                '<gama-local xmlns="http://www.gnu.org/software/gama/gama-local">',
                '<network axes-xy="ne" angles="left-handed">',
                '<parameters sigma-apr="1" sigma-act="aposteriori" tol-abs="1e6" />',
                "<points-observations>",
                *points,
                *("<obs>", *sights, "</obs>"),
                *("<height-differences>", *heights, "</height-differences>"),
                "</points-observations>",
                "</network>",
                "</gama-local>\n",
            ]
        ),
        encoding="utf-8",
    )


def _elements(kind: str, ends: list[str], values: list[float], sigma: float) -> list[str]:
    return [f'<{kind} {end} val="{value!r}" stdev="{sigma!r}" />' for end, value in zip(ends, values, strict=True)]


def adjust_by_gama(program: str, network: Path, limit: float = LIMIT) -> dict[str, Any]:
    """Seconds and bytes of a run, and where its result is; or that it was stopped at the limit.

    Raises :class:`NotAvailableError` where it ends with an error.
    """
    result, text = network.with_suffix(".xml"), network.with_suffix(".txt")
    command: list[str | Path] = [program, network, *_OPTIONS, "--xml", result, "--text", text]
    done = run(command, network.parent, ONE_THREAD, limit)
    found = {"cpu": done.seconds.cpu, "wall": done.seconds.wall, "peak_bytes": done.peak}
    if done.stopped:
        return {**found, "stopped_at": limit}
    if done.code or not result.is_file():
        words = (done.errors or done.output).strip().split("\n")[0]
        raise NotAvailableError(f"ended with code {done.code}: {words}")
    return {**found, "result": str(result)}


def compared(scene: Scene, result: Path) -> dict[str, float]:
    """σ0 of its result, and the largest difference (metres) of its coordinates from those that mor adjusts."""
    import numpy as np
    from problems import problem_of_grid
    from scenes import Grid

    from mor.solve.iterate import adjust

    if not isinstance(scene, Grid):
        raise ValueError("only geodetic networks are adjusted by gama-local")
    adjustment = adjust(*problem_of_grid(scene))
    sigma0, points = read_result(result)
    free = np.setdiff1d(np.arange(len(scene.point)), scene.control)
    places = np.array([points[f"P{k}"] for k in free])[:, [1, 0, 2]]
    difference = np.abs(places - adjustment.values["point"][free]).max()
    return {"sigma0": sigma0, "largest_difference": float(difference)}


def read_result(path: Path) -> tuple[float, dict[str, tuple[float, float, float]]]:
    """σ0 a posteriori, and the adjusted coordinates of each point, out of its XML output."""
    points: dict[str, tuple[float, float, float]] = {}
    sigma0 = float("nan")
    inside = False
    for event, element in ElementTree.iterparse(path, events=("start", "end")):
        name = element.tag.rpartition("}")[2]
        if name == "adjusted":
            inside = event == "start"
        elif event == "end" and name == "aposteriori":
            sigma0 = float(element.text or "nan")
        elif event == "end" and name == "point" and inside:
            own = {child.tag.rpartition("}")[2].lower(): child.text or "" for child in element}
            points[own["id"].strip()] = (float(own["x"]), float(own["y"]), float(own["z"]))
            element.clear()
    return sigma0, points
