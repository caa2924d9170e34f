"""What can be chosen about an evaluation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from aquanav_tools.errors import InputError
from aquanav_tools.sim.contacts import Backend, default_backend
from aquanav_tools.task import TaskOptions
from aquanav_tools.workers.ray_cluster import ADDRESS

MAX_EPISODES = 100_000
MAX_CONDITIONS = 1000
Region = Literal["first third", "middle third", "last third"]
View = Literal["chase", "onboard"]
"""As in envs.pictures, which takes long to import."""


@dataclass(frozen=True)
class Grid:
    """Conditions to vary: every combination of the values given is evaluated. What has none stays as it is."""

    current: tuple[float, ...] = ()
    """Fractions of the water's own speed."""
    sensor_noise: tuple[float, ...] = ()
    """Standard deviations of the error of each ray's distance, m."""
    action_delay: tuple[int, ...] = ()
    """Decisions between choosing an action and its effect."""
    randomisation: tuple[str, ...] = ()
    """Ranges of the vehicle's dynamics: mild, wide or a TOML file; none is the vehicle as its file has it. Those that
    draw the delay of actions themselves are evaluated once, not with each action_delay."""
    region: tuple[Region, ...] = ()
    """Thirds of the route to start in, by the path to the goal; needs the scenario's own starts. The caves that
    aquanav makes up have none in the last third."""


@dataclass(frozen=True)
class Case:
    """One episode by itself."""

    start: int
    """Which of the scenario's starts."""
    seed: int
    """Of the gusts, the sensor's noise and the policy."""
    sensor_noise: float = 0.0
    """Standard deviation of the error of each ray's distance, m."""
    current: float = 1.0
    """Fraction of the water's own speed."""

    def __post_init__(self) -> None:
        if self.start < 0 or self.seed < 0:
            raise InputError(f"A case has start {self.start} and seed {self.seed}; neither is negative.")


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions(TaskOptions):
    """Which episodes are run, under which rules: the table of a protocol file."""

    episodes: int | None = None
    """Number of episodes per scenario and condition. All starts take their turn, in an order shuffled by the seed.
    Without it every listed start once, which is all there is where nothing is random (still water, no sensor noise);
    where something is, every start equally often and 40 episodes at least."""
    seed: int = 0
    """Episode i of each scenario and condition has seed + i."""
    max_decisions: int | None = None
    """Episode limit; without it, the scenario's."""
    observation: str | None = None
    """What the policy observes, where its file does not tell by the number of values: an observation of your own as
    module:Name, or, with --sensors, the preset before them (full without it). Of a policy that observes a dictionary
    the preset in it, as NAME=PRESET; none; or a dictionary of your own, or a function that returns one, as
    module:Name. Its sensors are named as NAME=SENSOR, or by their own names."""
    grid: Grid = field(default_factory=Grid)
    cases: tuple[Case, ...] = ()
    """Episodes named one by one, instead of by number, seed and grid: what aquanav-eval stress saves. In a protocol's
    file only."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cases and (self.grid != Grid() or self.starts == "anywhere"):
            raise InputError("Cases name their starts and conditions; leave out the grid and --starts anywhere.")
        if self.episodes is not None and not 1 <= self.episodes <= MAX_EPISODES:
            raise InputError(
                f"--episodes is {self.episodes}; an evaluation has 1 to {MAX_EPISODES}. Choose a number there."
            )
        if self.seed < 0:
            raise InputError(f"--seed is {self.seed}; seeds are not negative. Choose 0 or more.")
        if self.max_decisions is not None and self.max_decisions < 1:
            raise InputError(f"--max-decisions is {self.max_decisions}; choose 1 or more.")
        if self.grid.region and self.starts == "anywhere":
            raise InputError(
                "Regions choose among the scenario's own starts; leave out the regions or --starts anywhere."
            )


@dataclass(frozen=True)
class EvaluateOptions(ProtocolOptions):
    """How a policy is evaluated. Each field is an option of aquanav-eval."""

    policies: tuple[str, ...]
    """Each as `policies.load_policy` takes it. Several are taken for training runs of one method."""
    scenario: tuple[Path, ...]
    """Scenario folders."""
    output: Path = Path("out/eval")
    """Folder for results.json, episodes.parquet, report.html, pictures and recordings; an earlier evaluation in it is
    replaced. Several policies get a folder each in it."""
    vehicle: str | None = None
    """Vehicle that dives instead of the scenario's: a name (aquanav list has them) or a .toml file. Its hull must fit;
    starts at which it touches the wall are left out."""
    protocol: str | None = None
    """A protocol that aquanav ships (paper, safety, robustness, quick), or a TOML file like one; options given here
    count above it."""
    record: Literal["all", "failures", "worst", "none"] = "all"
    """Which episodes get a rerun recording; failures are those without collision-free success, worst are the
    --max-recordings worst, which are run again."""
    max_recordings: int = 50
    """Recordings stop at this number; each takes less than 1 MB."""
    film: bool = False
    """Also write a WebM film of each recorded episode, from behind the vehicle: a tenth of a second of one core per
    decision. The report shows those of the worst; browsers play the others."""
    trust: bool = False
    """Let policy files run code, which those of unknown make and TorchScript do when they are loaded, and let protocol
    files name code. Only for files whose maker you trust; what can be read without is, all the same."""
    resume: bool = False
    """Go on with an evaluation that was stopped; its results become those of one that was not."""
    backend: Backend = field(default_factory=default_backend)
    """pybullet runs each episode by itself, with PyBullet's contacts in caves; own does, with our own contacts, and is
    the default where PyBullet is not installed. batch runs up to 256 side by side, several times as fast; an episode is
    the same whatever runs beside it. In caves its contacts are our own and its rays go through the distance field. It
    takes no shield, and the oracle in caves only: that of the batch, which plans anew at every decision."""
    workers: int | None = None
    """Processes that run episodes; the results do not depend on it. Without it as many as there are cores, but one for
    every 10 episodes at most, and with 1 this process runs."""
    ray: str | None = None
    """Run on the Ray cluster at HOST:PORT (auto finds one that runs here), with the same results; --workers then counts
    its processes. This machine must be one of its nodes, and the working directory, the policy and the scenarios must
    lie at the same paths on all. Needs pip install 'aquanav[cluster]'."""
    action_time_limit: float = 30.0
    """Wall time in which a policy must give an action, s; an episode in which it does not has failed."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.policies or not self.scenario:
            raise InputError("An evaluation needs a policy and a scenario. Name both.")
        if self.max_recordings < 0:
            raise InputError(f"--max-recordings is {self.max_recordings}; choose 0 or more.")
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers is {self.workers}; choose 1 or more, or leave it out for all cores.")
        if not 0.0 < self.action_time_limit < math.inf:
            raise InputError(f"--action-time-limit is {self.action_time_limit} s; choose more than 0.")
        if self.ray is not None and not ADDRESS.fullmatch(self.ray):
            raise InputError(
                f"--ray is '{self.ray}'; give auto, or the HOST:PORT that `ray start --head` shows. Clients outside "
                "the cluster (ray://) are not supported: start the evaluation on one of its nodes."
            )
        if self.backend == "batch" and self.ray is not None:
            raise InputError("A batch runs in this process. Leave out --ray, or --backend batch.")
        if self.backend == "batch" and self.workers is not None:
            raise InputError("A batch runs in this process. Leave out --workers, or --backend batch.")


@dataclass(frozen=True)
class SequentialOptions(EvaluateOptions):
    """How two policies are flown against each other until they are told apart."""

    smallest_difference: float = 0.05
    """Difference of collision-free success that matters, a fraction: flying also ends once neither policy can be better
    by as much. Smaller ones take more episodes: half of it, about four times as many."""
    block: int = 20
    """Episodes of each policy between two looks at what they say. The error does not depend on it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.policies, tuple) and len(self.policies) != 2:  # a command line may leave them to come
            raise InputError(
                f"A comparison pair by pair takes two policies, not {len(self.policies)}. Name two; compare "
                "evaluations of more without --sequential."
            )
        if not 0.0 < self.smallest_difference < 1.0:
            raise InputError(
                f"--smallest-difference is {self.smallest_difference}; it is a fraction above 0 and below 1, like 0.05 "
                "for five points."
            )
        if self.block < 1:
            raise InputError(f"--block is {self.block}; choose 1 or more.")


@dataclass(frozen=True, kw_only=True)
class StressOptions(TaskOptions):
    """How a policy is searched for failures. Each field is an option of aquanav-eval stress."""

    policy: str
    """As aquanav-eval takes it."""
    scenario: Path
    """Scenario folder."""
    output: Path = Path("out/stress")
    """Folder for worst.toml, stress.json and report.html."""
    budget: int = 200
    """Episodes of the search; as many are drawn at random beside it, to compare."""
    seed: int = 0
    """Of the search and of the random draws."""
    max_noise: float = 0.2
    """The search may give rays errors of this standard deviation, m."""
    max_current: float = 1.5
    """The search may let the water flow with this fraction of its speed."""
    seeds: int = 8
    """Number of seeds to choose from, for gusts and noise."""
    worst: int = 20
    """Cases to save."""
    max_decisions: int | None = None
    """Episode limit; without it, the scenario's."""
    observation: str | None = None
    """What the policy observes, as aquanav-eval takes it."""
    vehicle: str | None = None
    """Vehicle that dives instead of the scenario's; see aquanav-eval --help."""
    trust: bool = False
    """Let the policy's file run code; see aquanav-eval --help."""
    resume: bool = False
    """Go on with a search that was stopped; it ends like one that was not."""
    workers: int | None = None
    """Processes that run episodes; the results do not depend on it. Without it as many as there are cores."""
    action_time_limit: float = 30.0
    """Wall time in which a policy must give an action, s; an episode in which it does not has failed."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.budget <= MAX_EPISODES:
            raise InputError(f"--budget is {self.budget}; a search has 1 to {MAX_EPISODES} episodes.")
        if self.seed < 0 or self.seeds < 1 or self.worst < 1:
            raise InputError(
                f"--seed, --seeds and --worst are {self.seed}, {self.seeds} and {self.worst}; choose 0 or more for "
                "the first and 1 or more for the others."
            )
        for name in ("max_noise", "max_current"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InputError(f"--{name.replace('_', '-')} is {getattr(self, name)}; choose 0 or more.")
        usual = TaskOptions()
        names = ("starts", "start_range", "sensor_noise", "current_range")
        if any(getattr(self, name) != getattr(usual, name) for name in names):
            raise InputError(
                "The search chooses starts, sensor noise and the fraction of the current itself: leave out --starts, "
                "--start-range, --sensor-noise and --current-range. --max-noise and --max-current bound the search."
            )


@dataclass(frozen=True)
class ReplayOptions:
    """What is run again. Each field is an option of aquanav-eval replay."""

    results: Path
    """results.json of an evaluation, or its folder."""
    episode: int
    """Number of the episode, from 0."""
    output: Path | None = None
    """The recording; without it, replay-00017.rrd beside the results."""
    policy: str | None = None
    """The policy, where it is no longer at its path."""
    trust: bool = False
    """Let the policy's file run code, and run the code that the results name; see aquanav-eval --help."""
    scenario: Path | None = None
    """The scenario's folder, where it is no longer at its path."""
    vehicle: str | None = None
    """The vehicle's file, where another than the scenario's was evaluated and it is no longer at its path."""
    film: Path | None = None
    """Also write this film of the episode: .mp4 for players, .webm for browsers, .gif or .webp for pages that show no
    video. It takes 0.02 s of one core per decision."""
    bag: Path | None = None
    """Also write this folder, a bag of ROS 2 (MCAP) with standard messages, for Foxglove, RViz and ros2 bag. Needs
    pip install 'aquanav[ros]'."""
    track: Path | None = None
    """Also write this table with a row per state, .csv or .parquet: time, pose, velocity, current, clearance, reward,
    command and rays, units in the columns' names."""
    view: View = "chase"
    """Of the film: chase, from behind the vehicle, or onboard, from its nose."""


@dataclass(frozen=True)
class WorstOptions:
    """Which episodes are looked at. Each field is an option of aquanav-eval replay --worst."""

    results: Path
    """results.json of an evaluation or a benchmark, or its folder."""
    worst: int = 10
    """How many under each condition, which in a benchmark is a tier: failures first, then those with most collisions,
    then those with the least clearance. Episodes without a failure or a collision are left out."""
    output: Path | None = None
    """Folder for the page, the stills and the films; without it, `worst` beside the results."""
    films: bool = True
    """Whether to make films, which take 0.02 s of one core per picture."""
    seconds: float = 8.0
    """Before the first contact, or before the end where there is none, at which stills and films begin."""
    policy: str | None = None
    """The policy, where it is no longer at its path."""
    trust: bool = False
    """Let the policy's file run code, and run the code that the results name; see aquanav-eval --help."""
    scenario: Path | None = None
    """The scenario's folder, where it is no longer at its path; of results in one scenario."""
    vehicle: str | None = None
    """The vehicle's file, where another than the scenario's was evaluated and it is no longer at its path."""
    view: View = "chase"
    """Of stills and films: chase, from behind the vehicle, or onboard, from its nose."""

    def __post_init__(self) -> None:
        if self.worst < 1:
            raise InputError(f"--worst is {self.worst}; choose 1 or more.")
        if not 0.5 <= self.seconds < math.inf:
            raise InputError(f"--seconds is {self.seconds}; choose half a second or more.")
