"""The scenario folder: its schema, reading, writing and hashing."""
