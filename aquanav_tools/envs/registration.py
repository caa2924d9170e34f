"""Registering the environments with Gymnasium."""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

ENV_ID = "aquanav/Cave-v0"


def register_envs() -> None:
    """Register aquanav/Cave-v0, one vehicle or a batch. It truncates its episodes itself, by the scenario's limit."""
    if ENV_ID not in registry:
        register(
            ENV_ID,
            entry_point="aquanav_tools.envs.cave_env:CaveEnv",
            vector_entry_point="aquanav_tools.envs.vector_env:CaveVectorEnv",
        )
