"""Ray clusters for tests, on this machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.conftest import REPOSITORY

NODE: dict[str, Any] = {"num_cpus": 1, "object_store_memory": 80 << 20}
"""The least store that Ray takes is 75 MB."""


@contextmanager
def two_nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Yield two nodes of one core each that find this repository; skip the test where Ray is not installed."""
    pytest.importorskip("ray", reason="Ray is not installed: pip install -c constraints.txt 'aquanav[cluster]'.")
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(REPOSITORY), os.environ.get("PYTHONPATH", "")]))
    nodes = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False})
    try:
        nodes.add_node(**NODE)
        nodes.wait_for_nodes()
        yield nodes
    finally:
        nodes.shutdown()
