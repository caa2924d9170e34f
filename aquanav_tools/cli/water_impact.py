"""aquanav water-impact: replay one ideal action sequence in currents."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from aquanav_tools.cli.command import NO_TERMINAL
from aquanav_tools.errors import InputError


@dataclass(frozen=True)
class WaterImpact:
    """Swim a cave in still water, then repeat the very same actions blindly in currents.

    Writes impact.json (deviation and collisions of every replay), impact.svg and impact.png (the ways and the
    deviation over time) and impact.rrd (all of them swimming at once, for rerun).
    """

    scenario: Path
    """Scenario folder."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = field(default=Path("out/impact"))
    """Folder for the results; earlier ones in it are replaced."""
    policy: str = "baseline:reactive"
    """Who swims the ideal dive: a Stable-Baselines3 zip, an ONNX policy, or a baseline."""
    currents: tuple[Literal["half", "full", "flood"], ...] = ("half", "full", "flood")
    """Currents to replay it in."""
    seeds: int = 5
    """Draws of each current's gusts and eddies."""
    seed: int = 0
    """Of the first draw, and of the order in which starts are tried for the ideal dive."""


def run_water_impact(options: WaterImpact) -> None:
    """Run the experiment, write it down and print a table."""
    if options.seeds < 1 or options.seed < 0:
        raise InputError(f"--seeds is {options.seeds} and --seed {options.seed}; they start at 1 and at 0.")
    from tqdm import tqdm

    from aquanav_tools.report.recording.stream import require_recorder

    require_recorder()
    from aquanav_tools.evaluate.policies import load_policy
    from aquanav_tools.evaluate.water_impact import impact_table, measure_water_impact
    from aquanav_tools.scenario.folder import read_scenario

    policy, scenario = load_policy(options.policy), read_scenario(options.scenario)
    currents = tuple(dict.fromkeys(options.currents))
    with tqdm(total=len(currents) * options.seeds, unit="replay", delay=0.5, disable=NO_TERMINAL) as bar:
        impact = measure_water_impact(
            scenario, policy, currents, options.seeds, options.seed, lambda done, _: bar.update(done - bar.n)
        )
    table = impact_table(impact, scenario, policy)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        text = json.dumps(table, indent=1, allow_nan=False) + "\n"
        (options.output / "impact.json").write_text(text, encoding="utf-8")
    except OSError as cause:
        raise InputError(f"Cannot write to {options.output}: {cause}. Choose another folder with -o.") from cause
    _draw(options, scenario, impact)
    _print(options, table)


def _draw(options: WaterImpact, scenario, impact) -> None:  # type: ignore[no-untyped-def]  # imported where used
    from aquanav_tools.evaluate.water_impact import by_current
    from aquanav_tools.report.impact_plot import draw_impact
    from aquanav_tools.report.recording.cave import CaveModel
    from aquanav_tools.report.recording.impact import record_impact

    replays = by_current(impact)
    line = scenario.guide.centreline
    draw_impact(scenario.name, scenario.cavity, impact.ideal, line, replays, options.output / "impact.svg")
    record_impact(CaveModel(scenario), impact.ideal, replays, impact.hull, options.output / "impact.rrd")


def _print(options: WaterImpact, table) -> None:  # type: ignore[no-untyped-def]  # a table for JSON
    print(
        f"{table['policy']} swam {table['ideal_path_length']:.1f} m to the goal of {table['scenario']} in "
        f"{table['duration']:.0f} s of still water, from start {table['start']}. The same actions in currents:"
    )
    heads = f"{'reach goal':>12}{'touch wall':>12}{'contacts':>10}{'off, mean':>11}{'off, most':>11}"
    print(f"  {'current':<8}{'m/s':>6}{heads}")
    for row in table["currents"]:
        print(
            f"  {row['current']:<8}{row['strength']:>6g}{row['reached_the_goal']:>8} of {row['replays']}"
            f"{row['touched_the_wall']:>7} of {row['replays']}{row['mean_collisions']:>10.1f}"
            f"{row['mean_deviation']:>9.2f} m{row['max_deviation']:>9.2f} m"
        )
    print(f"Numbers:   {options.output / 'impact.json'}\nPicture:   {options.output / 'impact.png'}")
    print(f"Recording: rerun {options.output / 'impact.rrd'}")
