"""From a file to a clean, open surface that faces the water."""
