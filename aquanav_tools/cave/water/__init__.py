"""The water that flows through a cave, and where the roomiest way leads from everywhere in it."""
