"""The centreline graph: junctions, loops, dead ends and chambers."""
