"""Real caves as navigation benchmarks: build them, dive them, score policies in them.

The functions below are the whole of the public interface; `import aquanav` has the same. Each is loaded when it is
first asked for, so that importing this package takes no time.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aquanav_tools.api.caves import build_cave as build_cave
    from aquanav_tools.api.caves import load_scenario as load_scenario
    from aquanav_tools.api.environments import make_env as make_env
    from aquanav_tools.api.environments import make_vec_env as make_vec_env
    from aquanav_tools.api.policies import load_policy as load_policy
    from aquanav_tools.api.scores import compare as compare
    from aquanav_tools.api.scores import evaluate as evaluate
    from aquanav_tools.api.scores import replay as replay
    from aquanav_tools.api.training import train as train

from aquanav_tools.compile_caches import ensure_compile_caches
from aquanav_tools.first_compilation import watch_numba
from aquanav_tools.lazy import offer_functions

__version__ = "0.1.0"
_OLDEST, _NEWEST = (3, 10), (3, 14)
"""Pythons that it can be installed for, as pyproject.toml says; a checkout on the path was not installed."""
if not _OLDEST <= sys.version_info[:2] <= _NEWEST:
    raise ImportError(
        f"aquanav needs Python 3.{_OLDEST[1]} to 3.{_NEWEST[1]}, and {sys.executable} is "
        f"{sys.version_info[0]}.{sys.version_info[1]}. Run it with one of these: in a checkout, .ci/make-venv makes an "
        "environment with the newest that is there."
    )

_MODULES = {
    "build_cave": "caves",
    "load_scenario": "caves",
    "make_env": "environments",
    "make_vec_env": "environments",
    "load_policy": "policies",
    "compare": "scores",
    "evaluate": "scores",
    "replay": "scores",
    "train": "training",
}
"""Each public function's module in aquanav_tools.api."""
__all__ = [  # in words, for readers that run no code
    "build_cave", "compare", "evaluate", "load_policy", "load_scenario", "make_env", "make_vec_env", "replay", "train",
]  # fmt: skip

offer_functions(__name__, {name: f"aquanav_tools.api.{module}" for name, module in _MODULES.items()})
ensure_compile_caches()  # before numba is imported, which looks for a place then
watch_numba()
