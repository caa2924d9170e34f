"""Tools on triangle meshes that know nothing of caves: topology, crossings, handles, distances, holes."""
