"""Write what a first build and evaluation compile, in the order of first use: aquanav_tools/signatures.json.

    .venv/bin/python .ci/make_signatures.py

builds a shipped cave and scores a policy in it with empty caches, which takes some minutes. To be run when a compiled
function is added to these ways, or called with other types; tests/test_compile_ahead.py (slow) tells when.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
CAVE, POLICY = "cave-test-1", "baseline:reference-echosounders"
CACHES = {"AQUANAV_CACHE": "caves", "NUMBA_CACHE_DIR": "numba", "WARP_CACHE_PATH": "warp"}


def described(kind: Any) -> Any:
    """Return a type of numba as `aquanav_tools.compile_ahead.type_of` reads it."""
    from numba import types

    if isinstance(kind, types.Array):
        return ["array", described(kind.dtype), kind.ndim, kind.layout, not kind.mutable]
    if isinstance(kind, types.BaseNamedTuple):
        of = kind.instance_class
        return ["named", f"{of.__module__}:{of.__qualname__}", *map(described, kind.types)]
    if isinstance(kind, types.BaseTuple):
        return ["tuple", *map(described, kind.types)]
    if isinstance(kind, types.Omitted):
        return ["omitted", kind.value]
    return "boolean" if kind == types.boolean else str(kind)


def record(folder: Path) -> list[tuple[str, list[Any]]]:
    """Return what is compiled by a build and an evaluation in this process."""
    from numba.core import event

    found: list[tuple[str, list[Any]]] = []
    depth = 0

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            nonlocal depth
            function, depth = event.data["dispatcher"], depth + 1
            module = function.py_func.__module__
            if depth > 1 or not module.startswith("aquanav_tools.") or function.stats.cache_path is None:
                return  # one that another calls is compiled with that
            name, kinds = f"{module}:{function.py_func.__qualname__}", [described(kind) for kind in event.data["args"]]
            if tuple(map(type_of, kinds)) != tuple(event.data["args"]):
                raise SystemExit(f"{kinds} does not stand for {event.data['args']}, the arguments of {name}.")
            found.append((name, kinds))

        def on_end(self, event: Any) -> None:
            nonlocal depth
            depth -= 1

    from aquanav_tools.build.shipped_scenarios import build_shipped
    from aquanav_tools.cli.evaluate import main
    from aquanav_tools.compile_ahead import type_of

    event.register("numba:compile", Listener())
    build_shipped(CAVE)
    sys.argv = ["aquanav-eval", POLICY, "--scenario", CAVE, "--episodes", "2", "-o", str(folder / "out")]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
    return found


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        os.environ.update({name: str(Path(scratch, folder)) for name, folder in CACHES.items()})
        lines = [f"  {json.dumps(entry)}" for entry in record(Path(scratch))]
    (ROOT / "aquanav_tools/signatures.json").write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")
    print(f"{len(lines)} signatures.")
