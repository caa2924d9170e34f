from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.capture import look
from aquanav_tools.reconstruct.scale import (
    GeoreferenceOptions,
    Sim3,
    georeference,
    level,
    read_positions,
    upright,
)
from aquanav_tools.types import Array

NAMES = ["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"]


def turn(rng: np.random.Generator) -> Array:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def model(centres: Array, rotations: Array | None = None) -> SimpleNamespace:
    """What scale needs of a sparse model."""
    return SimpleNamespace(names=NAMES[: len(centres)], centres=centres, rotations=rotations)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_known_positions_give_back_the_transform_they_were_made_with(rng: np.random.Generator) -> None:
    truth = Sim3(3.7, turn(rng), np.array([10.0, -5.0, 2.0]))
    centres = rng.normal(size=(5, 3))
    positions = dict(zip(NAMES, truth.apply(centres), strict=True))
    found = georeference(model(centres), positions, GeoreferenceOptions())  # type: ignore[arg-type]
    assert found.world_from_sfm.scale == pytest.approx(3.7)
    np.testing.assert_allclose(found.world_from_sfm.rotation, truth.rotation, atol=1e-9)
    assert found.rms < 1e-9
    assert found.num_positions == 5


def test_a_mistyped_position_is_left_out_and_named(rng: np.random.Generator) -> None:
    truth = Sim3(2.0, turn(rng), np.zeros(3))
    centres = rng.normal(size=(5, 3))
    positions = dict(zip(NAMES, truth.apply(centres), strict=True))
    positions["c.jpg"] = positions["c.jpg"] + [9.0, 0.0, 0.0]
    found = georeference(model(centres), positions, GeoreferenceOptions())  # type: ignore[arg-type]
    assert found.world_from_sfm.scale == pytest.approx(2.0)
    assert found.num_positions == 4
    assert [caution.code for caution in found.cautions] == ["doubtful-positions"]
    assert "c.jpg" in found.cautions[0].message


def test_level_cameras_get_their_up_direction_along_z(rng: np.random.Generator) -> None:
    sfm_from_world = turn(rng)
    yaws = rng.uniform(-1.0, 1.0, 20)
    rotations = np.array([look(yaw, pitch) for yaw in yaws for pitch in (-0.3, 0.3)]) @ sfm_from_world.T
    centres = rng.normal(size=(40, 3)) * [10.0, 1.0, 1.0] @ sfm_from_world.T
    sim3 = upright(rotations, centres, 2.5)
    np.testing.assert_allclose(sim3.turn(sfm_from_world[:, 2][None]), [[0.0, 0.0, 1.0]], atol=1e-6)
    np.testing.assert_allclose(sim3.apply(centres).mean(axis=0), 0.0, atol=1e-9)
    assert np.linalg.det(sim3.rotation) == pytest.approx(1.0)
    spans = np.linalg.norm(np.diff(sim3.apply(centres), axis=0), axis=1)
    np.testing.assert_allclose(spans, 2.5 * np.linalg.norm(np.diff(centres, axis=0), axis=1))


def test_a_model_without_positions_says_that_its_size_is_arbitrary(rng: np.random.Generator) -> None:
    rotations = np.array([look(yaw, 0.0) for yaw in (0.0, 0.5, 1.0)])
    placement = level(model(rng.normal(size=(3, 3)), rotations))  # type: ignore[arg-type]
    assert placement.world_from_sfm.scale == 1.0
    assert [caution.code for caution in placement.cautions] == ["no-scale"]


def test_positions_file_is_read_in_any_column_order(tmp_path: Path) -> None:
    path = write(tmp_path / "p.csv", "x, z, y, name\n1, 3, 2, b.jpg\n")
    np.testing.assert_array_equal(read_positions(path, NAMES)["b.jpg"], [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,x,y\na.jpg,1,2\n", r"lacks the columns z.*must be: name,x,y,z"),
        ("name,x,y,z\naa.jpg,1,2,3\n", r"line 2: no photo is called 'aa\.jpg'\. Did you mean 'a\.jpg'"),
        ("name,x,y,z\na.jpg,1,2,3\na.jpg,1,2,3\n", r"line 3: 'a\.jpg' is listed twice"),
        ("name,x,y,z\na.jpg,1,two,3\n", r"line 2: x, y, z are not three numbers"),
        ("name,x,y,z\na.jpg,1,2\n", r"line 2: x, y, z are not three numbers"),
        ("name,x,y,z\na.jpg,1,nan,3\n", r"line 2: .* is not finite"),
    ],
)
def test_faults_in_a_positions_file_are_named_with_their_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_positions(write(tmp_path / "p.csv", text), NAMES)


def test_missing_positions_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv does not exist"):
        read_positions(tmp_path / "none.csv", NAMES)


def test_two_positions_are_too_few(rng: np.random.Generator) -> None:
    positions = {"a.jpg": np.zeros(3), "b.jpg": np.ones(3)}
    with pytest.raises(InputError, match=r"Only 2 of the 5 registered photos have a position; 3 are needed"):
        georeference(model(rng.normal(size=(5, 3))), positions, GeoreferenceOptions())  # type: ignore[arg-type]


def test_positions_on_a_line_are_refused(rng: np.random.Generator) -> None:
    positions = {name: np.array([2.0 * index, 0.0, 0.0]) for index, name in enumerate(NAMES)}
    with pytest.raises(InputError, match=r"5 positions lie on a line"):
        georeference(model(rng.normal(size=(5, 3))), positions, GeoreferenceOptions())  # type: ignore[arg-type]


def test_positions_that_fit_nothing_are_refused(rng: np.random.Generator) -> None:
    positions = {name: rng.normal(size=3) * 1000.0 for name in NAMES}
    with pytest.raises(InputError, match=r"positions agree with the model to 0\.001 m"):
        georeference(model(rng.normal(size=(5, 3))), positions, GeoreferenceOptions(max_error=0.001))  # type: ignore[arg-type]
