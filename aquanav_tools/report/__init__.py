"""Pictures, plots, HTML pages and recordings."""
