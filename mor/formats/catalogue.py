"""The formats mor knows: their keys, what reads and writes them, and on what that was tried."""

from __future__ import annotations

from typing import NamedTuple


class Code(NamedTuple):
    """Module and name of a reader or writer; it is imported when it is used."""

    module: str
    function: str


class FileFormat(NamedTuple):
    """One foreign format."""

    title: str
    read: Code | None = None
    write: Code | None = None
    suffixes: tuple[str, ...] = ()
    """Suffixes that mean this format and no other, where the content does not tell, and of files that are written."""
    folder: bool = False
    """True if a folder is a project."""
    beside: Code | None = None
    """Reader of a file that is put together with others, if it has more to say then."""
    untried: str = ""
    """What was not tried on files of the program itself, told on every conversion; empty if all was."""


def _book(module: str, function: str) -> Code:
    return Code(f"mor.formats.fieldbook.{module}", function)


FORMATS: dict[str, FileFormat] = {
    "colmap": FileFormat(
        "COLMAP model (folder, text or binary; written as text)",
        Code("mor.formats.colmap.reader", "read_colmap"),
        Code("mor.formats.colmap.writer", "write_colmap"),
        folder=True,
    ),
    "colmap-binary": FileFormat(
        "COLMAP model, written as binary", write=Code("mor.formats.colmap.writer", "write_colmap_binary")
    ),
    "opensfm": FileFormat(
        "OpenSfM or OpenDroneMap block (folder, reconstruction.json)",
        Code("mor.formats.opensfm", "read_opensfm"),
        folder=True,
    ),
    "gcp": FileFormat(
        "OpenDroneMap ground control (gcp_list.txt)",
        Code("mor.formats.recognition", "read_gcp_list"),
        Code("mor.formats.opensfm", "write_gcp_list"),
        beside=Code("mor.formats.recognition", "read_gcp_list_of_block"),
    ),
    "alicevision": FileFormat(
        "AliceVision, Meshroom (.sfm)",
        Code("mor.formats.alicevision", "read_alicevision"),
        suffixes=(".sfm",),
        untried="with a real file only cameras and poses were tested; image points follow the source",
    ),
    "metashape": FileFormat(
        "Metashape cameras.xml, markers.xml; projects .psz and .psx with tie points",
        Code("mor.formats.metashape", "read_metashape"),
        Code("mor.formats.metashape", "write_metashape"),
        untried="tested on a project of PhotoScan, on mor's own output and on excerpts of files of Metashape; "
        "no .psx and no tie points were available",
    ),
    "metashape-reference": FileFormat(
        "Metashape reference pane as text: markers or cameras",
        Code("mor.formats.metashape", "read_reference"),
        untried="no export of the reference pane was available: this reader follows the manual",
    ),
    "bal": FileFormat(
        "BAL, bundle adjustment in the large",
        Code("mor.formats.bal", "read_bal"),
        Code("mor.formats.bal", "write_bal"),
        suffixes=(".bal",),
    ),
    "bundler": FileFormat("Bundler (bundle.out)", Code("mor.formats.bal", "read_bundler"), suffixes=(".out",)),
    "gkf": FileFormat(
        "GNU Gama network",
        Code("mor.formats.gkf.reader", "read_gkf"),
        Code("mor.formats.gkf.writer", "write_gkf"),
        suffixes=(".gkf",),
    ),
    "gsi": FileFormat("Leica GSI-8, GSI-16", _book("gsi", "read_gsi"), suffixes=(".gsi",)),
    "idx": FileFormat("Leica IDX", _book("recorders", "read_idx"), suffixes=(".idx",)),
    "sdr": FileFormat("Sokkia SDR20, SDR33, SDL", _book("recorders", "read_sdr"), suffixes=(".sdr",)),
    "sokkia-scr": FileFormat("Sokkia SCR", _book("lists", "read_sokkia_scr"), suffixes=(".scr",)),
    "nikon": FileFormat("Nikon RAW", _book("lists", "read_nikon"), suffixes=(".raw", ".nik")),
    "topcon": FileFormat("Topcon GTS-7, GTS-6", _book("lists", "read_topcon"), suffixes=(".gts7", ".gt7")),
    "m5": FileFormat("Zeiss and Trimble M5", _book("recorders", "read_m5"), suffixes=(".m5",)),
    "geodimeter": FileFormat("Geodimeter ARE, JOB", _book("recorders", "read_geodimeter"), suffixes=(".are", ".job")),
    "rw5": FileFormat("Carlson RW5, TDS raw data", _book("recorders", "read_rw5"), suffixes=(".rw5",)),
    "fbk": FileFormat("Autodesk FBK", _book("recorders", "read_fbk"), suffixes=(".fbk",)),
    "jobxml": FileFormat(
        "Trimble JobXML",
        _book("landxml", "read_jobxml"),
        suffixes=(".jxl",),
        untried="with real jobs only GNSS surveys were tested; total-station records follow the schema",
    ),
    "starnet": FileFormat(
        "STAR*NET input data", Code("mor.formats.starnet", "read_starnet"), Code("mor.formats.starnet", "write_starnet")
    ),
    "dynadjust": FileFormat(
        "DynAdjust DNA files (.stn with .msr, and .geo): networks on the earth",
        Code("mor.formats.dynadjust.reader", "read_dynadjust"),
        Code("mor.formats.dynadjust.writer", "write_dynadjust"),
        suffixes=(".stn", ".msr"),
    ),
    "dynaml": FileFormat(
        "DynaML (pair of …stn.xml and …msr.xml, and .geo): networks on the earth",
        Code("mor.formats.dynadjust.reader", "read_dynaml"),
        Code("mor.formats.dynadjust.writer", "write_dynaml"),
    ),
    "snap": FileFormat(
        "SNAP command file (.snp), or coordinate and data files (.crd with .dat): networks on the earth",
        Code("mor.formats.snap.reader", "read_snap"),
        Code("mor.formats.snap.writer", "write_snap"),
        suffixes=(".snp", ".crd"),
    ),
    "comp3d": FileFormat(
        "Comp3D (.comp, or .cor with .obs)",
        Code("mor.formats.comp3d", "read_comp3d"),
        suffixes=(".obs", ".cor", ".comp"),
    ),
    "sinex": FileFormat(
        "SINEX: a GNSS solution with its covariance matrix",
        Code("mor.formats.sinex", "read_sinex"),
        Code("mor.formats.sinex", "write_sinex"),
        suffixes=(".snx",),
    ),
    "jag3d": FileFormat(
        "JAG3D column text (folder, names of files tell their kinds)",
        Code("mor.formats.jag3d", "read_jag3d"),
        Code("mor.formats.jag3d", "write_jag3d"),
        folder=True,
        untried="no project of JAG3D was available: this follows its wiki and the source of its import",
    ),
    "jag3d-script": FileFormat(
        "JAG3D project as SQL text (HSQLDB script with rows)",
        Code("mor.formats.jag3d", "read_jag3d_script"),
        suffixes=(".script",),
        untried="no project of JAG3D was available: this reader follows the tables that its source makes",
    ),
    "textbook": FileFormat("textbook network (Krumm)", Code("mor.formats.textbook", "read_krumm"), suffixes=(".dat",)),
    "photomodeler": FileFormat("PhotoModeler text export", Code("mor.formats.photomodeler", "read_photomodeler")),
    "dbat": FileFormat("DBAT script (XML with the tables it names)", Code("mor.formats.dbat", "read_dbat")),
    "pix4d": FileFormat(
        "Pix4Dmapper parameters (folder params, or …_calibrated_camera_parameters.txt)",
        Code("mor.formats.pix4d", "read_pix4d"),
        folder=True,
        untried="with real files only cameras and poses were tested; image points and control points follow the manual "
        "and other programs",
    ),
    "pix4d-cam": FileFormat(
        "Pix4D camera file (.cam)",
        Code("mor.formats.recognition", "read_camera_file"),
        suffixes=(".cam",),
        untried="tested on the lines of one public file",
    ),
    "pix4d-gcp": FileFormat(
        "Pix4D ground control (name, X, Y, Z, accuracies)",
        Code("mor.formats.pix4d", "read_control"),
        untried="no file of users was available: this reader follows the manual",
    ),
    "aicon": FileFormat(
        "AICON 3D Studio flat files",
        Code("mor.formats.aicon", "read_aicon"),
        Code("mor.formats.aicon", "write_aicon"),
        suffixes=(".ior", ".eor", ".obc", ".phc", ".scale"),
        folder=True,
    ),
    "ply": FileFormat("PLY points", write=Code("mor.formats.drawing", "write_ply"), suffixes=(".ply",)),
    "dxf": FileFormat("DXF drawing", write=Code("mor.formats.drawing", "write_dxf"), suffixes=(".dxf",)),
    "geojson": FileFormat("GeoJSON", write=Code("mor.formats.drawing", "write_geojson"), suffixes=(".geojson",)),
    "landxml": FileFormat(
        "LandXML: surveys with their points; written: points",
        _book("landxml", "read_landxml"),
        Code("mor.formats.drawing", "write_landxml"),
        suffixes=(".landxml",),
    ),
    "opencv": FileFormat("OpenCV camera files", write=Code("mor.formats.calibration", "write_opencv")),
}
"""Formats by the key that ``--from`` and ``--to`` take."""
