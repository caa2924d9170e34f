"""Vehicle, water, sensors and the physics backends."""
