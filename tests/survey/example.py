"""A small survey written for these tests, where Survex puts its stations, and Survex itself where it is installed."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.types import Array

LOOPS = """\
; every line below was made up; all loops misclose, so that positions depend on the weights
*title "Loops"
*fix upper.1
*equate entrance upper.1
*entrance entrance
*begin upper
*export 1 2 5 6 7
*calibrate declination -3.2
1 2 12.34 45.0 -10.5
2 3 10.20 120.5 5.0
3 4 8.80 200.0 LEVEL
4 1 11.95 284.0 7.5
*alias station - ..
3 - 2.50 300 10
3 . 1.50 20 -60
3 ... 4.50 90 0
4 5 6.10 - DOWN
5 6 9.00 170 -
6 7 7.50 80 -
7 4 10.00 300 18
*flags surface
1 20 15.00 10 30
*flags not surface duplicate
4 1 11.90 284.5 7.0
4 1 12.00 283.5 7.2
*end upper
*begin back
*export 1
*units compass backcompass clino backclino grads
*data normal from to tape compass backcompass clino backclino
1 2 12.0 50.0 251.0 5.0 -6.0
2 3 10.5 160.0 - -4.0 -
3 1 16.5 301.0 100.5 -1 0.5
*end back
*equate back.1 upper.5
*begin digitised
*export 1
*data cartesian from to easting northing altitude
1 2 5 6 -1
2 3 -3 7 0.5
*data normal station newline tape compass clino
3
 9.3 170.5 -2.0
 ; a note does not end the traverse
4
 4.4 182 1
1

3
 5 90 0
5
*end digitised
*equate digitised.1 upper.7
*begin gone
*export 1
*case preserve
*data normal from to compass tape clino
1 a 10 3.5 0
1 A 100 4.5 0
*data nosurvey from to
a A
*end gone
*equate gone.1 upper.6
*data passage station left right up down
upper.1 1 2 3 0.5
upper.2 1.5 1 - 0.7
"""

SCALE = 100
"""Survex rounds to centimetres; a survey a hundred times as large shows tenths of millimetres."""

ENLARGED = """\
*calibrate tape dx dy dz 0 100
*sd tape dx dy dz position 5 metres
*include loops
"""


def cavern(path: Path, out: Path) -> tuple[dict[str, Array], float]:
    """Return what Survex makes of a data file: positions by name and adjusted length, m. Skips without Survex."""
    if not shutil.which("cavern") or not shutil.which("dump3d"):
        pytest.skip("Survex is not installed (cavern, dump3d); on Debian it is the package survex.")
    run = subprocess.run(["cavern", "-o", str(out), str(path)], capture_output=True, text=True, cwd=out)
    assert run.returncode == 0, run.stdout + run.stderr
    image = out / (path.stem + ".3d")
    dump = subprocess.run(["dump3d", str(image)], capture_output=True, text=True, check=True).stdout
    nodes = re.findall(r"^NODE (\S+) (\S+) (\S+) \[(.+)\]", dump, re.MULTILINE)
    length = re.search(r"\(\s*([0-9.]+)m adjusted\)", run.stdout)
    assert length is not None
    return {name: np.array([float(x), float(y), float(z)]) for x, y, z, name in nodes}, float(length[1])
