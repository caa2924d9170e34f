"""Models out of another process: COLLADA and 3MF through trimesh, USD through its own library.

Each decoder yields tables of numbers: facts (metres per unit and the axis that points up), vertices, faces, colours.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.scan import trimesh_files
from aquanav_tools.cave.scan.announced import check_count
from aquanav_tools.cave.scan.decoder_process import MODEL_MEMORY, DecodingError, decoded, seconds_for
from aquanav_tools.cave.scan.surface_file import SurfaceFile, unreadable
from aquanav_tools.libraries import require
from aquanav_tools.text_files import check_utf8
from aquanav_tools.types import Mesh, PointCloud

AXES = ("x", "y", "z")
LIBRARIES = {
    ".dae": ("Reading COLLADA", "collada", "lxml"),
    ".3mf": ("Reading 3MF", "lxml"),
    ".usd": ("Reading USD", "pxr"),
    ".usda": ("Reading USD", "pxr"),
    ".usdc": ("Reading USD", "pxr"),
    ".usdz": ("Reading USD", "pxr"),
}
"""By the ending: what needs which libraries."""
BEGINNINGS = {".3mf": b"PK\x03\x04", ".usdz": b"PK\x03\x04", ".usdc": b"PXR-USDC", ".usda": b"#usda"}
BYTES_PER_VERTEX = 20
"""Of the XML in a 3MF or COLLADA, at least."""
DEFLATE_RATIO = 1040
"""What a zip's member unpacks to at most, times its size."""
METRES = {
    "micron": 1e-6, "millimeter": 1e-3, "centimeter": 0.01, "inch": 0.0254, "foot": 0.3048, "meter": 1.0,
    "millimeters": 1e-3,
}  # fmt: skip
"""Units of a 3MF (3MF Core Specification 1.3, 3.4), the last as trimesh calls the one that stands for none."""


def read_model(path: Path) -> SurfaceFile:
    """Return the surface in a COLLADA, 3MF or USD file.

    Raises:
        InputError: it is empty, damaged, cut off or of another format, or has no surface.
        ResourceError: it has too many points.
    """
    suffix = path.suffix.lower()
    _check_beginning(path, suffix)
    purpose, *libraries = LIBRARIES[suffix]
    require(purpose, *libraries)
    decoder = "aquanav_tools.cave.scan.usd" if "pxr" in libraries else __name__
    try:
        facts, vertices, faces, colours = decoded(decoder, path, (), seconds_for(path), MODEL_MEMORY)
    except (DecodingError, ValueError) as cause:
        raise unreadable(path, str(cause)) from cause
    metres, up = float(facts[0, 0]), AXES[int(facts[0, 1])]
    rgb = colours if len(colours) else None
    surface = Mesh(vertices, faces, rgb) if len(faces) else PointCloud(vertices, None, rgb)
    return SurfaceFile(surface, (), metres, up)


def model_tables(surface: Mesh | PointCloud, metres_per_unit: float, up: str) -> Iterator[Any]:
    """Yield the tables of a surface, as `read_model` takes them.

    Raises:
        ValueError: the unit is no length.
    """
    if not (math.isfinite(metres_per_unit) and metres_per_unit > 0.0):
        raise ValueError(f"its unit is {metres_per_unit} m, which is no length")
    yield np.array([[metres_per_unit, AXES.index(up)]])
    yield surface.vertices if isinstance(surface, Mesh) else surface.points
    yield surface.faces if isinstance(surface, Mesh) else np.zeros((0, 3), dtype=np.int64)
    yield np.zeros((0, 3), dtype=np.uint8) if surface.colours is None else surface.colours


def _check_beginning(path: Path, suffix: str) -> None:
    """Hold a file's first bytes, and what its archive announces, against its ending and its size."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(1024)
    if not head.strip():
        raise unreadable(path, f"it is empty: {size:,} bytes")
    if not head.startswith(BEGINNINGS.get(suffix, b"")) or (suffix == ".dae" and b"<" not in head):
        raise unreadable(path, f"its {size:,} bytes begin with {head[:12]!r}")
    if suffix == ".usda":
        check_utf8(path)
    if suffix == ".dae":
        check_count(path, size // BYTES_PER_VERTEX)
    if suffix in (".3mf", ".usdz"):
        _check_archive(path, size)


def _check_archive(path: Path, size: int) -> None:
    """Refuse a zip whose members announce more than its size can hold, or more than can be loaded."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError) as cause:
        raise unreadable(path, f"{cause}") from cause
    unpacked = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    if packed > size or unpacked > DEFLATE_RATIO * size:
        raise unreadable(
            path, f"its {len(members):,} members announce {packed:,} bytes, unpacked {unpacked:,}, and it has {size:,}"
        )
    check_count(path, unpacked // BYTES_PER_VERTEX if path.suffix.lower() == ".3mf" else 0)


def prepare() -> None:
    """Load what `decode` needs."""
    import collada  # noqa: F401
    import lxml.etree  # noqa: F401
    import networkx  # noqa: F401
    import PIL.Image  # noqa: F401
    import trimesh.exchange.load  # noqa: F401


def decode(path: Path) -> Iterator[Any]:
    """Yield the `model_tables` of a COLLADA or 3MF file.

    Raises:
        InputError: it is damaged, or has no surface.
        ResourceError: it has too many points.
    """
    loaded = trimesh_files.load(path)
    if not getattr(loaded, "geometry", None):
        raise unreadable(path, "it has no triangles")
    try:
        metres, up = _collada_frame(path) if path.suffix.lower() == ".dae" else (_unit_of_3mf(loaded), "z")
        yield from model_tables(trimesh_files.surface_of(path, loaded), metres, up)
    except ValueError as cause:
        raise unreadable(path, str(cause)) from cause


def _unit_of_3mf(scene: Any) -> float:
    names = {str(geometry.metadata.get("units", "millimeters")) for geometry in scene.geometry.values()}
    unknown = names - set(METRES)
    if unknown:
        raise ValueError(f"its unit {min(unknown)[:30]!r} is none of 3MF's")
    return METRES[names.pop()] if names else METRES["millimeter"]


def _collada_frame(path: Path) -> tuple[float, str]:
    """Return the metres in a unit of a COLLADA file, and its axis that points up.

    Source: COLLADA 1.4.1 specification, `asset`: without `unit` it is a metre, without `up_axis` that is Y_UP.
    """
    from lxml import etree

    metres, up = 1.0, "y"
    for _, asset in etree.iterparse(str(path), tag="{*}asset", resolve_entities=False, no_network=True):
        unit, axis = asset.find("{*}unit"), asset.findtext("{*}up_axis")
        if unit is not None:
            metres = float(unit.get("meter", "1"))
        if axis is not None and axis.strip()[:1].lower() in AXES:
            up = axis.strip()[0].lower()
        break  # the first is the document's own
    return metres, up
