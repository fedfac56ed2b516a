"""Data of the network figure besides rays: sights by kind, given points, relative ellipses, external reliability."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.report.html.derived import control_table
from mor.report.html.figures.layout import round_length
from mor.report.tables.rays import places
from mor.report.view import View

MOST_SIGHTS = 20_000
_SHARE = 0.06
"""Share of the extent that large vectors are drawn with."""
KINDS = {
    "direction": "directions|^bearing$|angle|vertical_direction",
    "distance": "distance",
    "levelling": "^height_difference$",
    "vector": "^vector$",
}
"""Types of observations of each kind, as expressions of their names."""


def sights(view: View) -> pl.DataFrame:
    """Pairs of places by kind, once each: numbers of points, of stations behind them; at most so many of each kind.

    In a block of images a distance between two points is a scale bar.
    """
    places = pl.concat(
        [
            frame.select(pl.col("id").cast(pl.String).alias("name"))
            for frame in (view.points, view.stations)
            if frame.height
        ]
        or [pl.DataFrame({"name": []}, {"name": pl.String})]
    ).with_row_index("number")
    numbers = places.unique("name", keep="first", maintain_order=True)
    used = view.used.filter(pl.col("type") != "image").select("type", "at", "from", "to")
    ends = pl.concat(
        [
            used.select("type", pl.col(one).alias("start"), pl.col(other).alias("end"))
            for one, other in (("from", "to"), ("at", "from"), ("at", "to"))
        ]
    )
    pairs = (
        ends.unique(maintain_order=True)
        .join(numbers.rename({"name": "start", "number": "a"}), on="start", maintain_order="left")
        .join(numbers.rename({"name": "end", "number": "b"}), on="end", maintain_order="left")
    )
    parts = [
        pairs.filter(pl.col("type").str.contains(types))
        .select(pl.lit(kind).alias("kind"), pl.col("a").cast(pl.Int32), pl.col("b").cast(pl.Int32))
        .unique(maintain_order=True)
        .head(MOST_SIGHTS)
        for kind, types in KINDS.items()
    ]
    found = pl.concat(parts)
    if not view.images.height:
        return found
    last = view.points.height
    is_bar = (pl.col("kind") == "distance") & (pl.col("a") < last) & (pl.col("b") < last)
    return found.with_columns(pl.when(is_bar).then(pl.lit("scale")).otherwise(pl.col("kind")).alias("kind"))


def detectable_effects(view: View) -> pl.DataFrame:
    """External reliability of the points, (point, dx, dy, dz) by number of point."""
    numbers = pl.DataFrame({"id": view.points["id"].cast(pl.String)}).with_row_index("number")
    found = view.external.join(numbers, left_on="point", right_on="id", maintain_order="left")
    return found.select(pl.col("number").cast(pl.Int32).alias("point"), "dx", "dy", "dz")


def scale_of_effects(view: View, effects: pl.DataFrame) -> float:
    """Enlargement with which large ones of the vectors take a share of the extent of the network."""
    sizes = np.linalg.norm(effects.select("dx", "dy", "dz").to_numpy(), axis=1)
    extent = float(np.ptp(places(view), axis=0).max(initial=0.0)) if view.points.height else 0.0
    large = float(np.quantile(sizes, 0.9)) if len(sizes) else 0.0
    return round_length(_SHARE * extent / large) if large > 0.0 and extent > 0.0 else 1.0


def relative_ellipses(view: View) -> pl.DataFrame:
    """Relative ellipses of the pairs that were asked for: numbers of the points, a, b, direction of a in plan."""
    asked = {name for row in view.relative for name in (row["from"], row["to"])}
    names = view.points["id"].to_list() if asked else []
    numbers = {str(name): k for k, name in enumerate(names) if str(name) in asked}
    rows = [
        (numbers[row["from"]], numbers[row["to"]], row["a"], row["b"], *row["direction"])
        for row in view.relative
        if row["from"] in numbers and row["to"] in numbers and row.get("direction")
    ]
    schema = {"one": pl.Int32, "other": pl.Int32, **dict.fromkeys(("a", "b", "dx", "dy"), pl.Float64)}
    return pl.DataFrame(rows, schema=schema, orient="row")


def with_given(view: View, points: pl.DataFrame) -> pl.DataFrame:
    """Points with the column ``given``: control, check (kept out of the adjustment), or nothing."""
    control = set(control_table(view)["point"].unique().to_list())
    kept_out = view.residuals.filter((pl.col("flag") == "check") & (pl.col("type") == "coordinates"))
    checks = {str(name) for name in kept_out["to"].to_list() + kept_out["from"].to_list() if name}
    held = points["status"].is_in(["fixed", "partly fixed"]) if "status" in points.columns else pl.Series([])
    names = points["id"].cast(pl.String).to_list()
    given = [
        "check" if name in checks else "control" if name in control or fixed else ""
        for name, fixed in zip(names, held.to_list() or [False] * len(names), strict=True)
    ]
    return points.with_columns(pl.Series("given", given, dtype=pl.String))
