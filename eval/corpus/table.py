"""The corpus' tables, as markdown and JSON."""

from __future__ import annotations

import json
import platform
from pathlib import Path
from typing import Any

COLUMNS = (
    "case", "outcome", "volume (m³)", "off by", "portals", "genus", "covered", "fit 50 / 95 % (mm)", "voxel (mm)",
    "method", "s", "GB", "verdict",
)  # fmt: skip


def print_tables(results: list[dict[str, Any]]) -> None:
    """Print both tables and the totals."""
    print("\n" + markdown(results))


def write_tables(results: list[dict[str, Any]], stem: Path) -> None:
    """Keep the page and its numbers beside each other, as `stem`.md and .json."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    stem.with_suffix(".md").write_text(markdown(results), encoding="utf-8")
    kept = [{key: value for key, value in result.items() if key != "path"} for result in results]
    stem.with_suffix(".json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def markdown(results: list[dict[str, Any]]) -> str:
    """Return everything as one markdown page."""
    caves = [result for result in results if result["group"] != "bad input"]
    bad = [result for result in results if result["group"] == "bad input"]
    lines = ["# Corpus of scans", "", *_totals(caves), ""]
    lines += _table(COLUMNS, [_cave_row(result) for result in caves])
    stopped = [result for result in caves if result["outcome"] == "error"]
    if stopped:
        lines += ["", "## What the builds that stopped said", ""]
        lines += [f"- {result['name']} ({result['exit_code']}): {_cell(result['sentence'])}" for result in stopped]
    if bad:
        rows = [_bad_row(result) for result in bad]
        lines += ["", "## Bad inputs", "", *_table(("input", "outcome", "s", "GB", "verdict", "sentence"), rows)]
    return "\n".join(lines) + "\n"


def _totals(caves: list[dict[str, Any]]) -> list[str]:
    """Return the headline figures."""
    to_prove = [case for case in caves if not case["error"]]
    proven = [case for case in to_prove if case["outcome"] == "proven"]
    compared = [case for case in proven if "volume_error" in case]
    near = [case for case in compared if abs(case["volume_error"]) <= case["max_volume_error"]]
    sealed = [case for case in compared if case["path_points_in_rock"] or case["path_segments_blocked"]]
    invented = [
        case for case in proven if case["expected_genus"] is not None and case["genus"] > case["expected_genus"]
    ]
    clear = [case for case in caves if case["outcome"] in ("proven", "error")]
    fitted = [case for case in proven if case["has_fit"]]
    fitting = [
        case for case in fitted if case["fit_median"] <= 0.25 * case["voxel"] and case["fit_95"] <= case["voxel"]
    ]
    portals = [case for case in proven if case["portals"] == case["expected_portals"]]
    sound = [case for case in proven if case["is_volume"] and not case["crossings"]]
    return [
        f"{platform.machine()}, Python {platform.python_version()}. Each row is one run of aquanav-build-cave.",
        "",
        f"- Ended proven or in a clear error: {_share(clear, caves)} (must be all)",
        f"- Proven, of those that are caves in a known unit: {_share(proven, to_prove)} (at least 95 %)",
        f"- Closed in one piece, with no two faces that cross: {_share(sound, proven)}",
        f"- Volume within 3 % of the truth where it is known: {_share(near, compared)}",
        f"- Passages sealed: {len(sealed)}; with tunnels invented: {len(invented)} (both must be 0)",
        f"- Open ends as in the truth: {_share(portals, proven)}",
        f"- Fit within a quarter voxel in the median and one voxel at 95 %: {_share(fitting, fitted)}",
        f"- Without any fault: {_share([case for case in caves if case['ok']], caves)}",
    ]


def _share(part: list[Any], whole: list[Any]) -> str:
    return f"{len(part)} of {len(whole)} ({len(part) / max(len(whole), 1):.1%})"


def _cave_row(case: dict[str, Any]) -> tuple[str, ...]:
    head, tail = (case["name"], case["outcome"]), (f"{case['seconds']:.0f}", f"{case['peak_gb']:.2f}", _verdict(case))
    if case["outcome"] != "proven" or "volume" not in case:
        return (*head, *[""] * 8, *tail)
    error, covered = case.get("volume_error"), case.get("covered")
    genus = "?" if case["expected_genus"] is None else case["expected_genus"]
    return (
        *head,
        f"{case['volume']:.2f}",
        "" if error is None else f"{error:+.1%}",
        f"{case['portals']} of {case['expected_portals']}",
        f"{case['genus']} of {genus}",
        "" if covered is None else f"{covered:.0%}",
        f"{1000 * case['fit_median']:.1f} / {1000 * case['fit_95']:.1f}",
        f"{1000 * case['voxel']:.0f}",
        case["method"],
        *tail,
    )


def _bad_row(case: dict[str, Any]) -> tuple[str, ...]:
    outcome = f"{case['outcome']} ({case['exit_code']})"
    verdict = "ok" if case["ok"] else "**wrong**"
    return (case["name"], outcome, f"{case['seconds']:.0f}", f"{case['peak_gb']:.2f}", verdict, _cell(case["sentence"]))


def _verdict(case: dict[str, Any]) -> str:
    return "ok" if case["ok"] else "**" + _cell("; ".join(case["faults"])) + "**"


def _cell(text: str) -> str:
    return text.replace("|", "/")


def _table(columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return lines + ["| " + " | ".join(row) + " |" for row in rows]
