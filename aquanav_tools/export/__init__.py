"""Scenarios as scenes of other simulators: one record of a scene, and one module per format that writes it."""
