"""Pictures and films of vehicles where they are: caves by lamp light, the sea by daylight."""
