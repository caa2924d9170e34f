"""Reading Unity's YAML and the panels in its prefabs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.build.original.rewarder import local_transform, read_rewarders
from aquanav_tools.build.original.unity_yaml import read_documents
from aquanav_tools.errors import InputError
from tests.build.original.files import prefab_of

CENTRES = np.array([[5.0, 1.0, 2.0], [15.0, 2.0, 2.5], [30.0, -1.0, 3.0]])

TEXT = """%YAML 1.1
%TAG !u! tag:unity3d.com,2011:
--- !u!4 &42
Transform:
  m_Place: {x: 1, y: -2.5, deep: {a: 3}}
  m_Wrapped: {fileID: 11500000, guid: acc7ff17c11819a4d98da4fcac5c5474,
    type: 3}
  m_Empty:
  m_None: []
  m_Text: 'two: words'
  m_List:
  - target: {fileID: 7}
    value: 3
  - target: {fileID: 8}
    value:
  m_Plain:
  - {fileID: 9}
  - ten
--- !u!999 &43
Other:
  m_Strange: ?!
"""


def test_tables_lists_and_wrapped_lines_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.prefab").write_text(TEXT)
    documents = read_documents(tmp_path / "a.prefab", {4})
    assert list(documents) == [42]
    assert documents[42].fields == {
        "m_Place": {"x": "1", "y": "-2.5", "deep": {"a": "3"}},
        "m_Wrapped": {"fileID": "11500000", "guid": "acc7ff17c11819a4d98da4fcac5c5474", "type": "3"},
        "m_Empty": "",
        "m_None": [],
        "m_Text": "two: words",
        "m_List": [{"target": {"fileID": "7"}, "value": "3"}, {"target": {"fileID": "8"}, "value": ""}],
        "m_Plain": [{"fileID": "9"}, "ten"],
    }


def test_panels_come_in_order_in_our_frame(tmp_path: Path) -> None:
    (tmp_path / "a.prefab").write_text(prefab_of(CENTRES))
    (rewarder,) = read_rewarders(tmp_path)
    np.testing.assert_allclose(rewarder.centres, CENTRES, atol=1e-12)
    np.testing.assert_allclose(rewarder.normals, np.tile([1.0, 0.0, 0.0], (3, 1)), atol=1e-12)
    # Unity's plane is 10 m wide, and twice that at scale 2: 10 m from the middle to an edge.
    np.testing.assert_allclose(np.linalg.norm(rewarder.sides, axis=2), 10.0)
    assert np.abs((rewarder.sides * rewarder.normals[:, None]).sum(axis=2)).max() < 1e-9


def test_panels_beyond_the_sixth_are_dropped_as_the_original_does(tmp_path: Path) -> None:
    centres = np.stack([np.arange(8.0), np.zeros(8), np.zeros(8)], axis=1)
    (tmp_path / "a.prefab").write_text(prefab_of(centres))
    (rewarder,) = read_rewarders(tmp_path)
    np.testing.assert_allclose(rewarder.centres, centres[:6], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "advice"),
    [
        ("  - {fileID: 1001}\n  - {fileID: 1002}\n", "", "names 1 panels; at least 2"),
        ("--- !u!1 &2001\n", "--- !u!1 &9999\n", "one of which is not in it"),
        ("x: 2.0, y: 2.0", "x: nan, y: 2.0", "one of which is not in it"),
        ("--- !u!4 &3001\nTransform:\n", "--- !u!4 &3001\n\n  oops oops\n", "damaged; clone it again"),
    ],
)
def test_damaged_prefabs_are_refused_with_advice(old: str, new: str, advice: str, tmp_path: Path) -> None:
    text = prefab_of(CENTRES)
    assert old in text
    (tmp_path / "a.prefab").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=advice):
        read_rewarders(tmp_path)


def test_a_prefab_without_objects_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.prefab").write_text("%YAML 1.1\n# m_targetRewarders\n")
    with pytest.raises(InputError, match=r"a\.prefab holds no object"):
        read_rewarders(tmp_path)


def test_panels_without_a_place_are_refused(tmp_path: Path) -> None:
    text = prefab_of(CENTRES).replace("!u!4 &3001", "!u!5 &3001")  # no longer a Transform
    (tmp_path / "a.prefab").write_text(text)
    with pytest.raises(InputError, match=r"one of which is not in it.*an object has no place"):
        read_rewarders(tmp_path)


def test_binary_assets_are_refused_with_advice(tmp_path: Path) -> None:
    (tmp_path / "a.prefab").write_bytes(b"\x00\x00UnityFS m_targetRewarders")
    with pytest.raises(InputError, match="Set Unity to write text"):
        read_rewarders(tmp_path)


def test_the_originals_panels_stand_where_its_contract_says(data_dir: Path) -> None:
    """Truth: the panels that were converted from the same prefabs by another program (saferlauv/panels)."""
    rewarders = {rewarder.name: rewarder for rewarder in read_rewarders(data_dir / "saferlauv_unity")}
    for name, key in (("DistanceRewarder", "easy"), ("DistanceRewarderSwoosh", "eval1")):
        panels = json.loads((data_dir / "saferlauv" / "panels" / f"{key}.json").read_text())["panels"]
        np.testing.assert_allclose(rewarders[name].centres, [panel["center"] for panel in panels], atol=1e-4)
        np.testing.assert_allclose(rewarders[name].normals, [panel["normal"] for panel in panels], atol=1e-4)


@pytest.mark.parametrize("size", [0.0, 1e200])
def test_a_rotation_that_turns_nothing_is_refused(size: float) -> None:
    at, one = {"x": 0, "y": 0, "z": 0}, {"x": 1, "y": 1, "z": 1}
    turn = {"w": size, "x": size, "y": 0, "z": 0}
    with pytest.raises(ValueError, match="a rotation of length"):
        local_transform({"m_LocalPosition": at, "m_LocalScale": one, "m_LocalRotation": turn})
