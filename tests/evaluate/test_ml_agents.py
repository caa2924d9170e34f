"""Policies of ML-Agents: read without running code, computed as they should be, refused where they are not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.ml_agents import MlAgentsPolicy
from aquanav_tools.evaluate.onnx_file import MAX_FILE_BYTES, OnnxGraph, OnnxNode, read_onnx
from aquanav_tools.evaluate.onnx_run import MAX_VALUES, OnnxRunner
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.types import Array
from tests.evaluate.onnx_files import model, node, policy

RUNTIME_ACTIONS = {
    "CurriculumLearning": "020020022002022222202002220000020020120202002110002200220210"
    "120220211122000200000000120100000222202000020000000020010110",
}
"""What onnxruntime 1.31.1 chose for `observations(16)`, three digits to an observation."""


def make_weights(rng: np.random.Generator, width: int, hidden: int, choices: int) -> list[Array]:
    shapes = (hidden, width), (hidden,), (choices, hidden), (choices,)
    return [rng.normal(size=shape).astype(np.float32) for shape in shapes]


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_a_policy_takes_the_branches_best_choices(rng: np.random.Generator, tmp_path: Path) -> None:
    weights = make_weights(rng, 7, 8, 5)
    loaded = MlAgentsPolicy(write(tmp_path / "a.onnx", policy(weights)))
    assert loaded.observation_space.shape == (7,)
    assert loaded.action_space.nvec.tolist() == [3, 2]
    for _ in range(50):
        observation = rng.normal(size=7).astype(np.float32)
        hidden = weights[0] @ np.clip((observation - 0.1) / 0.5, -5, 5) + weights[1]
        logits = weights[2] @ (hidden / (1.0 + np.exp(-hidden))) + weights[3]
        assert loaded.act(observation).tolist() == [np.argmax(logits[:3]), np.argmax(logits[3:])]


@pytest.mark.parametrize("branches", [(3, 3, 3), (2, 5), (1, 3)])
def test_the_sizes_of_branches_are_found(branches: tuple[int, ...], rng: np.random.Generator, tmp_path: Path) -> None:
    content = policy(make_weights(rng, 7, 8, sum(branches)), branches=branches)
    assert MlAgentsPolicy(write(tmp_path / "a.onnx", content)).action_space.nvec.tolist() == list(branches)


def test_a_single_branch_is_one_choice(rng: np.random.Generator, tmp_path: Path) -> None:
    content = policy(make_weights(rng, 7, 8, 4), branches=(4,))
    loaded = MlAgentsPolicy(write(tmp_path / "a.onnx", content))
    assert loaded.action_space == spaces.Discrete(4)
    assert loaded.act(np.zeros(7, dtype=np.float32)) in range(4)


def test_a_policy_with_the_originals_spaces_gets_its_preset(rng: np.random.Generator, tmp_path: Path) -> None:
    content = policy(make_weights(rng, 120, 8, 9), sizes=(36, 36, 20, 20, 8), branches=(3, 3, 3))
    loaded = load_policy(str(write(tmp_path / "a.onnx", content)))
    assert (loaded.observation, loaded.action, loaded.name) == ("original", "multidiscrete", "a.onnx")


def test_a_policy_for_other_spaces_is_told_what_would_fit(rng: np.random.Generator, tmp_path: Path) -> None:
    path = write(tmp_path / "boat.onnx", policy(make_weights(rng, 37, 8, 6), sizes=(29, 8), branches=(3, 3)))
    with pytest.raises(InputError) as caught:
        load_policy(str(path))
    for part in ("Box of 37 values", "MultiDiscrete([3, 3])", "original (36 values)", "original (120 values)"):
        assert part in str(caught.value)


CHANGES: list[tuple[dict[str, Any], str]] = [
    ({"output": "continuous_actions"}, "or deterministic_continuous_actions, are needed"),
    ({"memory_size": np.full(1, 128.0)}, "memory of 128 values"),
    ({"inputs": {"obs_2": (-1, 84, 84, 3)}}, "Cameras and memories are not supported"),
    ({"inputs": {"recurrent_in": (-1, 1, 128)}}, "Cameras and memories are not supported"),
    ({"opset": 99}, "ONNX version 99"),
    ({"w": np.full((8, 7), np.nan)}, "not all finite"),
    ({"w": np.zeros((8, 6))}, "operation Gemm failed"),
    ({"w": np.zeros((3, 7))}, "operation Gemm failed"),
]


@pytest.mark.parametrize(("changes", "advice"), CHANGES)
def test_unfit_policies_are_refused_with_advice(
    changes: dict[str, Any], advice: str, rng: np.random.Generator, tmp_path: Path
) -> None:
    path = write(tmp_path / "a.onnx", policy(make_weights(rng, 7, 8, 5), **changes))
    with pytest.raises(InputError, match=advice):
        MlAgentsPolicy(path)


def test_a_file_cut_off_or_scrambled_is_refused(rng: np.random.Generator, tmp_path: Path) -> None:
    content = policy(make_weights(rng, 7, 8, 5))
    for length in range(0, len(content) - 1, 41):
        with pytest.raises(InputError, match=r"a\.onnx"):
            MlAgentsPolicy(write(tmp_path / "a.onnx", content[:length]))
    for _ in range(200):
        scrambled = bytearray(content)
        for place in rng.integers(len(content), size=5):
            scrambled[place] = rng.integers(256)
        try:  # harmless where a weight was hit; anything but our own error fails the test
            MlAgentsPolicy(write(tmp_path / "a.onnx", bytes(scrambled)))
        except InputError as error:
            assert "a.onnx" in str(error)


def test_a_pointer_of_lfs_is_refused_with_advice(tmp_path: Path) -> None:
    path = write(tmp_path / "a.onnx", b"version https://git-lfs.github.com/spec/v1\noid sha256:ab\nsize 205456\n")
    with pytest.raises(InputError, match="git lfs pull"):
        load_policy(str(path))


def test_a_file_too_large_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "a.onnx").open("wb") as stream:
        stream.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(InputError, match="no policy for this task"):
        read_onnx(tmp_path / "a.onnx")


def test_foreign_operations_are_refused(tmp_path: Path) -> None:
    content = model([node("Run", ["x"], ["y"], {}, domain="evil")], {}, {"x": (-1, 1)}, ["y"], 9)
    with pytest.raises(InputError, match="foreign domain 'evil'"):
        read_onnx(write(tmp_path / "a.onnx", content))


def test_an_unknown_operation_is_refused_only_where_it_is_needed() -> None:
    nodes = (OnnxNode("Mystery", ("x",), ("y",), {}), OnnxNode("Add", ("x", "x"), ("z",), {}))
    graph = OnnxGraph(9, nodes, {}, {"x": (1,)}, ("y", "z"))
    assert OnnxRunner(graph, ["z"], "it").run({"x": np.ones(1)})[0] == 2.0
    with pytest.raises(InputError, match="uses the operation Mystery"):
        OnnxRunner(graph, ["y"], "it")


def test_shapes_made_to_fill_the_memory_are_refused() -> None:
    graph = OnnxGraph(9, (OnnxNode("Add", ("x", "y"), ("z",), {}),), {}, {"x": (1,), "y": (1,)}, ("z",))
    side = int(MAX_VALUES**0.5) + 1
    with pytest.raises(InputError, match="it would make"):
        OnnxRunner(graph, ["z"], "it").run({"x": np.ones((side, 1)), "y": np.ones((1, side))})


OPERATIONS = [
    ("Slice", [np.arange(10.0).reshape(2, 5), np.array([1]), np.array([4]), np.array([1])], {}, [[1, 2, 3], [6, 7, 8]]),
    ("Slice", [np.arange(4.0), np.array([3]), np.array([0]), np.array([0]), np.array([-2])], {}, [3, 1]),
    ("Clip", [np.array([-2.0, 0.5, 9.0]), np.array(-1.0), np.array(2.0)], {}, [-1, 0.5, 2]),
    ("ArgMax", [np.array([[1.0, 3.0, 2.0]])], {"axis": 1, "keepdims": 0}, [1]),
    ("Softmax", [np.array([[1000.0, 1000.0]])], {"axis": 1}, [[0.5, 0.5]]),
    ("Sigmoid", [np.array([-1e4, 0.0, 1e4])], {}, [0.0, 0.5, 1.0]),
    (
        "Gemm",
        [np.eye(2), np.array([[1.0, 2.0], [3.0, 4.0]]), np.ones(2)],
        {"alpha": 2.0, "beta": 3.0},
        [[5, 7], [9, 11]],
    ),
    ("Relu", [np.array([-1.0, 2.0])], {}, [0.0, 2.0]),
]
"""Operation, inputs, attributes, and the result by the text of ONNX's specification."""


@pytest.mark.parametrize(("kind", "inputs", "attributes", "expected"), OPERATIONS)
def test_operations_do_what_the_specification_says(
    kind: str, inputs: list[Array], attributes: dict[str, Any], expected: Any
) -> None:
    names = tuple(f"x{n}" for n in range(len(inputs)))
    graph = OnnxGraph(13, (OnnxNode(kind, names, ("y",), attributes),), {}, dict.fromkeys(names, ()), ("y",))
    (result,) = OnnxRunner(graph, ["y"], "it").run(dict(zip(names, inputs, strict=True)))
    np.testing.assert_allclose(result, expected)


def observations(count: int) -> Array:
    """Numbers in the range of the original's observations, the same on every machine."""
    values = np.sin(0.37 * np.arange(count * 120.0).reshape(count, 120) ** 1.1)
    shares = np.abs(values[:, :28]) ** 0.3
    hits = values[:, 28:56] > 0.0
    rays = np.stack([hits, np.zeros_like(hits), ~hits, np.where(hits, shares, 1.0)], axis=2).reshape(count, 112)
    values = np.concatenate([rays, values[:, 112:]], axis=1)
    values[:, 112:114] *= 40.0
    return values.astype(np.float32)


@pytest.mark.parametrize("name", sorted(RUNTIME_ACTIONS))
def test_the_originals_policies_choose_as_onnxruntime_does(name: str, data_dir: Path) -> None:
    loaded = MlAgentsPolicy(data_dir / "saferlauv" / "policies" / f"{name}.onnx")
    chosen = [loaded.act(observation) for observation in observations(len(RUNTIME_ACTIONS[name]) // 3)]
    assert "".join(str(choice) for choice in np.concatenate(chosen)) == RUNTIME_ACTIONS[name]
