"""Lists of neighbors: what they hold, and when they are made anew."""
