"""The public functions of aquanav_tools: keywords with defaults in, objects with numbers out. No prose, no printing."""
