"""Build every scan of the corpus and hold the results against the truth.

    python eval/corpus/run.py                # all; takes up where the last run stopped; keeps eval/results/corpus.*
    python eval/corpus/run.py --fresh        # all, from the beginning
    python eval/corpus/run.py --quick        # a dozen small ones
    python eval/corpus/run.py --only demo-0  # those whose name contains it
    python eval/corpus/run.py --held-out     # the second corpus, to judge by; keeps eval/results/corpus-held-out.*
    python eval/corpus/run.py --smoke        # one, to see that everything runs

Each case is written as a file and built by the command aquanav-build-cave in a process of its own. Inputs, scenarios
and one JSON line per finished case are kept in out/corpus.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parents[2]))  # the corpus is no part of the package

from eval.child import Ended, run_child
from eval.corpus.table import print_tables, write_tables
from eval.smoke import parser_of

if TYPE_CHECKING:
    from eval.corpus.cases import Case

BUILD = "from aquanav_tools.cli.build_cave import main; main()"
ERROR_CODES = range(2, 7)
SMOKE_CASE = "tube-holes-20x30cm"
ROOT = Path(__file__).parents[2]
DATA_DIR = ROOT.parent / "shared" / "data"


def parse_arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--quick", action="store_true", help="only a dozen small cases")
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    parser.add_argument("--held-out", action="store_true", help="the caves and damage that nothing was tuned on")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    parser.add_argument("--jobs", type=int, default=1, help="builds at the same time")
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds a build may take")
    parser.add_argument("--data", type=Path, default=DATA_DIR, help="folder with the real scans; skipped when absent")
    parser.add_argument("--output", type=Path, help="where inputs and results go; out/corpus or out/corpus-held-out")
    arguments = parser.parse_args()
    arguments.output = arguments.output or ROOT / "out" / stem(arguments)
    if arguments.smoke:
        arguments.quick, arguments.only, arguments.fresh = True, SMOKE_CASE, True
        arguments.output /= "smoke"
    return arguments


def stem(arguments: argparse.Namespace) -> str:
    """Return the name of the corpus in files."""
    return "corpus-held-out" if arguments.held_out else "corpus"


def main() -> None:
    """Run what is not done yet and print the tables."""
    arguments = parse_arguments()
    store = arguments.output / "results.jsonl"
    arguments.output.mkdir(parents=True, exist_ok=True)
    # Inputs are made and judged in other processes: a build's memory is counted from the size of its parent.
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        names = pool.submit(list_names, arguments).result()
        if arguments.fresh:
            store.unlink(missing_ok=True)
        done = read_results(store)
        todo = [name for name in names if name not in done]
        print(f"{len(names)} inputs, {len(names) - len(todo)} done before.", flush=True)
        began = time.monotonic()
        with ThreadPoolExecutor(arguments.jobs) as threads:
            running = [threads.submit(run_case, pool, name, arguments) for name in todo]
            for place, future in enumerate(as_completed(running)):
                result = future.result()
                done[result["name"]] = result
                with store.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(result) + "\n")
                left = (time.monotonic() - began) / (place + 1) * (len(todo) - place - 1)
                print(f"{place + 1}/{len(todo)} {summary(result)}; {left / 60:.0f} min left", flush=True)
    results = [done[name] for name in names]
    print_tables(results)
    if not arguments.quick and not arguments.only:
        write_tables(results, ROOT / "eval" / "results" / stem(arguments))
    sys.exit(not all(result["ok"] for result in results))


def list_names(arguments: argparse.Namespace) -> list[str]:
    """Return the names of the wanted cases, bad inputs last."""
    from eval.corpus.bad_inputs import bad_inputs

    cases = [case.name for case in cases_of(arguments) if case.is_quick or not arguments.quick]
    has_bad = not (arguments.quick or arguments.held_out)
    bad = [f"bad-{bad.name}" for bad in bad_inputs()] if has_bad else []
    return [name for name in [*cases, *bad] if arguments.only in name]


def cases_of(arguments: argparse.Namespace) -> list[Case]:
    """Return all cases of the corpus."""
    from eval.corpus.cases import all_cases
    from eval.corpus.held_out import held_out_cases

    return held_out_cases() if arguments.held_out else all_cases(arguments.data)


def run_case(pool: ProcessPoolExecutor, name: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the result of one case."""
    folder = arguments.output / name
    case = pool.submit(make_input, name, folder, arguments).result()
    shutil.rmtree(folder / "cave", ignore_errors=True)
    command = [sys.executable, "-c", BUILD, case["path"], "-o", str(folder / "cave"), *case["flags"]]
    ended = run_child(command, arguments.timeout)
    result = case | {"outcome": outcome(ended), "seconds": ended.seconds, "peak_gb": ended.peak_gb}
    result |= {"exit_code": ended.exit_code, "sentence": sentence(ended).replace(f"{folder}/", "")}
    if result["outcome"] == "proven":
        result |= pool.submit(judge_build, folder).result()
    return result | {"faults": faults(result), "ok": not faults(result)}


def make_input(name: str, folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Write a case's input into its folder; return what is known about it."""
    from eval.corpus.bad_inputs import bad_inputs
    from eval.corpus.files import write_case

    folder.mkdir(parents=True, exist_ok=True)
    if name.startswith("bad-"):
        bad = next(bad for bad in bad_inputs() if f"bad-{bad.name}" == name)
        bad.write(folder / bad.file_name)
        about = {"path": folder / bad.file_name, "group": "bad input", "error": bad.error, "flags": ()}
        return {"name": name, **about, "path": str(about["path"])}
    case = next(case for case in cases_of(arguments) if case.name == name)
    scan = case.make()
    expected = {"expected_portals": scan.truth.num_portals, "expected_genus": scan.truth.genus}
    limits = {
        "max_volume_error": case.max_volume_error,
        "min_covered": case.min_covered,
        "has_fit": case.has_fit,
        "keeps_handles": case.keeps_handles,
    }
    path = str(write_case(scan, folder))
    return {
        "name": name,
        "path": path,
        "group": case.group,
        "error": case.error,
        "flags": case.flags,
        **expected,
        **limits,
    }


def judge_build(folder: Path) -> dict[str, Any]:
    """Return how a finished build compares with its case's truth; nothing for a bad input that was built."""
    from eval.corpus.files import read_truth
    from eval.corpus.judge import judge

    return judge(folder / "cave", *read_truth(folder)) if (folder / "truth.npz").exists() else {}


def outcome(ended: Ended) -> str:
    """Return "proven", "error" (a sentence and its code), "crash" or "timeout"."""
    if ended.exit_code is None:
        return "timeout"
    if ended.exit_code == 0:
        return "proven"
    is_clear = ended.exit_code in ERROR_CODES and "Traceback" not in ended.errors
    return "error" if is_clear else "crash"


def sentence(ended: Ended) -> str:
    """Return the last line the command said, without the progress bars."""
    lines = [line.split("\r")[-1].strip() for line in (ended.errors or ended.output).splitlines()]
    said = [line for line in lines if line and "%" not in line[:60].split("|")[0]]
    return said[-1] if said else ""


def faults(result: dict[str, Any]) -> list[str]:
    """Return what is wrong with a result, in words."""
    found = []
    if result["outcome"] in ("crash", "timeout"):
        return [result["outcome"]]
    if result["error"]:
        is_right = result["outcome"] == "error" and re.search(result["error"], result["sentence"])
        return [] if is_right else [f"should stop with a sentence about {result['error']}"]
    if result["outcome"] == "error":
        return ["not proven"]
    if not result["is_volume"]:
        found.append("no closed volume in one piece")
    if result["crossings"]:
        found.append(f"{result['crossings']} pairs of faces cross")
    if abs(result.get("volume_error", 0.0)) > result["max_volume_error"]:
        found.append(f"volume off by {result['volume_error']:+.1%}")
    if result.get("path_points_in_rock", 0) or result.get("path_segments_blocked", 0):
        found.append("passage sealed")
    if result.get("covered") is not None and result["covered"] < result["min_covered"]:
        found.append(f"only {result['covered']:.0%} of the passage left")
    more = 0 if result["expected_genus"] is None else result["genus"] - result["expected_genus"]
    if more > 0:
        found.append(f"{more} tunnels invented")
    if more < 0 and result["keeps_handles"]:
        found.append(f"{-more} pillars or loops lost")
    if result["portals"] != result["expected_portals"]:
        found.append(f"{result['portals']} portals, not {result['expected_portals']}")
    if result["has_fit"] and (result["fit_median"] > 0.25 * result["voxel"] or result["fit_95"] > result["voxel"]):
        found.append("loose fit")
    return found


def summary(result: dict[str, Any]) -> str:
    """Return one line about a result."""
    verdict = "as expected" if result["ok"] else "; ".join(result["faults"])
    return f"{result['name']}: {result['outcome']} in {result['seconds']:.0f} s, {verdict}"


def read_results(store: Path) -> dict[str, dict[str, Any]]:
    """Return the results kept so far by name."""
    if not store.is_file():
        return {}
    rows = [json.loads(line) for line in store.read_text(encoding="utf-8").splitlines()]
    return {row["name"]: row for row in rows}


if __name__ == "__main__":
    main()
