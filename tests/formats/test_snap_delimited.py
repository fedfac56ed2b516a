"""Delimited files of SNAP say what its own data files say."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from mor.errors import InputError
from mor.formats import read_foreign
from mor.formats.snap.delimited import angle_words, date_by
from mor.project.document import Document

COMMANDS = "title Three\ncoordinate_file {}\ndata_file {}\nmode 3d adjustment\nfix A B\n"
STATIONS = """Three
NZGD2000
options ellipsoidal_heights geoid_heights c=Order

A  41 00 46.8 S 173 19 15.6 E 150.0 10.0 2
B  41 00 25.2 S 173 19 40.8 E 250.0 10.0 2
C  41 00 28.8 S 173 19 58.8 E  70.0 10.0 3
"""
STATION_FORM = """! a comment
FORMAT DELIMITER=; QUOTE=" HEADER=Y
required_columns code
CODE @code
COORDINATE_SYSTEM @crs default $crs default "NZGD1949"
HEIGHT_TYPE "ellipsoidal"
LATITUDE @lat
LONGITUDE @lon
HEIGHT @h
GEOID_UNDULATION @N default 10
CLASSIFICATION_COLUMNS is_**
ANGLE_FORMAT $angles default "degrees"
"""
STATION_ROWS = """Code;Lat;Lon;H;N;is_Order
A;41 00 46.8 S;E 173 19 15.6;150.0;;2
B;-41 00 25.2;173 19 40.8E;250.0;10.0;2
"C";S 41 00 28.8;173 19 58.8;70.0;;3
"""
MEASURED = """Three
#date 12 May 2001
#classification equpt
#ds_error 3 mm 2 ppm
#data HA error no_heights
A
B 10 28 15.8 2.0
C 30 11 26.3 2.0

B
A 1 27 59.3 3.0
C 244 47 28.1 3.0

#data ZD error
A 1.5 B 1.6 83 35 17.3 4.0
#data SD equpt
A 1.5 B 1.6 894.9014 EDM
B 1.5 C 1.6 * 470.8370 EDM
A 1.5 C 1.6 1154.9438 OLD
#data LV error no_heights
B C -180.01 0.0041231056256176605
#date 3 Jan 2002
#data LT error no_heights
C 41 00 28.8 S 0.5
"""
FORM = """FORMAT CSV HEADER=Y
OBSERVATION
TYPE kinds(@Kind)
SET_ID @Set
INSTRUMENT_STATION @From
INSTRUMENT_HEIGHT @Hi default 0
TARGET_STATION @To
TARGET_HEIGHT @Ht
VALUE @Reading
ERROR @Sigma default usual(@Kind)
ERROR_FACTOR @Factor
DISTANCE_ERROR_TYPE "calculated"
HEIGHT_DIFFERENCE_ERROR_TYPE "calculated"
ANGLE_FORMAT "dms"
ANGLE_ERROR_UNIT "degrees"
DATETIME @Date default "12.5.2001"
DATETIME_FORMAT "DMY"
CLASSIFICATION equpt @Tool
REJECTED states(@State)
NOTE @Comment
END_OBSERVATION
LOOKUP kinds
direction HA
zenith ZD
slope SD
level LV
latitude LT
END_LOOKUP
LOOKUP usual
slope 3mm 2ppm
default 1 mm 2 mmrkm sqrt 4000
END_LOOKUP
LOOKUP states
bad Y
default N
END_LOOKUP
"""
ROWS = f"""From,To,Hi,Ht,Kind,Set,Reading,Sigma,Factor,Tool,State,Date,Comment
A,B,,,direction,1,10 28 15.8,{1 / 3600!r},2,,,,"one, two"
A,C,,,direction,1,30 11 26.3,{2 / 3600!r},,,,,

B,A,,,direction,1,1 27 59.3,{3 / 3600!r},,,,,
B,C,,,direction,1,244 47 28.1,{3 / 3600!r},,,,,
A,B,1.5,1.6,zenith,,83 35 17.3,{4 / 3600!r},,,,,
A,B,1.5,1.6,slope,,894.9014,,,EDM,,,
B,C,1.5,1.6,slope,,470.8370,,,EDM,bad,,
A,C,1.5,1.6,slope,,1154.9438,,,OLD,,,
B,C,,,level,,-180.01,,,,,,
C,,,,latitude,,-41 00 28.8,{0.5 / 3600!r},,,,3 Jan 2002,
"""


def _document(folder: Path, files: dict[str, str], name: str = "n.snp") -> Document:
    for file, text in files.items():
        (folder / file).write_text(text)
    return read_foreign(folder / name, "snap")


def _tables(document: Document) -> list[tuple[object, ...]]:
    """What tables say, without their files and the numbers of their sets."""
    found = []
    for section in ("points", "observations"):
        for table in document.data[section]:
            names = [name for name in table["columns"] if name != "set"]
            places = [table["columns"].index(name) for name in names]
            rows = [[round(float(row[k]), 12) if _number(row[k]) else row[k] for k in places] for row in table["rows"]]
            found.append((table.get("type"), tuple(names), str(rows), str(table.get("units"))))
    return sorted(found, key=str)


def _number(text: object) -> bool:
    try:
        float(str(text))
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("more", ["", "reject_observations equpt=OLD\n", "ignore_observations before 2002-01-01\n"])
def test_rows_say_what_lines_of_data_files_say(tmp_path: Path, more: str) -> None:
    """Lookups, defaults, options, calculated errors, factors, sets, dates, classifications and rejected rows."""
    own = _document(
        tmp_path,
        {"n.snp": COMMANDS.format("n.crd", "n.dat") + more, "n.crd": STATIONS, "n.dat": MEASURED},
    )
    delimited = COMMANDS.format("n.csv csv crs=NZGD2000 format=places angles=dms", "o.csv csv") + more
    files = {"places.dtf": STATION_FORM, "n.csv": STATION_ROWS, "obs.dtf": FORM, "o.csv": ROWS}
    other = _document(tmp_path, {"d.snp": delimited, **files}, "d.snp")
    assert _tables(own) == _tables(other)
    assert own.data["world"] == other.data["world"]
    assert sum("rejected" in note.message for note in other.notes) == 1


def test_errors_of_vectors_east_north_up_with_correlations(tmp_path: Path) -> None:
    """The covariance matrix by the rotation of the place, written out here."""
    form = """FORMAT WHITESPACE HEADER=N
COLUMNS from to dx dy dz
OBSERVATION
TYPE "GB"
INSTRUMENT_STATION @from
TARGET_STATION @to
VALUE @dx " " @dy " " @dz
ERROR "0.003 0.004 0.008 0.5 0.2 -0.1"
VECTOR_ERROR_TYPE "enu_correlation"
END_OBSERVATION
"""
    commands = COMMANDS.format("n.crd", "v.txt csv format=v")
    document = _document(
        tmp_path, {"n.snp": commands, "n.crd": STATIONS, "v.dtf": form, "v.txt": "A C -577.7 -525.3 437.2\n"}
    )
    (table,) = document.data["observations"]
    R = np.array([[1, 0.5, 0.2], [0.5, 1, -0.1], [0.2, -0.1, 1]])
    s = np.array([0.003, 0.004, 0.008])
    phi, lam = np.radians([-(41 + 37.8 / 3600), 173 + 19 / 60 + 37.2 / 3600])
    axes = np.array(
        [
            [-np.sin(lam), np.cos(lam), 0],
            [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)],
            [np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)],
        ]
    )
    expected = axes.T @ (R * np.outer(s, s)) @ axes
    cells = dict(zip(table["columns"], table["rows"][0], strict=True))
    found = np.array([[float(cells[f"cov_d{min(a, b)}_d{max(a, b)}"]) for b in "xyz"] for a in "xyz"])
    np.testing.assert_allclose(found, expected, atol=1e-10)


@pytest.mark.parametrize(
    ("text", "form", "date"),
    [
        ("25 dec 2011 7 15", "DMY hm", datetime(2011, 12, 25, 7, 15)),
        ("25/12/2011 07:15", "DMY hm", datetime(2011, 12, 25, 7, 15)),
        ("25 december 2011", "DMY hm", datetime(2011, 12, 25)),
        ("2010.249 00.15", "YNhm", datetime(2010, 9, 6, 0, 15)),
        ("", "YMD", None),
    ],
)
def test_dates_in_their_order(text: str, form: str, date: datetime | None) -> None:
    """The examples of the help of SNAP, and a day of the year."""
    assert date_by(text, form.replace(" ", "")) == date


@pytest.mark.parametrize("text", ["E 173 19 15.6", "173 19 15.6E", "173 19 15.6", "173 19 15.6 E"])
def test_hemispheres(text: str) -> None:
    """Before or behind the angle, or its sign."""
    assert angle_words(text, "EW") == ["173", "19", "15.6", "E"]
    assert angle_words("-1.5", "EW") == ["1.5", "W"]


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("obs.dtf", "kinds(@Kind)", '"QQ"', "o.csv:2: found the data type 'QQ'"),
        (
            "obs.dtf",
            "FORMAT CSV",
            "REQUIRED_COLUMNS Kind Quality\nFORMAT CSV",
            "o.csv:1: column 'quality' is missing",
        ),
        ("places.dtf", "DELIMITER=;", "DELIMITER=;;", "places.dtf:2: found 'DELIMITER=;; QUOTE"),
        ("obs.dtf", "SET_ID", "SAT_ID", "obs.dtf:4: command 'sat_id' is not supported"),
        ("o.csv", "30 11 26.3", "30 71 26.3", "o.csv:3: found the angle 30 71 26.3"),
        ("o.csv", "3 Jan 2002", "3 Mai 2002", "o.csv:12: found the date '3 Mai 2002'"),
        ("o.csv", "C,,,,latitude", ",,,,latitude", "o.csv:12: expected the names of the stations"),
        ("n.csv", '"C";S 41', '"C;S 41', "n.csv: the line cannot be divided into fields"),
        ("n.csv", "-41 00 25.2", "", "n.csv:3: expected a code, two coordinates and a height"),
    ],
)
def test_mistakes_are_told_with_file_and_line(tmp_path: Path, file: str, old: str, new: str, words: str) -> None:
    """One wrong thing at a time."""
    delimited = COMMANDS.format("n.csv csv crs=NZGD2000 format=places angles=dms", "o.csv csv")
    files = {
        "d.snp": delimited,
        "places.dtf": STATION_FORM,
        "n.csv": STATION_ROWS,
        "obs.dtf": FORM,
        "o.csv": ROWS,
    }
    files[file] = files[file].replace(old, new)
    with pytest.raises(InputError) as caught:
        _document(tmp_path, files, "d.snp")
    assert words in str(caught.value)
