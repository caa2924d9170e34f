"""Cave surveys: read (Survex, Therion), adjusted, written, turned into a cave, and held against a scan."""
