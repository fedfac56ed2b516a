"""Formats are recognised by their structure, with reasons; nothing is guessed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, read_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, read_together

ROOTS = {"gama-local": "gkf", "LandXML": "landxml", "JOBFile": "jobxml", "DnaXmlFormat": "dynaml"}
RECORDS = {
    "gsi": "*110001+0000000000000A01 21.322+0000000000000000 22.322+0000000010000000\n",
    "sdr": "00NMSDR33 V04-04.02     01-Jan-20 00:00 113111\n10NMJOB             121111\n",
    "m5": "For M5|Adr 00001|TI  START                      |                      |      |      |\n",
    "rw5": "--a comment\nMO,AD0,UN1,SF1.0,EC0,EO0.0,AU0\nOC,OP1,N 1.0,E 2.0,EL3.0\nSS,OP1,FP2,AR1.0,ZE90.0\n",
    "nikon": "CO,Nikon RAW data format V2.00\nST,1,,2,,1.5,0.0,0.0\nSS,3,1.3,10.0,1.0000,90.0000,10:00:00,\n",
    "idx": "HEADER\n\tVERSION 1.20\n\tUNITS\n\t\tANGULAR DMS\n",
    "geodimeter": "2=100\n3=1.5\n5=1\n7=10.0\n",
    "dynadjust": "!#=DNA 3.01 STN    13.12.2018       GDA2020    01.01.2020         2\n",
    "gcp": "EPSG:32632\n500000.0 5000000.0 100.0 10 20 a.jpg P1\n500010.0 5000000.0 100.0 10 20 a.jpg P2\n",
}


@pytest.mark.parametrize("seed", range(40))
def test_the_root_of_xml_counts_after_prolog_and_comments(tmp_path: Path, seed: int) -> None:
    """Comments with tags of other formats, instructions, a document type, a byte order mark, a prefix."""
    random = np.random.default_rng(seed)
    root, key = list(ROOTS.items())[seed % len(ROOTS)]
    other = list(ROOTS)[(seed + 1) % len(ROOTS)]
    before = [
        f"<!-- <{other}> vector<double> -->",
        "<?xml-stylesheet href='a.xsl'?>",
        f"<!DOCTYPE {root} [<!ELEMENT {other} ANY>]>",
        "<!--\n[Handbook]\n-->",
    ]
    chosen = [before[k] for k in random.permutation(len(before))[: random.integers(1, 5)]]
    prefix = "p:" if random.random() < 0.3 else ""
    text = '<?xml version="1.0"?>\n' + "\n".join(chosen) + f"\n<{prefix}{root} a='1'>\n[section]\n</{prefix}{root}>"
    path = tmp_path / "file.txt"
    path.write_text(text, encoding="utf-8-sig" if random.random() < 0.5 else "utf-8")
    assert format_of(path) == key


@pytest.mark.parametrize("key", RECORDS)
@pytest.mark.parametrize("suffix", [".txt", "", ".raw"])
@pytest.mark.parametrize("noise", ["", "\x02\n", "\n\n"])
def test_records_tell_the_format_whatever_the_name(tmp_path: Path, key: str, suffix: str, noise: str) -> None:
    path = tmp_path / f"file{suffix}"
    path.write_text((noise if key not in ("dynadjust", "idx") else "") + RECORDS[key], newline="\r\n")
    assert format_of(path) == key


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "a.txt",
            "hello world\nthis is text\n",
            "this is text that begins with 'hello world', in no format that is read; the nearest are "
            "starnet (expected the codes and names of STAR*NET); gsi (expected blocks of words",
        ),
        ("a.txt", "a: [b\nc: }\n", "this is text that begins with 'a: [b'"),
        ("a.ini", "[core]\nkey = 1\n", "this is text that begins with '[core]'"),
        ("a.txt", "id;x;y\nA;1;2\n", "this is a table of 3 columns between semicolons"),
        ("a.txt", '{"a": 1}', "this is JSON, in no format that is read; the nearest are alicevision"),
        ("b.gsi", "", "this file is empty"),
        ("a.gsi", "hello\nworld\n", "expected words like 21.322"),
        (
            "a.xml",
            "<html><body/></html>",
            "XML with the root element <html>, in no format that is read; the nearest are jobxml",
        ),
        ("a.dat", "x\0y", "this is a binary file of an unknown kind"),
        ("a.txt", "", "this file is empty"),
        ("a.crd", "Week 1\n-----\nLOCAL GEODETIC DATUM: IGS14  EPOCH: 2018\n", "stations of the Bernese GNSS Software"),
        ("a.xml", '<?xml version="1.0"?\n<document><chunk/></document>\n', "begins as XML, but its first element"),
        ("heights.txt", "STN   REF   9.400\nSTN   PT2   0.200\n", "like observations of JAG3D (from, to, values)"),
        ("a.txt", "For R5|Adr 0001|TR OR.COOR|          |          |          |\n", "a Zeiss Elta file"),
        (
            "a.p4d",
            '<?xml version="1.0"?>\n<pix4dmapper>\n\t<software/>\n</pix4dmapper>\n',
            "a project file of Pix4Dmapper, which is not read; give the folder params",
        ),
        ("a.dc", "00TMSC V10-70       0   10/01/2021 13:52113111\n", "a Trimble DC file"),
        (
            "a.txt",
            "JOB     A\nsome\nother\nlines\n",
            "the nearest are topcon (expected 2 lines or more like the records STN, JOB, UNITS); ",
        ),
        (
            "a.txt",
            "10 8 3\n1 2 3 4\n" + "C P 1 2\n" * 8,
            "this file may have several formats (bal: three counts",
        ),
        ("a.dat", "4 2\nA -10.5 20\n" + "C B 1.5 -2.5\n" * 8 + "B A 1.5 -2.5 3\n" * 9, "this is text that begins with"),
        (
            "levels.txt",
            " 7 \t 8 \t0.5\t60.0\n 8 \t 9a \t1.5\t60.0\n",
            "a table of 4 columns without a header, like obs",
        ),
        ("levels.txt", "7 8 0.5 60\n8 9 1.5 60\n", "like observations of JAG3D (from, to, values)"),
        ("levels.txt", "7,8,0.5\n8,9,1.5\n", "a table of 3 columns without a header, like observations of JAG3D"),
        ("points.txt", "7 100.25\n8 100.5\n", "a table of 2 columns without a header, like a list of points"),
        ("a.txt", "one line longer than what is looked at " * 10_000, "text that begins with 'one line longer"),
    ],
)
def test_unknown_files_are_answered_with_what_they_look_like(tmp_path: Path, name: str, text: str, words: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_document(path)
    assert words in str(error.value)
    assert "YAML" not in str(error.value)


def test_names_of_starnet_may_be_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("C 1 100 200 !\nC 2 100 300\nD 1,2 100.0\nA 1,2,3 90-00-00\n")
    assert format_of(path) == "starnet"


@pytest.mark.parametrize("name", ["a.pdf", "a", "a.txt", "a.gsi", "a.dat"])
@pytest.mark.parametrize(
    ("begin", "words"),
    [
        (b"%PDF-1.7\n%\xe2\xe3", "a PDF document"),
        (b"\x89PNG\r\n\x1a\n", "an image"),
        (b"\xff\xd8\xff\xe0\0\x10JFIF", "an image"),
        (b"II*\0\x08\0", "an image"),
        (b"PK\3\4\x14\0[Content_Types].xml..PK\3\4xl/workbook.xml", "a spreadsheet"),
        (b"PK\3\4\0mimetypeapplication/vnd.oasis.opendocument.spreadsheet", "a spreadsheet"),
        (b"PK\3\4\0a.txt", "a ZIP archive"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", "a spreadsheet or document of Microsoft Office"),
        (b"(\xb5/\xfd", "a compressed file"),
        (
            b"SQLite format 3\0\x10" + bytes(1 << 17) + b"CREATE TABLE two_view_geometries (",
            "a database of COLMAP without poses, whose model is to be exported",
        ),
        (b"SQLite format 3\0", "an SQLite database"),
        (b"abc\0\1", "a binary file of an unknown kind"),
    ],
)
def test_binary_files_are_named_by_their_first_bytes(tmp_path: Path, name: str, begin: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(begin + bytes(range(256)))
    with pytest.raises(InputError, match=f"this is {words}, in no format that is read") as error:
        read_document(path)
    assert len(error.value.problems) == 1


@pytest.mark.parametrize("seed", range(60))
def test_any_text_is_answered_with_one_message_and_three_formats(tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    letters = np.array(list("abcdeXYZ0123456789 .,;:-+'\"{}[]()<>#%*\t\n\u00fc"))
    path = tmp_path / "file"
    path.write_text("q" + "".join(random.choice(letters, 300)), encoding=("utf-8", "latin-1", "utf-16")[seed % 3])
    with pytest.raises(InputError) as error:
        read_document(path)
    (message,) = error.value.problems
    assert "YAML" not in str(message)
    assert str(message).count(" (expected ") == 3


def test_a_project_file_may_have_any_suffix(tmp_path: Path) -> None:
    path = tmp_path / "project.txt"
    path.write_text("mor: 1\ntitle: a project\n")
    assert read_document(path).data["title"] == "a project"


GCP = """EPSG:32632
500000.0 5000000.0 100.0 99.5 199.5 a.jpg P1
500010.0 5000000.0 101.0 10 20 a.jpg P2
500010.0 5000000.0 101.0 15 25 elsewhere.jpg P2
"""


def test_a_control_list_alone_has_its_points(tmp_path: Path) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text(GCP)
    document = read_foreign(path, "gcp")
    assert [row[:4] for row in document.data["points"][0]["rows"]] == [
        ["P1", "500000.0", "5000000.0", "100.0"],
        ["P2", "500010.0", "5000000.0", "101.0"],
    ]
    assert "3 image points of 2 images not read: the file has no cameras" in " ".join(map(str, document.notes))
    assert len(read_network(document, tmp_path).things["point"].ids) == 2


def test_a_list_of_points_is_no_model_for_its_name_alone(tmp_path: Path) -> None:
    (tmp_path / "points3D.txt").write_text("1.489 1.094 -5.896\n1.139 0.936 -5.628\n")
    assert format_of(tmp_path / "points3D.txt") is None
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n10 20 7 30 40 7\n")
    assert format_of(tmp_path / "points3D.txt") == "colmap"


def test_a_control_list_beside_a_block_has_its_image_points(tmp_path: Path) -> None:
    """The names of images may lack their suffix; image points of other images are counted."""
    (tmp_path / "gcp_list.txt").write_text(GCP)
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 4000 3000 3000 3000 2000 1500\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n10 20 7 30 40 7\n2 1 0 0 0 1 0 0 1 b.jpg\n11 20 7\n")
    (tmp_path / "points3D.txt").write_text("7 0 0 10 0 0 0 1 1 0 2 0\n")
    document = read_together([tmp_path, tmp_path / "gcp_list.txt"], ["colmap", ""])
    rows = [row for table in document.data["observations"] for row in table.get("rows", [])]
    assert [row for row in rows if row[1] in ("P1", "P2")] == [
        ["a.jpg", "P1", "100.0", "200.0"],
        ["a.jpg", "P2", "10.5", "20.5"],
    ]
    assert "1 image point of images not in" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("first", "words"),
    [
        ("P1 1 2 3 4 5 a.jpg", "expected the coordinate system"),
        ("5;50.0;10.0*", "expected the coordinate system"),
    ],
)
def test_a_control_list_without_a_system_is_refused(tmp_path: Path, first: str, words: str) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text(f"{first}\n1 2 3 4 5 a.jpg\n")
    with pytest.raises(InputError, match=words):
        read_foreign(path)
