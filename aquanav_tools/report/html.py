"""One-page HTML reports: a single file with its pictures inside, readable offline and printable."""

from __future__ import annotations

import base64
import html
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z.-]*[a-z]")
TEMPLATE, VIEWER = (Path(__file__).with_name(name) for name in ("page.html", "viewer.js"))
MEDIA_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".jpg": "image/jpeg", ".webm": "video/webm"}
MAX_FILMS = 3_000_000
"""Bytes of films that a page carries; those for which there is no room are shown from the files beside it."""


@dataclass(frozen=True)
class Fact:
    """One number that matters, shown large."""

    label: str
    """What it is."""
    value: str
    """The number with its unit."""
    note: str = ""
    """Small print below: an interval, a count."""


@dataclass(frozen=True)
class Notice:
    """Something the reader should know: a result that is poor but usable."""

    code: str
    """Short stable name to look up, such as few-starts."""
    text: str
    """What happened, why, and what to do."""


@dataclass(frozen=True)
class Figure:
    """A PNG, SVG or JPEG with its caption."""

    path: Path
    caption: str
    columns: int = 3
    """How many of the page's three columns it takes."""

    def __post_init__(self) -> None:
        if self.columns not in (1, 2, 3) or self.path.suffix not in MEDIA_TYPES:
            raise ValueError(
                f"A figure is a PNG, SVG or JPEG in 1 to 3 columns, not {self.path.name} in {self.columns}."
            )


@dataclass(frozen=True)
class Model:
    """A GLB that the reader can turn."""

    path: Path
    caption: str

    def __post_init__(self) -> None:
        if self.path.suffix != ".glb":
            raise ValueError(f"A model is a GLB, not {self.path.name}.")


@dataclass(frozen=True)
class Film:
    """A WebM with its caption."""

    path: Path
    """In the page's folder."""
    caption: str

    def __post_init__(self) -> None:
        if self.path.suffix != ".webm":
            raise ValueError(f"A film that browsers play is a WebM, not {self.path.name}.")


class Link(str):
    """A text that leads somewhere, for a table."""

    href: str

    def __new__(cls, text: str, href: str) -> Link:
        """Make a text that leads to `href`."""
        link = super().__new__(cls, text)
        link.href = href
        return link


@dataclass(frozen=True)
class Table:
    """Rows of texts or links below a heading."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"Table '{self.title}' has {len(self.columns)} columns but a row of {len(row)}: {row}."
                )


@dataclass(frozen=True)
class Section:
    """A further part of a report under a heading of its own."""

    title: str
    text: str = ""
    """What to make of it, in a sentence or two."""
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    models: tuple[Model, ...] = ()
    films: tuple[Film, ...] = ()


@dataclass(frozen=True)
class Page:
    """A report, from the headline down to the small print."""

    title: str
    summary: str
    """One sentence that says how it went."""
    facts: tuple[Fact, ...] = ()
    warnings: tuple[Notice, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    models: tuple[Model, ...] = ()
    films: tuple[Film, ...] = ()
    sections: tuple[Section, ...] = ()
    """Parts after the first; a page with some has links to them at its top."""
    footer: str = ""
    """What made the report, and from what."""


def write_page(page: Page, path: Path) -> None:
    """Write a report as one HTML file that loads nothing from elsewhere. Texts are escaped; pictures are embedded.

    So are models, with a viewer, and films as far as MAX_FILMS allows: others are shown from the files beside it.
    """
    import jinja2

    template = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined).from_string(
        TEMPLATE.read_text(encoding="utf-8")
    )
    partial = path.with_name(path.name + ".partial")
    parts: tuple[Page | Section, ...] = (page, *page.sections)
    viewer = VIEWER.read_text(encoding="utf-8") if any(part.models for part in parts) else ""
    source = _film_sources([film for part in parts for film in part.films]).__getitem__
    text = template.render(page=page, embed=_embed, typeset=_typeset, viewer=viewer, base64=_base64, source=source)
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)


def _typeset(text: str) -> str:
    """Return a text as escaped HTML in which no line ends inside an option or before a per cent sign."""
    return OPTION.sub(r"<code>\g<0></code>", html.escape(text).replace(" %", "\u00a0%"))


def _embed(picture: Path) -> str:
    return f"data:{MEDIA_TYPES[picture.suffix]};base64,{_base64(picture)}"


def _base64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")


def _film_sources(films: Sequence[Film]) -> dict[Path, str]:
    """Return where the page finds each film: in itself, in their order, as long as there is room."""
    sources, room = {}, MAX_FILMS
    for film in films:
        size = film.path.stat().st_size
        is_inside = size <= room
        room -= size if is_inside else 0
        sources[film.path] = _embed(film.path) if is_inside else film.path.name
    return sources
