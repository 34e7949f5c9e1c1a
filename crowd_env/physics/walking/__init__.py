"""How people walk before they touch: the distance they keep, and how they step aside."""
