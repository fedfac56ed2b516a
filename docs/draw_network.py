"""Draw the network picture of the README from the sample project test_field.

Needs matplotlib, which the program itself does not. Run from the repository:

    python docs/draw_network.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from mor.api.pipeline import read_document, read_network, solve_network
from mor.quality.solution import Solved
from mor.report.estimates import image_table, point_table

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "images" / "network.svg"
ENLARGED = 4000.0
"""How much larger than the network the error ellipsoids are drawn."""
AZIMUTH, ELEVATION = np.radians(-60.0), np.radians(28.0)


def flat(xyz: np.ndarray) -> np.ndarray:
    """Points (n, 3) as seen from afar: (n, 2), right and up."""
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    back = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
    return np.asarray(xyz @ np.stack([right, np.cross(back, right)]).T)


def solved_sample(name: str) -> Solved:
    """A sample project, adjusted."""
    path = ROOT / "sample_projects" / name / "project.yaml"
    return solve_network(read_network(read_document(path), path.parent))


def draw(solved: Solved) -> Figure:
    """Images, targets with error bars, rays and scale bars."""
    points, images = point_table(solved), image_table(solved)
    xyz = points.select("x", "y", "z").to_numpy()
    centres = images.select("x", "y", "z").to_numpy()
    place = dict(zip(points["id"], flat(xyz), strict=True))
    stand = dict(zip(images["id"], flat(centres), strict=True))
    figure = Figure(figsize=(9.0, 5.2))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    rays = [  # every third of them is drawn
        (stand[image], place[point])
        for group in solved.adjustment.problem.groups
        if group.type.key.startswith("image/")
        for image, point in zip(*group.references, strict=True)
    ]
    axes.add_collection(LineCollection(rays[::3], colors="#3b6ea5", linewidths=0.3, alpha=0.25))
    bars = [
        (place[a], place[b])
        for group in solved.adjustment.problem.groups
        if group.type.key == "distance"
        for a, b in zip(*group.references, strict=True)
    ]
    axes.add_collection(LineCollection(bars, colors="#c0392b", linewidths=2.0))
    sigma = points.select("sx", "sy", "sz").to_numpy() * ENLARGED
    for axis in range(3):
        step = np.zeros_like(xyz)
        step[:, axis] = sigma[:, axis]
        axes.add_collection(
            LineCollection(np.stack([flat(xyz - step), flat(xyz + step)], axis=1), colors="#222222", linewidths=0.8)
        )
    axes.scatter(*flat(xyz).T, s=7, color="#222222", zorder=3)
    axes.scatter(*flat(centres).T, s=46, marker="^", color="#3b6ea5", zorder=3)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.autoscale_view()
    axes.margins(0.03)
    return figure


def main() -> None:
    """Write the picture."""
    matplotlib.rcParams["svg.hashsalt"] = "mor"
    TARGET.parent.mkdir(exist_ok=True)
    draw(solved_sample("test_field")).savefig(TARGET, metadata={"Date": None}, transparent=True)


if __name__ == "__main__":
    main()
