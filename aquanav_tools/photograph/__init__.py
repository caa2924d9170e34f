"""Photos and videos of synthetic caves by lamp light, with everything that is true about them."""
