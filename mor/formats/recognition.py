"""Recognise the format of a file or folder by its structure: XML root, magic numbers, records, and last its suffix.

Every format has a rule that returns the reason why an input may have it. Two formats with equally good reasons are told
apart by the suffix, or not at all: nothing is guessed.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from mor.formats.aicon.files import is_stem
from mor.formats.bingo.files import is_bingo
from mor.formats.catalogue import FORMATS
from mor.formats.jag3d.columns import OBSERVATION_FILE, POINT_FILE
from mor.formats.metashape.projects import is_project
from mor.formats.opensfm.ground_control import SYSTEM
from mor.formats.pix4d.camera_file import HEAD as CAMERA_FILE
from mor.formats.pix4d.files import CAMERAS, OFFSET, kind_of
from mor.formats.text import decoded
from mor.input_files import is_folder

_HEAD = 1 << 16
"""Bytes at the beginning of a file that tell its format."""
_RECORDS = 40
"""Lines that tell a format of records."""
_ROOT = re.compile(
    r"\ufeff?\s*(?:(?:<\?.*?\?>|<!--.*?-->|<!DOCTYPE(?:[^\[>]|\[.*?\])*>)\s*)*<(?:[\w.-]+:)?([A-Za-z_][\w.-]*)",
    re.DOTALL,
)
_VAGUE = (".txt", ".dat", ".out", ".raw", ".job", ".xml", ".json", ".gz")
"""Suffixes that many programs use: they are no reason for a format."""
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
        """Name of the root element of an XML file without namespace; empty for other files.

        Declaration, comments, processing instructions and document type before it are skipped.
        """
        found = _ROOT.match(self.text)
        return found[1] if found else ""

    @cached_property
    def records(self) -> list[str]:
        """The first lines that are not empty, without the control characters of a serial line."""
        lines = self.text.split("\n")
        lines = lines[:-1] if len(self.head) == _HEAD else lines
        return [bare for line in lines if (bare := line.strip("\0\1\2\3\4\x1a\r")).strip()][:_RECORDS]


class Candidate(NamedTuple):
    """A format that an input may have, and why."""

    key: str
    reason: str
    certain: bool = False
    """True for an XML root, a magic number or the files of a folder; False for lines that look like its records."""


def format_of(path: Path) -> str | None:
    """Key of the format of a file or folder; ``None`` for mor's own files and if nothing or too much tells."""
    if is_stem(path):
        return "aicon"
    suffix = path.suffix.lower()
    if suffix in _OWN and suffix != ".csv":
        return None
    sample = _sample(path)
    if suffix == ".csv":
        return "metashape-reference" if _reference_pane(sample) else None
    found = candidates(sample)
    return found[0].key if len(found) == 1 else _by_suffix(path) if not found else None


def candidates(sample: Sample) -> list[Candidate]:
    """Formats whose rules hold: the certain ones if there are any, and of several those of the suffix."""
    found = [Candidate(rule.key, reason, rule.certain) for rule in _RULES if (reason := rule.reason(sample))]
    found = [c for k, c in enumerate(found) if c.key not in [other.key for other in found[:k]]]
    found = [c for c in found if c.certain] or found
    by_suffix = [c for c in found if sample.path.suffix.lower() in FORMATS[c.key].suffixes]
    return by_suffix if len(found) > 1 and by_suffix else found


def explain_unknown(path: Path) -> str:
    """Say which formats a file is nearest to, and why, if none or several of them can be meant."""
    sample = _sample(path)
    found = candidates(sample)
    if len(found) > 1:
        said = "; ".join(f"{c.key}: {c.reason}" for c in found)
        return f"this file may have several formats ({said}); --from tells which"
    for pattern, words in _NOT_READ:
        if any(pattern.search(line) for line in sample.records[:3]):
            return words
    if b"\0" in sample.head:
        return "this is a binary file of no format that is read; --from tells the format if it has one"
    if not sample.text.strip():
        return "this file is empty"
    near = _nearest(sample)
    if near:
        said = "; ".join(f"{c.key} ({c.reason})" for c in near)
        return f"the format of this file is unknown; the nearest are {said}; --from tells the format"
    if sample.root:
        return f"the root element <{sample.root}> is that of no format that is read"
    return "this text has no records of a format that is read; mor new begins a project from tables"


_NOT_READ = (
    (
        re.compile(r"^00..SC V"),
        "this is a Trimble DC file (Survey Controller), which is not read; export the job as JobXML (.jxl)",
    ),
    (re.compile(r"RINEX VERSION / TYPE"), "this is a RINEX file; GNSS receivers' raw data are not read"),
)
"""Formats that are known and not read."""


def _nearest(sample: Sample) -> list[Candidate]:
    """At most three formats of records that some lines look like, or whose suffix the file has."""
    scores: list[tuple[float, Candidate]] = []
    for key, pattern, _, form in _RECORD_FORMATS:
        count = sum(pattern.match(line) is not None for line in sample.records)
        if count:
            words = f"{count} of its first {len(sample.records)} lines look like {form}"
            scores.append((count / len(sample.records), Candidate(key, words)))
    suffix = sample.path.suffix.lower()
    for key, known in FORMATS.items():
        if suffix and suffix in known.suffixes and known.read is not None:
            scores.append((0.5 if suffix not in _VAGUE else 0.01, Candidate(key, f"the suffix {suffix}")))
    scores.sort(key=lambda scored: -scored[0])
    best: dict[str, Candidate] = {}
    for _, candidate in scores:
        best.setdefault(candidate.key, candidate)
    return list(best.values())[:3]


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
    found = [key for key, known in FORMATS.items() if last in known.suffixes and known.read is not None]
    return found[0] if len(found) == 1 and last not in _VAGUE else None


def _numbers(words: list[str]) -> int:
    """Number of words if all of them are numbers."""
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


def _idx(sample: Sample) -> bool:
    head = re.match(r"\s*HEADER\b", sample.text) is not None and "UNITS" in sample.text
    return (
        head
        or re.search(r"^\s*(?:SLOPE|POINTS)\(.*\)\s*$", sample.text, re.MULTILINE | re.IGNORECASE) is not None
    )


def _sections(sample: Sample) -> bool:
    return not sample.root and any(len(words) > 0 and words[0].startswith("[") for words in sample.lines)


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


def _snap(sample: Sample) -> bool:
    """A data file has a title and #data; a command file names its files."""
    lines = [words for words in sample.lines if words]
    data = any(words[0].lower() == "#data" for words in lines[1:])
    return data or {"coordinate_file", "data_file"} <= {words[0].lower() for words in lines}


def _geodimeter(sample: Sample) -> bool:
    fitting = sum(re.match(r"\s*\d{1,3}\s*=", line) is not None for line in sample.records)
    return fitting > 0 and fitting >= 0.8 * len(sample.records)


def _aicon(sample: Sample) -> bool:
    return any(name.endswith((".ior", ".ior.gz")) for name in sample.names)


def _reference_pane(sample: Sample) -> bool:
    lines = sample.text.split("\n")[:6]
    return any(re.match(r"#?\s*label\s*[,;\t]\s*x/", line, re.IGNORECASE) for line in lines)


def _gcp(sample: Sample) -> bool:
    """A coordinate system, then x y z u v and an image a line; or the name that OpenDroneMap asks for."""
    if sample.path.name.lower() == "gcp_list.txt":
        return True
    lines = [line for line in sample.records if not line.startswith("#")]
    if len(lines) < 2 or not SYSTEM.match(lines[0].strip()):
        return False
    words = [line.split() for line in lines[1:4]]
    return all(len(row) >= 6 and _numbers(row[:5]) == 5 for row in words)


_RECORD_FORMATS: tuple[tuple[str, re.Pattern[str], int, str], ...] = (
    ("gsi", re.compile(r"\s*\*?\d{2}[\d.]{4}[+-]"), 1, "blocks of words as in 110001+00000001"),
    ("sdr", re.compile(r"00..SDR"), 1, "the head of an SDR33 file"),
    ("m5", re.compile(r"For M5\|Adr"), 1, "records For M5|Adr"),
    (
        "rw5",
        re.compile(r"JB,NM|MO,AD\d,UN|(?:OC|BK|SS|TR|FS|BD|BR|FD|FR),OP|SP,PN|GPS,PN|LS,H[IR]"),
        1,
        "the records JB, MO, OC",
    ),
    (
        "nikon",
        re.compile(r"CO,.*\bRAW data|(?:SS|F[12]),[^,]*,-?[\d.]+,-?[\d.]*,-?[\d.]+,", re.IGNORECASE),
        1,
        "comma-separated records CO, ST, SS",
    ),
    ("sokkia-scr", re.compile(r"A,SET\d"), 1, "the head of a SET file"),
    (
        "topcon",
        re.compile(r"(?:TopSURV|STN     |JOB     |UNITS   |BKB     )"),
        2,
        "the records STN, JOB, UNITS",
    ),
    ("pix4d-cam", re.compile(CAMERA_FILE), 1, "the head of a camera file"),
    ("bundler", re.compile(r"# Bundle file"), 1, "the head of a bundle file"),
)
"""Formats of records: key, a line, how many such lines there are at least, and what they look like."""


class _Rule(NamedTuple):
    key: str
    reason: Callable[[Sample], str]
    certain: bool


def _root(key: str, name: str, words: str = "") -> _Rule:
    """A rule for the root element of an XML file, which has certain words in it."""

    def reason(sample: Sample) -> str:
        return f"its root element is <{name}>" if sample.root == name and words in sample.text else ""

    return _Rule(key, reason, True)


def _records(key: str, pattern: re.Pattern[str], least: int, form: str) -> _Rule:
    """A rule for so many lines, or all there are, that look like a record."""

    def reason(sample: Sample) -> str:
        if sample.root or not sample.records:
            return ""
        count = sum(pattern.match(line) is not None for line in sample.records)
        return f"lines look like {form}" if count >= min(least, len(sample.records)) else ""

    return _Rule(key, reason, False)


def _if(key: str, holds: Callable[[Sample], bool], said: str, certain: bool = True) -> _Rule:
    return _Rule(key, lambda sample: said if holds(sample) else "", certain)


_RULES: tuple[_Rule, ...] = (
    _if("colmap", _colmap, "the files of a COLMAP model"),
    _if("jag3d", _jag3d, "the file names of a JAG3D project"),
    _if("pix4d", _pix4d, "the file names of Pix4Dmapper"),
    _if("bingo", lambda sample: is_bingo(sample.names, sample.path), "the file names of BINGO"),
    _if("openmvg", lambda sample: '"sfm_data_version"' in sample.text, "JSON with sfm_data_version"),
    _if("alicevision", _alicevision, "JSON with views and intrinsics"),
    _if("opensfm", _opensfm, "a reconstruction with shots"),
    _if("aicon", _aicon, "the file names of AICON 3D Studio"),
    _root("dbat", "document", "dbat_script_version"),
    _if("metashape", lambda sample: is_project(sample.path) and bool(sample.head), "a Metashape project"),
    _root("metashape", "document", "<chunk"),
    _root("metashape", "chunk", "<chunk"),
    _if("metashape-reference", _reference_pane, "the columns of a reference pane"),
    _root("jobxml", "JOBFile"),
    _root("landxml", "LandXML"),
    _root("gkf", "gama-local"),
    _if("dynadjust", lambda sample: sample.text.startswith("!#=DNA"), "the head !#=DNA"),
    _root("dynaml", "DnaXmlFormat"),
    _if("sinex", lambda sample: sample.text.startswith("%=SNX"), "the head %=SNX"),
    _if("jag3d-script", lambda s: '"PointApriori"' in s.text and "TABLE" in s.text, "tables of JAG3D"),
    _if("gcp", _gcp, "a coordinate system, then x y z u v and an image a line", certain=False),
    _if("bal", _bal, "three counts, then four numbers a line", certain=False),
    _if("snap", _snap, "the commands of SNAP"),
    *(_records(*form) for form in _RECORD_FORMATS),
    _if("idx", _idx, "the sections of an IDX file", certain=False),
    _if("geodimeter", _geodimeter, "a label and a value a line", certain=False),
    _if("pat-b", _patb, "photos that end with -99", certain=False),
    _if("starnet", _starnet, "the codes and names of STAR*NET", certain=False),
    _if("photomodeler", _photomodeler, "the head of a PhotoModeler export", certain=False),
    _if("textbook", _sections, "sections in brackets", certain=False),
)
"""What tells each format."""
