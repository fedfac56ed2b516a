"""A sample project in hand, as a person would edit it: the project file, and its tables as lists of rows."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

SAMPLES = Path(__file__).resolve().parents[3] / "sample_projects"
NAMES = (
    "aerial_strip",
    "bridge",
    "building",
    "facade",
    "facade with total station",
    "image_variant",
    "machine_part",
    "single_station",
    "stereo_rig",
    "test_field",
)
Row = dict[str, str]


@dataclass
class Survey:
    """What stands in the files of a project; every number is a text, as it is written."""

    name: str
    project: dict[str, Any]
    tables: dict[str, list[Row]] = field(default_factory=dict)

    def entries(self, section: str, type_: str = "") -> list[dict[str, Any]]:
        """Tables of a section that stand in files, of a type where one is given."""
        found = [entry for entry in self.project.get(section, []) if "file" in entry]
        return [entry for entry in found if not type_ or entry["type"] == type_]

    def rows(self, entry: dict[str, Any]) -> list[Row]:
        """Rows of the table of an entry."""
        return self.tables[entry["file"]]

    def write(self, folder: Path) -> Path:
        """Write it as files; the path of the project file."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, rows in self.tables.items():
            with (folder / name).open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, list(rows[0]))
                writer.writeheader()
                writer.writerows(rows)
        path = folder / "project.yaml"
        path.write_text(yaml.safe_dump(self.project, sort_keys=False, allow_unicode=True), encoding="utf-8")
        return path


def survey(name: str) -> Survey:
    """A sample project by name; the facade also with the total station that its tables come with."""
    folder = SAMPLES / name.partition(" ")[0]
    text = (folder / "project.yaml").read_text(encoding="utf-8")
    project = yaml.load(text, Loader=yaml.BaseLoader)
    found = Survey(name, project)
    if name == "facade with total station":
        _with_total_station(project)
    for section in ("images", "points", "stations", "observations"):
        for entry in found.entries(section):
            with (folder / entry["file"]).open(newline="", encoding="utf-8") as file:
                found.tables[entry["file"]] = list(csv.DictReader(file))
    return found


def _with_total_station(project: dict[str, Any]) -> None:
    directions: dict[str, Any] = {"type": "zenith_directions", "file": "directions.csv"}
    directions["values"] = {"sigma_horizontal": "0.5 mgon", "sigma_zenith": "0.5 mgon"}
    directions["units"] = {"horizontal": "gon", "zenith": "gon"}
    distances = {"type": "distance", "file": "distances.csv", "values": {"sigma": "2 mm"}}
    project["observations"] += [directions, distances]
    project["stations"] = [{"columns": ["id"], "rows": [["S1"], ["S2"]]}]


def scaled(rows: list[Row], columns: tuple[str, ...], factor: float) -> None:
    """Multiply the numbers of some columns; empty cells stay empty."""
    for row in rows:
        for column in columns:
            if row.get(column):
                row[column] = f"{float(row[column]) * factor:.9g}"


def exchanged(one: Row, other: Row, columns: tuple[str, ...]) -> None:
    """Exchange the cells of two rows in some columns."""
    for column in columns:
        one[column], other[column] = other[column], one[column]
