"""The command aquanav-train: learn a policy."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from aquanav_tools.cli.command import run_command
from aquanav_tools.errors import InputError
from aquanav_tools.libraries import LEARNING, require
from aquanav_tools.train.renamed import BUFFER, RENAMED, n_steps_text
from aquanav_tools.train.settings import RunSettings, TrainSettings

if TYPE_CHECKING:
    from aquanav_tools.train.pipeline import Pipeline
    from aquanav_tools.train.training import Trained

DESCRIPTION = """Learn a policy with Stable-Baselines3, in one scenario or lesson by lesson.

  aquanav-train --scenario caves/mine                 one lesson in a cave of yours
  aquanav-train --pipeline paper -o out/paper         the paper's curriculum, 3 million decisions
  aquanav-train --pipeline paper --clip 0.1 --seed 3  the same with another clip range in all lessons
  aquanav-train --pipeline mine.toml                  a file like those in pipelines/train
  aquanav-train --scenario caves/mine --init out/old  begin with the policy of another run
  aquanav-train --scenario generated/mixed --backend batch --num-envs 256
                                                      in caves that are drawn while it learns

Shipped pipelines: paper, paper-batch (the same on one batch of 512 vehicles, in less time), paper-end-to-end,
paper-clip-01, paper-clip-02, paper-sparse, paper-safe, paper-careful (a contact costs a hundred times as much),
paper-recurrent, paper-sac, quick, reference (keeps off walls in caves it never saw; it made what is in eval/policies),
generated (the same recipe in drawn caves).
Options given here count above the file's, in all lessons.

The output folder gets policy.zip (the last policy) and, with --validation, best.zip (the best in validation), both
with their observation scaling inside, policy.onnx and policy.pt (of the best, else the last), train.json (settings,
versions, content hashes), curve.csv, validation.csv, report.html, curve.rrd for rerun, and tensorboard/ (to see it,
install the extra: pip install 'aquanav[tensorboard]').

PPO learns from whole rollouts: --n-steps decisions of each of the --num-envs environments. Unless --n-steps is given,
it is chosen so that a short run has at least 30 updates and ends at the steps asked for, or just after them. The
command says what it will learn from.

In generated/mixed, or another style without a seed, --num-caves drawn caves are learned in at once, and another one
comes in after every --new-cave-every decisions: which and when follows from --seed alone. They are built ahead of need;
the bar shows how much of the time the learner waits for them. A fifth of all seeds is kept for tests, and refused here.

A run that was killed goes on from its last checkpoint when the same command is run again, to the same policy. With
more --steps it goes on from where it ended, and the learning rate rises to where it is in a run of that length; with
more lessons at the end of its pipeline, to the same policy as if they had been there at first."""


@dataclass(frozen=True)
class TrainOptions:
    """The command line."""

    pipeline: str | None = None
    """What to learn: a shipped pipeline, or a TOML file like one."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/train")
    """Folder for the run."""
    seed: int = 0
    """Of everything random."""
    overwrite: bool = False
    """Begin anew where the folder holds another run, which is lost."""
    run: tyro.conf.OmitArgPrefixes[RunSettings] = field(default_factory=RunSettings)
    """The run as a whole."""
    settings: tyro.conf.OmitArgPrefixes[TrainSettings] = field(default_factory=TrainSettings)
    """How to learn, in all lessons. Shown are the values that hold where neither a pipeline nor you say otherwise."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    run_command(
        TrainOptions,
        lambda options: _run(options, arguments),
        "aquanav-train",
        DESCRIPTION,
        defaults=_refuse_old_names,
        arguments=arguments,
    )


def _refuse_old_names(arguments: Sequence[str]) -> None:
    """Refuse a setting by a name that it no longer has; there are no other defaults to read from the arguments."""
    for old, new in RENAMED.items():
        flag, now = (f"--{name.replace('_', '-')}" for name in (old, new))
        if _value_of(flag, arguments) is not None:
            raise InputError(f"{flag} is called {now} now. Use that.")
    buffer = _value_of(f"--{BUFFER}", arguments)
    if buffer is not None:
        num_envs = _value_of("--num-envs", arguments) or "num_envs"
        n_steps = n_steps_text(*(int(text) if text.isdecimal() else text for text in (buffer, num_envs)))
        raise InputError(
            "--buffer counted decisions over all environments. --n-steps counts those of each, as in "
            f"Stable-Baselines3. Use --n-steps {n_steps}."
        )


def _value_of(flag: str, arguments: Sequence[str]) -> str | None:
    """Return what follows a flag, "" where nothing does; None where the flag is not given."""
    for number, argument in enumerate(arguments):
        if argument.startswith(f"{flag}="):
            return argument.removeprefix(f"{flag}=")
        if argument == flag:
            return "".join(arguments[number + 1 : number + 2])
    return None


def _run(options: TrainOptions, arguments: Sequence[str]) -> None:
    from aquanav_tools.train.pipeline import read_pipeline

    overrides = {**_given(options.run, arguments), **_given(options.settings, arguments)}
    pipeline = read_pipeline(options.pipeline, overrides)
    require("aquanav-train", *LEARNING)
    from aquanav_tools.train.training import train

    trained = train(pipeline, options.seed, options.output, overwrite=options.overwrite, show_progress=True, tell=print)
    print(_summary(trained, options.output, pipeline))


def _given(settings: Any, arguments: Sequence[str]) -> dict[str, Any]:
    """Return the settings that the command line names; a default is no wish, and the pipeline may say otherwise."""
    options = [argument for argument in arguments if argument.startswith("--")]  # in `--backend batch`, batch is none
    named = {option.split("=")[0].removeprefix("--").replace("-", "_") for option in options}
    names = [field.name for field in dataclasses.fields(settings)]
    return {name: getattr(settings, name) for name in names if name in named or f"no_{name}" in named}


def _summary(trained: Trained, folder: Path, pipeline: Pipeline) -> str:
    from aquanav_tools.scenario.split import distribution_of, names_for_tests
    from aquanav_tools.train.cave_rotation import FLOWN, TAKING, WAITING

    point, best, final, lesson = trained.point, trained.best, trained.final, pipeline.lessons[-1]
    deed = "This run was finished before; nothing was done. It learned" if trained.was_finished else "Learned"
    lines = [f"{deed} from {point.steps:,} decisions in {point.seconds:.0f} s."]
    if final is not None:
        lines.append(
            f"The last policy reached the goal in {final.success_rate:.0%} of {final.episodes} whole episodes in "
            f"{_named(lesson.all_scenarios)} (backend {pipeline.run.backend}, without chance in its actions), in "
            f"{final.collision_free_success:.0%} without a collision; {final.mean_collisions:.1f} collisions per "
            "episode."
        )
    policy = folder / "policy.zip"
    if best is None:
        lines.append("There is no best.zip: it needs scenarios to try the policy in while it learns (--validation).")
    else:
        policy = folder / "best.zip"
        lines.append(
            f"Best in validation: after {best.steps:,} decisions, {best.collision_free_success:.0%} collision-free "
            f"success ({policy})."
        )
    if WAITING in point.learner:
        lines.append(
            f"It flew {point.learner[FLOWN]:.0f} drawn caves. Of the last lesson's time, {point.learner[WAITING]:.2%} "
            f"was spent waiting for them and {point.learner[TAKING]:.2%} on taking them in."
        )
    vehicle = f" --vehicle {pipeline.run.vehicle}" if pipeline.run.vehicle else ""
    style = distribution_of(lesson.scenario)
    scenario = lesson.scenario if style is None else names_for_tests(style, 1)[0]
    score = f"aquanav-eval {policy} --scenario {scenario}{vehicle}"
    lines += [f"Report: {folder / 'report.html'}", f"Score it: {score}"]
    return "\n".join(lines)


def _named(scenarios: Sequence[str]) -> str:
    return scenarios[0] if len(scenarios) == 1 else f"{len(scenarios)} scenarios"
