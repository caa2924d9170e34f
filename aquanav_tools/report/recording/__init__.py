"""Rerun recordings: what happened, to look at in 3D and over time. The only importer of rerun."""
