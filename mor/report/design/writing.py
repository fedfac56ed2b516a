"""The files of a plan."""

from __future__ import annotations

from collections.abc import Sequence

from mor.output_files import Content
from mor.quality.design.requirements import Judged
from mor.quality.solved import Solved
from mor.report.design.content import planned_table
from mor.report.results.folder import write_folder
from mor.report.results.reservation import Reservation
from mor.report.tables.estimates import image_table, point_table
from mor.report.tables.files import table_writer

USUAL_FILES = ("design.json", "design.txt", "design.html")
"""Files that every plan has."""


def write_design(
    solved: Solved,
    judged: Sequence[Judged],
    text: str,
    data: str,
    more: dict[str, Content],
    place: Reservation,
) -> None:
    """Write report, data and tables of a plan; where it has no solution report and data alone."""
    writers: dict[str, Content] = {"design.txt": text, "design.json": data, **more}
    if solved.quality is not None:
        writers["points.csv"] = table_writer(point_table(solved))
        writers["planned.csv"] = table_writer(planned_table(solved))
        if solved.network.things["image"].ids:
            writers["images.csv"] = table_writer(image_table(solved).drop("rms"))
    write_folder(place, writers)
