"""Scoring policies, comparing scores, flying an episode again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from aquanav_tools.api.bars import bar
from aquanav_tools.api.policies import PolicySpec, load_policy
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate import comparing, evaluation, replaying
from aquanav_tools.evaluate.comparing import Compared
from aquanav_tools.evaluate.evaluation import Evaluation
from aquanav_tools.evaluate.options import EvaluateOptions, ReplayOptions, View
from aquanav_tools.evaluate.policies import observing
from aquanav_tools.evaluate.protocol import read_protocol
from aquanav_tools.evaluate.replaying import Replayed
from aquanav_tools.tables import from_table

Folders = str | Path | Sequence[str | Path]


def evaluate(
    policy: PolicySpec,
    scenario: Folders,
    *,
    output: str | Path = "out/eval",
    protocol: str | Path | None = None,
    trust: bool = False,
    progress: bool = False,
    **options: Any,
) -> Evaluation:
    """Score a policy on fixed seeded starts; write results, report and recordings.

    Args:
        policy: As `load_policy` takes it. One that is not a name or a path flies in this process.
        scenario: Scenario folder or shipped name, or several.
        output: Folder for results.json, episodes.parquet, report.html and recordings; an earlier evaluation in it is
            replaced.
        protocol: Rules from a shipped protocol ("paper", "safety", "robustness", "quick") or a TOML file; `options` win
            over it.
        trust: Whether policy files may run code.
        progress: Whether to show a bar with the time left, where stderr is a terminal.
        options: Every other option of aquanav-eval by its name: episodes=50, seed=0, current="full", record="none",
            workers=1, backend="batch" and others. With workers other than 1, a script needs
            `if __name__ == "__main__"`, as processes import it again.

    Returns:
        `summary` with rates and means and their 95 % intervals, `episodes` with the metrics of each (m, s, J), and
        the paths of the files.

    Raises:
        InputError: the policy cannot be used, or an option is unknown (with the nearest name) or senseless.
        ScenarioError: a scenario cannot be read.
        ResourceError: processes do not start.
    """
    loaded = None if isinstance(policy, str | Path) else load_policy(policy, trust=trust)
    if loaded is not None:
        options = _in_this_process(options)
        loaded = observing(loaded, options.get("observation"), options.get("sensors", ()))
    table = {
        **options,
        "policies": (str(policy) if loaded is None else loaded.name,),
        "scenario": [Path(one) for one in _listed(scenario)],
        "output": Path(output),
        "trust": trust,
    }
    chosen = from_table(EvaluateOptions, table, "evaluate")
    if protocol is not None:
        rules = {name: value for name, value in read_protocol(str(protocol), trust).items() if name not in options}
        chosen = replace(chosen, **rules, protocol=str(protocol))
    with bar("", "episode", shown=progress) as show:
        return evaluation.evaluate(chosen, show, load=None if loaded is None else lambda _: loaded)


def compare(evaluations: Folders, *others: str | Path, output: str | Path = "out/compare") -> Compared:
    """Compare evaluations: the first with each other one, on the same episodes, with intervals and tests.

    Args:
        evaluations: Output folder of `evaluate`, or several; a folder of several counts as training runs of one method.
        others: Further folders.
        output: Folder for comparison.json and report.html.

    Returns:
        `methods` with the scores of each, and `comparisons`: differences of rates (0 to 1) and means with their 95 %
        intervals, and p values.

    Raises:
        InputError: a folder holds no finished evaluation, or they have no scenario and condition in common.
    """
    return comparing.compare([Path(one) for one in (*_listed(evaluations), *others)], Path(output))


def replay(
    results: str | Path,
    episode: int,
    *,
    output: str | Path | None = None,
    policy: PolicySpec | None = None,
    scenario: str | Path | None = None,
    vehicle: str | None = None,
    film: str | Path | None = None,
    bag: str | Path | None = None,
    track: str | Path | None = None,
    view: View = "chase",
    trust: bool = False,
    progress: bool = False,
) -> Replayed:
    """Fly an episode of an evaluation again, check that it repeats to the bit, and record it.

    Args:
        results: Output folder of `evaluate`, or its results.json.
        episode: Number of the episode, from 0.
        output: The recording for rerun; None writes it beside the results.
        policy: The policy, where it is no longer at its path or never was a file; as `load_policy` takes it.
        scenario: The scenario's folder, where it is no longer at its path.
        vehicle: The vehicle's file, likewise.
        film: Also write this film: .mp4, .webm, .gif or .webp.
        bag: Also write this folder, a bag of ROS 2; needs pip install 'aquanav[ros]'.
        track: Also write this table with a row per state: .csv or .parquet.
        view: Of the film: "chase" or "onboard".
        trust: Whether the policy's file may run code.
        progress: Whether to show a bar over the film's frames, where stderr is a terminal.

    Returns:
        The episode's metrics (m, s, J), and where the recording, the film, the bag and the track lie.

    Raises:
        InputError: no such results or episode, or the policy, scenario or vehicle is missing or another one.
        ReplayError: the episode came out differently; its recording is written all the same.
    """
    options = ReplayOptions(
        Path(results), episode, None if output is None else Path(output), None, trust,
        None if scenario is None else Path(scenario), vehicle, None if film is None else Path(film),
        None if bag is None else Path(bag), None if track is None else Path(track), view,
    )  # fmt: skip
    loaded = None if policy is None else load_policy(policy, trust=trust)
    with bar("", "frame", shown=progress and film is not None) as show:
        return replaying.replay(options, show, None if loaded is None else lambda _: loaded)


def _in_this_process(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options with which a policy in memory is flown; it does not travel to other processes."""
    if options.get("workers", 1) != 1 or options.get("ray") is not None:
        raise InputError(
            "A policy in memory flies in this process. Leave out workers and ray, or name the policy by its path or as "
            "module:Name."
        )
    return options if options.get("backend") == "batch" else {**options, "workers": 1}


def _listed(folders: Folders) -> Sequence[str | Path]:
    return [folders] if isinstance(folders, str | Path) else folders
