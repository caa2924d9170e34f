"""Policies of ML-Agents: read without running code, computed as they should be, refused where they are not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from gymnasium import spaces

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.ml_agents import MlAgentsPolicy
from aquanav_tools.evaluate.onnx_file import MAX_FILE_BYTES, MAX_NODES, read_onnx
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
    ({"w": np.zeros((8, 6))}, "cannot be run: .*Gemm"),
    ({"w": np.zeros((3, 7))}, "cannot be run: .*Gemm"),
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


def broken(change: Callable[[onnx.ModelProto], object]) -> onnx.ModelProto:
    """A model that adds a constant to its input, changed."""
    found = model([node("Add", ["x", "c"], ["y"], {})], {"c": np.ones(3)}, {"x": (-1, 3)}, ["y"])
    change(found)
    return found


def lies_elsewhere(found: onnx.ModelProto) -> None:
    constant = found.graph.initializer[0]
    constant.ClearField("raw_data")
    constant.data_location = onnx.TensorProto.EXTERNAL
    constant.external_data.add(key="location", value="/etc/passwd")


def nests(found: onnx.ModelProto, kind: str) -> None:
    inner = onnx.helper.make_graph([], "inner", [], [])
    name = {"If": "then_branch"}.get(kind, "body")
    found.graph.node.append(onnx.helper.make_node(kind, ["x"], ["z"], **{name: inner}))


def takes_functions(found: onnx.ModelProto) -> None:
    add = onnx.helper.make_node("Add", ["a", "a"], ["b"])
    found.functions.append(onnx.helper.make_function("mine", "Twice", ["a"], ["b"], [add], found.opset_import))


def in_constant(found: onnx.ModelProto) -> None:
    lies_elsewhere(found)
    constant = onnx.helper.make_node("Constant", [], ["z"], value=found.graph.initializer.pop())
    found.graph.node.append(constant)


HOSTILE: list[tuple[Callable[[onnx.ModelProto], object], str]] = [
    (lambda m: m.graph.node.append(node("Run", ["x"], ["z"], {}, domain="evil")), "foreign domain 'evil'"),
    (lambda m: m.opset_import.add(domain="evil", version=1), "foreign domain 'evil'"),
    (lambda m: m.ClearField("opset_import"), "names no version"),
    (lambda m: m.ClearField("graph"), "it has no graph"),
    (lies_elsewhere, "'c' lie in another file"),
    (in_constant, "'c' lie in another file"),
    (takes_functions, "functions or training steps"),
    (lambda m: nests(m, "If"), "operation If holds a graph"),
    (lambda m: nests(m, "Loop"), "operation Loop holds a graph"),
    (lambda m: nests(m, "Scan"), "operation Scan holds a graph"),
    (lambda m: m.graph.sparse_initializer.add(), "sparse numbers"),
    (lambda m: m.graph.initializer[0].dims.append(1 << 40), "not a readable ONNX policy"),
    (lambda m: m.graph.initializer[0].dims.append(-1), "have the shape"),
    (lambda m: m.graph.initializer[0].dims.extend([1] * 8), "have the shape"),
    (lambda m: setattr(m.graph.initializer[0], "data_type", 8), "are of the type 8"),
    (lambda m: m.graph.node.extend([m.graph.node[0]] * MAX_NODES), "operations, more than"),
]


@pytest.mark.parametrize(("change", "advice"), HOSTILE)
def test_what_no_policy_holds_is_refused_before_it_is_run(
    change: Callable[[onnx.ModelProto], object], advice: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "a.onnx", broken(change).SerializeToString())
    with pytest.raises(InputError, match=advice):
        read_onnx(path)


def nested_bytes(depth: int) -> bytes:
    """Graphs within attributes of nodes of graphs, some of them deeper than any stack."""
    content = b""
    for _ in range(depth):
        for field in (6, 5, 1):  # AttributeProto.g, NodeProto.attribute, GraphProto.node
            length, size = b"", len(content)
            while size >= 0x80:
                length, size = length + bytes([size & 0x7F | 0x80]), size >> 7
            content = bytes([field << 3 | 2]) + length + bytes([size]) + content
    return b"\x3a" + content


@pytest.mark.parametrize("content", [b"", b"\xff" * 1000, b"\x3a\xff\xff\xff\xff\x0f", nested_bytes(2000)])
def test_bytes_of_no_model_are_refused(content: bytes, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a readable ONNX policy"):
        read_onnx(write(tmp_path / "a.onnx", content))


def test_an_unknown_operation_is_refused_only_where_it_is_needed() -> None:
    nodes = [node("Mystery", ["x"], ["y"], {}), node("Add", ["x", "x"], ["z"], {})]
    found = model(nodes, {}, {"x": (1, 1)}, ["y", "z"])
    assert OnnxRunner(found, ["z"], "it").run({"x": np.ones((1, 1), np.float32)})[0] == 2.0
    with pytest.raises(InputError, match="uses the operation Mystery"):
        OnnxRunner(found, ["y"], "it")


SIDE = int(MAX_VALUES**0.5) + 1
UNFIT = [
    ([node("Add", ["a", "b"], ["y"], {})], {"a": np.ones((SIDE, 1)), "b": np.ones((1, SIDE))}, "it would make"),
    ([node("MatMul", ["a", "a"], ["y"], {})], {"a": np.ones((1001, 1001))}, "multiplications, more than"),
    ([node("Div", ["a", "b"], ["y"], {})], {"a": np.array([-(2**63)]), "b": np.array([-1])}, "divides whole numbers"),
    ([node("Slice", ["a", "b", "b"], ["y"], {})], {"a": np.ones(3), "b": np.array([1])}, "or none at all"),
    ([node("Add", ["y", "a"], ["y"], {})], {"a": np.ones(3)}, "cannot be run|nowhere"),
    ([node("Add", ["a", "b"], ["y"], {})], {"a": np.ones(3), "b": np.array([1])}, "cannot be run"),
    ([node("Softmax", ["a"], ["y"], {"axis": 7})], {"a": np.ones((3, 3))}, "cannot be run"),
    ([node("Slice", ["a", "b", "c", "b", "b"], ["y"], {})],
     {"a": np.ones(3), "b": np.array([0]), "c": np.array([2])}, "cannot be run"),
]  # fmt: skip


@pytest.mark.parametrize(("nodes", "constants", "advice"), UNFIT)
def test_operations_made_to_end_the_process_are_refused(nodes: Any, constants: Any, advice: str) -> None:
    with pytest.raises(InputError, match=advice):
        OnnxRunner(model(nodes, constants, {}, ["y"]), ["y"], "it").run({})


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
    constants = {f"x{n}": value for n, value in enumerate(inputs)}
    found = model([node(kind, list(constants), ["y"], attributes)], constants, {}, ["y"])
    (result,) = OnnxRunner(found, ["y"], "it").run({})
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
