"""Measure the distance field: time, peak memory and error, beside the plain way of asking libigl at every sample.

    python eval/benchmarks/field.py [--length 300] [--spacing 0.1] [--cave cave.ply ...] [--dense] [--smoke]

The cave is a rough, winding passage of radius 2 to 4 m with 500 triangles per metre, or the cavity in a scenario
folder. `--dense` also runs the plain way, for which the box around the cave must fit in memory.
Each measurement is a process of its own, so that memory is its own. Give it an idle machine.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.geometry.volume.field import BAND, BRICK, ROCK, DistanceField
from aquanav_tools.scenario import geometry
from aquanav_tools.synthetic.caves import _tube_faces, bend
from aquanav_tools.types import Array, Mesh
from eval.smoke import parser_of

NUM_CHECKED = 200_000
SECTIONS, RINGS_PER_METRE = 50, 5


def winding_passage(length: float) -> Mesh:
    """Return a rough closed tube of about `length` m that bends to all sides."""
    from scipy.ndimage import gaussian_filter

    along = np.linspace(0.0, length, round(RINGS_PER_METRE * length) + 1)
    yaw = 0.9 * np.sin(2 * np.pi * along / 90) + 0.5 * np.sin(2 * np.pi * along / 37 + 1)
    pitch = 0.25 * np.sin(2 * np.pi * along / 60)
    ahead = np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)], axis=1)
    middle = np.cumsum(ahead, axis=0) / RINGS_PER_METRE
    side = np.cross([0.0, 0.0, 1.0], ahead)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    rough = gaussian_filter(np.random.default_rng(0).normal(size=(len(along), SECTIONS)), 1.5, mode=("nearest", "wrap"))
    radius = 3.0 + 0.8 * np.sin(2 * np.pi * along / 25)[:, None] + 0.15 * rough / rough.std()
    angle = np.linspace(0.0, 2 * np.pi, SECTIONS, endpoint=False)[:, None]
    around = np.cos(angle) * side[:, None] + np.sin(angle) * np.cross(ahead, side)[:, None]
    wall = middle[:, None] + radius[..., None] * around
    faces, _ = _tube_faces(len(along), SECTIONS)
    return Mesh(np.concatenate([wall.reshape(-1, 3), middle[[0, -1]]]), faces)


def truth_at(mesh: Mesh, points: Array, spacing: float) -> Array:
    """Return what libigl finds: clearance, cut off at BAND samples of rock, m."""
    import igl

    distance = np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[0])
    is_water = igl.fast_winding_number(mesh.vertices, mesh.faces, points) > 0.5
    return np.where(is_water, distance, np.maximum(-distance, -BAND * spacing))


def errors(mesh: Mesh, field: DistanceField) -> dict[str, float]:
    rng = np.random.default_rng(1)
    places = np.argwhere(field.bricks != ROCK)
    samples = BRICK * places[rng.integers(0, len(places), NUM_CHECKED)] + rng.integers(0, BRICK, (NUM_CHECKED, 3))
    at_samples = field.positions(samples)
    between = at_samples + field.spacing * rng.uniform(0.0, 1.0, (NUM_CHECKED, 3))
    found, exact = field.clearance(between), truth_at(mesh, between, field.spacing)
    near = np.abs(exact) < BAND * field.spacing
    off = np.abs(found - exact) / field.spacing
    return {
        "at samples, most, m": float(
            np.abs(field.clearance(at_samples) - truth_at(mesh, at_samples, field.spacing)).max()
        ),
        "between, median, spacings": float(np.median(off)),
        "between, 95 %, spacings": float(np.percentile(off, 95)),
        "between, most, spacings": float(off.max()),
        "between near walls, 95 %, spacings": float(np.percentile(off[near], 95)),
    }


def measure_ours(mesh: Mesh, spacing: float) -> dict[str, object]:
    distance_field(bend(sections=8, rings=9).truth, 0.5)  # compiled before the clock starts
    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start, cpu = time.perf_counter(), time.process_time()
    field = distance_field(mesh, spacing)
    result = used(start, cpu, base)
    stored = field.samples.nbytes + field.bricks.nbytes
    water = len(field.water()[0])
    return result | {"samples in water": water, "stored, MB": round(stored / 1e6)} | errors(mesh, field)


def measure_dense(mesh: Mesh, spacing: float) -> dict[str, object]:
    import igl

    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start, cpu = time.perf_counter(), time.process_time()
    low = mesh.vertices.min(axis=0) - (BAND + 1) * spacing
    shape = np.ceil((mesh.vertices.max(axis=0) - low) / spacing).astype(int) + BAND + 2
    values = np.empty(shape, dtype=np.float32)
    for i in range(shape[0]):
        points = low + spacing * np.argwhere(np.ones((1, *shape[1:]), dtype=bool)) + [i * spacing, 0, 0]
        distance = np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[0])
        is_water = igl.fast_winding_number(mesh.vertices, mesh.faces, points) > 0.5
        values[i] = np.where(is_water, distance, np.maximum(-distance, -BAND * spacing)).reshape(shape[1:])
    return used(start, cpu, base) | {"stored, MB": round(values.nbytes / 1e6)}


def used(start: float, cpu: float, base: int) -> dict[str, object]:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "seconds": round(time.perf_counter() - start, 2),
        "CPU seconds": round(time.process_time() - cpu, 2),
        "peak, MB": peak // 1024,
        "of which its own, MB": (peak - base) // 1024,
    }


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--length", type=float, default=300.0)
    parser.add_argument("--spacing", type=float, default=0.1)
    parser.add_argument("--cave", type=Path, help="a scenario's cave.ply instead of the made-up passage")
    parser.add_argument("--dense", action="store_true", help="run the plain way too")
    parser.add_argument("--alone", choices=["ours", "dense"], help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.length, arguments.spacing, arguments.dense = 20.0, 0.5, True
    if not arguments.alone:
        compare(arguments.dense)
        return
    mesh = geometry.read_cavity(arguments.cave, ()).mesh if arguments.cave else winding_passage(arguments.length)
    measured = (measure_ours if arguments.alone == "ours" else measure_dense)(mesh, arguments.spacing)
    extent = " x ".join(f"{side:.0f}" for side in np.ptp(mesh.vertices, axis=0))
    print(json.dumps({"triangles": len(mesh.faces), "box, m": extent} | measured))


def compare(with_dense: bool) -> None:
    rows = {way: alone(way) for way in (("ours", "dense") if with_dense else ("ours",))}
    for way, row in rows.items():
        print(f"\n{way}")
        for name, value in row.items():
            print(f"  {name:36} {value:.3g}" if isinstance(value, float) else f"  {name:36} {value}")
    if with_dense:
        for name in ("seconds", "CPU seconds", "of which its own, MB", "stored, MB"):
            print(f"dense / ours, {name}: {rows['dense'][name] / max(rows['ours'][name], 1e-9):.1f}")


def alone(way: str) -> dict[str, float]:
    command = [sys.executable, __file__, *sys.argv[1:], "--alone", way]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


if __name__ == "__main__":
    main()
