"""That every kernel compiles for a card, which Warp can do where there is none."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest
import warp as wp

import aquanav_tools.sim.batch as package
from aquanav_tools.sim.batch.runtime import find_device

ROOT = Path(package.__file__).parents[3]
OLDEST_CARD = 75
"""Compute capability: of the oldest cards that CUDA 13 knows."""
LONG = {"kernels", "boat_kernels", "boat_motion"}
"""Take 20 to 60 s."""


def _modules_with_kernels() -> list[str]:
    files = [path for path in Path(package.__file__).parent.rglob("*.py") if "@wp.kernel" in path.read_text()]
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in sorted(files)]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name.rsplit(".", 1)[-1] in LONG else [])
        for name in _modules_with_kernels()
    ],
)
def test_every_kernel_compiles_for_a_card(name: str, tmp_path: Path) -> None:
    find_device("cpu")
    if OLDEST_CARD not in wp.get_cuda_supported_archs():
        pytest.skip("This build of Warp has no compiler for cards.")
    module = importlib.import_module(name)
    wp.compile_aot_module(module, arch=OLDEST_CARD, module_dir=tmp_path, use_ptx=True)
    (assembly,) = tmp_path.glob("*.ptx")
    entries = re.findall(r"\.entry (\w+)\(", assembly.read_text())
    kernels = [kernel for kernel in wp.get_module(name).kernels.values() if not kernel.is_generic]
    assert len(entries) == len(kernels) > 0
    for kernel in kernels:
        assert any(entry.startswith(kernel.key) for entry in entries)
