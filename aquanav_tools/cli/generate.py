"""aquanav generate: scenarios in caves that are drawn from a style and seeds."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from aquanav_tools.cli.command import stage_bar
from aquanav_tools.errors import InputError
from aquanav_tools.synthetic.styles.names import MIXED
from aquanav_tools.workers.ray_cluster import ADDRESS


@dataclass(frozen=True)
class Generate:
    """Draw caves without end, and build them into the cache folder: each is a scenario called generated/STYLE/SEED.

    That name will do wherever a scenario is asked for; what is not built yet is built then. The same style and seed are
    the same cave always. Styles: phreatic-tube, vadose-canyon, bedding-plane, breakdown-chamber, shaft-ramp, maze,
    sump-series, flooded-gallery, mine-drift, fault-fissure, crawlway; mixed picks one by the seed. Of several caves
    each is built whole or not at all: after a kill the same command goes on with those that are left. The cache keeps
    10 GB of drawn caves, and drops those that were not used for longest.
    """

    style: str = MIXED
    """What kind of cave."""
    seed: int = 0
    """Picks the cave."""
    count: int = 1
    """How many, with seeds from `seed` upwards."""
    workers: int = 0
    """Processes that build them; one for each free core when 0."""
    ray: str | None = None
    """Build them on the Ray cluster at HOST:PORT (auto finds one that runs here). This machine must be one of its
    nodes, and the cache folder must be the same for all. Needs pip install 'aquanav[cluster]'."""


def run_generate(options: Generate) -> None:
    """Build the caves and print where each lies.

    Raises:
        InputError: there is no such style, or a number is out of range.
        MeshError: caves could not be built; the message says which, and why.
        ResourceError: workers end again and again, the cluster does not answer, or the cache cannot be written to.
    """
    from aquanav_tools.build.generated_set import CaveTask, build_set
    from aquanav_tools.errors import MeshError
    from aquanav_tools.synthetic.styles.names import style_of

    _check(options)
    tasks = [CaveTask(options.style, options.seed + n) for n in range(options.count)]
    for task in tasks:
        style_of(task.style, task.seed)
    faults = []
    with stage_bar(f"{len(tasks)} cave{'s' if len(tasks) > 1 else ''}") as progress:
        for done, (task, built) in enumerate(build_set(tasks, options.workers, options.ray), 1):
            progress(done, len(tasks))
            if built.folder is None:
                faults.append(f"seed {task.seed}: {built.fault}")
            else:
                print(built.folder)
            if options.count > 1 and not sys.stderr.isatty():
                state = "built" if built.folder else "not built"
                print(f"generated/{task.style}/{task.seed} is {state} ({done} of {len(tasks)}).", file=sys.stderr)
    if faults:
        raise MeshError(f"{len(faults)} of {len(tasks)} caves could not be built. {' '.join(faults)}")


def _check(options: Generate) -> None:
    if options.count < 1 or options.workers < 0:
        raise InputError(f"--count {options.count} must be at least 1, and --workers {options.workers} not negative.")
    if options.ray is not None and not ADDRESS.fullmatch(options.ray):
        raise InputError(f"--ray is {options.ray!r}; give auto, or the HOST:PORT that `ray start --head` shows.")
