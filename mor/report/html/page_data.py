"""Everything a page is made from, worked out once."""

from __future__ import annotations

from typing import NamedTuple

import polars as pl

from mor.report.html.derived import (
    image_points,
    images_with_tests,
    points_with_tests,
    sets_with_tests,
    windows,
)
from mor.report.tables.rays import Rays, Window, rays_of
from mor.report.view import View
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words


class PageData(NamedTuple):
    """A view with what follows from it."""

    view: View
    rays: Rays
    measured: pl.DataFrame
    """One row for each ray, see :func:`mor.report.html.derived.image_points`."""
    windows: dict[str, Window]
    points: pl.DataFrame
    images: pl.DataFrame
    sets: pl.DataFrame
    words: Words
    """What everything is said in."""

    @property
    def datum(self) -> str:
        """Name of the datum, in words."""
        return datum_name(self.view.summary["datum"], self.words)

    @property
    def angle_unit(self) -> str:
        """Unit in which angles between rays are said: gon or degrees."""
        return angle_unit_of_rays(self.view)


def page_data(view: View, words: Words = ENGLISH) -> PageData:
    """Return the data of the page of a view, in a language."""
    rays, measured = rays_of(view), image_points(view)
    areas = windows(view, measured)
    return PageData(
        view=view,
        rays=rays,
        measured=measured,
        windows=areas,
        points=points_with_tests(view, rays, angle_unit_of_rays(view)),
        images=images_with_tests(view, measured, areas),
        sets=sets_with_tests(view, words),
        words=words,
    )


def angle_unit_of_rays(view: View) -> str:
    """Gon where the project has gon, otherwise degrees."""
    return "gon" if view.summary["units"]["angle"] in ("gon", "mgon") else "deg"
