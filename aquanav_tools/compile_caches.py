"""Where numba and Warp keep what they compile, on machines where their usual places cannot be written to.

Without one, numba refuses to compile at all. Read-only installations without a home are common in containers.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path

from aquanav_tools.machine import user_cache

NUMBA_VARIABLE, WARP_VARIABLE = "NUMBA_CACHE_DIR", "WARP_CACHE_PATH"
MARK_VARIABLE = "AQUANAV_COMPILING_MARK"
"""Names the file whose presence says that a first compilation was told of, by this process or others of its command;
empty where there is nothing to tell. See `first_compilation`."""


def ensure_compile_caches() -> None:
    """Name a temporary folder for compiled code where no usual one can be written to, and say so.

    It is for this process and those that it starts, and goes with it: no other user could have put code there before.
    """
    package = Path(__file__).parent
    lacking = [
        variable
        for variable, places in (
            (NUMBA_VARIABLE, [package / "__pycache__", _in_user_cache("numba")]),
            (WARP_VARIABLE, [_in_user_cache("warp")]),
        )
        if not os.environ.get(variable) and not any(map(can_write, places))
    ]
    if not lacking:
        return
    os.environ[MARK_VARIABLE] = ""  # what follows says more
    try:
        folder = Path(tempfile.mkdtemp(prefix="aquanav-compiled-"))
    except OSError as error:  # no temporary folder either; libraries that need none still work
        print(
            f"There is no place for compiled code: neither the package's folder, the user's cache nor a temporary "
            f"folder can be written to ({error.strerror}). What numba or Warp compile will fail. Set "
            f"{' and '.join(lacking)}, and TMPDIR, to folders that can.",
            file=sys.stderr,
        )
        return
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for variable in lacking:
        os.environ[variable] = str(folder / variable.partition("_")[0].lower())
    print(
        f"Compiled code is kept in {folder} and deleted at the end, as neither the package's folder nor the user's "
        "cache can be written to: every run compiles anew, for a minute or two. Set "
        f"{' and '.join(lacking)} to a folder that lasts.",
        file=sys.stderr,
    )


def can_write(place: Path | None) -> bool:
    """Return whether a folder can be written to, or made."""
    if place is None:
        return False
    # Not by Path.exists, which raises an error below a folder of others.
    there = next(folder for folder in (place, *place.parents) if os.path.exists(folder))
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _in_user_cache(name: str) -> Path | None:
    root = user_cache()
    return None if root is None else root / name
