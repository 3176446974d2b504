"""Coverage control: robots spread over an area, each to the centroid of its own Voronoi cell."""
