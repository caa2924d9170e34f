"""Of a set that grew, only the new photos are searched, to the same result as from the beginning."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct import features
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.earlier import find_earlier
from aquanav_tools.reconstruct.features import FeatureOptions, extract_features
from aquanav_tools.reconstruct.images import PhotoSet, read_photos
from aquanav_tools.store import StageStore
from tests.reconstruct.pictures import pan, write


def find(photos_dir: Path, work: Path, content: dict[str, str]) -> Path:
    """Run the stage as `reconstruct` does, and return its database."""
    photos, options = read_photos(photos_dir), FeatureOptions(max_features=200)
    with StageStore(work).open("features", extract_features, content) as folder:
        earlier = find_earlier(folder, "a.db", content, extract_features)
        extract_features(photos, folder / "a.db", options, earlier=earlier)
    return folder / "a.db"


def contents(database: Path) -> list[tuple[int, str, bytes, bytes]]:
    with load_pycolmap().Database.open(database) as store:
        ids = {image.image_id: image.name for image in store.read_all_images()}
        keypoints = {i: np.asarray(store.read_keypoints(i)).tobytes() for i in ids}
        descriptors = {i: np.asarray(store.read_descriptors(i).data).tobytes() for i in ids}
    return [(i, ids[i], keypoints[i], descriptors[i]) for i in sorted(ids)]


def test_new_and_changed_photos_alone_are_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = {f"p{n}.png": picture for n, picture in enumerate(pan(4, 40, size=(150, 200)))}
    write(tmp_path / "in", {name: pictures[name] for name in ("p0.png", "p1.png", "p3.png")})
    find(tmp_path / "in", tmp_path / "work", {"p0.png": "a", "p1.png": "b", "p3.png": "d"})
    write(tmp_path / "in", {"p1.png": pictures["p1.png"][::-1], "p2.png": pictures["p2.png"]})
    searched: list[str] = []
    search = features._search

    def noted(photos: PhotoSet, files: list[str], *rest: Any, **probing: Any) -> Any:
        if not probing:  # a few photos of every set are tried, to tell how the rest is best searched
            searched.extend(files)
        return search(photos, files, *rest, **probing)

    monkeypatch.setattr(features, "_search", noted)
    content = {"p0.png": "a", "p1.png": "changed", "p2.png": "c", "p3.png": "d"}
    grown = find(tmp_path / "in", tmp_path / "work", content)
    assert searched == ["p1.png", "p2.png"]
    assert contents(grown) == contents(find(tmp_path / "in", tmp_path / "afresh", content))
