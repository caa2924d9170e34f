"""Small valid files of every format that the project reads: what a fuzz test mutates. Always the same bytes."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.evaluate.options import Grid
from aquanav_tools.evaluate.results import Provenance, results_table, write_results
from aquanav_tools.evaluate.summary import group, summarise
from aquanav_tools.geometry.volume.field import field_from_dense
from aquanav_tools.report.viewer_model import write_glb
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.sea.generate import generate_map
from aquanav_tools.sea.sea_map import write_map
from aquanav_tools.sim.vehicle import VEHICLE_DIR
from aquanav_tools.task import TaskOptions, choices_of
from aquanav_tools.train.checkpoint import Checkpoint, write_checkpoint
from aquanav_tools.types import Mesh
from tests.build.original.files import prefab_of, write_fbx
from tests.cave.scan import written
from tests.caves import tube_scenario
from tests.conftest import REPOSITORY
from tests.evaluate import onnx_files
from tests.evaluate.test_metrics import episode
from tests.sea.test_original_map import write_scene
from tests.survey.example import LOOPS
from tests.survey.test_image import version_3, version_8

Writer = Callable[[Path], object]

THERION = """\
encoding utf-8
survey main -title "Main"
  centreline
    date 2020.05.01
    fix 1 100 200 300
    station 1 "entrance" entrance
    data normal from to length compass clino
    1 2 10.0 45.0 -5
    2 3 12.5 90.0 0
    2 - 1.5 180 0
    data dimensions station left right up down
    1 1 1 2 0.5
    2 2 1 1 0.5
  endcentreline
endsurvey
"""


def write_seeds(folder: Path) -> list[Path]:
    """Write every seed, named READER-WHAT.SUFFIX, and return their paths, sorted."""
    for name, write in WRITERS.items():
        write(folder / name)
    return sorted(folder / name for name in WRITERS)


def _sphere() -> Any:
    import trimesh

    return trimesh.creation.icosphere(subdivisions=1, radius=2.0)


def _write_mesh(path: Path) -> None:
    _sphere().export(path)


def _write_ascii(path: Path) -> None:
    kind = "stl_ascii" if path.suffix == ".stl" else "ply"
    options = {"encoding": "ascii"} if kind == "ply" else {}
    path.write_bytes(_bytes(_sphere().export(file_type=kind, **options)))


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


def _write_cloud(path: Path) -> None:
    """Write a PLY of points with normals and colours, as stereo programs do: binary."""
    rows = _points()
    names = [*"xyz", "nx", "ny", "nz"]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n"
    head += "".join(f"property float {name}\n" for name in names)
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    table = np.zeros(len(rows), [(name, "<f4") for name in names] + [(name, "u1") for name in "rgb"])
    for name, column in zip(names, rows.T, strict=True):
        table[name] = column
    path.write_bytes((head + "end_header\n").encode() + table.tobytes())


def _points() -> np.ndarray:
    """Return (60, 6) points of a sphere with their normals."""
    normals = np.random.default_rng(1).normal(size=(60, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.concatenate([5.0 * normals, normals], axis=1)


def _write_table(path: Path) -> None:
    np.savetxt(path, _points(), "%.4f", delimiter="," if path.suffix == ".csv" else " ")


def _las_writer(point_format: int, version: str) -> Writer:
    def write(path: Path) -> None:
        import laspy

        header = laspy.LasHeader(point_format=point_format, version=version)
        header.scales = np.full(3, 0.001)
        las = laspy.LasData(header)
        las.xyz = np.tile(_points()[:, :3], (5, 1))
        las.write(path)
        _fix_date(path)

    return write


def _fix_date(path: Path) -> None:
    """Overwrite the day on which a LAS file was made: a header's bytes 90 to 93."""
    content = bytearray(path.read_bytes())
    content[90:94] = bytes(4)
    path.write_bytes(content)


def _write_scenario(path: Path) -> None:
    """Write the tests' tube as a scenario, on a coarse grid."""
    low, spacing = np.array([-0.5, -2.5, -2.5]), 0.5
    axes = [np.arange(a, b, spacing) for a, b in zip(low, (20.6, 2.6, 2.6), strict=True)]
    clearance = 2.0 - np.hypot(*np.meshgrid(*axes, indexing="ij")[1:])
    field = field_from_dense(low, spacing, clearance.astype(np.float32))
    vehicle = (VEHICLE_DIR / "bluerov2.toml").read_text()
    write_scenario(dataclasses.replace(tube_scenario(), field=field, vehicle_toml=vehicle), path)


def _write_picture(path: Path) -> None:
    made = tube_scenario()
    write_glb(made.cavity, made.collision, path)


def _write_policy(path: Path) -> None:
    from tests.evaluate.models import make_model

    _save_policy(make_model(net_arch=[8, 8]), path)


def _write_dictionary_policy(path: Path) -> None:
    from stable_baselines3 import PPO

    from tests.evaluate.test_dict_policies import untrained

    _save_policy(untrained(PPO, "multidiscrete", net_arch=[8, 8]), path)


def _save_policy(model: Any, path: Path) -> None:
    """Write a policy as Stable-Baselines3 saves it, in a zip without the day in it."""
    model.save(path)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in ("data", "policy.pth")}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content)


def _write_onnx(path: Path) -> None:
    rng = np.random.default_rng(0)
    shapes = ((8, 120), (8,), (9, 8), (9,))
    weights = [rng.normal(size=shape).astype(np.float32) for shape in shapes]
    path.write_bytes(onnx_files.policy(weights, sizes=(36, 36, 20, 20, 8), branches=(3, 3, 3)))


def _write_fbx(path: Path) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    write_fbx(path, Mesh(corners, faces), globals_={"UpAxis": 2, "UnitScaleFactor": 1.0})


def _write_results(path: Path) -> None:
    """Write the results of two episodes."""
    episodes = [
        episode(index=0, digest="0" * 64),
        episode(index=1, seed=8, outcome="timeout", time_ratio=None, digest="f" * 64, dynamics={"mass": 1.125}),
    ]
    policy = {"name": "baseline:reactive", "sha256": None, "path": "baseline:reactive", "is_trusted": False}
    scenarios = [{"name": "tube", "content_hash": "0" * 64, "path": "tube"}]
    protocol: dict[str, Any] = {
        "backend": "pybullet",
        "episodes": 2,
        "seed": 7,
        "observation": "full",
        "action": "multidiscrete",
    }
    protocol |= {**choices_of(TaskOptions()), "max_decisions": None, "grid": dataclasses.asdict(Grid())}
    protocol["conditions"] = [{"name": "as given", "changes": {}, "region": None}]
    provenance = Provenance(
        policy, scenarios, protocol, own_files={"own.toml": {"own.toml": "0" * 64}}, possible_episodes=None
    )
    table = results_table(provenance, summarise(episodes), group(episodes))
    write_results(table, episodes, path)


def _write_checkpoint(path: Path) -> None:
    import torch

    path.mkdir()
    learner = {"parameters": {"w": torch.zeros(4, 3)}, "num_timesteps": 7, "generators": ["text"]}
    write_checkpoint(Checkpoint(0, False, learner, {"curve": [1.0, 2.0], "seconds": 3.0}), path)


def _write_scene(path: Path) -> None:
    path.mkdir()
    write_scene(path, [])


def _write_prefabs(path: Path) -> None:
    path.mkdir()
    (path / "panels.prefab").write_text(prefab_of(np.array([[2.0 * n, 0.1 * n, 0.0] for n in range(5)])))


def _copied(*parts: str) -> Writer:
    return lambda path: path.write_bytes(REPOSITORY.joinpath(*parts).read_bytes())


def _text(content: str | bytes) -> Writer:
    return lambda path: path.write_bytes(_bytes(content))


WRITERS: dict[str, Writer] = {
    "scan-ascii.ply": _write_ascii,
    "scan-binary.ply": _write_mesh,
    "scan-cloud.ply": _write_cloud,
    "scan-mesh.obj": _write_mesh,
    "scan-binary.stl": _write_mesh,
    "scan-ascii.stl": _write_ascii,
    "scan-mesh.glb": _write_mesh,
    "scan-mesh.off": _write_mesh,
    "scan-table.xyz": _write_table,
    "scan-table.csv": _write_table,
    "scan-las.las": _las_writer(3, "1.2"),
    "scan-new.las": _las_writer(7, "1.4"),
    "scan-laz.laz": _las_writer(3, "1.2"),
    "scan-new.laz": _las_writer(7, "1.4"),
    "scan-two.e57": lambda path: written.write_e57(path, 60),
    "scan-two.ptx": lambda path: written.write_ptx(path, 20),
    "scan-blocks.pts": lambda path: written.write_pts(path, 20),
    "scan-ascii.pcd": lambda path: written.write_pcd(path, "ascii", 20),
    "scan-binary.pcd": lambda path: written.write_pcd(path, "binary", 20),
    "scan-packed.pcd": lambda path: written.write_pcd(path, "binary_compressed", 20),
    "scan-box.dae": written.write_dae,
    "scan-box.3mf": written.write_3mf,
    "scan-text.usda": written.write_usd,
    "scan-binary.usdc": written.write_usd,
    "scan-box.usdz": written.write_usd,
    "survey-loops.svx": _text(LOOPS),
    "survey-v8.3d": _text(version_8()),
    "survey-v3.3d": _text(version_3()),
    "survey-main.th": _text(THERION),
    "scenario": _write_scenario,
    "pictured-tube.glb": _write_picture,
    "vehicle-bluerov2.toml": _copied("aquanav_tools", "sim", "vehicles", "bluerov2.toml"),
    "vehicle-boat.toml": _copied("aquanav_tools", "sim", "vehicles", "boat.toml"),
    "policy-sb3.zip": _write_policy,
    "policy-parts.zip": _write_dictionary_policy,
    "policy-ml-agents.onnx": _write_onnx,
    "pipeline-paper.toml": _copied("pipelines", "train", "paper.toml"),
    "bay-drawn.toml": _text('format = 1\nvehicle = "otter"\nsea = "calm"\n[rocks]\ndensity = 0.1\n'),
    "bay-map.json": lambda path: write_map(generate_map(0), path),
    "boat-otter.toml": _copied("aquanav_tools", "sim", "boats", "otter.toml"),
    "map-drawn.json": lambda path: write_map(generate_map(0), path),
    "original": _write_scene,
    "prefabs": _write_prefabs,
    "checkpoint": _write_checkpoint,
    "results-two.json": _write_results,
    "protocol-robustness.toml": _copied("eval", "protocols", "robustness.toml"),
    "positions-four.csv": _text("name,x,y,z\n" + "".join(f"{n}.jpg,{n}.5,-{n}.25,0.125\n" for n in range(4))),
    "fbx-tetrahedron.fbx": _write_fbx,
}
