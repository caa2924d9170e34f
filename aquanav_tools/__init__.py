"""Real caves as navigation benchmarks: build them, dive them, score policies in them."""

__version__ = "0.1.0"
