"""Benchmarks: fixed sets of caves in tiers, the score of a policy over them, and the leaderboard of scores."""
