"""The build recipe: from photos, a scan or a synthetic cave to a scenario folder."""
