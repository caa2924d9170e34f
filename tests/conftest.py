"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.compile_caches import MARK_VARIABLE
from aquanav_tools.scenario.schema import Scenario
from tests.caves import tube_scenario
from tests.lighter import lighten_reports

REPOSITORY = Path(__file__).parent.parent
os.environ[MARK_VARIABLE] = ""  # what commands say in tests does not depend on what was compiled before

LONGEST = (
    "test_docs_run.py",
    "build/test_killed_cave_builds.py",
    "build/test_killed_photo_builds.py",
    "envs/test_surface_env.py",
    "reconstruct/test_pipeline.py",
    "build/test_scan_build.py",
    "test_fuzz.py",
    "evaluate/test_episode_runner.py",
    "train/test_workers.py",
    "train/test_validation.py",
    "examples/test_sensor_examples.py",
)
"""Files that take longest: first, so that of two processes that share the suite by files neither waits for the other at
the end. Those next to each other compile different things, which both would else compile at once."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of the longest files before all others."""
    place = {REPOSITORY / "tests" / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(LONGEST)))


@pytest.fixture(scope="session", autouse=True)
def sb3_logs(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Let Stable-Baselines3's own loggers, which some tests use, make their empty folders where pytest removes them."""
    os.environ["SB3_LOGDIR"] = str(tmp_path_factory.mktemp("sb3"))


@pytest.fixture(autouse=True)
def plain_reports(request: pytest.FixtureRequest) -> Iterator[None]:
    """Leave the pictures out of what a test reports on, but where it is marked; fixtures for several tests draw all."""
    if request.node.get_closest_marker("drawn_reports"):
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        lighten_reports(patch)
        yield


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator seeded by AQUANAV_TEST_SEED (default 0); the seed is printed with a failure."""
    seed = int(os.environ.get("AQUANAV_TEST_SEED", "0"))
    print(f"rng seed {seed} in {request.node.name}")
    return np.random.default_rng(seed)


@pytest.fixture(scope="session")
def tube() -> Scenario:
    """A straight tube of radius 2 m and length 20 m, kept in memory."""
    return tube_scenario()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real scans and photos, named by AQUANAV_DATA; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("AQUANAV_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"No real data: {folder} does not exist (set AQUANAV_DATA to its place).")
    return folder
