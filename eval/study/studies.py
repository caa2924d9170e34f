"""The paper's comparisons: which pipelines are learned, where they are scored, and what is asked of them."""

from __future__ import annotations

from dataclasses import dataclass

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
    variants: dict[str, str]
    """Pipelines by the names that the page gives them."""
    settings: str
    """Lines of TOML that count above every pipeline's own."""
    policy: str
    """Which of a run's policies is scored."""
    places: tuple[str, ...]
    """Scenarios to score in; "han" is built from its scan."""
    currents: dict[str, float | None]
    """Shares of each place's own current, by the names that the page gives them; None leaves it as it is."""
    episodes: int
    """Per place and current."""
    questions: tuple[Question, ...]
    safety_place: str
    """Where collisions and distances to the wall are compared."""
    method: str
    """How it was done, for the page."""


CAVES = Study(
    title="The paper's questions: caves",
    variants={
        "curriculum": "paper",
        "end-to-end": "paper-end-to-end",
        "clip-0.1": "paper-clip-01",
        "clip-0.2": "paper-clip-02",
        "sparse": "paper-sparse",
        "safe": "paper-safe",
        "careful": "paper-careful",
    },
    # 40 decisions of each of 512 vehicles make the original's buffer of 20,480.
    settings='backend = "batch"\nnum_envs = 512\nvalidation = []\n',
    policy="policy.zip",
    places=("cave-test-1", "cave-test-2", "cave-test-3", "han"),
    currents={"still": 0.0, "half": 0.5, "full": 1.0},
    episodes=40,  # each start of a shipped cave once
    questions=(
        Question("Curriculum or end to end", "curriculum", "end-to-end", "it makes policies safer and more general"),
        Question("Clip range 0.1 or 0.2", "clip-0.1", "clip-0.2", "small updates learn more steadily"),
        Question("Dense or sparse reward", "curriculum", "sparse", "without a dense reward learning does not converge"),
        Question("Safe or standard reward", "safe", "curriculum", "a price on nearness keeps policies off the walls"),
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
    variants={"standard": "bay-standard", "safe": "bay-safe"},
    settings="",
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

STUDIES = {"caves": CAVES, "bays": BAYS}
