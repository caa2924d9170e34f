"""The paper's comparisons: which pipelines are learned, where they are scored, and what is asked of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

AS_GIVEN = "as given"
"""What aquanav-eval calls the circumstances of a scenario that nothing changes."""


@dataclass(frozen=True)
class Question:
    """Two variants that differ in one thing."""

    title: str
    first: str
    second: str
    claim: str
    """What is concluded, put as the advantage of the first."""
    source: str = "The paper"
    """Who says so."""


@dataclass(frozen=True)
class Study:
    """Variants of training that are held against one another."""

    title: str
    variants: dict[str, dict[str, Any]]
    """What their pipelines say, by the names that the page gives them."""
    settings: dict[str, Any]
    """What counts above all of these."""
    policy: str
    """Which of a run's policies is scored."""
    places: tuple[str, ...]
    """Scenarios to score in; `places.py` builds those that do not ship."""
    currents: dict[str, float | None]
    """Shares of each place's own current, by the names that the page gives them; None leaves it as it is."""
    episodes: int
    """Per place and current."""
    questions: tuple[Question, ...]
    safety_place: str
    """Where collisions and distances to the wall are compared."""
    method: str
    """How it was done, for the page."""
    caves: dict[str, str] = field(default_factory=dict)
    """Where to learn in place of a pipeline's own scenarios."""


PAPER_QUESTIONS = (
    Question("Curriculum or end to end", "curriculum", "end-to-end", "it makes policies safer and more general"),
    Question("Clip range 0.1 or 0.2", "clip-0.1", "clip-0.2", "small updates learn more steadily"),
    Question("Dense or sparse reward", "curriculum", "sparse", "without a dense reward learning does not converge"),
)
SAFE_CLAIM = "a price on nearness keeps policies off the walls"
CURRENTS: dict[str, float | None] = {"still": 0.0, "half": 0.5, "full": 1.0}
# 40 decisions of each of 512 vehicles make the original's rollout of 20,480.
ON_THE_BATCH = {"backend": "batch", "num_envs": 512, "n_steps": 40, "validation": []}

CAVES = Study(
    title="The paper's questions: caves",
    variants={
        "curriculum": {"extends": "paper"},
        "end-to-end": {"extends": "paper-end-to-end"},
        "clip-0.1": {"extends": "paper-clip-01"},
        "clip-0.2": {"extends": "paper-clip-02"},
        "sparse": {"extends": "paper-sparse"},
        "safe": {"extends": "paper-safe"},
        "careful": {"extends": "paper-careful"},
    },
    settings=ON_THE_BATCH,
    policy="policy.zip",
    places=("cave-test-1", "cave-test-2", "cave-test-3", "han"),
    currents=CURRENTS,
    episodes=40,  # each start of a shipped cave once
    questions=(
        *PAPER_QUESTIONS,
        Question("Safe or standard reward", "safe", "curriculum", SAFE_CLAIM),
        Question(
            "Careful or standard reward",
            "careful",
            "curriculum",
            "a price on contacts that counts keeps policies off the walls",
            source="We",
        ),
    ),
    safety_place="cave-test-3",
    method="""\
Pipelines as shipped (`paper`, `paper-end-to-end`, `paper-clip-01`, `paper-clip-02`, `paper-sparse`,
`paper-safe`, `paper-careful`: 3 million decisions each), learned on the batch with 512 vehicles; the last policy of
each run counts. Each is scored in 40 episodes per cave and current on the batch, acting without chance; a contact ends
no episode. "han" is the scan of Han-sur-Lesse, as aquanav-build-cave closes it. The curves, which choose by chance,
dip where a lesson begins: its first episodes are cut short at random and count as failed.""",
)

BAYS = Study(
    title="The paper's questions: bays",
    variants={"standard": {"extends": "bay-standard"}, "safe": {"extends": "bay-safe"}},
    settings={},
    policy="best.zip",
    places=("bay-calm", "bay-breeze", "bay-rough"),
    currents={AS_GIVEN: None},
    episodes=200,
    questions=(
        Question("Safe or standard reward", "safe", "standard", "a price on nearness keeps policies off the rocks"),
    ),
    safety_place="bay-rough",
    method="""\
Pipelines as shipped (`bay-standard`, `bay-safe`: 1 million decisions each on a calm sea, on the batch);
of each run the policy that was best in 20 validation bays. Each is scored in 200 bays per sea, drawn from other seeds,
on the batch, acting without chance; a contact ends no episode. The curves dip where the second lesson begins: there the
first contact ends an episode, so that the first episodes to end are those that failed.""",
)

ORIGINAL = Study(
    title="The paper's questions in its own caves",
    variants={
        "curriculum": {"extends": "paper", "observation": "full", "reward": "safe"},
        "end-to-end": {"extends": "paper-end-to-end", "observation": "full", "reward": "safe"},
        "clip-0.1": {"extends": "paper-clip-01", "observation": "full", "reward": "safe"},
        "clip-0.2": {"extends": "paper-clip-02", "observation": "full", "reward": "safe"},
        "sparse": {"extends": "paper-sparse", "observation": "full"},
        "standard": {"extends": "paper", "observation": "full"},
        "31-values": {"extends": "paper", "reward": "safe"},
    },
    settings=ON_THE_BATCH,
    caves={"cave-train-1": "cave-easy", "cave-train-2": "cave-medium", "cave-train-3": "cave-medium"},
    policy="policy.zip",
    places=("cave-eval1", "cave-easy-3"),
    currents=CURRENTS,
    episodes=40,
    questions=(
        *PAPER_QUESTIONS,
        Question("Safe or standard reward", "curriculum", "standard", SAFE_CLAIM),
        Question(
            "With or without the vehicle's motion",
            "curriculum",
            "31-values",
            "who observes speed, tilt and ballast keeps off the walls",
            source="We",
        ),
    ),
    safety_place="cave-eval1",
    method="""\
The caves are the original's, as `aquanav import-original` places them, and so is the vehicle. The pipelines are those
of [study-caves.md](study-caves.md), 3 million decisions each on the batch with 512 vehicles: the first lesson in
cave-easy, the others in cave-medium (as in the original), end to end in cave-medium. As in the original's code,
policies learn with the safe reward at its price of nearness (but for sparse and standard) and observe the vehicle's
motion, by the preset "full" (but for 31-values, by the preset "paper"). Scored in caves that were not learned from:
cave-eval1, a way of its own, and cave-easy-3, the first lesson's way at 0.6 of its width. The last policy of each run
counts, in 40 episodes per cave and current on the batch, acting without chance; a contact ends no episode. Currents are
ours (0.25 and 0.5 m/s through the narrowest section), since the original's are lost. The curves, which choose by
chance, dip where a lesson begins: its first episodes are cut short at random and count as failed.""",
)

STUDIES = {"caves": CAVES, "original": ORIGINAL, "bays": BAYS}
