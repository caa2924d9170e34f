"""What a lesson of a training run is made of, and the run as a whole. Light to import: the command line reads it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from aquanav_tools.sim.contacts import Backend, default_backend
from aquanav_tools.task import TaskOptions
from aquanav_tools.workers.ray_cluster import ADDRESS

Algorithm = Literal["ppo", "recurrent-ppo", "sac", "td3"]
OFF_POLICY = ("sac", "td3")
"""Algorithms that learn from a memory of old decisions; they act continuously."""
NETWORK = ("algorithm", "observation", "sensors", "action", "hidden", "normalise", "masked_observations", "memory")
"""Settings that make the network, so that all lessons of a run share them."""
_POSITIVE = (
    "steps", "num_envs", "epochs", "learning_rate", "clip", "memory", "replay", "update_ratio", "num_caves",
    "new_cave_every",
)  # fmt: skip


@dataclass(frozen=True)
class TrainSettings(TaskOptions):
    """One lesson. The defaults are the original benchmark's first lesson with fewer steps and a price on contacts."""

    scenario: str = ""
    """Where to learn: a scenario folder, as aquanav-build-cave wrote it, or the name of a shipped scenario; or
    generated/mixed (or another style), caves that are drawn while it learns, another for every vehicle in turn."""
    scenarios: tuple[str, ...] = ()
    """More scenarios to learn in during the same lesson; the environments are divided evenly, in this order."""
    num_caves: int = 64
    """Drawn caves that are learned in at once where a scenario is generated/STYLE (or generated/mixed) without a seed;
    one for each environment at most. Several such scenarios take turns. The batch only."""
    new_cave_every: int = 100_000
    """Decisions of all environments after which the next drawn cave takes the place of another, in turn; a vehicle goes
    there when its episode ends."""
    cave_that_leaves: Literal["oldest", "easiest"] = "oldest"
    """Which of the drawn caves the next one takes the place of: the one that came first, or the one in which most
    episodes end at the goal without a contact by now, so that more is learned in caves that are hard."""
    cave_scales: tuple[float, float] = (1.0, 1.0)
    """Each drawn cave is made larger or smaller by a factor from this range, drawn evenly in the logarithm, but not so
    small that the vehicle does not fit: more caves, with tighter squeezes and sharper bends than their styles have."""
    waypoint: Literal["map", "route"] = "map"
    """What the sensor waypoint shows while learning: the way by the vehicle's own map, as it will ever after (map); or
    the cave's own route, which errs less and takes next to no time, so that a network learns to trust it (route). The
    batch only."""
    steps: int = 300_000
    """Decisions to learn from, over all environments. PPO learns from whole rollouts, so it may take a few more; the
    command says how many. The same command with more steps goes on with a run that has ended."""
    algorithm: Algorithm = "ppo"
    """ppo; recurrent-ppo, with an LSTM (needs the extra: pip install 'aquanav[recurrent]'); sac or td3, which act
    continuously."""
    observation: str = "full"
    """What the agent sees: the paper's 31 values (paper), those and the vehicle's own motion (full), the 120 of the
    original's code (original), or an observation of your own, module:Name (docs/extending.md)."""
    action: Literal["multidiscrete", "discrete", "continuous"] = "multidiscrete"
    """Form of the action."""
    num_envs: int = 8
    """Environments, each with its own vehicle."""
    mirrored: bool = False
    """Whether every second environment is seen in a mirror that swaps left and right: as many caves again."""
    masked_observations: tuple[Literal["distance", "azimuth", "elevation", "depth"], ...] = ()
    """What the network is kept from seeing: the goal's distance, azimuth or elevation, or the depth. They tell where in
    a cave it is, so that it may learn caves by heart; with the sensor waypoint, the goal draws it into dead ends. Needs
    normalise."""
    normalise: bool = True
    """Whether the network scales observations by the mean and spread of what was seen in training. The numbers are part
    of the policy."""
    hidden: tuple[int, ...] = (128, 128, 128)
    """Widths of the hidden layers, for the policy and for the value."""
    learning_rate: float = 3e-4
    """In the lesson's first update; it falls towards zero in a straight line."""
    schedule: Literal["linear", "original"] = "linear"
    """How it falls. linear: by the decisions before an update, so that each of N updates learns, the last with an Nth
    of the rate. original: by the decisions up to an update's end, as in ML-Agents, so that the last learns nothing; the
    paper's pipelines have it, so that published runs repeat."""
    clip: float = 0.2
    """PPO's clip range."""
    n_steps: int = 0
    """Decisions that each environment takes before each of PPO's updates, as in Stable-Baselines3: a rollout, and a
    point of the curve, is n_steps * num_envs. 0 takes what fits the steps: at least 30 updates, of the original's 20480
    decisions at most."""
    batch: int = 0
    """Decisions per gradient step. 0 takes about a sixteenth of the rollout."""
    epochs: int = 5
    """Passes over the rollout per update."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the matrix products in ppo's networks while learning; weights and the saved policy are float32. bfloat16
    rounds to 2 or 3 digits; processors without instructions for it (AVX512_BF16, AMX) take up to ten times as long."""
    discount: float = 0.99
    """Gamma."""
    gae_lambda: float = 0.95
    """Lambda of the generalised advantage estimate."""
    ent_coef: float = 0.005
    """Weight of the entropy bonus; sac finds its own."""
    imitation: tuple[float, float] = (0.0, 0.0)
    """Share of ppo's loss that is imitation, at the lesson's beginning and at its end, in a straight line: of what the
    oracle, which knows map and water, would choose where the policy comes (DAgger). The rest is ppo's own loss. Caves,
    the batch and multidiscrete actions only."""
    greedy: float = 0.0
    """Share of the environments in which the likeliest action is taken instead of one that is drawn, as the finished
    policy does: what that meets, such as circles that chance would break, is learned by imitation, and only so."""
    memory: int = 64
    """Width of recurrent-ppo's LSTM."""
    replay: int = 300_000
    """Decisions that sac, td3 and imitation remember; a lesson begins with none."""
    learning_starts: int = 0
    """Decisions at random before sac and td3 begin to learn. 0 takes a twentieth of the steps, 10000 at most."""
    update_ratio: float = 0.25
    """Gradient steps of sac and td3 per decision."""
    optimiser: Literal["carried", "fresh"] = "carried"
    """Whether a lesson goes on with the optimiser's moments of the one before, as the original does, or without.
    Weights, and the means and spreads of observations and returns, are carried on always."""

    @property
    def rollout_size(self) -> int:
        """Decisions of all environments between two updates."""
        return self.n_steps * self.num_envs

    @property
    def is_taught(self) -> bool:
        """Whether the oracle is asked what it would choose."""
        return any(self.imitation)

    @property
    def all_scenarios(self) -> tuple[str, ...]:
        """All that the lesson is learned in."""
        return (self.scenario, *self.scenarios)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in _POSITIVE:
            _check(getattr(self, name) > 0, f"{name} must be positive, got {getattr(self, name)}.")
        for name in ("discount", "gae_lambda"):
            _check(0.0 <= getattr(self, name) <= 1.0, f"{name} must be in [0, 1], got {getattr(self, name)}.")
        _check(
            math.isfinite(self.ent_coef) and self.ent_coef >= 0, f"ent_coef must not be negative, got {self.ent_coef}."
        )
        low, high = self.cave_scales
        _check(
            0.1 <= low <= high <= 10.0, f"cave_scales must rise and lie between 0.1 and 10, and they are {low}, {high}."
        )
        self._check_imitation()
        self._check_sight()
        _check(
            len(self.scenarios) < self.num_envs,
            f"The lesson has {len(self.all_scenarios)} scenarios for {self.num_envs} environments. Take more "
            "(num_envs).",
        )
        for name in ("n_steps", "batch", "learning_starts"):
            _check(getattr(self, name) >= 0, f"{name} must not be negative, got {getattr(self, name)}.")
        _check(bool(self.hidden) and min(self.hidden) > 0, f"hidden must list positive widths, got {self.hidden}.")
        _check(
            self.batch == 0 or self.rollout_size % self.batch == 0,
            f"A rollout has {self.rollout_size} decisions (n_steps {self.n_steps} x num_envs {self.num_envs}), which "
            f"batch ({self.batch}) must divide.",
        )
        _check(
            self.precision == "float32" or self.algorithm == "ppo",
            f"precision {self.precision} is for ppo, and the algorithm is {self.algorithm}. Leave it out.",
        )
        _check(
            self.algorithm not in OFF_POLICY or self.action == "continuous",
            f"{self.algorithm} acts continuously, and the action is {self.action}. Set action to continuous.",
        )

    def _check_sight(self) -> None:
        _check(
            self.normalise or not self.masked_observations,
            "Without normalise, the network sees all that is observed. Leave masked_observations out.",
        )
        _check(
            self.observation in ("paper", "full") or not (self.masked_observations or self.mirrored),
            f"mirrored and masked_observations need the observation paper or full, and it is {self.observation}. Leave "
            "them out.",
        )
        _check(
            self.observation == "full" or "depth" not in self.masked_observations,
            f"The observation {self.observation} has no depth. Leave it out of masked_observations.",
        )
        _check(
            self.waypoint == "map" or "waypoint" in self.sensors,
            f"waypoint is {self.waypoint}, which the sensor waypoint would show, and the sensors are {self.sensors}. "
            "Add it to them, or leave waypoint out.",
        )

    def _check_imitation(self) -> None:
        _check(
            all(0.0 <= share <= 1.0 for share in self.imitation),
            f"imitation must be two shares from 0 to 1, and it is {self.imitation}.",
        )
        _check(
            not self.is_taught or (self.algorithm == "ppo" and self.action == "multidiscrete"),
            f"imitation is for ppo with multidiscrete actions, and here {self.algorithm} acts by {self.action} ones. "
            "Leave it out.",
        )
        _check(0.0 <= self.greedy < 1.0, f"greedy must be a share from 0 to below 1, and it is {self.greedy}.")
        _check(
            not 0.0 < self.greedy * self.num_envs < 0.5,
            f"greedy = {self.greedy} of num_envs = {self.num_envs} is less than one. Take more, or leave it out.",
        )
        _check(
            self.is_taught or not self.greedy,
            f"What {self.greedy:.0%} greedy environments meet is learned by imitation, and there is none. Set "
            "imitation, or leave greedy out.",
        )


@dataclass(frozen=True)
class RunSettings:
    """What concerns a run as a whole, over all its lessons."""

    vehicle: str | None = None
    """Vehicle that learns instead of the scenarios' own: a name (aquanav list has them) or a .toml file. Its hull must
    fit; starts at which it touches the wall are left out."""
    validation: tuple[str, ...] = ()
    """Scenarios to try the policy in while it learns, each in its own water. The best policy is kept in best.zip, which
    there is with validation only."""
    validation_episodes: int = 20
    """Episodes per scenario: those that aquanav-eval runs with as many and seed 0."""
    validate_every: int = 250_000
    """Decisions between two trials; the first update after a multiple of these is tried."""
    checkpoint_every: int = 100_000
    """Decisions between two checkpoints. A run that was killed goes on from the last one."""
    backend: Backend = field(default_factory=default_backend)
    """Where the vehicles move while learning: each by itself, in caves with PyBullet's contacts (pybullet) or, where
    that is not installed, our own (own); or all of them in one batch, faster by several times with hundreds of them
    (num_envs). Trials are run by the same."""
    workers: int = 0
    """Processes among which the environments are divided, where each vehicle moves by itself, and that run the episodes
    of trials; 0 runs all in the process that learns. The result is the same."""
    cave_workers: int = 0
    """Processes of lower priority that build drawn caves ahead of need; 0 takes as many as the learner leaves of
    the cores, all but two, and at least one. The result is the same."""
    ray: str | None = None
    """Have the workers' environments on the Ray cluster at HOST:PORT (auto finds one that runs here), with the same
    result; trials then run in the process that learns. This machine must be one of its nodes, and the working directory
    and the scenarios must lie at the same paths on all. Each decision takes a message to every worker and back, so take
    it where environments are slow. Needs pip install 'aquanav[cluster]'."""
    init: str | None = None
    """A policy to begin with: the policy.zip or best.zip of another run, that run's folder, or baseline:reference. Its
    weights and its means and spreads of observations are taken over; spaces and network must be the same."""
    final_episodes: int = 20
    """Whole episodes in which the last policy is measured when all is learned, on the same backend, in the last
    lesson's scenarios and water; 0 leaves that out."""

    def __post_init__(self) -> None:
        for name in ("validation_episodes", "validate_every", "checkpoint_every"):
            _check(getattr(self, name) > 0, f"{name} must be positive, got {getattr(self, name)}.")
        _check(self.final_episodes >= 0, f"final_episodes must not be negative, got {self.final_episodes}.")
        for name in ("workers", "cave_workers"):
            _check(0 <= getattr(self, name) <= 256, f"{name} is {getattr(self, name)}; choose 0 to 256.")
        _check(
            self.workers == 0 or self.backend != "batch",
            f"workers is {self.workers}, and the batch runs in threads of its own. Leave workers out, or take the "
            f"backend {default_backend()}.",
        )
        _check(self.ray is None or self.workers > 0, "ray is given without workers. Say how many actors: workers.")
        _check(
            self.ray is None or bool(ADDRESS.fullmatch(self.ray)),
            f"ray is {self.ray!r}; give auto, or the HOST:PORT that `ray start --head` shows.",
        )


def _check(is_right: bool, message: str) -> None:
    if not is_right:
        raise ValueError(message)
