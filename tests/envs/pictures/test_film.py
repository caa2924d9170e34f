from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.envs.pictures.film import Frame, annotate, film, film_size
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.photograph.video import VideoFile

RATE = 10.0


class Painter:
    """Paints pictures whose grey tells the time: the film's truth."""

    size = (96, 72)

    def picture(self, state: np.ndarray, time: float) -> np.ndarray:
        return np.full((72, 96, 3), round(200.0 * time) + 20, np.uint8)


def frames(count: int = 6) -> list[Frame]:
    state = np.zeros(13)
    return [Frame(state, n / RATE, 0.5, 0, False, 1.0, 0.4) for n in range(count)]


def is_as_painted(shown: np.ndarray, number: int, atol: float) -> bool:
    return bool(np.abs(shown[:30].astype(float) - (20.0 * number + 20.0)).max() <= atol)


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_video_has_a_frame_for_every_state(tmp_path: Path, suffix: str) -> None:
    cv2 = pytest.importorskip("cv2", reason="what reads films here is OpenCV, which did not write them")
    path = tmp_path / f"dive{suffix}"
    film(Painter(), frames(), path, RATE)
    reader = cv2.VideoCapture(str(path))
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(RATE)
    shown = []
    while (read := reader.read())[0]:
        shown.append(read[1][..., ::-1])
    assert len(shown) == 6
    assert all(is_as_painted(picture, number, 8.0) for number, picture in enumerate(shown))  # lossy codecs
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_webm_is_what_browsers_play(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    film(Painter(), frames(), tmp_path / "dive.webm", RATE)
    data = (tmp_path / "dive.webm").read_bytes()
    assert data[:4] == b"\x1a\x45\xdf\xa3"  # EBML
    assert b"\x42\x82\x84webm" in data[:64] and b"V_VP8" in data  # its DocType and its codec
    assert capfd.readouterr().err == ""


def test_an_mp4_is_what_browsers_play(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    film(Painter(), frames(), tmp_path / "dive.mp4", RATE)
    assert b"avc1" in (tmp_path / "dive.mp4").read_bytes()  # H.264, by its name in the table of samples
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_an_odd_side_gets_one_pixel_more(tmp_path: Path, suffix: str) -> None:
    import av

    picture = np.full((73, 97, 3), 120, np.uint8)
    with VideoFile(tmp_path / f"odd{suffix}", RATE, (97, 73)) as video:
        video.write(picture)
    with av.open(str(tmp_path / f"odd{suffix}")) as file:
        (shown,) = file.decode(video=0)
    assert np.abs(shown.to_ndarray(format="rgb24").astype(int) - np.full((74, 98, 3), 120)).max() < 8


def test_a_video_that_cannot_be_written_is_told_with_the_cause(tmp_path: Path) -> None:
    with pytest.raises(ResourceError, match=r"The video .*dive\.mp4 cannot be written: .*No such file.*read-only"):
        VideoFile(tmp_path / "nowhere" / "dive.mp4", RATE, (96, 72))


def test_a_camera_that_fails_ends_the_film_with_its_own_error(tmp_path: Path) -> None:
    class Broken(Painter):
        def picture(self, state: np.ndarray, time: float) -> np.ndarray:
            if time > 0.25:
                raise RuntimeError("the lens fell off")
            return super().picture(state, time)

    with pytest.raises(RuntimeError, match="the lens fell off"):
        film(Broken(), frames(), tmp_path / "dive.mp4", RATE)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["GIF", "WEBP"])
def test_an_animation_has_a_frame_for_every_state_and_repeats(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"dive.{kind.lower()}"
    film(Painter(), frames(), path, RATE)
    with Image.open(path) as animation:
        assert (animation.format, animation.n_frames, animation.info["loop"]) == (kind, 6, 0)
        for number in range(6):
            animation.seek(number)
            animation.load()
            assert animation.info["duration"] == 100
            assert is_as_painted(np.asarray(animation.convert("RGB")), number, 5.0)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_film_of_another_kind_or_in_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no films like dive\.avi\. .* ends in \.mp4, \.webm, \.gif or \.webp"):
        film_size(tmp_path / "dive.avi")
    with pytest.raises(InputError, match=r"no folder .*nowhere for the film dive\.gif\. Make it first"):
        film_size(tmp_path / "nowhere" / "dive.gif")


@pytest.mark.parametrize("size", [(640, 480), (320, 240)])
def test_the_bar_changes_with_each_number_and_covers_nothing_else(size: tuple[int, int]) -> None:
    blank = np.full((size[1], size[0], 3), 90, np.uint8)
    frame = frames(1)[0]
    plain = annotate(blank, frame)
    bar = int(np.flatnonzero((plain != 90).any(axis=(1, 2)))[0])
    assert bar > 0.88 * size[1]
    assert plain[bar:].max() > 200  # light digits
    changes = {"time": 7.5, "clearance": 0.11, "num_contacts": 3, "is_touching": True, "progress": 88.0, "speed": 1.9}
    for name, value in changes.items():
        other = annotate(blank, replace(frame, **{name: value}))
        assert (other[bar:] != plain[bar:]).any(), name
        np.testing.assert_array_equal(other[:bar], blank[:bar])


def test_a_contact_shows_in_red() -> None:
    blank, frame = np.zeros((480, 640, 3), np.uint8), frames(1)[0]
    calm, touching = annotate(blank, frame).astype(int), annotate(blank, replace(frame, is_touching=True)).astype(int)
    is_red = [(picture[..., 0] > picture[..., 2] + 80).sum() for picture in (calm, touching)]
    assert is_red[0] == 0 and is_red[1] > 50
