"""Evaluating a policy in a scenario: run the episodes, record them, measure, write the results and the report."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.metrics import EpisodeMetrics, Summary, measure, summarise
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, load_policy
from aquanav_tools.evaluate.protocol import plan_episodes
from aquanav_tools.evaluate.reporting import write_report
from aquanav_tools.evaluate.results import Provenance, Run, results_table, write_results
from aquanav_tools.evaluate.rollout import run_episode
from aquanav_tools.report.recording.cave import CaveModel
from aquanav_tools.report.recording.episode import record_episode
from aquanav_tools.report.track import Track
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.task import choices_of
from aquanav_tools.types import Progress

RESULTS = "results.json"
RECORDING = "episode-{seed:05d}.rrd"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What an evaluation found and where it lies."""

    summary: Summary
    episodes: tuple[EpisodeMetrics, ...]
    results: Path
    report: Path
    recordings: tuple[Path, ...]


def evaluate(options: EvaluateOptions, progress: Progress) -> Evaluation:
    """Run an evaluation and write everything about it into `options.output`.

    Raises:
        InputError: the policy cannot be used, or the output folder cannot be made.
        ScenarioError: the scenario cannot be read.
    """
    policy = load_policy(options.policy)
    scenario = read_scenario(options.scenario)
    env = CaveEnv(scenario, observation=policy.observation, action=policy.action, **choices_of(options))
    _clear_output(options.output)
    started, clock = datetime.now(timezone.utc), time.perf_counter()
    try:
        tracks, recordings = _run_all(env, policy, options, progress)
    finally:
        env.close()
    seconds = time.perf_counter() - clock

    episodes = tuple(measure(track, env.starts.way_to_goal(track.positions[0], track.start_index)) for track in tracks)
    summary = summarise(episodes)
    provenance = _provenance(policy, scenario, options)
    speed = sum(track.num_decisions for track in tracks) / seconds
    run = Run(started.isoformat(timespec="seconds"), seconds, speed)
    report = write_report(scenario, tracks, episodes, summary, provenance, options.output)
    write_results(results_table(provenance, summary, episodes, run), options.output / RESULTS)
    return Evaluation(summary, episodes, options.output / RESULTS, report, recordings)


def _clear_output(folder: Path) -> None:
    """Make the folder, and remove an earlier evaluation's results and recordings, so that two never mix."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in (folder / RESULTS, folder / "report.html", *folder.glob("episode-*.rrd")):
            path.unlink(missing_ok=True)
    except OSError as cause:
        raise InputError(f"Cannot write to the output folder {folder}: {cause}. Choose another with -o.") from cause


def _run_all(
    env: CaveEnv, policy: LoadedPolicy, options: EvaluateOptions, progress: Progress
) -> tuple[list[Track], tuple[Path, ...]]:
    """Run every episode; write its recording right after it, so that a long evaluation can be watched as it goes."""
    plans = plan_episodes(len(env.scenario.starts), options.episodes, options.seed, options.starts == "anywhere")
    cave = CaveModel(env.scenario)
    directions = original_pattern().directions
    tracks: list[Track] = []
    recordings: list[Path] = []
    progress(0, len(plans))
    for plan in plans:
        track = run_episode(env, policy.policy, plan)
        tracks.append(track)
        if len(recordings) < options.max_recordings and _is_recorded(track, options):
            recordings.append(options.output / RECORDING.format(seed=plan.seed))
            record_episode(cave, track, env.vehicle.capsule, directions, recordings[-1])
        progress(len(tracks), len(plans))
    return tracks, tuple(recordings)


def _is_recorded(track: Track, options: EvaluateOptions) -> bool:
    is_clean = track.outcome == "success" and track.num_collisions == 0
    return options.record == "all" or (options.record == "failures" and not is_clean)


def _provenance(policy: LoadedPolicy, scenario: Scenario, options: EvaluateOptions) -> Provenance:
    limits = scenario.settings.limits
    return Provenance(
        policy=policy.name,
        policy_sha256=policy.sha256,
        scenario=scenario.name,
        scenario_hash=scenario.content_hash,
        options={
            "episodes": options.episodes,
            "seed": options.seed,
            "observation": policy.observation,
            "action": policy.action,
            **choices_of(options),
            "dt": limits.dt,
            "substeps": limits.substeps,
            "max_decisions": limits.decisions,
        },
    )
