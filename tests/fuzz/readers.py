"""Every reader of files that others write, by the word with which the names of its seeds begin.

The one place of the fuzz tests that imports readers: when a module moves, its line here moves with it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import laspy  # noqa: F401  # what readers import when they run is here before a case's memory is bounded
import torch  # noqa: F401
import trimesh.exchange.load  # noqa: F401

from aquanav_tools.build.original.rewarder import read_rewarders
from aquanav_tools.cave.scan.fbx import read_fbx
from aquanav_tools.cave.scan.files import read_surface
from aquanav_tools.evaluate import network, onnx_file  # noqa: F401
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import read_protocol
from aquanav_tools.evaluate.results import episodes_of, read_results
from aquanav_tools.export.looks import read_pictured
from aquanav_tools.reconstruct.georeference.camera_positions import read_positions
from aquanav_tools.scenario.bay import read_bay
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.sea.original import read_original_map
from aquanav_tools.sea.sea_map import read_map
from aquanav_tools.sim.boat import load_boat
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.survey.read import read_survey
from aquanav_tools.train.checkpoint import read_checkpoint
from aquanav_tools.train.pipeline import read_pipeline

READERS: dict[str, Callable[[Path], object]] = {
    "bay": read_bay,
    "boat": load_boat,
    "checkpoint": read_checkpoint,
    "fbx": read_fbx,
    "map": read_map,
    "original": lambda path: read_original_map(path / "made_up.json", 0.5),
    "pictured": read_pictured,
    "pipeline": lambda path: read_pipeline(path, {}),
    "policy": lambda path: load_policy(str(path)),
    "positions": lambda path: read_positions(path, [f"{number}.jpg" for number in range(4)]),
    "prefabs": read_rewarders,
    "protocol": lambda path: read_protocol(str(path)),
    "results": lambda path: episodes_of(read_results(path)),
    "scan": read_surface,
    "scenario": read_scenario,
    "survey": read_survey,
    "vehicle": load_vehicle,
}
