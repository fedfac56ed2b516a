"""Read camera priors of OpenSfM (``camera_models.json``), with σ from ``config.yaml`` or its defaults.

OpenSfM's own bundle adjustment observes every interior parameter: focal lengths with a relative σ, all others in its
own units (OpenSfM source, ``config.py`` and ``bundle_adjuster.cc``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mor.formats.draft import Draft
from mor.formats.json_text import JsonFile, Wrong, mapping
from mor.formats.opensfm.cameras import camera_of
from mor.formats.text import read_lines

_SIGMA = {
    "exif_focal_sd": 0.01,
    "principal_point_sd": 0.01,
    "radial_distortion_k1_sd": 0.01,
    "radial_distortion_k2_sd": 0.01,
    "radial_distortion_k3_sd": 0.01,
    "radial_distortion_k4_sd": 0.01,
    "tangential_distortion_p1_sd": 0.01,
    "tangential_distortion_p2_sd": 0.01,
}
"""OpenSfM's defaults."""


def with_priors(cameras: dict[str, dict[str, Any]], folder: Path, draft: Draft) -> dict[str, dict[str, Any]]:
    """Cameras (by OpenSfM's name) whose interior is observed where ``camera_models.json`` has them."""
    path = folder / "camera_models.json"
    if not path.is_file():
        return cameras
    file = JsonFile(path)
    sigma = {**_SIGMA, **_configured(folder / "config.yaml", draft)}
    result = dict(cameras)
    for name, camera in cameras.items():
        given = file.data.get(name) if isinstance(file.data, dict) else None
        if given is None:
            continue
        try:
            prior = camera_of(name, mapping(given, f"camera {name!r}"))
        except Wrong as error:
            draft.problem(str(error), file.line(name), file.file)
            continue
        if prior["model"] == camera["model"]:
            result[name] = {**camera, "interior": _observed(camera, prior, sigma)}
            draft.note(
                f"camera {name}: its parameters are observed, as in OpenSfM's own adjustment",
                file.line(name),
                file.file,
            )
    return result


def _configured(path: Path, draft: Draft) -> dict[str, float]:
    found = {}
    for line in read_lines(path, draft) if path.is_file() else ():
        key, _, rest = line.partition(":")
        try:
            value = float(rest.split("#")[0])
        except ValueError:
            continue
        if key.strip() in _SIGMA and 0.0 < value < 1e6:
            found[key.strip()] = value
    return found


def _observed(camera: dict[str, Any], prior: dict[str, Any], sigma: dict[str, float]) -> dict[str, Any]:
    side = max(float(camera["image"][key]) for key in ("width", "height"))
    interior = {}
    for name, setting in camera["interior"].items():
        start, value = setting["free"], prior["interior"][name]["free"]
        known = {"observed": value, "sigma": repr(_sigma_of(name, prior, sigma, side))}
        interior[name] = known if start == value else {**known, "start": start}
    return interior


def _sigma_of(name: str, prior: dict[str, Any], sigma: dict[str, float], side: float) -> float:
    if name in ("c", "fx", "fy"):
        return sigma["exif_focal_sd"] * float(prior["interior"][name]["free"])
    if name in ("cx", "cy"):
        return sigma["principal_point_sd"] * side
    if name in ("A1", "A2"):
        c = float(prior["interior"]["c"]["free"])
        return sigma[f"radial_distortion_k{name[1]}_sd"] / (c * c) ** int(name[1])
    kind = "tangential" if name.startswith("p") else "radial"
    return sigma[f"{kind}_distortion_{name}_sd"]
