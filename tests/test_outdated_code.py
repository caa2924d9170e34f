from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CALLER = """import numba

from {package}.{callee} import {names}


@numba.njit(cache=True)
def total(x):
    return {expression}
"""
CALLEE = """import numba

FACTOR = {factor}


@numba.njit(cache=True)
def scaled(x):
    return {scale} * x
"""
RUN = """import sys
from pathlib import Path
from aquanav_tools.outdated_code import forget_outdated
forget_outdated(Path(sys.argv[1]))
sys.path.insert(0, str(Path(sys.argv[1]).parent))
from caller_package.caller import total
print(total(1.0), sum(total.stats.cache_hits.values()))
"""


def value_of(package: Path, **environment: str) -> tuple[float, int]:
    """Return what the caller computes in a process of its own, and how often its code came from the cache.

    No bytecode is kept: Python tells a source's age in whole seconds, and two versions within one pass for the same.
    """
    done = subprocess.run(
        [sys.executable, "-B", "-c", RUN, str(package)],
        capture_output=True, text=True, check=False, env={**os.environ, **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split()
    return float(value), int(hits)


@pytest.mark.parametrize(
    ("names", "expression", "is_elsewhere"), [("scaled", "scaled(x)", False), ("FACTOR", "FACTOR * x", True)]
)
def test_code_is_compiled_anew_when_what_it_calls_has_changed(
    tmp_path: Path, names: str, expression: str, is_elsewhere: bool
) -> None:
    package = tmp_path / "caller_package"
    package.mkdir()
    caller = CALLER.format(package=package.name, callee="callee", names=names, expression=expression)
    (package / "caller.py").write_text(caller)
    (package / "callee.py").write_text(CALLEE.format(factor=2.0, scale=2.0))
    elsewhere = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")} if is_elsewhere else {}
    assert value_of(package, **elsewhere) == (2.0, 0)
    assert value_of(package, **elsewhere) == (2.0, 1)
    (package / "callee.py").write_text(CALLEE.format(factor=3.0, scale=3.0))
    assert value_of(package, **elsewhere) == (3.0, 0)
    assert value_of(package, **elsewhere) == (3.0, 1)


def test_code_of_several_modules_away_counts(tmp_path: Path) -> None:
    package = tmp_path / "caller_package"
    package.mkdir()
    (package / "caller.py").write_text(
        CALLER.format(package=package.name, callee="middle", names="total as inner", expression="inner(x)")
    )
    (package / "middle.py").write_text(
        CALLER.format(package=package.name, callee="callee", names="scaled", expression="scaled(x)")
    )
    (package / "callee.py").write_text(CALLEE.format(factor=2.0, scale=2.0))
    assert value_of(package) == (2.0, 0)
    (package / "callee.py").write_text(CALLEE.format(factor=2.0, scale=5.0))
    assert value_of(package) == (5.0, 0)


def test_a_change_that_is_not_compiled_in_costs_nothing(tmp_path: Path) -> None:
    package = tmp_path / "caller_package"
    package.mkdir()
    (package / "caller.py").write_text(
        CALLER.format(package=package.name, callee="callee", names="scaled", expression="scaled(x)")
    )
    (package / "callee.py").write_text(CALLEE.format(factor=2.0, scale=2.0))
    (package / "errors.py").write_text("class Wrong(Exception): pass\n")
    assert value_of(package) == (2.0, 0)
    (package / "errors.py").write_text("class Wrong(ValueError): pass\n")
    assert value_of(package) == (2.0, 1)
