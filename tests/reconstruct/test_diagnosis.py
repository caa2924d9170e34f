"""Each cause of a photo left out is put into one photo of a synthetic scene, and told of that photo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.diagnosis import CAUSES, Diagnosis, cause_of, check_registration, diagnose, summarise
from aquanav_tools.reconstruct.evidence import Evidence, gather_evidence
from aquanav_tools.reconstruct.images import read_photos
from tests.reconstruct.pictures import speckle, write

DARK, BLURRED, PLAIN, LONELY, PAIR, ISLAND, UNSEEN, WRONG = 7, 8, 9, 10, (11, 12), (13, 14, 15), 16, 17
"""Ids of the photos that are spoilt; 1 to 6 make up the model."""
CAUSE_OF = {
    DARK: "dark",
    BLURRED: "blurred",
    PLAIN: "plain",
    LONELY: "unmatched",
    **dict.fromkeys(PAIR, "stranded"),
    **dict.fromkeys(ISLAND, "detached"),
    UNSEEN: "unseen",
    WRONG: "contradicted",
}
SPOIL = {DARK: lambda p: p // 16, BLURRED: lambda p: cv2.blur(p, (9, 3))}


def names(count: int, start: int = 1) -> list[str]:
    return [f"p{index}.jpg" for index in range(start, start + count)]


def dark(*photo_names: str) -> list[Diagnosis]:
    return [Diagnosis(name, "dark", "") for name in photo_names]


def only(model: Any, image_ids: set[int]) -> Any:
    part = load_pycolmap().Reconstruction(model)
    for image_id in set(model.reg_image_ids()) - image_ids:
        part.deregister_frame(part.images[image_id].frame_id)
    return part


def part_from(store: Any, image_ids: set[int], others: set[int]) -> None:
    """Remove all matches between two sets of photos."""
    for first in image_ids:
        for second in others - {first}:
            store.delete_two_view_geometry(first, second)


def shuffle_matches(store: Any, image_id: int, others: set[int], rng: np.random.Generator) -> None:
    """Match each keypoint of a photo with a wrong one."""
    for other in sorted(others):
        geometry = store.read_two_view_geometry(image_id, other)
        matches = np.array(geometry.inlier_matches)
        matches[:, 1] = rng.permutation(matches[:, 1])
        geometry.inlier_matches = matches
        store.update_two_view_geometry(image_id, other, geometry)


@pytest.fixture
def scene(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, list[Any], dict[int, str]]:
    """A folder with pictures and database.db, its models, and the names of the photos."""
    pycolmap = load_pycolmap()
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs = options.num_cameras_per_rig = 1
    options.num_frames_per_rig, options.num_points3D = WRONG, 400
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(tmp_path / "database.db") as store:
        truth = pycolmap.synthesize_dataset(options, store)
        everyone = set(truth.reg_image_ids())
        kept = only(truth, set(range(1, 7)))
        for alone in (DARK, BLURRED, PLAIN, LONELY):
            part_from(store, {alone}, everyone)
        store.update_keypoints(PLAIN, np.asarray(store.read_keypoints(PLAIN))[:100])
        part_from(store, set(PAIR), everyone - set(PAIR))
        part_from(store, {UNSEEN}, everyone - {1})
        for row in range(10, len(kept.images[1].points2D)):  # the rest of what it shares with photo 1 nobody else saw
            if kept.images[1].points2D[row].has_point3D():
                kept.delete_observation(1, row)
        part_from(store, {WRONG}, everyone - {3, 4})
        shuffle_matches(store, WRONG, {3, 4}, rng)
    shown = {image_id: image.name for image_id, image in truth.images.items()}
    write(tmp_path, {name: SPOIL.get(i, np.array)(speckle(300, 400, seed=i)) for i, name in shown.items()})
    return tmp_path, [kept, only(truth, set(ISLAND))], shown


def test_each_cause_is_told_of_the_photos_that_have_it(scene: tuple[Path, list[Any], dict[int, str]]) -> None:
    folder, models, name_by_id = scene
    photos = read_photos(folder)
    evidence = gather_evidence(photos, folder / "database.db", models, tolerance_px=6.0)
    groups = [sorted(name_by_id[i] for i in model.reg_image_ids()) for model in models]
    found = {diagnosis.name: diagnosis for diagnosis in diagnose(evidence, groups)}
    assert {name: one.cause for name, one in found.items()} == {name_by_id[i]: one for i, one in CAUSE_OF.items()}
    assert set(CAUSE_OF.values()) == set(CAUSES)
    assert all(diagnosis.sentence.startswith(name) for name, diagnosis in found.items())
    told = {image_id: found[name_by_id[image_id]].sentence for image_id in CAUSE_OF}
    assert "no matches with any photo of the model" in told[DARK]
    assert "100 keypoints" in told[PLAIN]
    assert f"400 matches with 1 of the photos without a place (400 with {name_by_id[PAIR[1]]})" in told[PAIR[0]]
    assert "in another model of 3 photos" in told[ISLAND[0]]
    assert f"400 matches with 1 of the photos in the model (400 with {name_by_id[1]})" in told[UNSEEN]
    assert evidence[name_by_id[UNSEEN]].points < 11
    assert evidence[name_by_id[WRONG]].points > 300 > 15 > evidence[name_by_id[WRONG]].fitting


def test_without_a_model_photos_that_match_are_stranded(scene: tuple[Path, list[Any], dict[int, str]]) -> None:
    folder, _, name_by_id = scene
    evidence = gather_evidence(read_photos(folder), folder / "database.db", [], tolerance_px=6.0)
    assert len(evidence) == WRONG
    assert {cause_of(evidence[name_by_id[i]], is_in_other_model=False) for i in range(1, 7)} == {"stranded"}


def test_a_dark_photo_that_shows_much_of_the_model_was_not_left_out_for_the_dark() -> None:
    known = Evidence(brightness=5.0, sharpness=1.0, keypoints=4000, placed=(("p1.jpg", 90),), points=60, fitting=9)
    assert cause_of(known, is_in_other_model=False) == "contradicted"


def test_too_few_registered_photos_end_the_build_with_their_causes() -> None:
    with pytest.raises(
        ReconstructionError,
        match=r"Only 2 of 10 photos registered \(20 %\)\. 8 are too dark .*: p3\.jpg to p10\.jpg; add light",
    ):
        check_registration(names(10), [names(2)], dark(*names(8, start=3)), min_share=0.3)


def test_no_model_at_all_is_said_with_numbers() -> None:
    with pytest.raises(ReconstructionError, match=r"Only 0 of 3 photos registered \(0 %\)"):
        check_registration(names(3), [], dark(*names(3)), min_share=0.3)


def test_half_of_the_photos_is_enough_with_a_warning() -> None:
    cautions = check_registration(names(10), [names(5)], dark(*names(5, start=6)), min_share=0.3)
    assert [caution.code for caution in cautions] == ["few-registered"]
    assert "Only 5 of 10 photos registered (50 %)" in cautions[0].message


def test_separate_groups_are_named() -> None:
    cautions = check_registration(names(10), [names(8), names(2, start=9)], dark("p9.jpg", "p10.jpg"), min_share=0.3)
    assert [caution.code for caution in cautions] == ["unregistered-photos", "separate-models"]
    assert (
        "the largest, 8 photos from p1.jpg to p8.jpg, is used, not 2 photos from p9.jpg to p10.jpg"
        in cautions[1].message
    )
    assert "They may show two places" in cautions[1].message


def test_a_second_model_of_photos_that_the_first_one_has_is_no_second_place() -> None:
    assert check_registration(names(10), [names(10), names(2, start=4)], [], min_share=0.3) == ()


def test_complete_registration_warns_of_nothing() -> None:
    assert check_registration(names(10), [names(10)], [], min_share=0.3) == ()


def test_a_few_photos_left_out_are_named_too() -> None:
    (caution,) = check_registration(names(10), [names(9)], dark("p10.jpg"), min_share=0.3)
    assert caution.code == "unregistered-photos"
    assert caution.message.startswith(
        "1 of 10 photos did not register. 1 is too dark (mean grey below 20 of 255): p10."
    )


def test_summary_counts_causes_most_frequent_first_and_names_runs() -> None:
    text = summarise(names(9), [Diagnosis("p7.jpg", "blurred", ""), *dark("p1.jpg", "p2.jpg", "p3.jpg", "p9.jpg")])
    assert text.startswith("4 are too dark")
    assert ": p1.jpg to p3.jpg, p9.jpg; add light" in text
    assert "1 is blurred: p7.jpg; move slower" in text


def test_summary_lists_five_runs_at_most() -> None:
    text = summarise(names(30), dark(*names(30)[::2]))
    assert "p1.jpg, p3.jpg, p5.jpg, p7.jpg, p9.jpg and 10 more;" in text
