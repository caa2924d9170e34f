"""Scoring a policy: loading, rollouts, metrics, statistics."""
