"""From the arbitrary frame of structure from motion to the world: metres, z up, each with its uncertainty."""
