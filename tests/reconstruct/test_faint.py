"""Texture is brought out alike wherever the lamp stands, and noise is told from it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from aquanav_tools.reconstruct.features import FeatureOptions, overlap_closely
from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.intake.faint import brought_out, is_noisy


def rock(rng: np.random.Generator, contrast: float) -> np.ndarray:
    """Return (240, 320) grey values of detail that grows with its size, about 100."""
    layers = [size * cv2.GaussianBlur(rng.normal(0.0, size, (240, 320)), (0, 0), size) for size in (1.0, 2.0, 4.0, 8.0)]
    texture = np.sum(layers, axis=0)
    return 100.0 + contrast * texture / texture.std()


def lit(picture: np.ndarray, lamp_x: float) -> np.ndarray:
    """Return a picture lit by a lamp before a column of it."""
    falloff = np.exp(-(((np.arange(picture.shape[1]) - lamp_x) / 160.0) ** 2))
    return np.clip(picture * falloff, 0.0, 255.0).astype(np.uint8)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def test_the_same_rock_looks_the_same_wherever_the_lamp_stands(rng: np.random.Generator) -> None:
    wall = rock(rng, 20.0)
    left, right = lit(wall, 60.0), lit(wall, 260.0)
    assert correlation(left, right) < 0.0
    assert correlation(brought_out(left), brought_out(right)) > 0.9


def test_faint_detail_is_as_strong_as_plain_detail(rng: np.random.Generator) -> None:
    wall = rock(rng, 30.0)
    wall[:, 160:] = 100.0 + (wall[:, 160:] - 100.0) / 10.0
    detail = brought_out(wall.astype(np.uint8)).astype(float)
    assert np.std(detail[:, 220:]) > 0.7 * np.std(detail[:, :100])


def test_a_flat_wall_stays_flat(rng: np.random.Generator) -> None:
    flat = np.full((240, 320), 100, np.uint8)
    assert np.ptp(brought_out(flat)) <= 1


def test_noise_is_told_from_texture(rng: np.random.Generator) -> None:
    faint, noise = rock(rng, 3.0), rng.normal(0.0, 6.0, (240, 320))
    assert not is_noisy(faint.astype(np.float32))
    assert not is_noisy(rock(rng, 30.0).astype(np.float32))
    assert is_noisy((faint + noise).astype(np.float32))


def test_photos_that_overlap_closely_are_told_from_photos_of_wide_steps(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    layers = [size * cv2.GaussianBlur(rng.normal(0.0, size, (400, 3000)), (0, 0), size) for size in (1, 2, 4, 8, 16)]
    wall = np.sum(layers, axis=0)
    grey = np.clip(120.0 + 40.0 * wall / wall.std(), 0.0, 255.0).astype(np.uint8)
    for name, step in (("close", 20), ("wide", 420)):
        (tmp_path / name).mkdir()
        for index in range(6):
            cv2.imwrite(str(tmp_path / name / f"{index}.png"), grey[:, index * step : index * step + 500])
    options = FeatureOptions(max_features=1000)
    assert overlap_closely(read_photos(tmp_path / "close"), options, tmp_path)
    assert not overlap_closely(read_photos(tmp_path / "wide"), options, tmp_path)
