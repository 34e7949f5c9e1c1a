"""Commands of learning, and those that keep what ships of it."""
