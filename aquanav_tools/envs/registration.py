"""Registering the environments with Gymnasium."""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

ENV_ID = "aquanav/Cave-v0"
SURFACE_ID = "aquanav/Surface-v0"


def register_envs() -> None:
    """Register aquanav/Cave-v0 and aquanav/Surface-v0, one vehicle or a batch. They truncate episodes themselves."""
    if ENV_ID not in registry:
        register(
            ENV_ID,
            entry_point="aquanav_tools.envs.cave_env:CaveEnv",
            vector_entry_point="aquanav_tools.envs.vector_env:CaveVectorEnv",
        )
    if SURFACE_ID not in registry:
        register(
            SURFACE_ID,
            entry_point="aquanav_tools.envs.surface_env:SurfaceEnv",
            vector_entry_point="aquanav_tools.envs.vector_env:SurfaceVectorEnv",
        )
