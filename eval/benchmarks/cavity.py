"""Measure closing: a scan of a million triangles, by us and by the plain alternatives, side by side.

    python eval/benchmarks/cavity.py                          # ours alone
    python eval/benchmarks/cavity.py --peers VENV/bin/python  # with those that this interpreter can import
    python eval/benchmarks/cavity.py --triangles 100000       # a smaller scan of the same cave
    python eval/benchmarks/cavity.py --smoke                  # only to see that everything runs

For the peers: pip install pymeshfix pymeshlab point-cloud-utils (an environment of its own; some are GPL).
Every method runs in a process of its own. All are judged on the same stretch, away from the two torn ends, where each
of them does something else. The table is kept in eval/results/cavity.md.
"""

from __future__ import annotations

import json
import os
import platform
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # the judge lives with the corpus

from eval.child import Ended, run_child
from eval.smoke import parser_of

ROOT = Path(__file__).parents[2]
NOT_INSTALLED = "cannot be imported"
"""What cavity_peers.py says of a library that its interpreter lacks."""
PEERS = ("open3d-poisson", "pymeshfix", "pymeshlab-alpha-wrap", "pymeshlab-close-holes", "point-cloud-utils-watertight")
BUILD = "from aquanav_tools.cli.build_cave import main; main()"
LENGTH = 50.0
"""Of the cave, m."""
FACES_PER_METRE = 32.3
"""Triangles of this cave per metre of its length, times the square of its voxel; measured at 12 and 20 cm."""
END_MARGIN = 2.5
"""Nothing nearer to the ends counts, m: they are torn up to 0.6 m deep and the passage is 3 m wide."""
NUM_SAMPLES = 50_000
SMOKE_TRIANGLES = 15_000


def make_scan(num_triangles: int, folder: Path) -> None:
    """Write a rough cave of about `num_triangles` with 60 holes, 3 mm of noise and torn ends, and its truth."""
    from aquanav_tools.synthetic import caves as synthetic
    from aquanav_tools.synthetic import damage
    from eval.corpus.files import write_case

    voxel = float(np.sqrt(LENGTH * FACES_PER_METRE / num_triangles))
    scan = damage.intact(synthetic.demo_cave(synthetic.CaveOptions(seed=1, length=LENGTH, winding=4.0, voxel=voxel)))
    scan = damage.punch_holes(scan, number=60, radius=0.25, seed=1)
    scan = damage.add_noise(damage.tear_ends(scan, 0.6, seed=2), 0.003, seed=3)
    write_case(scan, folder)
    np.savez(folder / "scan.npz", vertices=scan.mesh.vertices, faces=scan.mesh.faces)


def run_ours(folder: Path, timeout: float) -> dict[str, Any]:
    """Build the scan with the command; return what it cost, in all and per stage."""
    command = [sys.executable, "-c", BUILD, str(folder / "scan.ply"), "-o", str(folder / "cave"), "--overwrite"]
    ended = run_child(command, timeout)
    row = {"method": "aquanav", **_cost(ended)}
    if ended.exit_code != 0:
        return row
    stages = json.loads((folder / "cave" / "build.json").read_text(encoding="utf-8"))["stages"]
    closing = sum(stage["seconds"] for stage in stages[1:4])
    return row | {"stages": stages, "closing_s": closing}


def run_peer(python: Path, method: str, folder: Path, timeout: float) -> dict[str, Any]:
    """Close the scan with a peer; return what it cost."""
    python = Path(sys.executable) if method == "open3d-poisson" else python  # which the project has itself
    script = Path(__file__).with_name("cavity_peers.py")
    closed = folder / f"{method}.npz"
    closed.unlink(missing_ok=True)
    ended = run_child([str(python), str(script), method, str(folder / "scan.npz"), str(closed)], timeout)
    return {"method": method, **_cost(ended)}


def _cost(ended: Ended) -> dict[str, Any]:
    said = ended.errors.strip().splitlines()
    failure = "timeout" if ended.exit_code is None else said[-1] if said and ended.exit_code else ""
    cost = {"wall_s": ended.seconds, "cpu_s": ended.cpu_seconds, "peak_gb": ended.peak_gb}
    return cost | {"exit_code": ended.exit_code, "failure": failure}


def judge(method: str, folder: Path) -> dict[str, Any]:
    """Return how a method's result compares with the truth between the ends."""
    from aquanav_tools.scenario.folder import read_scenario
    from aquanav_tools.types import Mesh
    from eval.corpus.files import read_truth

    truth, _ = read_truth(folder)
    if method == "aquanav":
        return _compare(read_scenario(folder / "cave").cavity.mesh, truth.solid, truth.paths[0])
    with np.load(folder / f"{method}.npz") as stored:
        mesh = Mesh(stored["vertices"], stored["faces"].astype(np.int64))
        return {"closing_s": float(stored["seconds"])} | _compare(mesh, truth.solid, truth.paths[0])


def _compare(mesh: Any, truth: Any, path: Any) -> dict[str, Any]:
    from aquanav_tools.cave.cavity import to_manifold
    from aquanav_tools.errors import MeshError
    from aquanav_tools.geometry.polyline import resample
    from aquanav_tools.types import Mesh
    from eval.corpus.judge import depth_below, num_blocked

    solid = mesh.to_trimesh()
    if solid.volume < 0.0:  # wound inwards, as open3d's Poisson does: turned round without blame
        mesh = Mesh(mesh.vertices, mesh.faces[:, ::-1])
        solid = mesh.to_trimesh()
    facts: dict[str, Any] = {
        "triangles": len(mesh.faces),
        "is_volume": bool(solid.is_volume),
        "components": int(solid.body_count),
    }
    points = resample(path, 0.05)
    points = points[(points[:, 0] > END_MARGIN) & (points[:, 0] < LENGTH - END_MARGIN)]
    facts |= {
        "outside": float((depth_below(mesh, points) <= 0.0).mean()),
        "blocked": num_blocked(mesh, points[:-1], points[1:]),
        "distances_mm": _distances(mesh, truth),
    }
    try:
        cut = _middle(to_manifold(mesh))
    except MeshError as reason:
        return facts | {"manifold": False, "reason": str(reason)}
    genus = int(1 - solid.euler_number // 2) if facts["components"] == 1 else None
    return facts | {
        "manifold": True,
        "genus": genus,
        "volume_error": cut.volume() / _middle(to_manifold(truth)).volume() - 1,
    }


def _middle(solid: Any) -> Any:
    return solid.trim_by_plane((1.0, 0.0, 0.0), END_MARGIN).trim_by_plane((-1.0, 0.0, 0.0), END_MARGIN - LENGTH)


def _distances(mesh: Any, truth: Any) -> tuple[float, float]:
    """Return the median and 95 % of the distances between both surfaces, either way, mm."""
    both = []
    for here, there in ((mesh, truth), (truth, mesh)):
        points = here.to_trimesh().sample(NUM_SAMPLES, seed=0)
        points = points[(points[:, 0] > END_MARGIN) & (points[:, 0] < LENGTH - END_MARGIN)]
        both.append(_distance(there, points))
    return tuple(1000.0 * np.percentile(np.concatenate(both), (50, 95)))


def _distance(mesh: Any, points: Any) -> Any:
    from aquanav_tools.libraries import load_open3d
    from eval.corpus.judge import scene_of

    tensor = load_open3d().core.Tensor(points.astype(np.float32))
    return scene_of(mesh).compute_distance(tensor).numpy()


def markdown(rows: list[dict[str, Any]], triangles: int, load: float) -> str:
    """Return the kept page."""
    lines = [
        "# Closing a scan, by us and by the plain alternatives",
        "",
        f"A synthetic cave of {LENGTH:.0f} m as a scan of {triangles} triangles with 60 holes, 3 mm of noise and two "
        f"torn ends. {os.cpu_count()} cores, {platform.machine()}; load by others at the start {load:.1f}, which "
        "inflates wall-clock times. Closing: the method alone (ours: preparing and closing); whole: the process, for "
        "ours with distances, route, panels, starts, pictures and files. Judged away from the ends.",
        "",
        "| method | closing (s) | whole (s) | CPU (s) | peak (GB) | manifold3d, is_volume | pieces | volume | "
        "distance 50 / 95 % (mm) | genus | path in rock | path blocked | triangles |",
        "|" + "---|" * 13,
    ]
    lines += ["| " + " | ".join(_row(row)) + " |" for row in rows]
    stages: list[dict[str, Any]] = next((row["stages"] for row in rows if "stages" in row), [])
    lines += ["", "| our stage | s | peak memory (MB) |", "|---|---|---|"]
    lines += [f"| {stage['title']} | {stage['seconds']:.1f} | {stage['peak_memory_mb']:.0f} |" for stage in stages]
    return "\n".join(lines) + "\n"


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    closing = f"{row['closing_s']:.1f}" if "closing_s" in row else ""
    cost = (row["method"], closing, f"{row['wall_s']:.1f}", f"{row['cpu_s']:.1f}", f"{row['peak_gb']:.2f}")
    if "manifold" not in row:
        return (*cost, f"failed: {row['failure']}".replace("|", "/"), *[""] * 7)
    error = f"{row['volume_error']:+.1%}" if row["manifold"] else "?"
    genus = "?" if row.get("genus") is None else str(row["genus"])
    valid = f"{'yes' if row['manifold'] else 'no'}, {'yes' if row['is_volume'] else 'no'}"
    distance = " / ".join(f"{value:.1f}" for value in row["distances_mm"])
    blocked, outside = str(row["blocked"]), f"{row['outside']:.0%}"
    return (*cost, valid, str(row["components"]), error, distance, genus, outside, blocked, str(row["triangles"]))


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--peers", type=Path, help="interpreter that has the peers' libraries")
    parser.add_argument("--triangles", type=int, default=1_000_000, help="size of the scan, about")
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds a method may take")
    arguments = parser.parse_args()
    peers: tuple[str, ...] = PEERS if arguments.peers else ()
    if arguments.smoke:
        arguments.triangles, peers = SMOKE_TRIANGLES, PEERS[:1]
        print(f"{', '.join(PEERS[1:])}: left out, they need an environment of their own (--peers).")
    folder = ROOT / "out" / "benchmarks" / f"cavity-{arguments.triangles}"
    load = os.getloadavg()[0]
    # Large work is done in a process of its own: a child's memory is counted from its parent's.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        if not (folder / "scan.npz").exists():
            pool.submit(make_scan, arguments.triangles, folder).result()
        with np.load(folder / "scan.npz") as scan:
            triangles = len(scan["faces"])
        rows = []
        for method in ("aquanav", *peers):
            is_ours = method == "aquanav"
            row = run_ours(folder, arguments.timeout) if is_ours else None
            row = row or run_peer(arguments.peers, method, folder, arguments.timeout)
            if NOT_INSTALLED in row["failure"]:
                print(f"{method}: left out. {row['failure']}", flush=True)
                continue
            row |= pool.submit(judge, method, folder).result() if row["exit_code"] == 0 else {}
            rows.append(row)
            print("  ".join(_row(row)), flush=True)
    page = markdown(rows, triangles, load)
    print("\n" + page)
    if arguments.triangles >= 1_000_000:
        (ROOT / "eval" / "results" / "cavity.md").write_text(page, encoding="utf-8")
    sys.exit(rows[0]["exit_code"] != 0)


if __name__ == "__main__":
    main()
