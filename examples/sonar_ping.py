"""Draw what a forward imaging sonar hears at a start of a cave: python examples/sonar_ping.py --scenario cave-test-1.

The fan is drawn as from above, the vehicle at the bottom looking up; beside it rings of range.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.factory import cave_of, read_any_scenario
from aquanav_tools.sim.batch.sensors.sonar import ImagingSonar
from aquanav_tools.sim.batch.sensors.sonar_sheet import SonarSheet

RING = 2.0
"""Between rings, m."""
PAPER, INK = (42, 31, 11), (200, 190, 170)
"""Blue, green, red."""


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="cave-test-1", help="a scenario folder, or the name of one that ships")
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--max-range", type=float, default=10.0, help="m")
    parser.add_argument("--width", type=int, default=720, help="px")
    parser.add_argument("--out", type=Path, default=Path("sonar.png"))
    options = parser.parse_args()
    sonar = ImagingSonar(SonarSheet(max_range=options.max_range, dynamic_range_db=40.0))
    cave = cave_of(read_any_scenario(options.scenario), "A sonar")
    env = CaveEnv(cave, observation={"sonar": sonar}, contacts="own")
    observation: Any = env.reset(seed=1, options={"start": options.start})[0]
    env.close()
    picture = drawn(observation["sonar"], sonar.data, options.width)
    Image.fromarray(picture[..., ::-1]).quantize(64).save(options.out, optimize=True)
    print(f"{options.out}: {options.out.stat().st_size / 1e3:.0f} kB")


def drawn(ping: Any, sonar: SonarSheet, width: int) -> Any:
    """Return a (beams, bins) ping as a picture (H, W, 3), blue, green, red."""
    half = 0.5 * np.radians(sonar.horizontal_aperture_deg)
    per_metre = 0.45 * width / (sonar.max_range * np.sin(min(half, 0.5 * np.pi)))
    height = int(per_metre * sonar.max_range) + 20
    ahead = (height - 10 - np.arange(height))[:, None] / per_metre
    left = (0.5 * width - np.arange(width))[None, :] / per_metre
    distance, azimuth = np.hypot(ahead, left), np.arctan2(left, ahead)
    beams = (azimuth + half) / (2.0 * half) * (sonar.num_beams - 1)
    bins = (distance - sonar.min_range) / sonar.bin_size - 0.5
    levels = cv2.remap(ping, bins.astype(np.float32), beams.astype(np.float32), cv2.INTER_LINEAR)
    picture = cv2.applyColorMap(np.clip(255.0 * levels, 0, 255).astype(np.uint8), cv2.COLORMAP_INFERNO)
    picture[(np.abs(azimuth) > half) | (distance > sonar.max_range)] = PAPER
    for ring in np.arange(RING, sonar.max_range + 1e-6, RING):
        radius, middle = round(per_metre * ring), (width // 2, height - 10)
        span = np.degrees(half)
        cv2.ellipse(picture, middle, (radius, radius), -90.0, -span, span, INK, 1, cv2.LINE_AA)
        place = (round(middle[0] + radius * np.sin(half)) + 4, round(middle[1] - radius * np.cos(half)) + 4)
        cv2.putText(picture, f"{ring:g} m", place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, INK, 1, cv2.LINE_AA)
    return picture


if __name__ == "__main__":
    main()
