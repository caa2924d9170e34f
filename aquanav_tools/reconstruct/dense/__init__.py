"""Depth and normal of every pixel of a photo, by comparing it with others."""
