"""The table of the photo benchmark, as markdown and JSON."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

CAMERAS = (
    "set", "photos", "registered", "centres off, mean / max (mm)", "rotations off (deg)",
    "COLMAP registered", "centres off, mean / max (mm)", "CPU time, ours (s)", "COLMAP (s)",
)  # fmt: skip
MODELS = (
    "set", "cloud F at 5 / 10 cm", "surface F at 5 / 10 cm", "between the portals", "invented wall", "volume off by",
    "of the whole cave", "portals", "genus (truth)", "cameras outside", "GB", "outcome",
)  # fmt: skip
CLOUDS = (
    "set", "cloud within 2 cm: precision, recall, F", "5 cm", "10 cm", "scale", "volume (m3)", "extent (m)",
    "invented wall", "seen wall off, median / 95 % (cm)", "of seen free space in it", "of it seen free",
    "gap of a loop", "outcome", "commit",
)  # fmt: skip
STAGES = {
    "features": ("Finding features",),
    "matching": ("Matching photos",),
    "cameras": ("Placing cameras",),
    "depth": ("Measuring depth",),
    "fusion": ("Fusing depth maps",),
    "closing": ("Preparing the surface", "Closing the cavity"),
}
"""Columns of the table of times, by the titles of a build's stages; the rest are added up."""


def print_table(results: list[dict[str, Any]]) -> None:
    """Print all three tables."""
    print("\n" + markdown(results))


def write_table(results: list[dict[str, Any]], folder: Path, order: Sequence[str]) -> None:
    """Keep photos.md and photos.json; rows of other sets, from earlier runs, stay.

    Args:
        results: figures of the sets that were run.
        folder: with both files.
        order: names of all sets. Rows of others are dropped.
    """
    earlier = json.loads((folder / "photos.json").read_text(encoding="utf-8"))
    rows = {row["name"]: row for row in (*earlier, *results)}
    kept = [rows[name] for name in order if name in rows]
    (folder / "photos.md").write_text(markdown(kept), encoding="utf-8")
    (folder / "photos.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def markdown(results: list[dict[str, Any]]) -> str:
    """Return everything as one markdown page."""
    lines = [
        "# Photos",
        "",
        f"{platform.machine()}, Python {platform.python_version()}. Each row is one run of aquanav-build-cave, at the "
        "commit that the third table names (of rows older than that column, the one that recorded them); "
        "centres and rotations after the similarity transform that fits the true centres best. COLMAP is its own "
        "command line: features, exhaustive matching, incremental mapping.",
        "",
        "## Cameras",
        "",
        *_table(CAMERAS, [_camera_row(result) for result in results]),
        "",
        "## Models",
        "",
        "Of the wall that two photos or more show, in the whole cave and between the portals that were found. Volume "
        "between the portals, and of the whole cave.",
        "",
        *_table(MODELS, [_model_row(result) for result in results if "volume_error" in result]),
        "",
        "## Clouds and cavities, rendered and real",
        "",
        "Rendered against the true wall that two photos or more show; real ones against a depth camera's maps where "
        "there are some, and blank where nothing is known. Scale: true lengths over the build's. Where a walk "
        "ends at its beginning, the gap is the least distance from its first tenth to its last, as share of the way.",
        "",
        *_table(CLOUDS, [_cloud_row(result) for result in results]),
        "",
        "## Seconds per stage, on the clock / of CPU",
        "",
        "On the clock only where the machine had nothing else to do; compare CPU times.",
        "",
        *_table(("set", *STAGES, "all other", "whole"), [_time_row(result) for result in results]),
    ]
    stopped = [result for result in results if result["outcome"] != "proven"]
    if stopped:
        lines += ["", "## What the builds that stopped said", ""]
        lines += [f"- {result['name']}: {result['sentence']}" for result in stopped]
    return "\n".join(lines) + "\n"


def _camera_row(result: dict[str, Any]) -> tuple[str, ...]:
    peer = result.get("peer", {})
    ours = sum(_times(result, title)[1] for name in ("features", "matching", "cameras") for title in STAGES[name])
    return (
        result["name"],
        str(result["photos"]),
        str(result.get("registered", 0)),
        _errors(result),
        f"{result['rotation_deg']:.2f}" if "rotation_deg" in result else "",
        str(peer.get("registered", "")),
        _errors(peer),
        f"{ours:.0f}",
        f"{peer['cpu_seconds']:.0f}" if peer else "",
    )


def _errors(result: dict[str, Any]) -> str:
    """Return both errors of the centres in mm, or in % of their extent where the reference has no unit."""
    if "centre_mean" not in result:
        return ""
    if result.get("is_metric", True):
        return f"{1000 * result['centre_mean']:.1f} / {1000 * result['centre_max']:.1f}"
    share = 100.0 / result["extent"]
    return f"{share * result['centre_mean']:.2f} / {share * result['centre_max']:.2f} % of the extent"


def _model_row(result: dict[str, Any]) -> tuple[str, ...]:
    cells = [result["name"], _f_scores(result.get("cloud")), _f_scores(result.get("surface"))]
    return (
        *cells,
        _f_scores(result.get("surface_between")),
        f"{result['invented_share']:.0%}",
        f"{result['volume_error']:+.1%}",
        f"{result['whole_volume_error']:+.1%}",
        str(result["portals"]),
        f"{result['genus']} ({result['true_genus']})",
        str(result["cameras_outside"]),
        f"{result['peak_gb']:.2f}",
        result["outcome"],
    )


def _cloud_row(result: dict[str, Any]) -> tuple[str, ...]:
    def share(name: str) -> str:
        return f"{result[name]:.1%}" if name in result else ""

    scores = result.get("cloud", {})
    return (
        result["name"],
        *(_triple(scores, cm) for cm in (2, 5, 10)),
        f"{result['scale']:.3f}" if "scale" in result else "",
        f"{result['volume']:.1f}" if "volume" in result else "",
        " x ".join(f"{size:.1f}" for size in result.get("extent_m", ())),
        share("invented_share"),
        f"{100 * result['wall_median']:.1f} / {100 * result['wall_95']:.1f}" if "wall_median" in result else "",
        share("free_held"),
        share("held_free"),
        share("loop_gap"),
        result["outcome"],
        result.get("commit", ""),
    )


def _triple(scores: dict[str, float], cm: int) -> str:
    names = [f"{figure}_{cm}" for figure in ("precision", "recall", "f")]
    return ", ".join(f"{scores[name]:.2f}" for name in names) if all(name in scores for name in names) else ""


def _f_scores(score: dict[str, float] | None) -> str:
    return "" if score is None else f"{score['f_5']:.3f} / {score['f_10']:.3f}"


def _time_row(result: dict[str, Any]) -> tuple[str, ...]:
    named = [_times(result, *titles) for titles in STAGES.values()]
    whole = (result["seconds"], result["cpu_seconds"])
    rest = tuple(all_in_all - sum(part) for all_in_all, part in zip(whole, zip(*named, strict=True), strict=True))
    return (result["name"], *(f"{wall:.0f} / {cpu:.0f}" for wall, cpu in (*named, rest, whole)))


def _times(result: dict[str, Any], *titles: str) -> tuple[float, float]:
    """Return wall and CPU time of stages, s; 0 where a build did not come so far."""
    stages = [result["stages"][title] for title in titles if title in result["stages"]]
    return sum(stage["seconds"] for stage in stages), sum(stage["cpu_seconds"] for stage in stages)


def _table(columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return lines + ["| " + " | ".join(row) + " |" for row in rows]
