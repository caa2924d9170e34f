"""The versions of all that a policy rests on."""

from __future__ import annotations

import platform

from aquanav_tools import __version__
from aquanav_tools.libraries import installed_version
from aquanav_tools.provenance import code_digest

LIBRARIES = ("gymnasium", "numpy", "pybullet", "stable-baselines3", "torch", "warp-lang")


def versions() -> dict[str, str]:
    """Return the versions of libraries, and a hash of the code."""
    return {
        "aquanav": __version__,
        "code": code_digest("aquanav_tools.train.training"),
        "python": platform.python_version(),
        **{name: installed_version(name) for name in LIBRARIES},
    }
