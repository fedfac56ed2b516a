"""Names and columns of the files of a JAG3D network, and their observation types.

JAG3D asks for the kind of a file when it is imported; here its name tells. Lengths are m, angles gon, y is east and
x north. Source: JAG3D, *Datenimport* (wiki), and the classes that read its flat files.
"""

from __future__ import annotations

import re

OBSERVATIONS = {
    "leveling": "height_difference",
    "directions": "directions",
    "horizontal_distances": "horizontal_distance",
    "slope_distances": "distance",
    "zenith_angles": "zenith_angle",
}
"""Types by the beginning of a name."""
POINTS = ("reference", "stochastic", "datum", "new")
"""Fixed, observed, free with and without the datum."""
POINT_FILE = re.compile(rf"({'|'.join(POINTS)})_points?_([123])d.*\.txt$", re.IGNORECASE)
OBSERVATION_FILE = re.compile(rf"({'|'.join(OBSERVATIONS)}).*\.txt$", re.IGNORECASE)
AXES = {"1": ("z",), "2": ("x", "y"), "3": ("x", "y", "z")}
"""Coordinates of a project (x east) in the order of the columns, by dimension."""
