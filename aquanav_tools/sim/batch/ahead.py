"""Compile the kernels of caves in a process of its own, while the caves are built that they are needed for.

Warp compiles a module of kernels when the first of them is launched, which takes half a minute, and two processes that
launch it at once compile it twice. Results do not depend on this.
"""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from aquanav_tools.compile_caches import WARP_VARIABLE
from aquanav_tools.first_compilation import say_compiling
from aquanav_tools.machine import user_cache
from aquanav_tools.scenario.bay import is_bay

MODULES = tuple(f"aquanav_tools.sim.batch.{name}" for name in ("kernels", "prediction", "guide"))
"""With the kernels that every episode in a cave needs."""
logger = logging.getLogger(__name__)


@contextlib.contextmanager
def compiling_kernels(scenarios: Iterable[str | Path]) -> Iterator[None]:
    """Have the kernels compiled while the body runs, where none were yet, and wait for them after it.

    Args:
        scenarios: Names or paths of where they are needed: only caves need them.
    """
    if all(map(is_bay, scenarios)) or _were_compiled():
        yield
        return
    say_compiling()
    command = [sys.executable, "-m", __name__]
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
        if child.wait() != 0:
            logger.warning("Compiling ahead failed with %d; it is done when it is needed.", child.returncode)
    finally:
        child.kill()
        child.wait()


def compile_kernels() -> None:
    """Compile the kernels into the cache, the modules side by side."""
    import importlib

    import warp as wp

    from aquanav_tools.sim.batch.runtime import find_device

    device = find_device("cpu")
    for name in MODULES:
        importlib.import_module(name)
    wp.force_load(device, [wp.get_module(name) for name in MODULES])


def _were_compiled() -> bool:
    """Return whether Warp's cache has each of the modules, of this version or another: asking Warp takes a second."""
    given, usual = os.environ.get(WARP_VARIABLE), user_cache()
    folder = Path(given) if given else usual / "warp" if usual else None
    return folder is not None and all(any(folder.glob(f"*/wp_{name}_*")) for name in MODULES)


if __name__ == "__main__":
    compile_kernels()
