"""Mutations of a project file as keys and values."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import yaml

from .cells import mutated_rows
from .values import changed_text, chosen, hostile

Path = tuple[Any, ...]

OPTIONS: tuple[dict[str, Any], ...] = (
    *({"datum": datum} for datum in ("fixed", "free", {"free": "all", "components": ["z"]}, {"free": []})),
    {"datum": {"free": "all", "movements": "reference"}},
    *({"settings": {"dimensions": d}} for d in ("xyz", "xy", "z")),
    *({"settings": {"robust": r, "snooping": "true"}} for r in ("l1", "danish")),
    *({"settings": {"variance_components": "iterate", "variance_method": m}} for m in ("simplified", "helmert")),
    *({"settings": {"max_iterations": k}} for k in ("1", "2", "100000")),
    *({"settings": {"sigma": s, "sigma0": v}} for s in ("apriori", "aposteriori") for v in ("1", "1e-9", "1e9")),
    *({"settings": {key: level}} for key in ("snooping_level", "familywise_level", "global_level", "power")
      for level in ("1e-300", "1e-16", "0.5", "0.9999999999999999")),
    *({"units": {"length": u}} for u in ("mm", "km", "us-ft")),
    *({"units": {"angle": u}} for u in ("deg", "dms", "rad", "mgon")),
    *({"axes": {"xy": a}} for a in ("ne", "nw", "ws", "sw")),
    {"axes": {"angles": "counterclockwise", "bearings_from": "south"}},
    {"checks": []},
)  # fmt: skip
"""Keys that are right as they stand, and lead deep into the program."""
KEYS = (
    *(
        "mor",
        "title",
        "units",
        "axes",
        "cameras",
        "images",
        "pairs",
        "points",
        "stations",
        "systems",
        "features",
    ),
    *(
        "instruments",
        "observations",
        "checks",
        "datum",
        "settings",
        "name",
        "file",
        "rows",
        "columns",
        "values",
    ),
    *(
        "delimiter",
        "fixed",
        "group",
        "level",
        "type",
        "instrument",
        "ppm",
        "centring",
        "factor",
        "covariance",
        "cluster",
    ),
    *(
        "free",
        "observed",
        "sigma",
        "start",
        "interior",
        "eccentricity",
        "image_variant",
        "model",
        "unit",
        "coordinates",
    ),
    *(
        "r0",
        "image",
        "width",
        "height",
        "pixel",
        "minimal",
        "components",
        "movements",
        "id",
        "other",
        "scale",
        "offset",
    ),
)
TYPES = (
    *(
        "distance",
        "horizontal_distance",
        "directions",
        "zenith_directions",
        "bearing",
        "vertical_direction",
        "level",
    ),
    *(
        "zenith_angle",
        "angle",
        "vector",
        "height_difference",
        "coordinates",
        "local",
        "image",
        "parameter",
        "difference",
    ),
)


def parsed(content: bytes) -> Any:
    """The plain data of a project file, all scalars texts; ``None`` where it is none any more."""
    try:
        return yaml.load(content.decode("utf-8"), Loader=getattr(yaml, "CBaseLoader", yaml.BaseLoader))
    except (yaml.YAMLError, UnicodeDecodeError):
        return None


def mutated_project(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """A project with one of its keys or values changed; ``other`` is another project to take parts from."""
    data = parsed(content)
    if not isinstance(data, dict):
        return content
    donor = parsed(other)
    data = _KINDS[int(rng.integers(len(_KINDS)))](rng, data, donor if isinstance(donor, dict) else data)
    text: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=None, width=10_000)
    return text.encode("utf-8", "replace")


def _places(data: Any, path: Path = ()) -> list[Path]:
    """Paths of everything in it; of long lists one part, so that rows do not drown the rest."""
    inside = list(data.items()) if isinstance(data, dict) else list(enumerate(data)) if isinstance(data, list) else []
    found = [path] if path else []
    for key, value in inside[:8] + inside[-2:] if len(inside) > 10 else inside:
        found += _places(value, (*path, key))
    return found


def _parent(data: Any, path: Path) -> Any:
    for key in path[:-1]:
        data = data[key]
    return data


def _some(rng: np.random.Generator, data: Any) -> tuple[Any, Any]:
    """A mapping or list inside, and one of its keys."""
    path = chosen(rng, _places(data) or [()])
    return _parent(data, path), path[-1]  # type: ignore[arg-type, index]


def _deleted(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    parent, key = _some(rng, data)
    del parent[key]
    return data


def _replaced(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    parent, key = _some(rng, data)
    value = parent[key]
    parent[key] = changed_text(rng, value) if isinstance(value, str) else chosen(
        rng, (hostile(rng), [], {}, None, [value], {"free": value}, [[value]], {hostile(rng): value})
    )  # fmt: skip
    return data


def _scalar(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    leaves = [p for p in _places(data) if isinstance(_parent(data, p)[p[-1]], str)]
    if leaves:
        path: Any = chosen(rng, leaves)
        parent = _parent(data, path)
        parent[path[-1]] = changed_text(rng, parent[path[-1]])
    return data


def _renamed(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    parent, key = _some(rng, data)
    if isinstance(parent, dict):
        new = chosen(rng, (hostile(rng), *KEYS[:: int(rng.integers(1, 5))], key[:-1], key + "s"))
        parent[new] = parent.pop(key)
    else:
        parent.append(copy.deepcopy(parent[key]))
    return data


def _exchanged(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    (a, i), (b, k) = _some(rng, data), _some(rng, data)
    a[i], b[k] = copy.deepcopy(b[k]), copy.deepcopy(a[i])
    return data


def _taken(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    """A part of another project, put into a place of this one."""
    parent, key = _some(rng, data)
    source, place = _some(rng, donor)
    if isinstance(parent, list) and rng.random() < 0.5:
        parent.append(copy.deepcopy(source[place]))
    else:
        parent[key] = copy.deepcopy(source[place])
    return data


def _added(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    """Another key with some value."""
    parent, _ = _some(rng, data)
    source, place = _some(rng, donor)
    if isinstance(parent, dict):
        parent[chosen(rng, KEYS)] = chosen(rng, (hostile(rng), copy.deepcopy(source[place])))
    else:
        parent.append(hostile(rng))
    return data


def _optional(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    """A setting, a datum, axes or units that are right in themselves."""
    option: Any = chosen(rng, OPTIONS)
    for key, value in copy.deepcopy(option).items():
        known = data.get(key)
        data[key] = {**known, **value} if isinstance(known, dict) and isinstance(value, dict) else value
    if rng.random() < 0.2:
        data["datum"] = {"minimal": {str(chosen(rng, ("x", "xy", "xyz", "z"))): _point(rng, data)}}
    return data


def _point(rng: np.random.Generator, data: Any) -> str:
    rows = [row for table in data.get("points") or [] if isinstance(table, dict) for row in table.get("rows") or []]
    row: Any = chosen(rng, rows or [["A"]])
    cells = list(row.values()) if isinstance(row, dict) else row
    return str(cells[0]) if cells else "A"


def _group(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    """Something about a table: its type, σ model, status, units, constant columns, or checks made of it."""
    section = str(chosen(rng, ("observations", "observations", "points", "images", "stations", "systems")))
    tables = [table for table in data.get(section) or [] if isinstance(table, dict)]
    if not tables:
        return _replaced(rng, data, donor)
    table: Any = chosen(rng, tables)
    changes: Any = {
        "observations": (
            {"type": chosen(rng, TYPES)}, {"ppm": chosen(rng, ("2", "1e6", "1e300"))},
            {"factor": chosen(rng, ("1e-9", "1e9", "1e-300"))}, {"values": {"sigma": hostile(rng)}},
            {"centring": {"instrument": "1 mm", "target": "1 mm", "target_height": "0"}},
            {"values": {"sigma": chosen(rng, ("0", "1e-12", "1e12", "-1", "1e-160"))}},
            {"covariance": [["1", "0"], ["0", "1"]]}, {"cluster": "C", "covariance": hostile(rng)},
            {"instrument": hostile(rng)}, {"units": hostile(rng)},
        ),
        "points": (
            {"fixed": ["x", "y", "z"]}, {"fixed": ["z"]}, {"fixed": []}, {"values": {"sigma": "1 mm"}}, {"group": "A"},
        ),
        "images": (
            {"fixed": ["x", "y", "z", "omega", "phi", "kappa"]}, {"values": {"sigma_omega": "1"}},
            {"values": {"height": "1"}},
        ),
        "stations": (
            {"level": chosen(rng, ("free", "fixed", "1 mgon", "0", "-1"))},
            {"fixed": ["x"]}, {"fixed": ["orientation"]},
        ),
        "systems": (
            {"fixed": ["x", "y", "z", "omega", "phi", "kappa"]}, {"fixed": ["scale"]}, {"values": {"scale": "0"}},
        ),
    }[section]  # fmt: skip
    table.update(copy.deepcopy(chosen(rng, changes)))  # type: ignore[call-overload]
    if section == "observations" and rng.random() < 0.1:
        data.setdefault("checks", []).append(copy.deepcopy(table))
    return data


def _rows(rng: np.random.Generator, data: Any, donor: Any) -> Any:
    """The rows of a table in the project file."""
    tables = [t for entries in data.values() if isinstance(entries, list) for t in entries if isinstance(t, dict)]
    tables = [t for t in tables if isinstance(t.get("rows"), list) and isinstance(t.get("columns"), list)]
    if not tables or any(not isinstance(row, list) for t in tables for row in t["rows"]):
        return _scalar(rng, data, donor)
    table: Any = chosen(rng, tables)
    rows = [[str(cell or "") for cell in row] for row in (table["columns"], *table["rows"])]
    table["columns"], *table["rows"] = mutated_rows(rng, rows, 1)
    return data


_KINDS = (
    *(_deleted, _replaced, _scalar, _scalar, _renamed, _exchanged, _taken, _added),
    *(*(_optional,) * 3, *(_group,) * 3, *(_rows,) * 5),
)  # fmt: skip
