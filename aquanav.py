"""The public interface of aquanav_tools under the project's own name; see there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import aquanav_tools
from aquanav_tools import __all__ as __all__
from aquanav_tools import __version__ as __version__

if TYPE_CHECKING:
    from aquanav_tools import build_cave as build_cave
    from aquanav_tools import compare as compare
    from aquanav_tools import evaluate as evaluate
    from aquanav_tools import load_policy as load_policy
    from aquanav_tools import load_scenario as load_scenario
    from aquanav_tools import make_env as make_env
    from aquanav_tools import make_vec_env as make_vec_env
    from aquanav_tools import replay as replay
    from aquanav_tools import train as train


def __getattr__(name: str) -> Any:
    if name not in aquanav_tools.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(aquanav_tools, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *aquanav_tools.__all__})
