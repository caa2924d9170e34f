"""Thousands of vehicles at once, as NVIDIA Warp kernels: one source for processors and for CUDA cards.

Only this package imports warp. Motion, contacts and progress are computed in float64, as beside PyBullet; rays and
observations in float32.
"""
