"""Inputs that are no cave, each with what the sentence must speak of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.types import Mesh, PointCloud
from eval.corpus.files import ply_bytes

NUM_MANY = 50_000_000
LAS_RECORD_BYTES = 20


@dataclass(frozen=True)
class BadInput:
    """A file that cannot become a cave."""

    name: str
    file_name: str
    write: Callable[[Path], None]
    error: str
    """Regular expression that its sentence has to match."""


def bad_inputs() -> list[BadInput]:
    """Return every bad input of the issue."""

    def bad(name: str, error: str, make: Callable[[], Mesh | PointCloud | bytes], suffix: str = "ply") -> BadInput:
        def write(path: Path) -> None:
            made = make()
            path.write_bytes(made if isinstance(made, bytes) else ply_bytes(made))

        return BadInput(name, f"scan.{suffix}", write, error)

    cloud = PointCloud(np.random.default_rng(0).uniform(0.0, 5.0, (5000, 3)))
    return [
        bad("empty-file", "empty|damaged|cut off", lambda: b""),
        bad("empty-text", "empty|no points|0 points", lambda: b"", "xyz"),
        bad("no-points", "0 points|empty", lambda: PointCloud(np.zeros((0, 3)))),
        bad("cut-off-file", "damaged|cut off", lambda: ply_bytes(_tube())[:5000]),
        bad("text-not-numbers", "not a table of numbers", lambda: b"dear diary\ntoday I dived\n", "xyz"),
        bad("one-triangle", "triangle|points|no space|enclose", lambda: Mesh(np.eye(3), np.array([[0, 1, 2]]))),
        bad("flat-sheet", "flat|wall or floor|no passage|no cave|encloses", lambda: _sheet(0.0)),
        bad("wavy-sheet", "wall or floor|no passage|no cave|encloses", lambda: _sheet(0.1)),
        bad("boulder", "rock|solid|object|open end|inside", _boulder),
        bad("two-caves", "two|2 |separate|disconnected|pieces", _two_caves),
        bad("not-a-number", "not finite", lambda: _with_nan(float("nan"))),
        bad("infinite", "not finite", lambda: _with_nan(float("inf"))),
        bad("one-place", "one place|no extent|unit", lambda: PointCloud(np.zeros((500, 3)))),
        bad("noise-in-a-box", "no cave|no passage|enclose|sparse|surface", lambda: cloud),
        bad("too-narrow", "narrow|wide|vehicle|clearance|radius|room", lambda: synthetic.tube(0.15, 6.0, 24, 81).mesh),
        BadInput("fifty-million-points", "scan.las", _write_many, "50,?000,?000|50 million|points"),
    ]


def _tube() -> Mesh:
    return synthetic.tube(radius=1.2, length=10.0, sections=48, rings=81).mesh


def _sheet(wave: float) -> Mesh:
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 4, 40), np.linspace(0, 4, 40), indexing="ij"))
    corner = (40 * np.arange(39)[:, None] + np.arange(39)).ravel()
    faces = [np.stack([corner, corner + 40, corner + 1], 1), np.stack([corner + 1, corner + 40, corner + 41], 1)]
    return Mesh(np.stack([x, y, wave * np.sin(3.0 * x)], axis=1), np.concatenate(faces))


def _boulder() -> Mesh:
    """Return a closed rock of about 0.8 m seen from outside: no vehicle fits into it, and none has business there."""
    import trimesh

    rock = trimesh.creation.icosphere(subdivisions=4, radius=0.4)
    bumps = 1.0 + 0.1 * np.sin(9.0 * rock.vertices).sum(axis=1, keepdims=True)
    return Mesh(np.array(rock.vertices) * bumps, np.array(rock.faces, dtype=np.int64))


def _two_caves() -> Mesh:
    tube = _tube()
    vertices = np.concatenate([tube.vertices, tube.vertices + [0.0, 20.0, 0.0]])
    return Mesh(vertices, np.concatenate([tube.faces, tube.faces + len(tube.vertices)]))


def _with_nan(value: float) -> Mesh:
    tube = _tube()
    vertices = tube.vertices.copy()
    vertices[17, 1] = value
    return Mesh(vertices, tube.faces)


def _write_many(path: Path) -> None:
    """Write a LAS file whose header promises NUM_MANY points; the file is sparse, so that it takes no disk."""
    import laspy

    las = laspy.create(point_format=0, file_version="1.2")
    las.x, las.y, las.z = (np.linspace(0.0, side, 1000) for side in (30.0, 4.0, 3.0))
    las.write(path)
    with path.open("r+b") as stream:
        stream.seek(96)
        start = int.from_bytes(stream.read(4), "little")
        stream.seek(107)
        stream.write(NUM_MANY.to_bytes(4, "little"))
        stream.truncate(start + NUM_MANY * LAS_RECORD_BYTES)
