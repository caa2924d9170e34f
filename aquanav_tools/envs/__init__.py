"""The benchmark task as a Gymnasium environment."""
