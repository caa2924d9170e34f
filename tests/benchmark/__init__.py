"""Benchmarks and the leaderboard."""
