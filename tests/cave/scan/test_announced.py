"""Headers that announce more than their file holds, or more than there is memory for."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pytest
import trimesh

from aquanav_tools.cave.scan.announced import MAX_LOADED
from aquanav_tools.cave.scan.files import read_surface
from aquanav_tools.errors import AquanavError, InputError, ResourceError

PLY = "ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty double z\n"
FACES = "element face {faces}\nproperty list uchar int vertex_indices\n"


def write_ply(path: Path, kind: str, vertices: int, faces: int, num_bytes: int) -> Path:
    head = (PLY + FACES + "end_header\n").format(kind=kind, vertices=vertices, faces=faces)
    path.write_bytes(head.encode() + b"0" * num_bytes)
    return path


@pytest.mark.parametrize(
    ("kind", "vertices", "faces", "num_bytes", "words"),
    [
        ("binary_little_endian", 101, 0, 1600, "announces 101 of vertex, 0 of face, which take 1,616 bytes"),
        ("binary_big_endian", 4, 10**15, 1600, "announces 4 of vertex, 1,000,000,000,000,000 of face"),
        ("ascii", 1000, 0, 5000, "announces 1,000 of vertex, 0 of face, which take 6,000 bytes"),
    ],
)
def test_a_ply_that_is_too_small_for_its_header_is_refused(
    tmp_path: Path, kind: str, vertices: int, faces: int, num_bytes: int, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        read_surface(write_ply(tmp_path / "a.ply", kind, vertices, faces, num_bytes))


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_every_ply_that_trimesh_writes_holds_what_it_announces(tmp_path: Path, kind: str) -> None:
    ball = trimesh.creation.icosphere(subdivisions=1)
    encoding = "ascii" if kind == "ascii" else "binary"
    content = ball.export(file_type="ply", encoding=encoding)
    (tmp_path / "a.ply").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert len(read_surface(tmp_path / "a.ply").surface.faces) == 80  # type: ignore[union-attr]


def write_glb(path: Path, tree: dict[str, object]) -> Path:
    text = json.dumps(tree).encode()
    path.write_bytes(struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text)
    return path


def test_a_gltf_that_announces_zeros_without_end_is_refused(tmp_path: Path) -> None:
    accessors = [{"componentType": 5126, "count": 10**11, "type": "VEC3"}]
    with pytest.raises(ResourceError, match="about 100000 million points"):
        read_surface(write_glb(tmp_path / "a.glb", {"bufferViews": [], "accessors": accessors}))


def test_a_gltf_that_places_a_mesh_again_and_again_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ball = trimesh.creation.icosphere(subdivisions=1)
    scene = trimesh.Scene()
    for n in range(50):
        scene.add_geometry(ball, geom_name="ball", node_name=f"ball {n}")
    scene.export(tmp_path / "a.glb")
    monkeypatch.setattr("aquanav_tools.cave.scan.announced.MAX_LOADED", 1000)
    with pytest.raises(ResourceError, match="more than the 0 million"):
        read_surface(tmp_path / "a.glb")


@pytest.mark.parametrize("suffix", [".obj", ".off", ".stl"])
def test_a_mesh_of_more_than_twenty_million_points_is_refused_by_its_size(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    with path.open("wb") as stream:
        stream.truncate(101 * MAX_LOADED)  # sparse: takes no room on the disk
    with pytest.raises(ResourceError, match="million points, more than the 20 million"):
        read_surface(path)


@pytest.mark.parametrize("name", ["a.zip", "a.bz2", "a.tar.gz", "a.dxf"])
def test_archives_are_no_scans(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"PK\x03\x04")
    with pytest.raises(AquanavError, match=r"has no known scan format|is not read|is an archive, not a scan"):
        read_surface(tmp_path / name)
