"""The place: shapely polygons in, arrays of wall and exit segments out."""
