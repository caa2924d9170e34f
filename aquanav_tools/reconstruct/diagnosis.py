"""Why a photo found no place in the model, and what to do about it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.intake.names import name_of, natural_key

GOOD_SHARE = 0.8
"""Registered share below which a reconstruction of a passage has gaps (measured)."""
MIN_REGISTERED = 3
DARK_BELOW = 20.0
"""Mean grey value, of 255, below which SIFT finds next to nothing."""
BLURRED_BELOW = 0.2
"""Sharpness relative to the median of the registered photos."""
FEW_KEYPOINTS = 300
FEW_MATCHES = 30
"""Matches that a photo needs with one model to be placed in it (COLMAP's abs_pose_min_num_inliers)."""
CAUSES = {
    "dark": "too dark (mean grey below 20 of 255); add light or frames there",
    "blurred": "blurred; move slower or take sharper frames there",
    "plain": f"without texture (fewer than {FEW_KEYPOINTS} keypoints); move back or light the rock from the side there",
    "unmatched": f"without a neighbour that shows its rock (fewer than {FEW_MATCHES} matches); add photos in between",
    "detached": "in a group of its own; add photos that link it to the rest",
    "unplaced": "matched but could not be placed; add photos from other places there",
}


@dataclass(frozen=True)
class Caution:
    """A result that is poor but usable."""

    code: str
    """For looking it up."""
    message: str
    """What happened with numbers, the likely cause, what to do next."""


@dataclass(frozen=True)
class Diagnosis:
    """Why one photo is not in the model."""

    name: str
    cause: str
    """A key of CAUSES."""
    sentence: str


def diagnose(photos: PhotoSet, database: Path, groups: Sequence[Sequence[str]]) -> tuple[Diagnosis, ...]:
    """Return the diagnosis of every photo that is not in the first of the groups of registered photos."""
    registered = set(groups[0]) if groups else set()
    missing = [name for name in photos.names if name not in registered]
    if not missing:
        return ()
    detached = {name for group in groups[1:] for name in group}
    usual = np.median([_sharpness(photos.path(name)) for name in sorted(registered or photos.names)[::5]])
    keypoints, matches = _matching_statistics(database)
    diagnoses = []
    for name in missing:
        brightness, sharpness = _brightness(photos.path(name)), _sharpness(photos.path(name))
        if brightness < DARK_BELOW:
            cause, evidence = "dark", f"mean grey {brightness:.0f} of 255"
        elif sharpness < BLURRED_BELOW * usual:
            cause, evidence = "blurred", f"{100 * sharpness / usual:.0f} % of the usual sharpness"
        elif keypoints.get(name, 0) < FEW_KEYPOINTS:
            cause, evidence = "plain", f"{keypoints.get(name, 0)} keypoints"
        elif name in detached:
            cause, evidence = "detached", f"{matches.get(name, 0)} matches with its best neighbour"
        elif matches.get(name, 0) < FEW_MATCHES:
            cause, evidence = "unmatched", f"{matches.get(name, 0)} matches with its best neighbour"
        else:
            cause, evidence = "unplaced", f"{matches.get(name, 0)} matches with its best neighbour"
        diagnoses.append(Diagnosis(name, cause, f"{name} ({evidence}) is {CAUSES[cause]}."))
    return tuple(diagnoses)


def check_registration(
    num_photos: int, groups: Sequence[Sequence[str]], diagnoses: Sequence[Diagnosis], min_share: float
) -> tuple[Caution, ...]:
    """Return the cautions about a mapping that left photos out.

    Raises:
        ReconstructionError: fewer than MIN_REGISTERED photos, or less than `min_share` of them, are in the first group.
    """
    count = len(groups[0]) if groups else 0
    share = count / num_photos
    message = f"Only {count} of {num_photos} photos registered ({100 * share:.0f} %). {summarise(diagnoses)}"
    if count < MIN_REGISTERED or share < min_share:
        raise ReconstructionError(message)
    cautions = []
    if share < GOOD_SHARE:
        cautions.append(Caution("few-registered", message))
    apart = [rest for group in groups[1:] if (rest := [name for name in group if name not in groups[0]])]
    if apart:
        kept, *others = [f"{len(group)} photos from {group[0]} to {group[-1]}" for group in (groups[0], *apart)]
        cautions.append(
            Caution(
                "separate-models",
                f"The photos fell apart into {1 + len(apart)} groups; the largest, {kept}, is used, not "
                f"{'; '.join(others)}. They may show two places, or photos that link the groups are missing: build the "
                "groups apart, or add photos that show the rock of both.",
            )
        )
    return tuple(cautions)


def summarise(diagnoses: Sequence[Diagnosis]) -> str:
    """Return one sentence per cause, the most frequent first, with the count and the range of photos."""
    sentences = []
    for cause, count in Counter(diagnosis.cause for diagnosis in diagnoses).most_common():
        names = sorted((d.name for d in diagnoses if d.cause == cause), key=natural_key)
        where = names[0] if count == 1 else f"from {names[0]} to {names[-1]}"
        verb = "is" if count == 1 else "are"
        sentences.append(f"{count} {verb} {CAUSES[cause].replace(';', f', {where};', 1)}.")
    return " ".join(sentences)


def _brightness(path: Path) -> float:
    """Return the mean grey value in [0, 255]."""
    return float(_grey(path).mean())


def _sharpness(path: Path) -> float:
    """Return the variance of the Laplacian at a common width of 640 px, relative to the brightness squared."""
    import cv2

    grey = _grey(path)
    small = cv2.resize(grey, (640, max(1, round(640 * grey.shape[0] / grey.shape[1]))), interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(small, cv2.CV_64F).var() / max(small.mean(), 1.0) ** 2)


def _grey(path: Path):  # type: ignore[no-untyped-def]  # an OpenCV image
    import cv2

    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def _matching_statistics(database: Path) -> tuple[dict[str, int], dict[str, int]]:
    """Return for every photo its keypoints, and its verified matches with the neighbour that has most."""
    with load_pycolmap().Database.open(database) as store:
        names = {image.image_id: name_of(image.name) for image in store.read_all_images()}
        keypoints = {name: int(store.num_keypoints_for_image(image_id)) for image_id, name in names.items()}
        best: Counter[str] = Counter()
        pair_ids, counts = store.read_two_view_geometry_num_inliers()
        for pair_id, count in zip(pair_ids, counts, strict=True):
            for image_id in load_pycolmap().pair_id_to_image_pair(pair_id):
                best[names[image_id]] = max(best[names[image_id]], int(count))
    return keypoints, dict(best)
