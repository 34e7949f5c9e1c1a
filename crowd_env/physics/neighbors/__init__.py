"""Lists of neighbors: their content, and when they are rebuilt."""
