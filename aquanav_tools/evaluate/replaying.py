"""Running an episode of an evaluation again, to see that it repeats and to watch it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.factory import AnyScenario, read_any_scenario, with_vehicle
from aquanav_tools.envs.pictures.film import film_size
from aquanav_tools.envs.starting import NOWHERE_LISTED
from aquanav_tools.errors import AquanavError, InputError
from aquanav_tools.evaluate.env_cache import EpisodeSpec, open_env_cache
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.observed import named_observation
from aquanav_tools.evaluate.options import ProtocolOptions, ReplayOptions, View, WorstOptions
from aquanav_tools.evaluate.own_files import check_own_files, own_files
from aquanav_tools.evaluate.policies import LoadedPolicy, code_of, policy_loader, recorded_spec
from aquanav_tools.evaluate.protocol import Condition, EpisodePlan
from aquanav_tools.evaluate.recording import bag_trajectory, film_trajectory, record_trajectory
from aquanav_tools.evaluate.results import episodes_of, read_results, versions
from aquanav_tools.registry import refuse_recorded
from aquanav_tools.report.recording.bag import check_bag
from aquanav_tools.report.recording.stream import require_recorder
from aquanav_tools.report.recording.track import check_track, write_track
from aquanav_tools.report.trajectory import FAILED, Trajectory
from aquanav_tools.sim.contacts import Backend
from aquanav_tools.task import TaskOptions, choices_of, named_code
from aquanav_tools.types import Progress, ignore_progress

RECORDING = "replay-{index:05d}.rrd"


class ReplayError(AquanavError):
    """An episode did not repeat."""


@dataclass(frozen=True)
class Replayed:
    """An episode that came out as before, to the bit."""

    episode: EpisodeMetrics
    recording: Path
    film: Path | None
    """None where none was asked for."""
    bag: Path | None
    """Likewise."""
    track: Path | None
    """Likewise."""


def replay(
    options: ReplayOptions,
    progress: Progress = ignore_progress,
    load: Callable[[str], LoadedPolicy] | None = None,
) -> Replayed:
    """Run an episode again; write its recording, and its film, bag and track where asked for.

    Args:
        options: Which episode.
        progress: Called with (frames of the film written, frames in all).
        load: Loads the policy by its name; None takes `load_policy`.

    Raises:
        InputError: no such results or episode, the policy, the scenario or code of the user's own is missing or another
            one, or no film of that name or view can be made, or no track of that name.
        LibraryError: there can be no recording, as rerun is not installed, or no bag, as rosbags is not.
        ReplayError: the episode came out differently; its recording is written all the same.
    """
    require_recorder()
    if options.film is not None:  # before the episode, which takes long
        film_size(options.film)
        check_choice("view", options.view, get_args(View))
    if options.bag is not None:
        check_bag(options.bag)
    if options.track is not None:
        check_track(options.track)
    repeater = Repeater(options, load)
    once = repeater.run(options.episode)
    output = options.output or repeater.path.with_name(RECORDING.format(index=once.episode.index))
    record_trajectory(once.scenario, once.trajectory, output)
    if options.bag is not None:
        bag_trajectory(once.scenario, once.trajectory, options.bag)
    if options.track is not None:
        write_track(options.track, once.trajectory)
    if options.film is not None:
        film_trajectory(once.scenario, once.trajectory, options.film, options.view, progress)
    if once.difference:
        raise ReplayError(f"{once.difference} What happened now is in {output}.")
    return Replayed(once.episode, output, options.film, options.bag, options.track)


@dataclass(frozen=True, eq=False)
class Repeated:
    """An episode that was run again."""

    scenario: AnyScenario
    trajectory: Trajectory
    episode: EpisodeMetrics
    """As it came out now."""
    difference: str
    """How it came out differently, and why that may be; empty where it is the same to the bit."""


class Repeater:
    """Runs episodes of an evaluation again."""

    def __init__(
        self, options: ReplayOptions | WorstOptions, load: Callable[[str], LoadedPolicy] | None = None
    ) -> None:
        """Read the results, and load the policy; `load` does that by its name, and None takes `load_policy`.

        Raises:
            InputError: no such results, or the policy or code of the user's own is missing or another one.
        """
        self.path = options.results / "results.json" if options.results.is_dir() else options.results
        self._table, self._options = read_results(self.path), options
        self.episodes = episodes_of(self._table)
        self._rules = _rules(self._table["protocol"])
        recorded = code_of(self._table["policy"]["path"])
        is_recorded = load is None and options.policy is None
        if not options.trust:
            changed = [name for item in self._table["protocol"]["conditions"] for name in named_code(item["changes"])]
            own = recorded if is_recorded else None
            names = [*named_code(choices_of(self._rules)), *changed, self._rules.observation, own]
            refuse_recorded(names, str(self.path), "If you trust it, add --trust.")
        _check_own_files(self._table, self._rules, recorded, is_recorded=is_recorded)
        self._policy = _policy(self._table, options, load or policy_loader(self._rules, is_trusted=options.trust))
        self._scenario: AnyScenario | None = None

    def run(self, index: int) -> Repeated:
        """Return an episode, run again.

        Raises:
            InputError: no such episode, or its scenario is missing or another one.
        """
        before = _find(self.episodes, index, self.path)
        if self._scenario is None or self._scenario.name != before.scenario:
            self._scenario = _scenario(self._table, before.scenario, self._options)
        protocol = self._table["protocol"]
        condition = _condition(protocol["conditions"], before.condition)
        start = None if before.start == NOWHERE_LISTED else before.start
        spec = EpisodeSpec(index, self._scenario, condition, EpisodePlan(before.seed, start))
        trajectory, now = _run(self._policy, spec, self._rules, protocol.get("backend", "pybullet"))
        is_same = now.digest == before.digest
        difference = "" if is_same else _difference(before, now, self._table["versions"])
        return Repeated(self._scenario, trajectory, now, difference)


def _check_own_files(table: dict[str, Any], rules: ProtocolOptions, policy: str, *, is_recorded: bool) -> None:
    """Check the user's own files against the results; the policy's only where the results name the policy."""
    if "own_files" not in table:  # before format 5
        return
    before = dict(table["own_files"])
    if not is_recorded:
        before.pop(policy, None)
    ranges = table["protocol"]["grid"].get("randomisation", ())
    check_own_files(before, own_files(rules, rules.observation, ranges, policy if is_recorded else ""))


def _run(
    policy: LoadedPolicy, spec: EpisodeSpec, rules: ProtocolOptions, backend: Backend
) -> tuple[Trajectory, EpisodeMetrics]:
    if backend == "batch":
        return _run_batched(policy, spec, rules)
    with open_env_cache(policy, rules, backend) as env_cache:
        return env_cache.run(spec)


def _run_batched(policy: LoadedPolicy, spec: EpisodeSpec, rules: ProtocolOptions) -> tuple[Trajectory, EpisodeMetrics]:
    """Run the episode as a batch of one, which is what it was beside others."""
    from aquanav_tools.evaluate.batch_runner import BatchRunner

    runner = BatchRunner([policy], rules)
    try:
        return runner.run([spec])[0]
    finally:
        runner.close()


def _find(episodes: list[EpisodeMetrics], index: int, path: Path) -> EpisodeMetrics:
    if not 0 <= index < len(episodes):
        raise InputError(f"{path} has the episodes 0 to {len(episodes) - 1}, not {index}. Choose one of them.")
    return episodes[index]


def _policy(
    table: dict[str, Any], options: ReplayOptions | WorstOptions, load: Callable[[str], LoadedPolicy]
) -> LoadedPolicy:
    expected = table["policy"]
    policy = load(options.policy or recorded_spec(expected["path"], expected["sha256"]))
    if policy.sha256 != expected["sha256"]:
        raise InputError(
            f"The policy {policy.name} is another one than was evaluated ({policy.sha256} instead of "
            f"{expected['sha256']}). Name the right file with --policy."
        )
    return policy


def _scenario(table: dict[str, Any], name: str, options: ReplayOptions | WorstOptions) -> AnyScenario:
    expected = next(item for item in table["scenarios"] if item["name"] == name)
    vehicle = expected.get("vehicle")
    path = options.vehicle or (vehicle and vehicle["path"])
    scenario = with_vehicle(read_any_scenario(options.scenario or expected["path"]), path)
    if scenario.content_hash != expected["content_hash"]:
        raise InputError(
            f"The scenario {scenario.name} is another one than was evaluated: its content hash is "
            f"{scenario.content_hash} instead of {expected['content_hash']}. Name the right folder with --scenario."
        )
    used, wanted = scenario.other_vehicle, vehicle and vehicle["sha256"]
    if (used and used.sha256) != wanted:
        raise InputError(
            f"The vehicle {used.name if used else 'of the scenario'} is another one than was evaluated "
            f"({used.sha256 if used else 'its own'} instead of {wanted or 'its own'}). Name the right file with "
            "--vehicle, or leave it out."
        )
    return scenario


def _condition(conditions: Sequence[dict[str, Any]], name: str) -> Condition:
    item = next(item for item in conditions if item["name"] == name)
    return Condition(**{**item, "changes": _with_tuples(item["changes"])})


def _with_tuples(values: dict[str, Any]) -> dict[str, Any]:
    """Return options as they were: JSON has no tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def _rules(protocol: dict[str, Any]) -> ProtocolOptions:
    task = {name: protocol.get(name, usual) for name, usual in choices_of(TaskOptions()).items()}
    task = _with_tuples(task)
    return ProtocolOptions(
        observation=named_observation(protocol["observation"], task["sensors"], task["history"]),
        episodes=protocol["episodes"],
        seed=protocol["seed"],
        max_decisions=protocol["max_decisions"],
        **task,
    )


def _difference(before: EpisodeMetrics, now: EpisodeMetrics, made_with: dict[str, str]) -> str:
    here = versions()
    other = [
        f"{name} {made_with.get(name)} then, {here[name]} now" for name in here if made_with.get(name) != here[name]
    ]
    cause = (
        "; ".join(other) if other else "the versions are the same, so another machine or the policy may be the cause"
    )
    if FAILED in (before.outcome, now.outcome):
        cause += f"; the policy failed ({before.reason or now.reason})"
    return (
        f"Episode {before.index} did not repeat to the bit: {before.outcome} after {before.time:.2f} s with "
        f"{before.collisions} collisions then, {now.outcome} after {now.time:.2f} s with {now.collisions} now "
        f"({cause})."
    )
