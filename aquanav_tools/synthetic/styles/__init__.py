"""Caves of a style, drawn from a seed: plans of passages and rock, and the surface of their water."""
