"""Two layers: several polygons fitted to the hulls that the strips of both read."""
