"""Plain geometry: triangles, samples of a volume, lines and planes. Nothing here knows what a cave is."""
