"""Content files are found by name, and only inside their folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools import shipped
from aquanav_tools.errors import InputError


@pytest.fixture
def content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "content" / "pipelines" / "build"
    folder.mkdir(parents=True)
    for name in ("photos.toml", "scan.toml", "notes.md"):
        (folder / name).touch()
    (tmp_path / "secret.toml").touch()
    monkeypatch.setattr(shipped, "CONTENT_DIR", tmp_path / "content")
    return folder


def test_names_are_those_of_the_toml_files_in_order(content: Path) -> None:
    assert shipped.shipped_names("pipelines/build") == ["photos", "scan"]


def test_numbers_in_names_count_by_their_size(content: Path) -> None:
    for number in (10, 2, 1):
        (content / f"cave-{number}.toml").touch()
    assert shipped.shipped_names("pipelines/build") == ["cave-1", "cave-2", "cave-10", "photos", "scan"]


def test_a_shipped_file_is_found_by_its_name(content: Path) -> None:
    assert shipped.shipped_path("pipelines/build", "scan") == content / "scan.toml"


def test_a_misspelt_name_gets_the_closest_match(content: Path) -> None:
    with pytest.raises(InputError, match=r"ships no 'photo' in pipelines/build\. Did you mean 'photos'\?"):
        shipped.shipped_path("pipelines/build", "photo")


@pytest.mark.parametrize("name", ["../../../secret", "/etc/passwd", "", "."])
def test_no_name_leads_out_of_the_folder(content: Path, name: str) -> None:
    with pytest.raises(InputError):
        shipped.shipped_path("pipelines/build", name)


def test_the_checkout_holds_the_content_folders() -> None:
    for folder in ("pipelines", "scenarios", "eval/protocols"):
        assert (shipped.CONTENT_DIR / folder).is_dir()
