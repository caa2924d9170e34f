"""A run's policy as it ships: eval/policies/NAME.zip, without the optimiser's moments, and NAME.onnx.

    aquanav-train --pipeline generated --seed 0 -o out/generated
    python eval/publish_policy.py out/generated reference-echosounders

The moments, two thirds of a zip, serve going on with its lesson; `--init` and evaluations leave them.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import zipfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from eval.pages import ROOT

POLICIES = ROOT / "eval" / "policies"
MOMENTS = "policy.optimizer.pth"


def publish(run: Path, name: str, folder: Path = POLICIES) -> tuple[Path, Path]:
    """Write the files of a run's last policy under a name; return the zip's path and the ONNX file's."""
    missing = [file for file in ("policy.zip", "policy.onnx") if not (run / file).is_file()]
    if missing:
        raise SystemExit(f"{run} has no {' and no '.join(missing)}. Name the output folder of an ended aquanav-train.")
    zipped, exported = folder / f"{name}.zip", folder / f"{name}.onnx"
    with (
        zipfile.ZipFile(run / "policy.zip") as source,
        zipfile.ZipFile(zipped, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as target,
    ):
        for member in source.namelist():
            content = source.read(member)
            # A fixed date: the same run gives the same bytes.
            target.writestr(_undated(member), _without_moments(content) if member == MOMENTS else content)
    shutil.copyfile(run / "policy.onnx", exported)
    return zipped, exported


def _undated(member: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(member)
    info.compress_type = zipfile.ZIP_DEFLATED
    return info


def _without_moments(content: bytes) -> bytes:
    import torch

    optimiser = torch.load(io.BytesIO(content), weights_only=True)
    stream = io.BytesIO()
    torch.save({**optimiser, "state": {}}, stream)
    return stream.getvalue()


def main() -> None:
    """Publish what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="output folder of aquanav-train")
    parser.add_argument("name", help="of the policy: baseline:NAME")
    options = parser.parse_args()
    for path in publish(options.run, options.name):
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
