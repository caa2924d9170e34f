"""Bays of rocks and reefs for boats: maps, a new one from every seed, and the shortest way through them."""
