"""What a boat's full thrust leads to on open, still water; apart from the divers', since caves rest on that alone."""

from __future__ import annotations

import numpy as np

from aquanav_tools.sea.sea_map import Berth
from aquanav_tools.sim.batch.boat_motion import OpenWater
from aquanav_tools.sim.batch.boat_world import state_at_berth
from aquanav_tools.sim.boat import DENSITY, Boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sea_state import SeaState
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.sim.trial import DT
from aquanav_tools.sim.vehicle_base import STATE_SIZE


def boat_speed(boat: Boat | OriginalVehicle) -> float:
    """Return the speed that a boat reaches ahead on still, open water in 60 s, m/s."""
    water, still = SeaWater(SeaState(), 100.0), Berth(np.zeros(2), 0.0)
    begin = state_at_berth(boat, still, water)[:STATE_SIZE]
    return float(OpenWater(boat, DENSITY, DT).voyage(begin, round(60.0 / DT), thrust=1.0)[-1, 7])
