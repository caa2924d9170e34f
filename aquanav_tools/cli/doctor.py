"""Trying each library that is not pure Python, in a process of its own: one that aborts must not take the others along.

This module is the one place outside a library's room that may import it (see tests/test_imports.py).
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from aquanav_tools.libraries import OPTIONAL, is_installed

TIMEOUT_S = 120
"""A first import from a cold disk takes up to half a minute."""


@dataclass(frozen=True)
class Finding:
    """How one library fared."""

    library: str
    is_well: bool | None
    """None where it is not installed and need not be."""
    detail: str
    """What was tried, or the last line of what went wrong."""


def _try_embreex() -> str:
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    hits = RayMeshIntersector(trimesh.creation.box()).intersects_any([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    if not hits.all():
        raise RuntimeError("a ray from inside a box met none of its sides")
    return "a ray met a box"


def _try_manifold3d() -> str:
    import manifold3d

    return f"a cube of volume {manifold3d.Manifold.cube((1.0, 1.0, 1.0)).volume():g}"


def _try_matplotlib() -> str:
    import io

    from matplotlib.figure import Figure

    Figure().savefig(io.BytesIO(), format="png")
    return "drew a picture without a display"


def _try_numba() -> str:
    import numba

    if numba.njit(lambda x: x + 1)(1) != 2:
        raise RuntimeError("a compiled function gave a wrong sum")
    return "compiled a function"


def _try_laspy() -> str:
    import laspy

    if not laspy.LazBackend.Lazrs.is_available():
        raise RuntimeError("the library lazrs, which unpacks LAZ, is missing")
    return "can unpack LAZ"


def _try_onnxruntime() -> str:
    import numpy as np
    import onnx
    import onnxruntime

    described = onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1])
    add = onnx.helper.make_node("Add", ["x", "x"], ["y"])
    output = onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, [1])
    graph = onnx.helper.make_graph([add], "sum", [described], [output])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 13)], ir_version=8)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    if session.run(None, {"x": np.ones(1, dtype=np.float32)})[0][0] != 2.0:
        raise RuntimeError("a model of one sum gave a wrong sum")
    return "ran a model of one sum"


def _try_open3d() -> str:
    from aquanav_tools.libraries import load_open3d

    box = load_open3d().geometry.TriangleMesh.create_box()
    return f"loaded with its own libusb-1.0, made a box of {len(box.triangles)} triangles"


def _try_av() -> str:
    import av

    lacking = {"libx264", "libvpx"} - av.codecs_available
    if lacking:
        raise RuntimeError(f"this build cannot encode with {' and '.join(sorted(lacking))}: films need the wheel of av")
    return "encodes H.264 and VP8"


def _try_opencv() -> str:
    import cv2
    import numpy as np

    if cv2.GaussianBlur(np.ones((5, 5), np.float32), (3, 3), 0.0).min() < 0.99:
        raise RuntimeError("blurring an even picture changed it")
    return "blurred a picture"


def _try_pybullet() -> str:
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    if client < 0:
        raise RuntimeError("the physics server without graphics did not start")
    pybullet.disconnect(client)
    return "physics without graphics"


def _try_pycolmap() -> str:
    import pycolmap

    return f"with {'CUDA' if pycolmap.has_cuda else 'the CPU only'}"


def _try_rerun() -> str:
    import rerun

    rerun.RecordingStream("aquanav_doctor")
    return "opened a recording"


def _try_torch() -> str:
    import torch

    if not torch.isfinite(torch.ones(2, 2) @ torch.ones(2, 2)).all():
        raise RuntimeError("a product of small matrices is not finite")
    return f"on {torch.cuda.get_device_name() if torch.cuda.is_available() else 'the CPU: no CUDA device'}"


def _try_warp() -> str:
    import warp

    warp.config.log_level = warp.LOG_ERROR
    if warp.zeros(3, device="cpu").numpy().any():
        raise RuntimeError("zeros are not zero")
    return f"on {', '.join(str(device) for device in warp.get_devices())}"


TRIALS: dict[str, Callable[[], str]] = {
    "av": _try_av,
    "cv2": _try_opencv,
    "embreex": _try_embreex,
    "laspy": _try_laspy,
    "manifold3d": _try_manifold3d,
    "matplotlib": _try_matplotlib,
    "numba": _try_numba,
    "onnxruntime": _try_onnxruntime,
    "open3d": _try_open3d,
    "pybullet": _try_pybullet,
    "pycolmap": _try_pycolmap,
    "rerun": _try_rerun,
    "torch": _try_torch,
    "warp": _try_warp,
}
"""By the library's import name: a function that uses it a little and says how that went."""


def examine(library: str, trials: Mapping[str, Callable[[], str]] = TRIALS) -> Finding:
    """Return how a library fares in a process of its own."""
    if library in OPTIONAL and not is_installed(library):
        return Finding(library, None, f"pip install 'aquanav[{OPTIONAL[library].extra}]'")
    trial = trials[library]
    code = f"from {trial.__module__} import {trial.__name__} as trial; print(trial())"
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return Finding(library, False, f"no answer within {TIMEOUT_S} s")
    if done.returncode == 0:
        return Finding(library, True, _last_line(done.stdout))
    return Finding(library, False, _last_line(done.stderr) or f"the process ended with code {done.returncode}")


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else ""
