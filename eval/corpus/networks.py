"""Branching caves of the corpus, smooth and rough, as they are and damaged."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

from aquanav_tools.synthetic import damage
from aquanav_tools.synthetic import networks as synthetic_networks
from aquanav_tools.synthetic.damage import DamagedScan, Truth
from aquanav_tools.synthetic.networks import Network
from eval.corpus.cases import Case

ROUGHNESS = 0.12
"""Relief of the rough ones, m."""


def known(network: Network, *, is_rough: bool = True) -> DamagedScan:
    """Return a network undamaged; every passage's axis is a path that must stay open."""
    if is_rough:
        network = dataclasses.replace(network, roughness=ROUGHNESS)
    cavity = network.cavity()
    genus = int(1 - cavity.mesh.to_trimesh().euler_number // 2)
    paths = tuple(passage.axis for passage in network.passages)
    return DamagedScan(network.scan(), Truth(cavity.mesh, paths, len(cavity.portals), genus))


def network_cases() -> list[Case]:
    """Return forks, loops, a helix, a chamber and all of it in one."""
    d, n = damage, synthetic_networks
    shapes: dict[str, Callable[[], Network]] = {
        "fork": n.fork, "loop": n.loop, "helix": n.helix, "chamber": n.chamber, "combination": n.combination,
    }  # fmt: skip

    def smooth(make: Callable[[], Network]) -> DamagedScan:
        return known(make(), is_rough=False)

    intact = [Case(name, "networks", partial(smooth, make)) for name, make in shapes.items()]

    def rough(name: str, network: Callable[[], Network], step: Callable[[DamagedScan], DamagedScan]) -> Case:
        return Case(name, "networks", lambda: step(known(network())), min_covered=0.6)

    return [
        *intact,
        rough("fork-holes-20x25cm", n.fork, lambda s: d.punch_holes(s, 20, 0.25, 1)),
        rough("fork-torn-1m", n.fork, lambda s: d.tear_ends(s, 1.0, 2)),
        rough("loop-cloud", n.loop, lambda s: d.sample_cloud(s, 0.05, "none", 3)),
        rough("loop-soup-flipped", n.loop, lambda s: d.flip_faces(d.unweld(s, 4, 0.003), 0.5, 4)),
        rough("helix-cloud-normals", n.helix, lambda s: d.sample_cloud(s, 0.05, "true", 5)),
        rough("helix-noise-2cm", n.helix, lambda s: d.add_noise(s, 0.02, 6)),
        rough("chamber-shell-5cm", n.chamber, lambda s: d.duplicate_shell(s, 0.05, 0.5, 7)),
        rough("combination-holes-30x20cm", n.combination, lambda s: d.punch_holes(s, 30, 0.2, 8)),
    ]
