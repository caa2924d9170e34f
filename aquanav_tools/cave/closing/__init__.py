"""From an open surface to a proven cavity with its portals, and to its collision mesh."""
