"""A SINEX file as a project on the earth: positions of all stations, observed with their full covariance matrix."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row
from mor.formats.sinex.blocks import APRIORI, ESTIMATE, MATRIX, Parameter, blocks_of, matrix_of, parameters_of
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

_SYSTEM = "+proj=geocent +ellps=GRS80 +units=m +type=crs"
"""Geocentric axes: what a SINEX file says of its frame."""
_AXES = ("STAX", "STAY", "STAZ")


def read_sinex(path: Path) -> Document:
    """The project of a SINEX file. Raises :class:`InputError`."""
    draft = Draft(str(path))
    lines = read_lines(path, draft)
    if not lines or not lines[0].startswith("%=SNX"):
        words = f"found {(lines[0] if lines else '')[:30]!r}, expected %=SNX in the first line"
        raise InputError([Problem(words, str(path), 1)])
    blocks = blocks_of(lines, draft)
    for name in (ESTIMATE, MATRIX):
        if name not in blocks:
            draft.problem(f"there is no block {name}", 1)
    if draft.problems:
        return draft.finish()
    parameters = parameters_of(blocks[ESTIMATE], draft)
    Q = None if draft.problems else matrix_of(blocks[MATRIX], parameters, draft)
    if Q is not None:
        _put(draft, parameters, Q)
        _tell(draft, parameters, APRIORI in blocks)
    return draft.finish()


def _put(draft: Draft, parameters: dict[int, Parameter], Q: FloatArray) -> None:
    """Stations as free points that begin where they were estimated, and their observed positions."""
    order = sorted(parameters)
    sites: dict[str, dict[str, int]] = {}
    for place, index in enumerate(order):
        found = parameters[index]
        if found.type in _AXES:
            axes = sites.setdefault(found.site, {})
            if found.type in axes:
                draft.problem(f"{found.type} of station {found.site!r} is there twice", found.line)
            axes[found.type] = place
    names = _names(list(sites))
    rows, places = [], []
    for site, axes in sites.items():
        line = parameters[order[next(iter(axes.values()))]].line
        if len(axes) < 3:
            draft.problem(f"station {site!r} has {', '.join(axes)} alone, expected STAX, STAY and STAZ", line)
            continue
        places += [axes[axis] for axis in _AXES]
        values = [repr(parameters[order[axes[axis]]].value) for axis in _AXES]
        rows.append(Row([names[site], *values], line))
    if not rows:
        draft.problem("no station has an estimated position", 1)
        return
    draft.put("units", {"length": "m", "angle": "deg"})
    draft.put("world", {"crs": _SYSTEM}, 1)
    draft.table("points", ("id", "x", "y", "z"), rows)
    covariance = Q[np.ix_(places, places)]
    draft.table(
        "observations", ("point", "x", "y", "z"), rows, type="gnss_position", covariance=covariance.tolist()
    )


def _names(sites: list[str]) -> dict[str, str]:
    """Code of the station, with its point and solution where there are several."""
    codes = [site.split()[0] for site in sites]
    return {site: code if codes.count(code) == 1 else site for site, code in zip(sites, codes, strict=True)}


def _tell(draft: Draft, parameters: dict[int, Parameter], apriori: bool) -> None:
    words = "does not say its reference frame: coordinates are taken as geocentric, heights above GRS80"
    draft.note(f"SINEX {words}; name it in world: {{crs: …}}", 1)
    others = [found for found in parameters.values() if found.type not in _AXES]
    if others:
        types = ", ".join(dict.fromkeys(found.type for found in others))
        draft.note(
            f"not read: {len(others)} parameters ({types}); positions keep their covariances", others[0].line
        )
    epochs = list(dict.fromkeys(found.epoch for found in parameters.values() if found.type in _AXES))
    if len(epochs) > 1:
        draft.note(
            f"positions are of {len(epochs)} epochs ({epochs[0]}, {epochs[1]}, …), taken as they are", 1
        )
    if apriori:
        draft.note("a-priori constraints of the solution stay in its covariances", 1)
