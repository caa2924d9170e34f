"""Build caves from rendered and real photos and hold the results against the truth, COLMAP's command line beside it.

    python eval/benchmarks/photos.py                    # all; takes up where the last run stopped; keeps eval/results
    python eval/benchmarks/photos.py --fresh            # all, from the beginning
    python eval/benchmarks/photos.py --again            # all builds again, with what of the last ones is still valid
    python eval/benchmarks/photos.py --only clear       # sets whose name contains it
    python eval/benchmarks/photos.py --only clear --keep    # and put their rows into eval/results, beside the others
    python eval/benchmarks/photos.py --photos 24 --only clear   # fewer photos, to try it
    python eval/benchmarks/photos.py --peer real        # COLMAP beside the real sets only; `none` does without it

Every set is rendered by `aquanav render` (or read from the data folder), then built by the command aquanav-build-cave
in a process of its own; COLMAP (Debian's package colmap) follows when all are built. Photos, builds and the figures of
each finished set are kept in out/photos. Give it an idle machine: about 10 minutes per set on two cores, longer for
COLMAP.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from aquanav_tools.store import write_whole
from eval.child import run_child
from eval.corpus.run import outcome, sentence
from eval.photos.sets import CASES, PhotoSetCase
from eval.photos.table import print_table, write_table
from eval.smoke import parser_of

ROOT = Path(__file__).parents[2]
DATA_DIR = Path(os.environ.get("AQUANAV_DATA", ROOT.parent / "shared" / "data"))
RENDER = "from aquanav_tools.cli.info import main; main()"
Run = Callable[[PhotoSetCase, argparse.Namespace], dict[str, Any]]
NO_TIME = {"seconds": 0.0, "cpu_seconds": 0.0}
SMOKE_PHOTOS = 10
TAKEN_SHARE = 0.2
"""A stage that took less than this share of its earlier CPU time was not carried out again."""
BUILD = "from aquanav_tools.cli.build_cave import main; main()"


def parse_arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--only", default="", help="only sets whose name contains this")
    parser.add_argument("--keep", action="store_true", help="put the rows of --only into eval/results")
    parser.add_argument("--photos", type=int, default=0, help="photos per rendered set, when not its own number")
    parser.add_argument("--quality", default="standard", help="draft, standard or high")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    parser.add_argument(
        "--again", action="store_true", help="build again, using stages that are still valid; those keep their times"
    )
    parser.add_argument("--peer", choices=("all", "real", "none"), default="all", help="sets that COLMAP gets too")
    parser.add_argument("--timeout", type=float, default=7200.0, help="seconds a build may take")
    parser.add_argument("--data", type=Path, default=DATA_DIR, help="folder with the real photos; skipped when absent")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "photos", help="where photos and builds go")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.only, arguments.photos, arguments.quality, arguments.fresh = "clear", SMOKE_PHOTOS, "draft", True
        arguments.output /= "smoke"
        if shutil.which("colmap") is None:
            arguments.peer = "none"
            print("COLMAP is left out: there is no command colmap here (Debian's package colmap).")
    return arguments


def main() -> None:
    """Run what is not done yet and print the table."""
    arguments = parse_arguments()
    if arguments.peer != "none" and shutil.which("colmap") is None:
        sys.exit("There is no command colmap here. Install Debian's package colmap, or add --peer none.")
    cases = [case for case in CASES if arguments.only in case.name]
    missing = [case.name for case in cases if case.folder and not (arguments.data / case.folder).is_dir()]
    if missing:
        print(f"Skipped, since {arguments.data} lacks them: {', '.join(missing)}.")
    cases = [case for case in cases if case.name not in missing]
    with_peer = [case for case in cases if arguments.peer == "all" or (arguments.peer == "real" and case.folder)]
    if arguments.fresh:
        for case in cases:
            for step in ("build", "peer"):
                _kept(case, step, arguments).unlink(missing_ok=True)
    for case in cases:
        if arguments.again:
            write_figures(run_case(case, arguments), case, "build", arguments)
        result = once(run_case, case, "build", arguments)
        print(f"{case.name}: {result['outcome']}, {result.get('registered', 0)} of {result['photos']}", flush=True)
    for case in with_peer:
        result = once(run_peer, case, "peer", arguments)
        print(f"{case.name}: COLMAP {result['outcome']}, {result.get('registered', 0)} registered", flush=True)
    results = [once(run_case, case, "build", arguments) for case in cases]
    for case, result in zip(cases, results, strict=True):
        if case in with_peer:
            result["peer"] = once(run_peer, case, "peer", arguments)
    print_table(results)
    is_all = not arguments.only and not missing
    if (is_all or arguments.keep) and not arguments.photos:
        write_table(results, ROOT / "eval" / "results", [case.name for case in CASES])


def once(run: Run, case: PhotoSetCase, step: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of one step of a set, from an earlier run where there was one."""
    if not _kept(case, step, arguments).exists():
        write_figures(run(case, arguments), case, step, arguments)
    return read_figures(case, step, arguments)


def read_figures(case: PhotoSetCase, step: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what `write_figures` kept."""
    figures: dict[str, Any] = json.loads(_kept(case, step, arguments).read_text(encoding="utf-8"))
    return figures


def write_figures(figures: dict[str, Any], case: PhotoSetCase, step: str, arguments: argparse.Namespace) -> None:
    """Keep the figures of one step of a set."""
    kept = _kept(case, step, arguments)
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_whole(kept, json.dumps(figures, indent=1))


def run_case(case: PhotoSetCase, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of one set."""
    folder = arguments.output / case.name
    photos = photos_of(case, arguments)
    build = folder / "cave"
    earlier: dict[str, Any] = {"stages": {}, "peak_gb": 0.0}
    if arguments.again and _kept(case, "build", arguments).exists():
        earlier = read_figures(case, "build", arguments)
    else:
        shutil.rmtree(build, ignore_errors=True)
    flags = ["--quality", arguments.quality, "--overwrite"]
    # Real photos are held against cameras in whatever unit.
    flags += ["--positions", str(photos / "positions.csv")] if case.condition else case.flags
    command = [sys.executable, "-c", BUILD, str(photos), "-o", str(build), *flags]
    ended = run_child(command, arguments.timeout)
    result: dict[str, Any] = {"name": case.name, "is_metric": case.is_metric, "outcome": outcome(ended)}
    result["commit"] = commit()
    result |= {"seconds": ended.seconds, "cpu_seconds": ended.cpu_seconds}
    result |= {"sentence": sentence(ended).replace(f"{folder}/", "")}
    result["photos"] = len([path for path in photos.iterdir() if path.suffix.lower() in (".jpg", ".png")])
    record = build / "build.json"
    stages = json.loads(record.read_text(encoding="utf-8"))["stages"] if record.exists() else []
    made = {stage["title"]: {key: stage[key] for key in ("seconds", "cpu_seconds")} for stage in stages}
    result["stages"] = stage_times(made, earlier["stages"])
    for key in ("seconds", "cpu_seconds"):
        result[key] += sum(times[key] - made.get(title, NO_TIME)[key] for title, times in result["stages"].items())
    result["peak_gb"] = max(ended.peak_gb, earlier["peak_gb"])
    return result | judge(case, build, photos, arguments.data)


def commit() -> str:
    """Return the short name of the commit that is checked out, and whether files differ from it."""
    command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude", "*"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def stage_times(made: dict[str, Any], earlier: dict[str, Any]) -> dict[str, Any]:
    """Return the times of a build's stages, of those that were taken from its work folder the earlier ones."""
    times = dict(made)
    for title, before in earlier.items():
        if made.get(title, NO_TIME)["cpu_seconds"] < TAKEN_SHARE * before["cpu_seconds"]:
            times[title] = before
    return times


def photos_of(case: PhotoSetCase, arguments: argparse.Namespace) -> Path:
    """Return the folder of a set's photos, made where it is missing."""
    photos = arguments.output / case.name / "photos"
    return render(case, photos, arguments) if case.condition else link(case, photos, arguments)


def render(case: PhotoSetCase, photos: Path, arguments: argparse.Namespace) -> Path:
    """Return the folder of a rendered dive; one that is there is kept."""
    if not (photos / "truth_wall.ply").exists():
        command = [sys.executable, "-c", RENDER, "render", "--condition", case.condition, "--out", str(photos)]
        command += ["--photos", str(arguments.photos)] if arguments.photos else []
        ended = run_child(command, arguments.timeout)
        if ended.exit_code != 0:
            sys.exit(f"Rendering {case.name} ended with {ended.exit_code}: {sentence(ended)}")
    return photos


def link(case: PhotoSetCase, photos: Path, arguments: argparse.Namespace) -> Path:
    """Return a folder with links to a real set's photos and nothing else."""
    shutil.rmtree(photos, ignore_errors=True)
    photos.mkdir(parents=True)
    inner, pattern = case.images
    for path in sorted((arguments.data / case.folder / inner).glob(pattern))[:: case.every]:
        (photos / path.name).symlink_to(path.resolve())
    return photos


def judge(case: PhotoSetCase, build: Path, photos: Path, data: Path) -> dict[str, Any]:
    """Return how a build fits what is known about its set."""
    from eval.photos.depth_truth import read_depth_reference
    from eval.photos.judge import judge_real, judge_rendered

    if case.condition:
        return judge_rendered(build, photos)
    folder = data / case.folder
    centres = {} if case.reference is None else case.reference(folder)
    return judge_real(build, centres, read_depth_reference(folder) if case.has_depth else None, is_loop=case.is_loop)


def run_peer(case: PhotoSetCase, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what COLMAP's command line makes of the same photos."""
    from eval.photos.judge import judge_cameras
    from eval.photos.peer import run_colmap
    from eval.photos.score import read_true_cameras

    photos = photos_of(case, arguments)
    result = run_colmap(photos, arguments.output / case.name / "colmap", arguments.timeout)
    if case.condition:
        truth = read_true_cameras(photos)
        centres = dict(zip(truth.names, truth.centres, strict=True))
    else:
        centres = {} if case.reference is None else case.reference(arguments.data / case.folder)
    cameras = result.pop("cameras")
    return result | {"is_metric": case.is_metric} | judge_cameras(cameras, centres)


def _kept(case: PhotoSetCase, step: str, arguments: argparse.Namespace) -> Path:
    path: Path = arguments.output / case.name / f"{step}.json"
    return path


if __name__ == "__main__":
    main()
