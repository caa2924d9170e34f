"""Compiled functions: what one computes does not depend on who called it first."""

from __future__ import annotations

import importlib
import os
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numba
import pytest

import aquanav_tools
from aquanav_tools.libraries import LibraryError

SAMPLE = "[float(fractal(0.37 * n, -0.11 * n, 5.0, 7.0, 6, 0.88, 1e9, 3)).hex() for n in range(200)]"
FRACTAL = "from aquanav_tools.synthetic.noise import fractal"
PHOTOS = "from aquanav_tools.photograph.rock import _rock_colour; _rock_colour(0.1, 0.2, 0.3, 1e9, 1.0, 0)"


def modules() -> Iterator[object]:
    """Yield all modules of the package that can be imported here."""
    for found in pkgutil.walk_packages(aquanav_tools.__path__, "aquanav_tools."):
        try:
            yield importlib.import_module(found.name)
        except (ImportError, LibraryError):  # an extra that is not installed
            continue


def callers() -> Iterator[tuple[object, str, object]]:
    """Yield each compiled function with the name of each global that it reads, and that."""
    for module in modules():
        for value in vars(module).values():
            if isinstance(value, numba.core.registry.CPUDispatcher):
                code = value.py_func.__code__
                inner = [names for one in code.co_consts if hasattr(one, "co_names") for names in one.co_names]
                for name in {*code.co_names, *inner}:
                    yield value, name, value.py_func.__globals__.get(name)


def test_a_function_called_with_fast_arithmetic_says_which_is_its_own() -> None:
    """Or it takes its first caller's, and numba's cache keeps it so for all others."""
    dispatcher = numba.core.registry.CPUDispatcher
    calls = [(caller, name, called) for caller, name, called in callers() if isinstance(called, dispatcher)]
    assert len(calls) > 50
    silent = {
        f"{called.py_func.__module__}.{name}"
        for caller, name, called in calls
        if "fastmath" in caller.targetoptions
        and "fastmath" not in called.targetoptions
        and called.targetoptions.get("inline") != "always"  # becomes part of its callers
    }
    assert not silent, f"say fastmath=False or what they may do: {sorted(silent)}"


@pytest.mark.parametrize("first", ["", PHOTOS])
def test_rock_has_the_same_noise_whatever_was_compiled_first(first: str, tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    program = f"{first}\n{FRACTAL}\nprint({SAMPLE})"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    from aquanav_tools.synthetic.noise import fractal

    exact = [float(fractal.py_func(0.37 * n, -0.11 * n, 5.0, 7.0, 6, 0.88, 1e9, 3)) for n in range(200)]
    assert [float.fromhex(text.strip(" '[]\n")) for text in run.stdout.split(",")] == exact
