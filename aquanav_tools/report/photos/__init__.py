"""How photos became a cave: drawings for the report of a build."""
