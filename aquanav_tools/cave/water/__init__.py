"""The distance field of the water, and the ways through it."""
