from __future__ import annotations

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image

from aquanav_tools.report import html
from aquanav_tools.report.html import Fact, Figure, Film, Model, Notice, Page, Table, write_page


@pytest.fixture
def page(tmp_path: Path) -> Page:
    Image.new("RGB", (4, 3), (1, 2, 3)).save(tmp_path / "a.png")
    return Page(
        title="Cave <b>&",
        summary="It went well.",
        facts=(Fact("length", "27 m", "along the route"),),
        warnings=(Notice("few-starts", "Only 3 starts."),),
        figures=(Figure(tmp_path / "a.png", "A picture."),),
        tables=(Table("Rows", ("a", "b"), (("1", "2"), ("3", "4"))),),
        footer="made here",
    )


def test_page_says_everything_it_was_given(page: Page, tmp_path: Path) -> None:
    write_page(page, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    for part in ("It went well.", "27 m", "along the route", "few-starts", "Only 3 starts.", "A picture.", "made here"):
        assert part in text
    assert text.count("<td") == 4


def test_texts_are_escaped(page: Page, tmp_path: Path) -> None:
    write_page(page, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "Cave &lt;b&gt;&amp;" in text
    assert "<b>" not in text


def test_picture_is_inside_and_nothing_is_loaded_from_elsewhere(page: Page, tmp_path: Path) -> None:
    write_page(page, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    (embedded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    assert base64.b64decode(embedded) == (tmp_path / "a.png").read_bytes()
    assert "http" not in text
    assert "<script" not in text


def test_every_tag_is_closed(page: Page, tmp_path: Path) -> None:
    class Balance(HTMLParser):
        open_tags: list[str] = []  # noqa: RUF012

        def handle_starttag(self, tag: str, attrs: object) -> None:
            if tag not in ("meta", "img"):
                self.open_tags.append(tag)

        def handle_endtag(self, tag: str) -> None:
            assert self.open_tags.pop() == tag

    write_page(page, tmp_path / "report.html")
    parser = Balance()
    parser.feed((tmp_path / "report.html").read_text())
    assert not parser.open_tags


def test_table_refuses_a_row_of_another_length() -> None:
    with pytest.raises(ValueError, match="2 columns but a row of 1"):
        Table("Rows", ("a", "b"), (("1",),))


def test_a_drawing_is_embedded_as_svg(tmp_path: Path) -> None:
    (tmp_path / "plan.svg").write_text("<svg/>")
    figure = Figure(tmp_path / "plan.svg", "Plan.", columns=2)
    write_page(Page("Cave", "It went well.", figures=(figure,)), tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text()
    assert '<figure class="columns-2">' in text
    assert "data:image/svg+xml;base64," + base64.b64encode(b"<svg/>").decode() in text


@pytest.mark.parametrize(("name", "columns"), [("a.gif", 3), ("a.png", 4)])
def test_a_figure_is_a_png_or_svg_of_one_to_three_columns(name: str, columns: int) -> None:
    with pytest.raises(ValueError, match=f"not {name} in {columns}"):
        Figure(Path(name), "A picture.", columns)


def test_a_model_is_inside_with_a_viewer_that_loads_nothing(page: Page, tmp_path: Path) -> None:
    (tmp_path / "view.glb").write_bytes(bytes(range(256)))
    with_model = replace(page, models=(Model(tmp_path / "view.glb", "The cave."),))
    write_page(with_model, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    (embedded,) = re.findall(r'<script type="text/plain">([^<]+)</script>', text)
    assert base64.b64decode(embedded) == bytes(range(256))
    assert text.count("readGlb(bytes)") == 1
    assert "http" not in text and "import " not in text.split("readGlb")[1] and " src=" not in text.split("<script>")[1]


def test_films_are_inside_in_their_order_as_far_as_there_is_room(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "MAX_FILMS", 10)
    films = []
    for name, size in (("one", 6), ("two", 6), ("three", 4)):
        (tmp_path / f"{name}.webm").write_bytes(b"x" * size)
        films.append(Film(tmp_path / f"{name}.webm", f"Film {name}."))
    write_page(replace(page, films=tuple(films)), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    found = re.findall(r'<video [^>]*src="([^"]+)"', text)
    assert [source.startswith("data:video/webm;base64,") for source in found] == [True, False, True]
    assert found[1] == "two.webm"


@pytest.mark.parametrize(("kind", "name"), [(Film, "dive.mp4"), (Model, "cave.ply")])
def test_what_browsers_do_not_show_is_refused(kind: type, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        kind(Path(name), "")
