"""Submissions for the leaderboard: one file with the policy, every episode and the score, so that anybody can check it.

Nothing in such a file is believed: the score is computed anew from the episodes, and `verify` dives them again.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import dataclasses
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.benchmark.definition import Benchmark, read_benchmark
from aquanav_tools.benchmark.options import BenchmarkOptions
from aquanav_tools.benchmark.run import BenchmarkRun
from aquanav_tools.benchmark.score import Score, score_of
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.policies import PREFIX, code_of
from aquanav_tools.evaluate.results import episode_row, read_episode_rows, versions
from aquanav_tools.evaluate.shielding import inner_of
from aquanav_tools.policy.run_folder import best_policy
from aquanav_tools.tables import from_table
from aquanav_tools.text_files import read_json

FORMAT = 1
MAX_POLICY_BYTES = 50_000_000
MAX_BYTES = 120_000_000
TOLERANCE = 1e-6
"""Of a score that is computed anew: what rounding its episodes to six decimals moves it."""


@dataclass(frozen=True)
class SubmittedPolicy:
    """The policy of a submission."""

    spec: str
    """A baseline's name; or "file", also behind "shield:"."""
    name: str
    sha256: str | None
    suffix: str
    """Of the file."""
    content: str | None
    """The file in base64; None for a baseline."""
    observation: str | None
    """What it observes, where its file does not tell."""


@dataclass(frozen=True)
class SubmittedCave:
    """One cave and how it was dived in."""

    scenario: str
    """As the benchmark calls it."""
    name: str
    """As its episodes call it."""
    mesh: str
    """See `aquanav_tools.benchmark.worker.mesh_hash`."""
    episodes: tuple[EpisodeMetrics, ...] = ()


@dataclass(frozen=True)
class Submission:
    """What a policy did in a benchmark."""

    format: int
    name: str
    """Of the method; several with one name are training runs of one."""
    benchmark: str
    benchmark_sha256: str
    backend: str
    processor: str
    versions: tuple[tuple[str, str], ...]
    policy: SubmittedPolicy
    caves: tuple[SubmittedCave, ...]
    mean: float
    iqm: float

    @property
    def episodes(self) -> list[EpisodeMetrics]:
        """All episodes in their order."""
        return [episode for cave in self.caves for episode in cave.episodes]


def check_can_submit(options: BenchmarkOptions) -> None:
    """Refuse what cannot be put into one file, before anything is run.

    Raises:
        InputError: the name is no plain word, the policy is code or too large, or the caves are the user's own.
    """
    name = options.submit or ""
    if not name.replace("-", "").replace("_", "").replace(".", "").isalnum() or name.startswith("."):
        raise InputError(f"--submit is '{name}'; choose a name of letters, digits, dots and dashes.")
    if code_of(options.policy):
        raise InputError(
            f"{options.policy} is code of your own, which nobody could check without running it. Export the policy as "
            "ONNX or as a Stable-Baselines3 zip and submit that."
        )
    if options.real or options.benchmark.endswith(".toml") or "+" in options.benchmark:
        raise InputError(
            f"{options.benchmark} has caves that others do not have. A submission is of a benchmark that comes with "
            "aquanav."
        )
    path = _policy_path(options.policy)
    if path is not None and path.is_file() and path.stat().st_size > MAX_POLICY_BYTES:
        raise InputError(f"{path} has {path.stat().st_size / 1e6:.0f} MB; a submission takes at most 50 MB.")


def submission_of(options: BenchmarkOptions, run: BenchmarkRun) -> Submission:
    """Return the submission of a run.

    Raises:
        InputError: the policy's file has changed since.
    """
    path, content = _policy_path(options.policy), None
    if path is not None:
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != run.policy.sha256:
            raise InputError(f"{path} is not what was dived with: it has changed since. Run the benchmark again.")
    caves = []
    for row in run.caves:
        _, cave = run.benchmark.caves[row["number"]]
        episodes = tuple(EpisodeMetrics(**episode_row(EpisodeMetrics(**metrics))) for metrics in row["metrics"])
        caves.append(SubmittedCave(cave.scenario, row["scenario"]["name"], row["mesh"], episodes))
    policy = SubmittedPolicy(
        spec=options.policy if path is None else options.policy.removesuffix(inner_of(options.policy)) + "file",
        name=run.policy.name,
        sha256=run.policy.sha256,
        suffix="" if path is None else path.suffix,
        content=None if content is None else base64.b64encode(content).decode("ascii"),
        observation=options.observation,
    )
    mean, iqm = run.score.total.mean.mean, run.score.total.iqm.mean
    benchmark, made_with = run.benchmark, tuple(sorted(versions().items()))
    return Submission(
        FORMAT, str(options.submit), benchmark.name, benchmark.sha256, options.backend, processor(), made_with, policy,
        tuple(caves), mean, iqm,
    )  # fmt: skip


def write_submission(submission: Submission, path: Path) -> None:
    """Write a submission as JSON, whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    table = asdict(submission)
    for cave, row in zip(submission.caves, table["caves"], strict=True):
        row["episodes"] = [episode_row(episode) for episode in cave.episodes]
    partial.write_text(json.dumps(table, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(partial, path)


def read_submission(path: Path) -> Submission:
    """Return the submission in a file, checked against itself and the benchmark that this version has.

    Raises:
        InputError: it is none, is of another version's benchmark, lacks caves, its policy is not the one it names, or
            its score is not that of its episodes.
    """
    if not path.is_file():
        raise InputError(f"There is no file {path}. Name a file that aquanav-eval --submit wrote.")
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path} has {path.stat().st_size / 1e6:.0f} MB, more than any submission.")
    table = read_json(path)
    if isinstance(table, dict) and table.get("format") != FORMAT:
        raise InputError(f"{path} is no submission of format {FORMAT}. Name a file that aquanav-eval --submit wrote.")
    submission = _parsed(table, path)
    benchmark = benchmark_of(submission, path)
    _check_policy(submission, path)
    _check_caves(submission, benchmark, path)
    score = score_in(submission, benchmark)
    for what, told, found in (("mean", submission.mean, score.total.mean), ("IQM", submission.iqm, score.total.iqm)):
        if abs(told - found.mean) > TOLERANCE:
            raise InputError(
                f"{path} was tampered with: it says that the {what} is {told:.4f}, and its episodes come to "
                f"{found.mean:.4f}."
            )
    return submission


def benchmark_of(submission: Submission, path: Path) -> Benchmark:
    """Return the benchmark that a submission is of.

    Raises:
        InputError: this version has none of that name, or another one.
    """
    benchmark = read_benchmark(submission.benchmark)
    if benchmark.sha256 != submission.benchmark_sha256:
        raise InputError(
            f"{path} is of another {submission.benchmark} than this version of aquanav has (SHA-256 "
            f"{submission.benchmark_sha256[:12]} instead of {benchmark.sha256[:12]}). Run the benchmark again."
        )
    return benchmark


def score_in(submission: Submission, benchmark: Benchmark) -> Score:
    """Return the score that a submission's episodes come to."""
    tiers = {cave.name: tier.name for cave, (tier, _) in zip(submission.caves, benchmark.caves, strict=True)}
    return score_of(submission.episodes, tiers)


@contextlib.contextmanager
def policy_file(policy: SubmittedPolicy) -> Iterator[str]:
    """Yield what to call a submission's policy by, while its file lies in a folder for the time being."""
    if policy.content is None:
        yield policy.spec
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"policy{policy.suffix}"
        path.write_bytes(base64.b64decode(policy.content))
        yield policy.spec.removesuffix("file") + str(path)


def processor() -> str:
    """Return the kind of this machine's processor: kernels are compiled for it, and may round otherwise on others."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    import platform

    return platform.processor() or platform.machine()


def _check_policy(submission: Submission, path: Path) -> None:
    policy = submission.policy
    if policy.content is None:
        inner = inner_of(policy.spec)
        if not inner.startswith(PREFIX):
            raise InputError(f"{path} carries no policy, and {policy.spec!r} is no baseline.")
        return
    try:
        content = base64.b64decode(policy.content, validate=True)
    except (binascii.Error, ValueError) as cause:
        raise InputError(f"The policy in {path} cannot be decoded: {cause}.") from cause
    if inner_of(policy.spec) != "file" or policy.suffix not in (".zip", ".onnx"):
        raise InputError(f"The policy in {path} is no zip or ONNX file ({policy.spec!r}, {policy.suffix!r}).")
    if hashlib.sha256(content).hexdigest() != policy.sha256:
        raise InputError(f"{path} was tampered with: its policy does not have the SHA-256 that it says.")


def _check_caves(submission: Submission, benchmark: Benchmark, path: Path) -> None:
    wanted = [cave.scenario for _, cave in benchmark.caves]
    found = [cave.scenario for cave in submission.caves]
    if found != wanted:
        missing = sorted(set(wanted) - set(found))
        raise InputError(
            f"{path} does not have the caves of {benchmark.name}: {len(missing)} are missing"
            f"{', ' + missing[0] + ' first' if missing else ', or they are in another order'}."
        )
    for number, cave in enumerate(submission.caves):
        first = number * benchmark.episodes
        plan = [(first + n, cave.name, benchmark.seed + n) for n in range(benchmark.episodes)]
        if [(episode.index, episode.scenario, episode.seed) for episode in cave.episodes] != plan:
            raise InputError(f"{path} was tampered with: the episodes in {cave.scenario} are not the benchmark's.")


def _policy_path(spec: str) -> Path | None:
    """Return the file of a policy; None for a baseline."""
    inner = inner_of(spec)
    if inner.startswith(PREFIX):
        return None
    return best_policy(Path(inner)) if Path(inner).is_dir() else Path(inner)


def _parsed(table: dict[str, Any], path: Path) -> Submission:
    """Return what a table holds; its episodes are checked by the schema of results.json."""
    rows = table.get("caves")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path} has no list of caves.")
    episodes = [tuple(read_episode_rows(row.pop("episodes", None), path.name)) for row in rows]
    found = from_table(Submission, table, path.name)
    caves = [dataclasses.replace(cave, episodes=own) for cave, own in zip(found.caves, episodes, strict=True)]
    return dataclasses.replace(found, caves=tuple(caves))
