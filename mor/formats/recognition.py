"""Which format a file or a folder has, by what is in it; suffixes only where that tells nothing."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mor.formats.aicon.files import is_stem
from mor.formats.bingo.files import is_bingo
from mor.formats.catalogue import FORMATS
from mor.formats.jag3d.columns import OBSERVATION_FILE, POINT_FILE
from mor.formats.metashape.projects import is_project
from mor.formats.pix4d.camera_file import HEAD as CAMERA_FILE
from mor.formats.pix4d.files import CAMERAS, OFFSET, kind_of
from mor.formats.text import decoded
from mor.input_files import is_folder

_HEAD = 1 << 16
"""Bytes at the beginning of a file that tell its format."""
_OWN = (".yaml", ".yml", ".csv", ".parquet")
"""Suffixes of mor's own files."""
COLMAP_FILES = ("cameras", "images", "points3D")


@dataclass(frozen=True)
class Sample:
    """The beginning of a file, or the names in a folder."""

    path: Path
    head: bytes = b""
    names: frozenset[str] = frozenset()

    @cached_property
    def text(self) -> str:
        """The beginning as text."""
        return decoded(self.head)[0]

    @cached_property
    def lines(self) -> list[list[str]]:
        """Words of the first lines; the last one, which may be cut off, is left out."""
        lines = self.text.split("\n")
        return [line.split() for line in (lines[:-1] if len(self.head) == _HEAD else lines)]

    @cached_property
    def root(self) -> str:
        """Name of the root element of an XML file without namespace, or nothing."""
        start = re.match(r"\s*<", self.text)
        found = re.search(r"<(?:[\w.-]+:)?([A-Za-z_][\w.-]*)", self.text) if start else None
        return found[1] if found else ""


def format_of(path: Path) -> str | None:
    """Key of the format of a file or folder; ``None`` for mor's own files and where nothing tells."""
    if is_stem(path):
        return "aicon"
    suffix = path.suffix.lower()
    if suffix in _OWN and suffix != ".csv":
        return None
    sample = _sample(path)
    if suffix == ".csv":
        return "metashape-reference" if _reference_pane(sample) else None
    for key, holds in _RULES:
        if key in FORMATS and holds(sample):
            return key
    return _by_suffix(path)


def _sample(path: Path) -> Sample:
    if is_folder(path):
        return Sample(path, names=frozenset(_names(path)))
    try:
        if not path.is_file():
            return Sample(path)
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
            return Sample(path, file.read(_HEAD))
    except (OSError, EOFError, ValueError, zlib.error):
        return Sample(path)


def _names(folder: Path) -> Iterator[str]:
    try:
        yield from (entry.name for entry in folder.iterdir())
    except OSError:
        return


def _by_suffix(path: Path) -> str | None:
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    last = suffixes[-1] if suffixes else ""
    return next((key for key, known in FORMATS.items() if last and last in known.suffixes), None)


def _numbers(words: list[str]) -> int:
    """How many words there are, if all are numbers."""
    try:
        for word in words:
            float(word)
    except ValueError:
        return 0
    return len(words)


def _colmap(sample: Sample) -> bool:
    if not sample.names:
        return sample.path.stem in COLMAP_FILES and sample.path.suffix in (".bin", ".txt")
    return any(all(f"{name}{end}" in sample.names for name in COLMAP_FILES) for end in (".bin", ".txt"))


def _opensfm(sample: Sample) -> bool:
    if sample.names:
        return "reconstruction.json" in sample.names or (
            "opensfm" in sample.names and (sample.path / "opensfm" / "reconstruction.json").is_file()
        )
    return sample.text.lstrip()[:1] in ("[", "{") and '"shots"' in sample.text + '"shots"' * (
        '"projection_type"' in sample.text
    )


def _pix4d(sample: Sample) -> bool:
    if not sample.names:
        return kind_of(sample.path.name) not in ("", OFFSET)
    inner = any((sample.path / name).is_dir() for name in ("1_initial/params", "params"))
    return inner or any(kind_of(name) == CAMERAS for name in sample.names)


def _jag3d(sample: Sample) -> bool:
    return any(POINT_FILE.match(name) for name in sample.names) and any(
        OBSERVATION_FILE.match(name) for name in sample.names
    )


def _alicevision(sample: Sample) -> bool:
    head = sample.text.lstrip()[:1] == "{" and '"version"' in sample.text
    return head and any(f'"{name}"' in sample.text for name in ("featuresFolders", "viewId", "intrinsicId"))


def _photomodeler(sample: Sample) -> bool:
    """Tolerance and iterations, nine σ, then the camera: lines 2, 3 and 4."""
    counts = [_numbers(words) for words in sample.lines[1:4]]
    return len(counts) == 3 and counts[0] in (2, 3, 4) and counts[1] >= 6 and counts[2] >= 5


def _sections(sample: Sample) -> bool:
    return any(len(words) > 0 and words[0].startswith("[") for words in sample.lines)


def _bal(sample: Sample) -> bool:
    """Three counts, then camera, point, x, y a line."""
    lines = [words for words in sample.lines[:4] if words]
    if len(lines) < 2 or len(lines[0]) != 3 or not all(word.isdecimal() for word in lines[0]):
        return False
    return all(len(words) == 4 and _numbers(words) == 4 for words in lines[1:2])


def _patb(sample: Sample) -> bool:
    """Photo and camera constant, then point, x, y a line, up to −99."""
    lines = [words for words in sample.lines if words and words[0][0] not in "#*!"]
    end = next((k for k, words in enumerate(lines) if words[0] == "-99"), 0)
    if end < 2 or not 2 <= len(lines[0]) <= 5 or not _numbers(lines[0][1:]):
        return False
    return all(len(words) >= 3 and _numbers(words[1:3]) == 2 for words in lines[1:end])


_STARNET = re.compile(
    r"\s*(?:\.[A-Za-z0-9]+|#|'|(?:C|E|B|A|D|V|DV|M|BM|L|SS|DB|DN|DM|DE|TB|T|TE|G0|G1|G2|G3|P)(?:\s|$))",
    re.IGNORECASE,
)
_STARNET_NAMES = re.compile(
    r"\s*(?:(?:B|A|D|V|DV|M|BM|L|SS)\s+\S+-\S+|DB\s+\S|TB\s+\S|C\s+\S+(?:\s+-?[\d.]+){2})", re.I
)


def _starnet(sample: Sample) -> bool:
    lines = [line for line in sample.text.split("\n")[:60] if line.strip()]
    fitting = sum(_STARNET.match(line) is not None for line in lines)
    return fitting >= 0.8 * len(lines) and sum(_STARNET_NAMES.match(line) is not None for line in lines) >= 2


def _beginning(pattern: str, least: int = 1) -> Callable[[Sample], bool]:
    """True where so many of the first lines, comments and empty ones aside, look like a pattern."""
    form = re.compile(pattern)

    def holds(sample: Sample) -> bool:
        lines = [line for line in sample.text.split("\n")[:40] if line.strip()]
        return sum(form.match(line) is not None for line in lines) >= min(least, max(len(lines), 1))

    return holds


def _snap(sample: Sample) -> bool:
    """A data file has a title and #data; a command file names its files."""
    lines = [words for words in sample.lines if words]
    data = any(words[0].lower() == "#data" for words in lines[1:])
    return data or {"coordinate_file", "data_file"} <= {words[0].lower() for words in lines}


def _geodimeter(sample: Sample) -> bool:
    lines = [line for line in sample.text.split("\n")[:40] if line.strip()]
    return bool(lines) and all(re.match(r"\s*\d{1,3}=", line) for line in lines)


def _aicon(sample: Sample) -> bool:
    return any(name.endswith((".ior", ".ior.gz")) for name in sample.names)


def _reference_pane(sample: Sample) -> bool:
    lines = sample.text.split("\n")[:6]
    return any(re.match(r"#?\s*label\s*[,;\t]\s*x/", line, re.IGNORECASE) for line in lines)


_RULES: tuple[tuple[str, Callable[[Sample], bool]], ...] = (
    ("colmap", _colmap),
    ("jag3d", _jag3d),
    ("pix4d", _pix4d),
    ("pix4d-cam", _beginning(CAMERA_FILE)),
    ("bingo", lambda sample: is_bingo(sample.names, sample.path)),
    ("openmvg", lambda sample: '"sfm_data_version"' in sample.text),
    ("alicevision", _alicevision),
    ("opensfm", _opensfm),
    ("aicon", _aicon),
    ("dbat", lambda sample: sample.root == "document" and "dbat_script_version" in sample.text),
    ("metashape", lambda sample: is_project(sample.path) and bool(sample.head)),
    ("metashape", lambda sample: sample.root in ("document", "chunk") and "<chunk" in sample.text),
    ("metashape-reference", _reference_pane),
    ("jobxml", lambda sample: sample.root == "JOBFile"),
    ("landxml", lambda sample: sample.root == "LandXML"),
    ("gkf", lambda sample: sample.root == "gama-local"),
    ("bundler", _beginning(r"# Bundle file")),
    ("bal", _bal),
    ("dynadjust", lambda sample: sample.text.startswith("!#=DNA")),
    ("dynaml", lambda sample: sample.root == "DnaXmlFormat"),
    ("sinex", lambda sample: sample.text.startswith("%=SNX")),
    ("jag3d-script", lambda sample: '"PointApriori"' in sample.text and "TABLE" in sample.text),
    ("snap", _snap),
    ("gsi", _beginning(r"\s*\*?\d{2}[\d.]{4}[+-]")),
    ("idx", lambda sample: bool(re.match(r"\s*HEADER\b", sample.text)) and "UNITS" in sample.text),
    ("sdr", _beginning(r"00..SDR")),
    ("m5", _beginning(r"For M5\|Adr")),
    ("rw5", _beginning(r"JB,NM|MO,AD\d,UN", 1)),
    ("nikon", _beginning(r"CO,\s*Nikon RAW")),
    ("sokkia-scr", _beginning(r"A,SET\d")),
    ("topcon", _beginning(r"(TopSURV|STN     |JOB     |UNITS   |BKB     )", 2)),
    ("geodimeter", _geodimeter),
    ("pat-b", _patb),
    ("starnet", _starnet),
    ("photomodeler", _photomodeler),
    ("textbook", _sections),
)
"""What tells each format, the first that holds."""
