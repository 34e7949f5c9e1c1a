"""A batch of crowds that walk, touch and leave; no rewards, no agents."""
