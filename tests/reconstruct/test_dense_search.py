"""The dense search against a plane whose depth is known in closed form, on the processor and on graphics cards."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest

from aquanav_tools.errors import ResourceError
from aquanav_tools.reconstruct.dense import cpu
from aquanav_tools.reconstruct.dense.engine import cuda_obstacle, solver
from aquanav_tools.reconstruct.dense.levels import Level, Task, find_planes, gather, make_agree
from aquanav_tools.reconstruct.dense.state import WORST_COST, Photo, Planes, Search
from tests.conftest import REPOSITORY
from tests.reconstruct.walls import DEPTH, HEIGHT, WIDTH, Wall, small_case, wall_pictures

LEVELS = (Level(1, 3, 3, 0.5, 3), Level(0, 2, 2, 0.2, 3))
INSIDE = np.s_[6:-6, 12:-12]
"""Away from the border, where windows leave the other photos."""


def wall_task(wall: Wall = Wall()) -> Task:  # noqa: B008  # frozen
    picture, *others = wall_pictures(wall)
    return Task(picture, others, nearest=1.0, farthest=4.0, seed=0)


def points_beside(rng: np.random.Generator) -> np.ndarray:
    """(P, 3) points up to a tenth beside the wall, as a start that is not yet the answer."""
    z = DEPTH * rng.uniform(0.9, 1.1, 12)
    return np.column_stack([rng.uniform(-0.5, 0.5, (12, 2)) * z[:, None], z])


def test_depth_and_normal_of_a_wall_are_found_from_points_beside_it(rng: np.random.Generator) -> None:
    planes = find_planes(wall_task(), points_beside(rng), LEVELS, cpu.solve)
    assert np.median(planes.cost[INSIDE]) < 0.02
    assert np.median(np.abs(1.0 / planes.inverse[INSIDE] - DEPTH)) < 0.02  # 7.5 px of disparity to a fifteenth of one
    assert np.median(np.abs(planes.slopes[INSIDE])) < 5e-4  # 1/m per px: 3.4 degrees


def test_slope_of_a_slanted_wall_is_found(rng: np.random.Generator) -> None:
    wall = Wall(slant=0.4)  # 1/z = (1 - slant x/z) / DEPTH along a row
    planes = find_planes(wall_task(wall), points_beside(rng), LEVELS, cpu.solve)
    expected = -wall.slant / DEPTH / wall_pictures(wall)[0].matrix[0, 0]
    assert np.median(planes.slopes[INSIDE][..., 0]) == pytest.approx(expected, rel=0.15)
    assert np.median(np.abs(planes.slopes[INSIDE][..., 1])) < 5e-4


@pytest.mark.slow
def test_the_process_that_compiles_gets_the_result_of_those_that_read_the_compiled_code(tmp_path: Path) -> None:
    code = "from tests.reconstruct.walls import print_small_case; print_small_case('cpu')"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    first, second = (
        subprocess.run(
            [sys.executable, "-c", code], env=environment, cwd=REPOSITORY, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    )
    assert any(tmp_path.rglob("*.nbc"))
    assert first == second


def test_unusable_pixels_get_no_depth(rng: np.random.Generator) -> None:
    task = wall_task()
    usable = task.picture.usable.copy()
    usable[:, :20] = 0
    picture = replace(task.picture, usable=usable)
    planes = find_planes(replace(task, picture=picture), points_beside(rng), LEVELS, cpu.solve)
    assert np.all(planes.cost[:, :20] == WORST_COST)
    assert np.mean(planes.cost[INSIDE][:, 10:] < WORST_COST) > 0.9


def test_a_wall_without_texture_gets_no_depth(rng: np.random.Generator) -> None:
    task = wall_task()
    flat = [replace(picture, grey=np.full_like(picture.grey, 90)) for picture in (task.picture, *task.others)]
    planes = find_planes(replace(task, picture=flat[0], others=flat[1:]), points_beside(rng), LEVELS, cpu.solve)
    assert np.all(planes.cost == WORST_COST)


@pytest.mark.parametrize(("is_level", "given_up"), [(True, 1.0), (False, 0.0)])
def test_only_wall_that_looks_alike_at_any_depth_is_given_up(
    is_level: bool, given_up: float, rng: np.random.Generator
) -> None:
    """Stripes along the way from camera to camera: depth moves a window along them, onto what looks the same.

    Across waves of 14 px, 3 % of 7.5 px of disparity cost 1 - cos(0.1) = 0.005.
    """
    levels = (LEVELS[0], replace(LEVELS[1], distinction=0.001))
    planes = find_planes(wall_task(Wall(is_level=is_level)), points_beside(rng), levels, cpu.solve)
    assert np.mean(planes.cost[INSIDE] == WORST_COST) == pytest.approx(given_up, abs=0.05)


def test_rock_that_one_source_alone_shows_is_kept(rng: np.random.Generator) -> None:
    task = wall_task()
    blind = replace(task.others[1], grey=rng.integers(0, 255, (HEIGHT, WIDTH)).astype(np.uint8))
    planes = find_planes(replace(task, others=[task.others[0], blind]), points_beside(rng), LEVELS, cpu.solve)
    assert np.median(np.abs(1.0 / planes.inverse[INSIDE] - DEPTH)) < 0.02


def test_depths_that_other_photos_do_not_confirm_cost_more(rng: np.random.Generator) -> None:
    task = wall_task()
    start = np.full((HEIGHT, WIDTH), 1.0 / DEPTH, np.float32), np.zeros((HEIGHT, WIDTH, 2), np.float32)
    level = Level(0, 1, 2, 0.02, 3, agreement=0.3)
    right = [np.full((HEIGHT, WIDTH), 1.0 / DEPTH, np.float32)] * 2
    wrong = [np.full((HEIGHT, WIDTH), 1.2 / DEPTH, np.float32)] * 2
    confirmed = make_agree(task, start, right, level, cpu.solve)
    denied = make_agree(task, start, wrong, level, cpu.solve)
    assert np.median(confirmed.cost[INSIDE]) < 0.05
    # 0.3 is what the two sources' disagreement adds; a wrong depth that they confirm costs more than that.
    assert np.median(denied.cost[INSIDE]) == pytest.approx(np.median(confirmed.cost[INSIDE]) + 0.3, abs=0.05)


def test_a_wrong_depth_is_taken_back_where_the_other_photos_know_better(rng: np.random.Generator) -> None:
    """Waves of one direction repeat: a depth off by a wave looks as good, and only the other photos tell."""
    wall = Wall(is_striped=True)
    task = wall_task(wall)
    alias = 1.0 / DEPTH + wall.period_of_inverse  # a disparity of one stripe more, at a depth of 1.1 m
    start = np.full((HEIGHT, WIDTH), alias, np.float32), np.zeros((HEIGHT, WIDTH, 2), np.float32)
    maps = [np.full((HEIGHT, WIDTH), 1.0 / DEPTH, np.float32)] * 2
    level = Level(0, 3, 3, 0.5, 3, agreement=0.3)
    agreed = make_agree(task, start, maps, level, cpu.solve)
    alone = make_agree(task, start, maps, replace(level, agreement=0.0), cpu.solve)
    assert np.median(np.abs(1.0 / agreed.inverse[INSIDE] - DEPTH)) < 0.04
    assert np.median(np.abs(1.0 / alone.inverse[INSIDE] - DEPTH)) > 0.2


def test_the_same_functions_on_a_simulated_graphics_card_find_the_same() -> None:
    """In a process of its own: the simulator takes the place of numba.cuda when imported, and runs plain Python."""
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONWARNINGS": "ignore"}
    code = "from tests.reconstruct.walls import print_small_case; print_small_case('cuda')"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    simulated = np.array([float(word) for word in done.stdout.split()]).reshape(4, -1)
    here = small_case(cpu.solve)
    # Rates of given planes differ by rounding only; after a round a few pixels took another of two planes alike.
    np.testing.assert_allclose(simulated[0], here[0], atol=2e-3)
    assert np.mean(np.abs(simulated[1] - here[1]) < 0.01 * here[1]) > 0.9
    assert np.mean(np.abs(simulated[2] - here[2]) < 0.02) > 0.9
    assert np.mean((simulated[3] == WORST_COST) == (here[3] == WORST_COST)) > 0.9
    assert 0.0 < np.mean(here[3] == WORST_COST) < 1.0


@pytest.mark.slow
def test_kernels_compile_for_graphics_cards(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.cuda import compile_ptx
    from numba.cuda.cudadrv.nvvm import is_available

    if not is_available():
        pytest.skip("CUDA's compiler library (NVVM) is not on this machine")
    from aquanav_tools.reconstruct.dense import card

    card_of_8_0 = SimpleNamespace(compute_capability=(8, 0))  # numba asks for it to compile what a kernel calls
    monkeypatch.setattr("numba.cuda.dispatcher.get_current_device", lambda: card_of_8_0)
    values = kernel_values()
    types = [numba.typeof(value) for value in values]
    two = [numba.int64, numba.int64]
    for kernel, arguments in ((card.choose, types), (card.sweep, [*two, *types]), (card.reject, types)):
        code, _ = compile_ptx(kernel.py_func, tuple(arguments), fastmath=True, cc=(8, 0))
        assert ".visible .entry" in code


def kernel_values() -> tuple[object, ...]:
    task = wall_task()
    photo = Photo(task.picture.grey.astype(np.float32), task.picture.usable, np.float32(60), np.float32(60))
    size = task.picture.grey.shape
    image = np.zeros(size, np.float32)
    planes = Planes(image, np.zeros((*size, 2), np.float32), image, np.zeros((*size, 3), np.uint8))
    one = np.float32(1)
    return photo, gather(task.picture, task.others), planes, Search(3, 2, 3, one, one, one, one, 0)


def test_a_graphics_card_finds_the_same_as_the_processor() -> None:
    obstacle = cuda_obstacle()
    if obstacle:
        pytest.skip(obstacle)
    there, here = small_case(solver("cuda").solve), small_case(cpu.solve)
    np.testing.assert_allclose(there[0], here[0], atol=2e-3)
    assert np.mean(np.abs(there[1] - here[1]) < 0.01 * here[1]) > 0.9


def test_asking_for_a_graphics_card_where_there_is_none_says_so() -> None:
    if not cuda_obstacle():
        pytest.skip("there is a CUDA graphics card here")
    with pytest.raises(ResourceError, match=r"CUDA graphics card here.*'auto' or 'cpu'"):
        solver("cuda")
    assert solver("auto").solve is cpu.solve
