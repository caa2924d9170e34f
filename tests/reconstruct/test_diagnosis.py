from __future__ import annotations

import pytest

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.diagnosis import CAUSES, Diagnosis, check_registration, diagnose, summarise
from aquanav_tools.reconstruct.features import FeatureOptions, extract_features
from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.matching import MatchOptions, match_features


def names(count: int, start: int = 1) -> list[str]:
    return [f"p{index}.jpg" for index in range(start, start + count)]


def dark(*photo_names: str) -> list[Diagnosis]:
    return [Diagnosis(name, "dark", "") for name in photo_names]


def test_each_cause_is_found_in_a_photo_that_has_it(tmp_path) -> None:  # type: ignore[no-untyped-def]
    import cv2
    import numpy as np

    rng = np.random.default_rng(0)
    speckle = cv2.GaussianBlur(rng.integers(0, 255, (300, 400), dtype=np.uint8), (5, 5), 0)
    other = cv2.GaussianBlur(rng.integers(0, 255, (300, 400), dtype=np.uint8), (5, 5), 0)
    plain = np.full((300, 400), 128, np.uint8)
    plain[130:170, ::2] = 255
    photos = {
        "good1": speckle,
        "good2": np.roll(speckle, 8, axis=1),
        "night": speckle // 20,
        "shaken": cv2.GaussianBlur(speckle, (0, 0), 12),
        "wall": plain,
        "lonely": other,
        "island": np.roll(speckle, 16, axis=1),
        "stuck": np.roll(speckle, 24, axis=1),
    }
    for name, pixels in photos.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), pixels)
    folder = read_photos(tmp_path)
    database = tmp_path / "work" / "database.db"
    extract_features(folder, database, FeatureOptions(max_features=800))
    match_features(folder, database, MatchOptions())
    groups = [["good1.png", "good2.png"], ["island.png"]]
    found = {diagnosis.name: diagnosis for diagnosis in diagnose(folder, database, groups)}
    causes = {name.removesuffix(".png"): diagnosis.cause for name, diagnosis in found.items()}
    assert causes == {
        "night": "dark",
        "shaken": "blurred",
        "wall": "plain",
        "lonely": "unmatched",
        "island": "detached",
        "stuck": "unplaced",
    }
    assert set(causes.values()) == set(CAUSES)
    assert all(diagnosis.sentence.startswith(name) for name, diagnosis in found.items())


def test_too_few_registered_photos_end_the_build_with_their_causes() -> None:
    with pytest.raises(
        ReconstructionError, match=r"Only 2 of 10 photos registered \(20 %\)\. 8 are too dark .*p3.jpg to p10"
    ):
        check_registration(10, [names(2)], dark(*names(8, start=3)), min_share=0.3)


def test_no_model_at_all_is_said_with_numbers() -> None:
    with pytest.raises(ReconstructionError, match=r"Only 0 of 3 photos registered \(0 %\)"):
        check_registration(3, [], dark(*names(3)), min_share=0.3)


def test_half_of_the_photos_is_enough_with_a_warning() -> None:
    cautions = check_registration(10, [names(5)], dark(*names(5, start=6)), min_share=0.3)
    assert [caution.code for caution in cautions] == ["few-registered"]
    assert "Only 5 of 10 photos registered (50 %)" in cautions[0].message


def test_separate_groups_are_named() -> None:
    cautions = check_registration(10, [names(8), names(2, start=9)], dark("p9.jpg", "p10.jpg"), min_share=0.3)
    assert [caution.code for caution in cautions] == ["separate-models"]
    assert (
        "the largest, 8 photos from p1.jpg to p8.jpg, is used, not 2 photos from p9.jpg to p10.jpg"
        in cautions[0].message
    )
    assert "They may show two places" in cautions[0].message


def test_a_second_model_of_photos_that_the_first_one_has_is_no_second_place() -> None:
    assert check_registration(10, [names(10), names(2, start=4)], [], min_share=0.3) == ()


def test_complete_registration_warns_of_nothing() -> None:
    assert check_registration(10, [names(10)], [], min_share=0.3) == ()


def test_summary_counts_causes_most_frequent_first() -> None:
    text = summarise([Diagnosis("p7.jpg", "blurred", ""), *dark(*names(2))])
    assert text.startswith("2 are too dark")
    assert "1 is blurred, p7.jpg" in text
