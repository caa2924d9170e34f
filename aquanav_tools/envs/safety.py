"""The environment in Safety-Gymnasium's form, for its algorithms: cost beside reward."""

from __future__ import annotations

from typing import Any

import gymnasium

SafeStep = tuple[Any, float, float, bool, bool, dict[str, Any]]


class SafetyWrapper(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Steps return (observation, reward, cost, terminated, truncated, info).

    The cost is `info["cost"]`, 1.0 for a decision with contact. Constraints are usually on its sum over an episode.
    """

    def step(self, action: Any) -> SafeStep:  # type: ignore[override]
        """Take a decision."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward), float(info["cost"]), terminated, truncated, info
