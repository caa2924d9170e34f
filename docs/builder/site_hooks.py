"""Pages of the site that are not in docs/: brought in from the repository, or made from commands, schemas and files.

mkdocs loads this by its name in mkdocs.yml. A link to a file that has no page is an error, so that no page sends its
reader to the sources.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

import site_commands
import site_files
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
BROUGHT_IN = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CODE_OF_CONDUCT.md": "code_of_conduct.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "examples/README.md": "examples.md",
    "eval/policies/README.md": "policies/index.md",
    "LICENSE": "LICENSE.txt",
    "CITATION.cff": "CITATION.txt",
}
"""Files of the repository that are in the site, by their names there."""
FOLDERS = {"eval/results": "results", "eval/policies": "policies", "docs": "."}
"""Folders whose pages and pictures are."""
SUFFIXES = (".md", ".png", ".webp", ".jsonl")
LINK = re.compile(r"(\]\()([^)#:\s]+)(#[^)\s]*)?(\))")
FENCE = re.compile(r"^(```.*?^```)", re.M | re.S)
MARK = re.compile(r"^<!-- insert: ([a-z-]+) -->$", re.M)
MADE = {
    "commands": site_commands.commands,
    "results": site_files.results,
    "shipped": site_files.shipped,
    "notebooks": site_files.notebooks,
    "programs": site_files.programs,
}
"""What takes the place of a mark in a page."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are not in docs/."""
    for path, name in sources().items():
        if files.get_file_from_path(name) is None:
            files.append(File.generated(config, name, abs_src_path=str(ROOT / path)))
    return files


def sources() -> dict[str, str]:
    """Return the name in the site of every file of the repository that it takes as it is, by its path."""
    found = dict(BROUGHT_IN)
    for folder, place in FOLDERS.items():
        for path in sorted((ROOT / folder).rglob("*")):
            key = path.relative_to(ROOT).as_posix()
            if path.suffix in SUFFIXES and key not in found:
                found[key] = posixpath.normpath(posixpath.join(place, path.relative_to(ROOT / folder).as_posix()))
    return found


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Put in what is made, and lead links between files of the repository to the pages that these are in."""
    return MARK.sub(lambda match: MADE[match[1]](), relinked(markdown, page.file.src_uri))


def relinked(markdown: str, name: str) -> str:
    """Return a page's text with its links as the site has them.

    Args:
        markdown: the text as it stands in the repository.
        name: of the page in the site.

    Raises:
        PluginError: a link leads to a file that is not in the site.
    """
    places = sources()
    paths = {place: path for path, place in places.items()}
    folder = posixpath.dirname(paths[name])

    def lead(match: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(folder, match[2]))
        target, anchor = places.get(path), match[3] or ""
        if path.startswith("examples/") and path.endswith(".py"):
            target, anchor = places["examples/README.md"], "#" + posixpath.basename(path).replace(".", "")
        if target is None:
            raise PluginError(f"{paths[name]} links to {path}, which has no page in the site.")
        return f"{match[1]}{posixpath.relpath(target, posixpath.dirname(name) or '.')}{anchor}{match[4]}"

    parts = FENCE.split(markdown)
    return "".join(part if part.startswith("```") else LINK.sub(lead, part) for part in parts)
