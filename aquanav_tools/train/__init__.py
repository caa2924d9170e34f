"""Learning a policy."""
