"""What files say, as text of pages: the schema of results, shipped files as they are, the example programs."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = ROOT / "aquanav_tools/evaluate/results.schema.json"
SHIPPED = (
    ("Vehicles", "aquanav_tools/sim/vehicles", "*.toml"),
    ("Boats", "aquanav_tools/sim/boats", "*.toml"),
    ("Ranges of dynamics", "aquanav_tools/sim/randomisations", "*.toml"),
    ("Data sheets of sensors", "aquanav_tools/sim/batch/sensors/sheets", "*.toml"),
    ("Recipes of builds", "pipelines/build", "*.toml"),
    ("Pipelines of training", "pipelines/train", "*.toml"),
    ("Protocols of evaluation", "eval/protocols", "*.toml"),
    ("Caves", "scenarios", "*.toml"),
    ("Bays", "scenarios/bays", "*.toml"),
)
"""Titles of sections with the files that are in them. The benchmarks' sets are lists of caves, too long to read."""


def shipped() -> str:
    """Return every file that ships and is there to be read, copied and changed, folded up."""
    return "\n".join(_shipped())


def _shipped() -> Iterator[str]:
    for title, folder, pattern in SHIPPED:
        yield f"## {title}\n"
        for path in sorted((ROOT / folder).glob(pattern)):
            yield _folded(path.stem, path, "toml")


def programs() -> str:
    """Return each example program whole, under its own heading."""
    paths = sorted((ROOT / "examples").glob("*.py"))
    return "\n".join(f"## {path.name}\n\n{_block(path, 'python')}\n" for path in paths)


def notebooks() -> str:
    """Return each notebook under a heading, its headings a level lower."""
    return "\n".join(
        part for path in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb")) for part in _cells(path)
    )


def _cells(path: Path) -> Iterator[str]:
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "code":
            yield f"```python\n{text}\n```\n"
        else:
            yield re.sub("^#", "##", text, flags=re.M) + "\n"


def _folded(title: str, path: Path, language: str) -> str:
    inner = "\n".join(f"    {line}" if line else "" for line in _block(path, language).splitlines())
    return f'??? note "{title}"\n\n{inner}\n'


def _block(path: Path, language: str) -> str:
    return f"```{language}\n{path.read_text(encoding='utf-8').strip()}\n```"


def results() -> str:
    """Return the schema of results.json as a table for each of its objects."""
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    return "\n".join(_tables("results.json", schema, schema))


def _tables(title: str, schema: dict[str, Any], whole: dict[str, Any]) -> Iterator[str]:
    yield f"## {title}\n"
    if "description" in schema:
        yield schema["description"] + "\n"
    yield "| field | type | |\n|---|---|---|"
    required = schema.get("required", [])
    for name, field in schema["properties"].items():
        said = field.get("description", "") if name in required else "optional; " + field.get("description", "")
        yield f"| `{name}` | {_cell(_type(field))} | {_cell(said.removesuffix('; '))} |"
    yield ""
    for name, field in schema["properties"].items():
        inner = _object(field)
        if inner:
            yield from _tables(f"{title}: {name}" if title != "results.json" else name, inner, whole)
    for name, inner in schema.get("$defs", {}).items():
        yield from _tables(name, inner, whole)


def _object(field: dict[str, Any]) -> dict[str, Any] | None:
    """Return the object that a field is, or is a list of, where that is described in place."""
    return field if "properties" in field else _object(field["items"]) if isinstance(field.get("items"), dict) else None


def _type(field: dict[str, Any]) -> str:
    if "$ref" in field:
        name = field["$ref"].split("/")[-1]
        return f"[{name}](#{name})"
    if "enum" in field:
        return ", ".join(f"`{json.dumps(value)}`" for value in field["enum"])
    if "anyOf" in field:
        return " or ".join(_type(one) for one in field["anyOf"])
    kind = field.get("type", "any")
    words = kind if isinstance(kind, str) else " or ".join(kind)
    return f"{words} of {_type(field['items'])}" if "items" in field else words


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
