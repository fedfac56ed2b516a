"""Foreign files with mistakes in them: ``python -m tests.formats.mutants --count 10000`` reads so many of each format.

A mutant is read, and its network built, or it is refused with its file; anything else is a fault.
"""

from __future__ import annotations

import argparse
import io
import json
import resource
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from mor.api.pipeline import read_document
from mor.errors import InputError
from mor.formats import read_foreign, write_foreign
from mor.project.network import build_network
from mor.project.schema import validate

Files = dict[str, bytes]
_WORDS = (
    *(
        "",
        "0",
        "-1",
        "1e999",
        "nan",
        "inf",
        "1e-320",
        "x",
        "1,5",
        "1_0",
        "9" * 30,
        "-",
        "!",
        "*",
        "&",
        "'",
        '"',
        "#",
    ),
    *(
        "ä",
        "\x00",
        "\t",
        "NaN",
        "[",
        "]",
        "{}",
        "<a>",
        "&amp;",
        "=",
        "1e308",
        "0x10",
        "\ufeff",
        "--",
        "1.2.3",
    ),
)
_BYTES = (0, 1, 255, 128, 127, 10)


def materials(folder: Path) -> dict[str, tuple[str, str, Files]]:
    """Format, the file or folder that is read, and files, by name; what the tests of each format are made of."""
    from .test_alicevision import alicevision
    from .test_bal import _bal
    from .test_colmap import RIG
    from .test_comp3d import COMP, COR, observed
    from .test_dbat import SCRIPT, TABLES
    from .test_dynadjust import MEASURED, STATIONS
    from .test_dynaml import MEASURED as XML_MEASURED
    from .test_dynaml import STATIONS as XML_STATIONS
    from .test_field_books import BOOKS
    from .test_jag3d import FILES
    from .test_jag3d_script import small
    from .test_landxml import PLAN, survey
    from .test_metashape import PANE, XML, _zipped, projected, tied
    from .test_odd_books import FBK
    from .test_opensfm import _folder
    from .test_photomodeler_reader import HEAD, PHOTO, POINTS
    from .test_pix4d import CAM
    from .test_pix4d import project as pix4d
    from .test_sinex import _solution, sinex
    from .test_snap import COMMANDS
    from .test_snap import MEASURED as SNAP_DATA
    from .test_snap import STATIONS as SNAP_STATIONS
    from .test_starnet import PROJECT as STARNET_PROJECT
    from .test_starnet import _on_earth, _space
    from .test_textbook_reader import PLANE as TEXTBOOK

    def written_by(key: str, name: str) -> Files:
        source = Path(tempfile.mkdtemp(dir=folder))
        made = write_foreign(read_document(_bal(source)[0]), source, source / name, key)
        return {path.name: content for path, content in made.files.items()}

    opensfm = Path(tempfile.mkdtemp(dir=folder))
    _folder(opensfm)
    (opensfm / "gcp_list.txt").write_text("WGS84\n8.0 50.0 103.0 1999.5 1499.5 c.jpg P1\n")
    export = HEAD + "".join(PHOTO.format(n=n, c="25.5") for n in (0, 1)) + POINTS.format(control="  9 5 5 5 0 0 0\n")
    books = {Path(name).suffix[1:] + name[:1]: (name, text.encode()) for name, text in BOOKS.items()}
    suffixes = {"gsib": "gsi", "gsio": "gsi", "sdrb": "sdr", "m5b": "m5", "jxlb": "jobxml", "rw5b": "rw5"}
    return {
        "colmap text": ("colmap", "", {name: text.encode() for name, text in RIG.items()}),
        "colmap binary": ("colmap", "", written_by("colmap-binary", "m")),
        "opensfm": ("opensfm", "", {path.name: path.read_bytes() for path in opensfm.iterdir()}),
        "bal": ("bal", "p.bal", written_by("bal", "p.bal")),
        "metashape": ("metashape", "m.xml", {"m.xml": XML.encode()}),
        "metashape projection": ("metashape", "m.xml", {"m.xml": projected().encode()}),
        "metashape project": ("metashape", "m.psz", {"m.psz": _zipped(XML)}),
        "metashape tie points": (
            "metashape",
            "hall.psx",
            _tie_points(Path(tempfile.mkdtemp(dir=folder)), tied),
        ),
        "photomodeler": ("photomodeler", "e.txt", {"e.txt": export.encode()}),
        "jag3d": ("jag3d", "", {name: text.encode() for name, text in FILES.items()}),
        "reference pane": ("metashape-reference", "m.csv", {"m.csv": PANE.encode()}),
        "alicevision": ("alicevision", "a.sfm", {"a.sfm": json.dumps(alicevision(), indent=1).encode()}),
        "dynadjust": ("dynadjust", "n.msr", {"n.msr": MEASURED.encode(), "n.stn": STATIONS.encode()}),
        "sinex": ("sinex", "s.snx", {"s.snx": sinex(*_solution(9, 3)).encode()}),
        "snap": (
            "snap",
            "n.snp",
            {"n.snp": COMMANDS.encode(), "n.crd": SNAP_STATIONS.encode(), "n.dat": SNAP_DATA.encode()},
        ),
        "dbat": ("dbat", "w.xml", {"w.xml": SCRIPT.encode(), **{k: t.encode() for k, t in TABLES.items()}}),
        "jag3d script": ("jag3d-script", "n.script", {"n.script": small().encode()}),
        "pix4d": ("pix4d", "a_tp_pix4d.txt", {k: t.encode() for k, t in pix4d(3, 2, 6)[0].items()}),
        "pix4d camera": ("pix4d-cam", "a.cam", {"a.cam": CAM.encode()}),
        "dynaml": (
            "dynaml",
            "nmsr.xml",
            {"nmsr.xml": XML_MEASURED.encode(), "nstn.xml": XML_STATIONS.encode()},
        ),
        "landxml": ("landxml", "n.xml", {"n.xml": survey().encode()}),
        "landxml plan": ("landxml", "n.xml", {"n.xml": PLAN.encode()}),
        "starnet": ("starnet", "n.dat", {"n.dat": _space().encode()}),
        "starnet vectors": ("starnet", "n.dat", {"n.dat": _on_earth().encode()}),
        "starnet project": (
            "starnet",
            "p.snproj",
            {
                "p.snproj": STARNET_PROJECT.encode(),
                "one.dat": _space().encode(),
                "sub/two.dat": b".INST S9\nD 1-3 500\nSS 1-2-9 80 10 90\n",
            },
        ),
        **{name: (suffixes[name], file, {file: text}) for name, (file, text) in books.items()},
        "idx": ("idx", "a.idx", {"a.idx": _IDX.encode()}),
        "nikon": ("nikon", "a.raw", {"a.raw": _NIKON.encode()}),
        "topcon": ("topcon", "a.gts7", {"a.gts7": _TOPCON.encode()}),
        "fbk": ("fbk", "a.fbk", {"a.fbk": FBK.encode()}),
        "topcon stream": ("topcon", "a.raw", {"a.raw": _TOPCON_STREAM.encode()}),
        "comp3d": (
            "comp3d",
            "n.comp",
            {
                "n.comp": COMP.encode(),
                "n.cor": COR.encode(),
                "sub/n.obs": observed().encode(),
                "sub/more.obs": b"9 C D 0 0.003\n11 A @f.xyz V 2\n12 C @p.xyz\n",
                "sub/f.xyz": b"B 1 2 3 0.001\nC 3 -2 1 0.001 0.002 -0.003 0.0001\n",
                "sub/p.xyz": b"A 10 20 3 0.001 0.002 0.0001\nB 390 -5 4 0.001 0.0002 0.002 0.0001 1.5\n",
            },
        ),
        "comp3d on the earth": (
            "comp3d",
            "n.comp",
            {
                "n.comp": COMP.replace('"use_proj" : false', '"use_proj" : true, "proj_def" : "EPSG:2154"').encode(),
                "n.cor": b"1 A 600000 6500000 100 0 0 0 3.0 -2.0\n2 B 600100 6500000 90 0.01 0 0\n",
                "sub/n.obs": b"19 A @b.bas 2 1.5\n3 A B 100.5 0.001\n6 A B 106.3 0.001\n",
                "sub/b.bas": b"B 10 20 30 1e-6 1e-7 0 2e-6 -1e-7 3e-6 1.2\nC 1 2 3 1e-6 0 0 2e-6 0 3e-6\n",
            },
        ),
        "gkf": ("gkf", "n.gkf", {"n.gkf": _GKF.encode()}),
        "gcp": ("gcp", "gcp_list.txt", {"gcp_list.txt": _GCP.encode()}),
        "bundler": ("bundler", "bundle.out", {"bundle.out": _BUNDLER.encode()}),
        "textbook": ("textbook", "n.dat", {"n.dat": TEXTBOOK.encode()}),
        "sokkia": ("sokkia-scr", "a.scr", {"a.scr": _SOKKIA.encode()}),
        "geodimeter": ("geodimeter", "a.job", {"a.job": _GEODIMETER.encode()}),
    }


def _tie_points(folder: Path, tied: Callable[[Path, str], object]) -> Files:
    """A project with its archives."""
    tied(folder, "psx")
    archives = (folder / "hall.files").rglob("*.zip")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in [folder / "hall.psx", *archives]}


_TOPCON_STREAM = (
    "_'S1_(X_)1.500_+A_ ?+00012345m0903015+3595930d+00012344***+00+00000_*_,1.400_+B_ W+0001234\n"
    "56m08959300-00010200d+0000000001+0000000002-0000000003***+0000+000000_*T_,1.60000_+C_ <0900000+0450000d_*_,1.2_"
    "'S2_(_)1.700_+A_ ?+00020000m0900000+0000000d+00020000***_*_,1.300\n"
)
_GKF = (
    '<?xml version="1.0"?>\n<gama-local xmlns="http://www.gnu.org/software/gama/gama-local">\n'
    '<network axes-xy="ne" angles="left-handed" epoch="1.5">\n<description>a network</description>\n'
    '<parameters sigma-apr="10" conf-pr="0.95" tol-abs="1000" sigma-act="aposteriori" angles="400"/>\n'
    '<points-observations distance-stdev="5 3 1" direction-stdev="10" zenith-angle-stdev="10">\n'
    '<point id="A" x="0" y="0" z="10" fix="xyz"/>\n<point id="B" x="100" y="0" z="11" adj="XYz"/>\n'
    '<point id="C" x="50" y="80" adj="xyz"/>\n<obs from="A" from_dh="1.5">\n<direction to="B" val="0.0" stdev="5"/>\n'
    '<direction to="C" val="64.4"/>\n<distance to="B" val="100.0"/>\n<s-distance to="C" val="94.4" to_dh="1.2"/>\n'
    '<z-angle to="C" val="99.5"/>\n<angle bs="B" fs="C" val="64.4" stdev="10"/>\n'
    '<azimuth to="B" val="0-00-01" stdev="3"/>\n'
    "</obs>\n<height-differences>\n"
    '<dh from="A" to="C" val="2.0" dist="0.1" stdev="1.0"/>\n</height-differences>\n<vectors>\n'
    '<vec from="A" to="C" dx="50" dy="80" dz="2"/>\n<cov-mat dim="3" band="0">1 1 1</cov-mat>\n</vectors>\n'
    '<coordinates>\n<point id="B" x="100" y="0"/>\n<cov-mat dim="2" band="1">4 1 4</cov-mat>\n</coordinates>\n'
    "</points-observations>\n</network>\n</gama-local>\n"
)
_GCP = (
    "EPSG:32632\n500000 5500000 100.5 10.5 20.25 a.jpg P1\n500010 5500000 101 30 40 b.jpg P1 7\n"
    "500020 5500020 99 1 2 a.jpg\n"
)
_BUNDLER = (
    "# Bundle file v0.3\n2 2\n500 -0.1 0.01\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n510 0 0\n1 0 0\n0 1 0\n0 0 1\n-1 0 0\n"
    "0 0 -5\n255 255 255\n2 0 11 10.5 -20 1 12 3 4\n1 1 -6\n0 0 0\n2 0 1 5 6 1 2 7 8\n"
)
_IDX = (
    "HEADER\n\tUNITS\n\t\tANGULAR DMS\n\t\tLINEAR  METRE\n\tEND UNITS\nEND HEADER\nDATABASE\n"
    "\tPOINTS(PointNo, PointID, East, North, Elevation, Code, Date, CLASS)\n"
    '\t\t1,\t"A",\t10,\t20,\t1,\t"",\t,\tFIX;\n\t\t2,\t"B",\t30,\t20,\t1,\t"",\t,\tFIX;\n\tEND POINTS\nEND DATABASE\n'
    'THEODOLITE\n\tSETUP\n\t\tSTN_NO\t1\n\t\tSTN_ID\t"A"\n\t\tINST_HT\t1.5;\n\tEND SETUP\n'
    "\tSLOPE(TgtNo, TgtID, CfgNo, Hz, Vz, SDist, RefHt, Date, Ppm, ApplType, Flags)\n"
    '\t\t2,\t"B",\t1,\t90.0000,\t90.0000,\t20.0,\t1.5,\t,\t0,\t107,\t0;\n'
    '\t\t3,\t"C",\t1,\t17.573160,\t91.032780,\t12.5,\t1.5,\t,\t0,\t107,\t0;\n\tEND SLOPE\nEND THEODOLITE\n'
)
_NIKON = (
    "CO,Nikon RAW data format V2.00\nCO,Dist Units: Metres\nCO,Angle Units: DDDMMSS\nCO,Coord Order: NEZ\n"
    "MC,1,,100.000,200.000,10.000,\nST,1,,,,1.400,55.4500,55.4500\nF1,2,1.2,30.1,0.0000,90.0000,8:27:58\n"
    "SS,3,1.2,20.0,45.3000,91.1530,8:30:00,TREE\n"
)
_TOPCON = (
    "TopSURV v6.04\nJOB     G,\nUNITS   M,D\nSTN     1,1.5,\nXYZ     4000.0,2000.0,100.0\nBKB     2,45.00000,0.0\n"
    "BS      2,0.000\nHV      45.00000,87.46350\nSS      3,0.0,c\nSD      74.39010,87.47000,2.1650\n"
    "HD      7.0,2.1,0.1\n"
)
_SOKKIA = (
    "A,SET4C,13194,5802,5406,E0\nM,6.2.16,1,?,1.680,15,760,0.0,0.0,0.0,0,1,0\n"
    "1,Eh,0000,?,1.5,7,20.0,0.0,9.9,20.000,90.0000,90.0000,D7\n"
    "2,Ea,0000,?,0.085,0,7.244,102.3045,288.0705,4A\n16,Ee,0000,?,0.000,0,71.4030,191.2515,0.0020,-0.0000,BC\n"
)
_GEODIMETER = "2=GP1\n3=1.5\n5=3\n6=1.3\n17=174.0749\n7=354.0755\n8=89.1805\n5=P3\n7=223.1343\n9=85.921\n11=85.9\n"


def mutant(rng: np.random.Generator, files: Files) -> Files:
    """One of the files with one to three changes."""
    changed = dict(files)
    for _ in range(int(rng.integers(1, 4))):
        name = sorted(changed)[int(rng.integers(len(changed)))]
        content = changed[name]
        archive = content.startswith(b"PK") and content == files[name] and rng.random() < 0.8
        changed[name] = _packed(rng, content) if archive else _changed(rng, content)
    return changed


def _changed(rng: np.random.Generator, content: bytes) -> bytes:
    binary = b"\0" in content[:400] or rng.random() < 0.1
    return _bytes(rng, content) if binary else _text(rng, content)


def _packed(rng: np.random.Generator, content: bytes) -> bytes:
    """An archive with a change in one of its files: changed bytes of the archive itself fail at its checksums."""
    result = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(result, "w") as new:
        chosen = int(rng.integers(len(old.namelist())))
        for number, name in enumerate(old.namelist()):
            inside = old.read(name)
            new.writestr(name, _changed(rng, inside) if number == chosen else inside)
    return result.getvalue()


def _bytes(rng: np.random.Generator, content: bytes) -> bytes:
    if not content:
        return b"\xff"
    at, kind = int(rng.integers(len(content))), int(rng.integers(4))
    if kind == 0:
        return content[:at]
    if kind == 1:
        return content[:at] + bytes([_BYTES[int(rng.integers(len(_BYTES)))]]) + content[at + 1 :]
    if kind == 2:
        return content[:at] + content[at + int(rng.integers(1, 9)) :]
    return content[:at] + rng.bytes(int(rng.integers(1, 9))) + content[at:]


def _text(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.decode("utf-8", "replace").split("\n")
    at, kind = int(rng.integers(len(lines))), int(rng.integers(6))
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(at, lines[int(rng.integers(len(lines)))])
    elif kind == 2:
        lines = lines[:at]
    else:
        words = lines[at].split(" ")
        place = int(rng.integers(len(words)))
        word = _WORDS[int(rng.integers(len(_WORDS)))]
        words[place] = word if kind < 5 else words[place] + word
        lines[at] = " ".join(words)
    return "\n".join(lines).encode("utf-8", "replace")


def fault(key: str, path: Path, network: bool = True) -> str:
    """Return words for a fault in reading a file, and perhaps in its network; empty if there is none."""
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            document = read_foreign(path, key)
            project = validate(document)
            if network:
                build_network(project, document, path.parent)
    except InputError as error:
        if not error.problems or not all(problem.file for problem in error.problems):
            return f"refused without a file: {error}"
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        return f"{type(error).__name__}: {error}"
    seconds = time.process_time() - began
    return f"took {seconds:.1f} s" if seconds > 10.0 else ""


def faults(name: str, seed: int, count: int, folder: Path, networks: int = 1) -> Iterator[tuple[int, str]]:
    """Numbers of the mutants of a material that are read wrongly, and what is wrong.

    Of every ``networks``-th mutant the network is built, too, which takes five times as long as reading it.
    """
    known = materials(folder)
    key, main, files = known[name]
    order = sorted(known).index(name)
    place = Path(tempfile.mkdtemp(dir=folder))
    for number in range(count):
        rng = np.random.default_rng([seed, order, number])
        for file, content in mutant(rng, files).items():
            (place / file).parent.mkdir(parents=True, exist_ok=True)
            (place / file).write_bytes(content)
        found = fault(key, place / main if main else place, number % networks == 0)
        if found:
            yield number, found


def main() -> None:
    """Read mutants of every format, and say what went wrong."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--networks", type=int, default=1, help="every so many mutants a network is built")
    parser.add_argument("--only", default="", help="materials, between commas")
    given = parser.parse_args()
    total = 0
    with tempfile.TemporaryDirectory(prefix="mutants") as temporary:
        for name in materials(Path(temporary)):
            if given.only and name not in given.only.split(","):
                continue
            found = list(faults(name, given.seed, given.count, Path(temporary), given.networks))
            total += len(found)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
            print(f"{name}: {given.count} mutants, {len(found)} faults, peak so far {peak:.2f} GB", flush=True)
            for number, words in found[:5]:
                print(f"  {number}: {words}")
    sys.exit(1 if total else 0)


if __name__ == "__main__":
    main()
