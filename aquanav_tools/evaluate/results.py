"""results.json and episodes.parquet: what an evaluation found, in forms that other programs can rely on.

Both follow from the policy, the scenarios and the options alone: repeated on the same machine, they are the same to the
byte. results.schema.json describes the first; the second has a row per episode with the same columns, and is left out
where PyArrow is not installed.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import platform
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aquanav_tools import __version__
from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.episode_table import DYNAMICS
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.own_files import OwnFiles
from aquanav_tools.evaluate.summary import Group, Summary
from aquanav_tools.libraries import installed_version, lack_of
from aquanav_tools.text_files import read_json

FORMAT = 5
"""4 had neither what episodes drew of their vehicles' dynamics nor hashes of the user's own code; it is still read."""
SCHEMA = Path(__file__).with_name("results.schema.json")
ROWS_AT_A_TIME = 1000
"""Of the Parquet file; memory need not hold them all."""
DIGITS = 6
"""Decimals kept: micrometres and microseconds."""
logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class Provenance:
    """What was evaluated, where and how; the tables are those of results.json."""

    policy: dict[str, Any]
    """Its name, SHA-256 (None for a baseline), path, and whether its file was let run code."""
    scenarios: list[dict[str, Any]]
    """What `scenario_row` returns of each."""
    protocol: dict[str, Any]
    """Resolved options that change the numbers."""
    own_files: OwnFiles
    """Code and ranges of the user's own that protocol and policy name, with the SHA-256 of their modules and files."""
    possible_episodes: int | None
    """That differ, in these scenarios under these conditions; None for no end of them."""

    def identity(self, versions: dict[str, str]) -> dict[str, Any]:
        """Return what must be the same for two runs to give the same episodes."""
        kept = ("name", "content_hash", "vehicle")
        hashes = [{key: scenario[key] for key in kept if key in scenario} for scenario in self.scenarios]
        policy = {key: self.policy[key] for key in ("name", "sha256")}
        files = {"own_files": self.own_files}
        return {"format": FORMAT, "policy": policy, "scenarios": hashes, **self.protocol, **files, "versions": versions}


def scenario_row(scenario: AnyScenario, path: str) -> dict[str, Any]:
    """Return what results say of a scenario, with the vehicle that dived where that was not its own."""
    row: dict[str, Any] = {"name": scenario.name, "content_hash": scenario.content_hash, "path": path}
    if scenario.other_vehicle is not None:
        row["vehicle"] = dataclasses.asdict(scenario.other_vehicle)
    return row


def vehicle_text(vehicle: dict[str, Any]) -> str:
    """Return what a report says of the vehicle in a `scenario_row`."""
    numbers = ", ".join(map(str, vehicle["left_out"]))
    left_out = f"; it does not fit at the starts {numbers} of the scenario's files" if numbers else ""
    return f"{vehicle['name']}, not the scenario's own{left_out}"


def results_table(provenance: Provenance, summary: Summary, groups: Sequence[Group]) -> dict[str, Any]:
    """Return the table that results.json holds, without its episodes."""
    table = {
        "format": FORMAT,
        **dataclasses.asdict(provenance),
        "versions": versions(),
        "summary": summary.as_table(),
        "groups": [{"by": group.by, "name": group.name, "summary": group.summary.as_table()} for group in groups],
    }
    rounded: dict[str, Any] = _rounded(table)
    return rounded


def check_results(table: dict[str, Any]) -> None:
    """Raise jsonschema.ValidationError when a table does not follow the shipped schema."""
    _validator().validate(table)


def write_results(table: dict[str, Any], episodes: Sequence[EpisodeMetrics], path: Path) -> None:
    """Check a table and its episodes and write them as results.json, whole or not at all, an episode at a time."""
    check_results({**table, "episodes": [episode_row(episodes[0])]})
    row_validator = _validator("episode")
    partial = path.with_name(path.name + ".partial")
    with partial.open("w", encoding="utf-8") as stream:
        stream.write(json.dumps(table, indent=2, allow_nan=False).removesuffix("\n}") + ',\n  "episodes": [')
        for number, episode in enumerate(episodes):
            row = episode_row(episode)
            row_validator.validate(row)
            text = json.dumps(row, indent=2, allow_nan=False)
            stream.write(("," if number else "") + "\n" + textwrap.indent(text, "    "))
        stream.write("\n  ]\n}\n")
    os.replace(partial, path)


def read_results(path: Path) -> dict[str, Any]:
    """Return the table in a results.json.

    Raises:
        InputError: no such file, or it does not follow this version's schema.
    """
    import jsonschema  # type: ignore[import-untyped]

    if not path.is_file():
        raise InputError(f"There is no file {path}. Name the results.json, or the folder, of a finished evaluation.")
    table: dict[str, Any] = read_json(path)
    try:
        check_results(table)
    except jsonschema.ValidationError as cause:
        place = "/".join(map(str, cause.absolute_path)) or "the top"
        raise InputError(
            f"{path} is no result of format {FORMAT}: at {place}, {cause.message[:200]}. Another version of aquanav "
            "wrote it. Run the evaluation again."
        ) from cause
    return table


def episodes_of(table: dict[str, Any]) -> list[EpisodeMetrics]:
    """Return the episodes in the table of a results.json."""
    return [EpisodeMetrics(**episode) for episode in table["episodes"]]


def read_episode_rows(rows: Any, where: str) -> list[EpisodeMetrics]:
    """Return the episodes in rows as results.json has them.

    Raises:
        InputError: they do not follow this version's schema; `where` is what the message calls their file.
    """
    import jsonschema

    validator = _validator("episode")
    try:
        jsonschema.validate(rows, {"type": "array"})
        for row in rows:
            validator.validate(row)
    except jsonschema.ValidationError as cause:
        raise InputError(f"{where} has an episode that is none: {cause.message[:200]}.") from cause
    return [EpisodeMetrics(**row) for row in rows]


def write_episodes(episodes: Sequence[EpisodeMetrics], path: Path) -> None:
    """Write a row per episode as Parquet, whole or not at all; say so where the library for it is not installed."""
    if lack := lack_of("A table of episodes as Parquet", "pyarrow"):
        logger.warning("%s is left out; results.json has the same episodes. %s", path.name, lack)
        return
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {"int": pa.int64(), "str": pa.string(), "float": pa.float64(), "float | None": pa.float64()}
    types["int | None"] = pa.int64()
    drawn = sorted({name for episode in episodes for name in episode.dynamics})
    columns = [field for field in dataclasses.fields(EpisodeMetrics) if field.name != "dynamics"]
    schema = pa.schema(
        [(field.name, types[str(field.type)]) for field in columns]
        + [(DYNAMICS + name, types["float"]) for name in drawn]
    )
    partial = path.with_name(path.name + ".partial")
    with pq.ParquetWriter(partial, schema) as writer:
        for first in range(0, len(episodes), ROWS_AT_A_TIME):
            rows = [_flat(episode_row(episode)) for episode in episodes[first : first + ROWS_AT_A_TIME]]
            writer.write_table(pa.Table.from_pylist(rows, schema=schema))
    os.replace(partial, path)


def versions() -> dict[str, str]:
    """Return the versions of what the numbers depend on."""
    packages = ("numpy", "gymnasium", "pybullet", "torch", "stable-baselines3")
    found = {name: installed_version(name) for name in packages}
    return {"aquanav": __version__, "python": platform.python_version(), **found}


def _validator(part: str = "") -> Any:
    """Return what holds a table, or the part of one that the schema defines, to the shipped schema."""
    import jsonschema

    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    whole = jsonschema.Draft202012Validator(schema)
    return whole.evolve(schema=schema["$defs"][part]) if part else whole


def episode_row(episode: EpisodeMetrics) -> dict[str, Any]:
    """Return an episode as results.json has it."""
    row: dict[str, Any] = _rounded(dataclasses.asdict(episode))
    if not row["dynamics"]:
        del row["dynamics"]
    return row


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with a column for each of the drawn dynamics."""
    return row | {DYNAMICS + name: value for name, value in row.pop("dynamics", {}).items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return value
