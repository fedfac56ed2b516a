"""The formats mor knows: their keys, what reads and writes them, and on what that was tried."""

from __future__ import annotations

from typing import NamedTuple


class FileFormat(NamedTuple):
    """One foreign format."""

    title: str
    read: str | None = None
    """Reader as ``module:function`` below ``mor.formats``; it is imported when it is used."""
    write: str | None = None
    suffixes: tuple[str, ...] = ()
    """Suffixes that mean this format and no other, where the content does not tell, and of files that are written."""
    folder: bool = False
    """True if a folder is a project."""
    beside: str | None = None
    """Reader of a file that is put together with others, if it has more to say then."""
    untried: str = ""
    """What was not tried on files of the program itself, told on every conversion; empty if all was."""


FORMATS: dict[str, FileFormat] = {
    "colmap": FileFormat(
        "COLMAP model (folder, text or binary; written as text)",
        "colmap.reader:read_colmap",
        "colmap.writer:write_colmap",
        folder=True,
    ),
    "colmap-binary": FileFormat("COLMAP model, written as binary", write="colmap.writer:write_colmap_binary"),
    "opensfm": FileFormat(
        "OpenSfM or OpenDroneMap block (folder, reconstruction.json)", "opensfm:read_opensfm", folder=True
    ),
    "gcp": FileFormat(
        "OpenDroneMap ground control (gcp_list.txt)",
        "recognition:read_gcp_list",
        "opensfm:write_gcp_list",
        beside="recognition:read_gcp_list_of_block",
    ),
    "alicevision": FileFormat(
        "AliceVision, Meshroom (.sfm)",
        "alicevision:read_alicevision",
        suffixes=(".sfm",),
        untried="with a real file only cameras and poses were tested; image points follow the source",
    ),
    "metashape": FileFormat(
        "Metashape cameras.xml, markers.xml; projects .psz and .psx with tie points",
        "metashape:read_metashape",
        "metashape:write_metashape",
        untried="tested on a project of PhotoScan, on mor's own output and on excerpts of files of Metashape; "
        "no .psx and no tie points were available",
    ),
    "metashape-reference": FileFormat(
        "Metashape reference pane as text: markers or cameras",
        "metashape:read_reference",
        untried="no export of the reference pane was available: this reader follows the manual",
    ),
    "bal": FileFormat("BAL, bundle adjustment in the large", "bal:read_bal", "bal:write_bal", suffixes=(".bal",)),
    "bundler": FileFormat("Bundler (bundle.out)", "bal:read_bundler", suffixes=(".out",)),
    "gkf": FileFormat("GNU Gama network", "gkf.reader:read_gkf", "gkf.writer:write_gkf", suffixes=(".gkf",)),
    "gsi": FileFormat("Leica GSI-8, GSI-16", "fieldbook.gsi:read_gsi", suffixes=(".gsi",)),
    "idx": FileFormat("Leica IDX", "fieldbook.recorders:read_idx", suffixes=(".idx",)),
    "sdr": FileFormat("Sokkia SDR20, SDR33, SDL", "fieldbook.recorders:read_sdr", suffixes=(".sdr",)),
    "sokkia-scr": FileFormat("Sokkia SCR", "fieldbook.lists:read_sokkia_scr", suffixes=(".scr",)),
    "nikon": FileFormat("Nikon RAW", "fieldbook.lists:read_nikon", suffixes=(".raw", ".nik")),
    "topcon": FileFormat("Topcon GTS-7, GTS-6", "fieldbook.lists:read_topcon", suffixes=(".gts7", ".gt7")),
    "m5": FileFormat("Zeiss and Trimble M5", "fieldbook.recorders:read_m5", suffixes=(".m5",)),
    "geodimeter": FileFormat("Geodimeter ARE, JOB", "fieldbook.recorders:read_geodimeter", suffixes=(".are", ".job")),
    "rw5": FileFormat("Carlson RW5, TDS raw data", "fieldbook.recorders:read_rw5", suffixes=(".rw5",)),
    "fbk": FileFormat("Autodesk FBK", "fieldbook.recorders:read_fbk", suffixes=(".fbk",)),
    "jobxml": FileFormat(
        "Trimble JobXML",
        "fieldbook.landxml:read_jobxml",
        suffixes=(".jxl",),
        untried="with real jobs only GNSS surveys were tested; total-station records follow the schema",
    ),
    "starnet": FileFormat("STAR*NET input data", "starnet:read_starnet", "starnet:write_starnet"),
    "dynadjust": FileFormat(
        "DynAdjust DNA files (.stn with .msr, and .geo): networks on the earth",
        "dynadjust.reader:read_dynadjust",
        "dynadjust.writer:write_dynadjust",
        suffixes=(".stn", ".msr"),
    ),
    "dynaml": FileFormat(
        "DynaML (pair of …stn.xml and …msr.xml, and .geo): networks on the earth",
        "dynadjust.reader:read_dynaml",
        "dynadjust.writer:write_dynaml",
    ),
    "snap": FileFormat(
        "SNAP command file (.snp), or coordinate and data files (.crd with .dat): networks on the earth",
        "snap.reader:read_snap",
        "snap.writer:write_snap",
        suffixes=(".snp", ".crd"),
    ),
    "comp3d": FileFormat("Comp3D (.comp, or .cor with .obs)", "comp3d:read_comp3d", suffixes=(".obs", ".cor", ".comp")),
    "sinex": FileFormat(
        "SINEX: a GNSS solution with its covariance matrix", "sinex:read_sinex", "sinex:write_sinex", suffixes=(".snx",)
    ),
    "jag3d": FileFormat(
        "JAG3D column text (folder, names of files tell their kinds)",
        "jag3d:read_jag3d",
        "jag3d:write_jag3d",
        folder=True,
        untried="no project of JAG3D was available: this follows its wiki and the source of its import",
    ),
    "jag3d-script": FileFormat(
        "JAG3D project as SQL text (HSQLDB script with rows)",
        "jag3d:read_jag3d_script",
        suffixes=(".script",),
        untried="no project of JAG3D was available: this reader follows the tables that its source makes",
    ),
    "textbook": FileFormat("textbook network (Krumm)", "textbook:read_krumm", suffixes=(".dat",)),
    "photomodeler": FileFormat("PhotoModeler text export", "photomodeler:read_photomodeler"),
    "dbat": FileFormat("DBAT script (XML with the tables it names)", "dbat:read_dbat"),
    "pix4d": FileFormat(
        "Pix4Dmapper parameters (folder params, or …_calibrated_camera_parameters.txt)",
        "pix4d:read_pix4d",
        folder=True,
        untried="with real files only cameras and poses were tested; image points and control points follow the manual "
        "and other programs",
    ),
    "pix4d-cam": FileFormat(
        "Pix4D camera file (.cam)",
        "recognition:read_camera_file",
        suffixes=(".cam",),
        untried="tested on the lines of one public file",
    ),
    "pix4d-gcp": FileFormat(
        "Pix4D ground control (name, X, Y, Z, accuracies)",
        "pix4d:read_control",
        untried="no file of users was available: this reader follows the manual",
    ),
    "aicon": FileFormat(
        "AICON 3D Studio flat files",
        "aicon:read_aicon",
        "aicon:write_aicon",
        suffixes=(".ior", ".eor", ".obc", ".phc", ".scale"),
        folder=True,
    ),
    "ply": FileFormat("PLY points", write="drawing:write_ply", suffixes=(".ply",)),
    "dxf": FileFormat("DXF drawing", write="drawing:write_dxf", suffixes=(".dxf",)),
    "geojson": FileFormat("GeoJSON", write="drawing:write_geojson", suffixes=(".geojson",)),
    "landxml": FileFormat(
        "LandXML: surveys with their points; written: points",
        "fieldbook.landxml:read_landxml",
        "drawing:write_landxml",
        suffixes=(".landxml",),
    ),
    "opencv": FileFormat("OpenCV camera files", write="calibration:write_opencv"),
}
"""Formats by the key that ``--from`` and ``--to`` take."""
