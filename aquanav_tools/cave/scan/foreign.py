"""Files that are given as scans and are none: what they are, by their ending, and what to do instead."""

from __future__ import annotations

import difflib
from pathlib import Path

MESHES = (".ply", ".obj", ".stl", ".glb", ".gltf", ".off", ".dae", ".3mf", ".fbx", ".usdz", ".usdc", ".usda", ".usd")
CLOUDS = (".ply", ".las", ".laz", ".e57", ".ptx", ".pts", ".pcd", ".xyz", ".csv")
SIMILAR = 0.75
"""Share of letters that a mistyped ending has in common with the right one: .plyy with .ply, not .docx with .dxf."""

_KINDS: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (
        (".pdf", ".svg", ".ai", ".eps", ".ps", ".th2", ".xvi"),
        "a document or a drawing, not a scan",
        "A map or an elevation does not hold the shape of the walls. Give the survey it was drawn from (Survex .svx or "
        ".3d, Therion .th), or a scan.",
    ),
    (
        (".doc", ".docx", ".odt", ".rtf", ".xls", ".xlsx", ".ods", ".ppt", ".pptx", ".md", ".html"),
        "a document, not a scan",
        "If it is a table of points, save it as text with a row 'x y z' for each (.xyz or .csv).",
    ),
    (
        (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".heic", ".heif", ".gif", ".bmp", ".webp", ".dng", ".cr2", ".nef"),
        "a single picture",
        "A cave takes many that overlap: put them into a folder and give the folder. A terrain model or a depth map is "
        "to be exported as points (.xyz) first.",
    ),
    (
        (".rcp", ".rcs", ".fls", ".zfs", ".dp", ".lsproj"),
        "a point cloud in a format that is not read",
        "Export it as .e57, .las, .laz or .ply; CloudCompare, which is free, converts most of them.",
    ),
    (
        (".3ds", ".blend", ".skp", ".dwg", ".dxf", ".max", ".step", ".stp", ".iges", ".igs"),
        "a 3D model in a format that is not read",
        "Export it as .ply, .obj, .stl or .glb from the program that made it.",
    ),
    (
        (".srv", ".wpj", ".mak", ".tro", ".trox", ".top", ".csx", ".csz", ".tdr", ".plt", ".lox", ".thconfig"),
        "a cave survey in a format that is not read",
        "Export it as Survex (.svx or .3d), or give the Therion data (.th).",
    ),
    (
        (".wmv", ".webm", ".mts", ".m2ts", ".flv", ".mpg", ".mpeg", ".360", ".insv"),
        "a video in a format that is not read",
        "Convert it to .mp4 first, for example with ffmpeg.",
    ),
    (
        (".psx", ".psz", ".rcproj", ".rsproj"),
        "a photogrammetry program's project",
        "Export the dense cloud or the mesh from it (.ply), or give the folder of photos.",
    ),
    (
        (".rar", ".7z", ".tar", ".gz", ".tgz", ".xz"),
        "an archive, not a scan",
        "Unpack it, and give the scan that was in it.",
    ),
    (
        (".shp", ".kml", ".kmz", ".gpx", ".geojson", ".gpkg"),
        "map data, not a scan",
        "It holds places, not walls. Give a scan.",
    ),
)


def told_instead(path: Path, formats: set[str]) -> str:
    """Return what is wrong with a file whose ending is none of the formats that scans are read from."""
    suffix = path.suffix.lower()
    for suffixes, what, advice in _KINDS:
        if suffix in suffixes:
            return f"{path.name} is {what}. {advice}"
    close = difflib.get_close_matches(suffix, sorted(formats), n=1, cutoff=SIMILAR) if suffix else []
    meant = f" Did you mean '{close[0]}'?" if close else ""
    ending = f"no known scan format ('{suffix}')" if suffix else "no ending that tells its format"
    return (
        f"{path.name} has {ending}.{meant} Scans are meshes ({', '.join(MESHES)}) or point clouds "
        f"({', '.join(CLOUDS)}); surveys are .svx, .3d or .th; photos are a folder."
    )
