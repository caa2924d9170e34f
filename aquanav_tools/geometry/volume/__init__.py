"""A closed volume as samples of its clearance, in bricks, and ways from sample to sample."""
