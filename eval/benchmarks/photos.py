"""Build caves from rendered and real photos and hold the results against the truth, COLMAP's command line beside it.

    python eval/benchmarks/photos.py                    # all; takes up where the last run stopped; keeps eval/results
    python eval/benchmarks/photos.py --fresh            # all, from the beginning
    python eval/benchmarks/photos.py --only clear       # sets whose name contains it
    python eval/benchmarks/photos.py --photos 24 --only clear   # fewer photos, to try it
    python eval/benchmarks/photos.py --no-peer          # without COLMAP, where Debian's package colmap is missing

Every set is rendered by `aquanav render` (or read from the data folder), then built by the command aquanav-build-cave
in a process of its own. Photos, builds and one JSON line per finished set are kept in out/photos. Give it an idle
machine: about 15 minutes per set on two cores, as long again for COLMAP.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from eval.child import run_child
from eval.corpus.run import outcome, sentence
from eval.photos.sets import CASES, PhotoSetCase
from eval.photos.table import print_table, write_table

ROOT = Path(__file__).parents[2]
DATA_DIR = Path(os.environ.get("AQUANAV_DATA", ROOT.parent / "shared" / "data"))
RENDER = "from aquanav_tools.cli.info import main; main()"
BUILD = "from aquanav_tools.cli.build_cave import main; main()"


def parse_arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="only sets whose name contains this")
    parser.add_argument("--photos", type=int, default=0, help="photos per rendered set, when not its own number")
    parser.add_argument("--quality", default="standard", help="draft, standard or high")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    parser.add_argument("--no-peer", action="store_true", help="without COLMAP's command line")
    parser.add_argument("--timeout", type=float, default=7200.0, help="seconds a build may take")
    parser.add_argument("--data", type=Path, default=DATA_DIR, help="folder with the real photos; skipped when absent")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "photos", help="where photos and builds go")
    return parser.parse_args()


def main() -> None:
    """Run what is not done yet and print the table."""
    arguments = parse_arguments()
    if not arguments.no_peer and shutil.which("colmap") is None:
        sys.exit("There is no command colmap here. Install Debian's package colmap, or add --no-peer.")
    arguments.output.mkdir(parents=True, exist_ok=True)
    store = arguments.output / "results.jsonl"
    if arguments.fresh:
        store.unlink(missing_ok=True)
    cases = [case for case in CASES if arguments.only in case.name]
    missing = [case.name for case in cases if case.folder and not (arguments.data / case.folder).is_dir()]
    if missing:
        print(f"Skipped, since {arguments.data} lacks them: {', '.join(missing)}.")
    done = _read(store)
    for case in cases:
        if case.name in done or case.name in missing:
            continue
        result = run_case(case, arguments)
        done[case.name] = result
        with store.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(result) + "\n")
        print(f"{case.name}: {result['outcome']}, {result.get('registered', 0)} of {result['photos']}", flush=True)
    results = [done[case.name] for case in cases if case.name in done]
    print_table(results)
    if not arguments.only and not arguments.photos and not missing:
        write_table(results, ROOT / "eval" / "results")


def run_case(case: PhotoSetCase, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of one set."""
    folder = arguments.output / case.name
    photos = render(case, folder / "photos", arguments) if case.condition else link(case, folder / "photos", arguments)
    build = folder / "cave"
    shutil.rmtree(build, ignore_errors=True)
    flags = ["--quality", arguments.quality]
    if case.condition:
        flags += ["--positions", str(photos / "positions.csv")]
    command = [sys.executable, "-c", BUILD, str(photos), "-o", str(build), *flags]
    ended = run_child(command, arguments.timeout)
    result = {"name": case.name, "is_metric": case.is_metric, "outcome": outcome(ended)}
    result |= {"seconds": ended.seconds, "cpu_seconds": ended.cpu_seconds, "peak_gb": ended.peak_gb}
    result |= {"sentence": sentence(ended).replace(f"{folder}/", "")}
    result["photos"] = len([path for path in photos.iterdir() if path.suffix.lower() in (".jpg", ".png")])
    record = build / "build.json"
    stages = json.loads(record.read_text(encoding="utf-8"))["stages"] if record.exists() else []
    result["stages"] = {stage["title"]: stage["seconds"] for stage in stages}
    result |= judge(case, build, photos, arguments.data)
    if not arguments.no_peer:
        result["peer"] = run_peer(case, photos, folder / "colmap", arguments)
    return result


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
    for path in sorted((arguments.data / case.folder / inner).glob(pattern)):
        (photos / path.name).symlink_to(path.resolve())
    return photos


def judge(case: PhotoSetCase, build: Path, photos: Path, data: Path) -> dict[str, Any]:
    """Return how a build fits what is known about its set."""
    from eval.photos.judge import judge_cameras, judge_rendered, read_cameras

    if case.condition:
        return judge_rendered(build, photos)
    if case.reference is None:
        return {"registered": len(read_cameras(build))}
    return judge_cameras(read_cameras(build), case.reference(data / case.folder))


def run_peer(case: PhotoSetCase, photos: Path, folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what COLMAP's command line makes of the same photos."""
    from eval.photos.judge import judge_cameras
    from eval.photos.peer import run_colmap
    from eval.photos.score import read_true_cameras

    result = run_colmap(photos, folder, arguments.timeout)
    if case.condition:
        truth = read_true_cameras(photos)
        centres = dict(zip(truth.names, truth.centres, strict=True))
    else:
        centres = {} if case.reference is None else case.reference(arguments.data / case.folder)
    cameras = result.pop("cameras")
    return result | {"is_metric": case.is_metric} | judge_cameras(cameras, centres)


def _read(store: Path) -> dict[str, dict[str, Any]]:
    if not store.is_file():
        return {}
    rows = [json.loads(line) for line in store.read_text(encoding="utf-8").splitlines()]
    return {row["name"]: row for row in rows}


if __name__ == "__main__":
    main()
