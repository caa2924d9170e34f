"""Reading E57, the exchange format of terrestrial laser scanners: every scan of a file, each by its own pose.

Source: ASTM E2807-11 (2019), Standard Specification for 3D Imaging Data Exchange: lengths in metres, angles in radians.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.scan.decoder_process import DecodingError, decoded, seconds_for
from aquanav_tools.cave.scan.stationed import CHUNK_POINTS, cloud_of_tables, stationed_table
from aquanav_tools.cave.scan.surface_file import SurfaceFile, unreadable
from aquanav_tools.libraries import require
from aquanav_tools.types import Array

HEADER = struct.Struct("<8sIIQQQQ")
"""Signature, versions, length of the file, place and length of its XML, size of a page with its checksum."""
MAX_XML = 256 << 20
MAX_POINTS_PER_BYTE = 1
"""Scanners write 6 bytes or more; what never changes takes none, so that a file may announce any number."""
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = ("cartesianInvalidState", "sphericalInvalidState")
COLOURS = ("colorRed", "colorGreen", "colorBlue")


def read_e57(path: Path) -> SurfaceFile:
    """Return the points of all scans in a file, with colours and stations where it has them.

    Raises:
        InputError: the file is empty, damaged, cut off or of another format.
    """
    check_header(path)
    require("Reading E57", "pye57", otherwise=" 'aquanav[build]'")
    try:
        return cloud_of_tables(path, decoded(__name__, path, (), seconds_for(path)))
    except DecodingError as cause:
        raise unreadable(path, str(cause)) from cause


def check_header(path: Path) -> None:
    """Hold a file's header against its size.

    Raises:
        InputError: it is no header of E57, or announces another size.
    """
    with path.open("rb") as stream:
        head = stream.read(HEADER.size)
    size = path.stat().st_size
    if len(head) < HEADER.size or not head.startswith(b"ASTM-E57"):
        raise unreadable(path, f"its {size:,} bytes do not begin with a header of E57")
    _, major, minor, length, xml_at, xml_bytes, page = HEADER.unpack(head)
    if major != 1 or page != 1024:
        raise unreadable(
            path, f"its header says version {major}.{minor} with pages of {page:,} bytes, not 1.0 and 1024"
        )
    if length != size or xml_at + xml_bytes > size or xml_bytes > MAX_XML:
        raise unreadable(
            path,
            f"its header announces {length:,} bytes, {xml_bytes:,} of them XML from byte {xml_at:,}, and the file has "
            f"{size:,}",
        )


def prepare() -> None:
    """Load what `decode` needs."""
    import scipy.spatial.transform  # noqa: F401
    from pye57 import libe57  # noqa: F401


def decode(path: Path) -> Iterator[Array]:
    """Yield `stationed_table`s of all valid points in a file, in its common coordinates.

    Raises:
        InputError: it has no scan, or announces more points than fit into it.
    """
    from pye57 import libe57

    try:
        yield from _tables(path)
    except (libe57.E57Exception, ValueError) as cause:
        raise unreadable(path, str(cause).strip().partition("\n")[0]) from cause


def _tables(path: Path) -> Iterator[Array]:
    from pye57 import libe57

    # Not pye57.E57, whose constructor removes the file when anything after opening it fails.
    image = libe57.ImageFile(str(path), "r")
    if not image.root().isDefined("data3D") or not len(image.root()["data3D"]):
        raise unreadable(path, "it has no scan: its list of scans is missing or empty")
    scans = image.root()["data3D"]
    counts = [scans[n]["points"].childCount() for n in range(len(scans))]
    most = MAX_POINTS_PER_BYTE * path.stat().st_size
    if sum(counts) > most:
        raise unreadable(
            path, f"its scans announce {sum(counts):,} points, and its {most:,} bytes hold {most:,} at most"
        )
    for n, count in enumerate(counts):
        if count:
            yield from _scan_tables(image, scans[n], count)


def _scan_tables(image: Any, scan: Any, count: int) -> Iterator[Array]:
    """Yield the tables of one scan."""
    from pye57 import libe57

    prototype = libe57.StructureNode(scan["points"].prototype())
    names = {prototype.get(n).elementName() for n in range(prototype.childCount())}
    axes = next((fields for fields in (CARTESIAN, SPHERICAL) if names.issuperset(fields)), None)
    if axes is None:
        raise ValueError(f"a scan has no coordinates that are known, only {', '.join(sorted(names))}")
    colours = COLOURS if names.issuperset(COLOURS) else ()
    flags = tuple(name for name in INVALID if name in names)
    capacity = min(count, CHUNK_POINTS)
    columns = {name: np.zeros(capacity) for name in (*axes, *colours, *flags)}
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(image, name, column, capacity, True, True))
    rotation, station, is_known = _pose(scan)
    scale = _colour_scale(scan) if colours else None
    reader = scan["points"].reader(buffers)
    while num_read := reader.read():
        points = np.stack([columns[name][:num_read] for name in axes], axis=1)
        if axes is SPHERICAL:
            points = _from_spherical(points)
        is_valid = np.isfinite(points).all(axis=1)
        for name in flags:
            is_valid &= columns[name][:num_read] == 0
        rgb = None
        if scale is not None:
            rgb = np.stack([columns[name][:num_read] for name in colours], axis=1)[is_valid]
            rgb = (rgb - scale[0]) * (255.0 / np.maximum(scale[1] - scale[0], 1e-12))
        yield stationed_table(points[is_valid] @ rotation.T + station, rgb, station if is_known else None)
    reader.close()


def _from_spherical(points: Array) -> Array:
    """Return the x, y, z of ranges, azimuths and elevations."""
    distance, azimuth, elevation = points.T
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1)


def _pose(scan: Any) -> tuple[Array, Array, bool]:
    """Return a scan's rotation, the place of its scanner, and whether it is known: programs write zeros for none."""
    from scipy.spatial.transform import Rotation

    rotation, station = np.eye(3), np.zeros(3)
    if scan.isDefined("pose"):
        pose = scan["pose"]
        if pose.isDefined("rotation"):
            quaternion = [pose["rotation"][name].value() for name in "xyzw"]
            rotation = Rotation.from_quat(quaternion).as_matrix()
        if pose.isDefined("translation"):
            station = np.array([pose["translation"][name].value() for name in "xyz"], dtype=np.float64)
    is_known = bool(station.any() or not np.allclose(rotation, np.eye(3)))
    return rotation, station, is_known


def _colour_scale(scan: Any) -> tuple[Array, Array]:
    """Return the (3,) least and largest values of red, green and blue that a scan's limits name; 0 and 255 without."""
    low, high = np.zeros(3), np.full(3, 255.0)
    if scan.isDefined("colorLimits"):
        limits = scan["colorLimits"]
        for n, name in enumerate(COLOURS):
            if limits.isDefined(f"{name}Minimum") and limits.isDefined(f"{name}Maximum"):
                low[n], high[n] = limits[f"{name}Minimum"].value(), limits[f"{name}Maximum"].value()
    return low, high
